//! Presses by depth: the record has the set depth and the depth reached, and the run is resumed, verified and evaluated like others.

use palpate_testing::interrupted::cut_to_lines;
use palpate_testing::{TestFolder, shipped_text};

/// A grid, random places, and three depths at each place of a list.
const RECIPE: &str = r#"name = "deep"
rig = "sim"

[[step]]
phase = "calibration"
grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 4.0 }
depth_mm = 0.6

[[step]]
phase = "calibration"
list = { places_mm = [[0.0, 0.0], [3.0, -3.0]] }
depth_mm = [0.2, 0.4, 0.8]

[[step]]
phase = "test"
random = { count = 4, x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], depth_mm = [0.1, 0.6] }
"#;

/// Largest difference between the reached and the set depth, mm.
const REACHED_WITHIN_MM: f64 = 0.02;

#[test]
fn presses_by_depth_reach_their_depth_and_are_recorded() {
    let bench = TestFolder::with([("deep.toml", RECIPE)]);
    bench.palpate_ends(0, "run deep.toml --out run");
    let column = |name| bench.column("run/presses.csv", name);
    let (set, depth, force) = (column("depth_set_mm"), column("depth_mm"), column("force_n"));
    assert_eq!(set.len(), 16 + 6 + 4);
    assert_eq!(set[16..22], ["0.2", "0.4", "0.8", "0.2", "0.4", "0.8"]);
    assert!(column("force_set_n").iter().all(String::is_empty));
    assert!(column("flags").iter().all(String::is_empty), "{:?}", column("flags"));
    let number = |text: &String| text.parse::<f64>().unwrap();
    for (set, depth) in set.iter().map(number).zip(depth.iter().map(number)) {
        assert!((set - depth).abs() < REACHED_WITHIN_MM, "{depth} mm in place of {set} mm");
    }
    assert!(force.iter().map(number).all(|force_n| (0.05..2.0).contains(&force_n)), "{force:?}");
    assert!(column("u_depth_mm").iter().all(String::is_empty), "nothing states the errors of stage and cell");
    bench.palpate_ends(0, "verify run");
    bench.palpate_ends(0, "rebuild run");
    bench.palpate_ends(0, "verify run");
    let evaluated = bench.palpate_ends(0, "evaluate run --solver surrogate --json").json_lines();
    assert!(evaluated[0]["location_error_mm"]["mean"].as_f64().unwrap() < 1.0, "{}", evaluated[0]);
}

#[test]
fn run_by_depth_that_was_cut_is_resumed_with_the_same_rows() {
    let bench = TestFolder::with([("deep.toml", RECIPE)]);
    bench.palpate_ends(0, "run deep.toml --out whole");
    bench.palpate_ends(0, "run deep.toml --out cut");
    cut_to_lines(&bench, "cut", 25);
    bench.palpate_ends(0, "resume cut");
    let depths = |run: &str| bench.column(&format!("{run}/presses.csv"), "depth_set_mm");
    assert_eq!(depths("cut"), depths("whole"));
    bench.palpate_ends(0, "verify cut");
}

#[test]
fn depth_beyond_the_limit_or_in_a_characterisation_is_refused_at_its_line() {
    let deep = RECIPE.replace("depth_mm = 0.6", "depth_mm = 1.6");
    let staircase = RECIPE.replacen("phase = \"calibration\"", "phase = \"characterisation\"", 1);
    let both = RECIPE.replace("depth_mm = 0.6", "depth_mm = 0.6\nforce_n = 1.0");
    for (text, expected) in [
        (deep, "this step presses 1.6 mm deep, over the 1.57 mm that the specimen's depth limit of 1.6 mm leaves"),
        (staircase, "a characterisation needs forces"),
        (both, "this step has more than one force or depth"),
    ] {
        let bench = TestFolder::with([("deep.toml", text.as_str())]);
        let output = bench.palpate_ends(2, "check deep.toml");
        assert!(output.running().contains(expected), "{}", output.err);
    }
}

#[test]
fn depth_has_an_uncertainty_where_stage_and_load_cell_state_theirs() {
    let rig = shipped_text("rigs/sim.toml").replacen(
        "[load_cell]\n",
        "certificate = { number = \"S-1\", date = \"2026-05-04\", u_mm = 0.004 }\n\n[load_cell]\nstiffness_n_mm = 100.0\n",
        1,
    );
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", &rig)]);
    bench.palpate_ends(0, "run deep.toml --rig rig.toml --out run");
    let number = |text: &String| text.parse::<f64>().unwrap();
    let column = |name| bench.column("run/presses.csv", name).iter().map(number).collect::<Vec<_>>();
    for (force_n, u_mm) in column("force_n").into_iter().zip(column("u_depth_mm")) {
        // touch 10 um, stage 2 um, deflection of the cell evenly from 0 to its whole
        let expected_mm = (0.010f64.powi(2) + 0.002f64.powi(2) + (force_n / 100.0).powi(2) / 3.0).sqrt();
        assert!((u_mm - expected_mm).abs() < 2e-5, "{u_mm} in place of {expected_mm} mm");
    }
}
