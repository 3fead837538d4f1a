//! Drags: motions in contact that recipe and rig both name.

use palpate_testing::executions::rig_with_three_axes;
use palpate_testing::{TestFolder, exchanged};

const RECIPE: &str = r#"name = "dragged"
checks = "none"

[[step]]
phase = "calibration"
list = { places_mm = [[0.0, 0.0], [2.0, -2.0]] }
force_n = 1.0
drag = { mm = 0.4, directions_deg = [0, 90, 180, 270] }
"#;

const ALLOWED: &str = "drag = { shear_n = 0.8, slide_mm = 1.0, stiffness_n_mm = 1.5, friction = 1.2 }";

/// A rig that allows drags, with friction in its scene.
fn rig(friction: &str) -> String {
    let rig = rig_with_three_axes();
    let allowed = exchanged(&rig, "force_n = 2.0", &format!("{ALLOWED}\nstiffness_least_n_mm = 1.0\nforce_n = 3.0"));
    format!("{allowed}\n[scene.friction]\n{friction}\n")
}

const STICKS: &str = "sticking = 1.0\nsliding = 0.9\nstiffness_n_mm = 1.0";
const SLIPS: &str = "sticking = 0.3\nsliding = 0.15\nstiffness_n_mm = 1.2";

fn bench(recipe: &str, rig: &str) -> TestFolder {
    TestFolder::with([("dragged.toml", recipe), ("rig.toml", rig)])
}

const RUN: &str = "run dragged.toml --rig rig.toml --simulate --out run";

#[test]
fn a_drag_is_recorded_with_its_forces_and_its_slips() {
    let folder = bench(RECIPE, &rig(STICKS));
    let checked = folder.palpate_ends(0, "check dragged.toml --rig rig.toml").out;
    assert!(
        checked.contains("a drag of 0.4 mm ends with at most 0.730 of 0.8 N sideways,\n  2.308 of 3 N in all"),
        "{checked}"
    );
    folder.palpate_ends(0, RUN);
    let numbers = |column: &str| -> Vec<f64> {
        folder.column("run/presses.csv", column).iter().map(|cell| cell.parse().unwrap()).collect()
    };
    let [way_mm, x_n, y_n, slips] = ["drag_mm", "force_x_n", "force_y_n", "slips"].map(numbers);
    assert_eq!(way_mm, [0.0, 0.4].repeat(8), "each press is sampled before its drag and after it");
    assert!(slips.iter().all(|count| *count == 0.0), "{slips:?}");
    // the tip sticks: 1 N/mm times 0.4 mm, along each direction in turn
    let along = [[0.4, 0.0], [0.0, 0.4], [-0.4, 0.0], [0.0, -0.4]];
    for press in 0..8 {
        let [expected_x, expected_y] = along[press % 4];
        let moved = [x_n[2 * press + 1] - x_n[2 * press], y_n[2 * press + 1] - y_n[2 * press]];
        assert!((moved[0] - expected_x).abs() < 0.01 && (moved[1] - expected_y).abs() < 0.01, "{press}: {moved:?}");
    }
    folder.palpate_ends(0, "verify run");
    let matrix = folder.read("run/calibration_matrix.csv");
    assert_eq!(matrix.lines().next().unwrap().split(',').count(), 8, "a window after a drag is no calibration");

    let slipping = bench(RECIPE, &rig(SLIPS));
    slipping.palpate_ends(0, RUN);
    let slips: Vec<f64> =
        slipping.column("run/presses.csv", "slips").iter().map(|cell| cell.parse().unwrap()).collect();
    assert!(slips.iter().skip(1).step_by(2).all(|count| *count >= 1.0), "{slips:?}");
    let ends = bench(&RECIPE.replace("270] }", "270], slip = \"trip\" }"), &rig(SLIPS));
    assert!(ends.palpate_ends(4, RUN).running().contains("slipped"));
}

#[test]
fn a_drag_ends_at_its_force_sideways() {
    let recipe = exchanged(RECIPE, "mm = 0.4,", "mm = 0.44, shear_n = 0.3, speed_mm_s = 0.3,");
    let folder = bench(&recipe, &rig(STICKS));
    folder.palpate_ends(0, RUN);
    let numbers = |column: &str| -> Vec<f64> {
        folder.column("run/presses.csv", column).iter().map(|cell| cell.parse().unwrap()).collect()
    };
    let [way_mm, x_n, y_n] = ["drag_mm", "force_x_n", "force_y_n"].map(numbers);
    for level in (1..way_mm.len()).step_by(2) {
        let shear_n = x_n[level].hypot(y_n[level]);
        assert!((shear_n - 0.3).abs() < 0.01, "{level}: {shear_n} N after {} mm", way_mm[level]);
        assert!((way_mm[level] - 0.3).abs() < 0.02, "{level}: {} mm at 1 N/mm", way_mm[level]);
    }
    let over = bench(&recipe.replace("shear_n = 0.3", "shear_n = 0.9"), &rig(STICKS)).palpate_ends(2, RUN).err;
    assert!(over.contains("this drag ends at 0.9 N sideways, over the limit of 0.8 N"), "{over}");
}

#[test]
fn swapped_and_mirrored_axes_end_the_run_at_the_first_drag() {
    for axes in ["swapped", "mirrored", "dead x"] {
        let other = format!("noise_n = 0.003, sideways = \"{axes}\" }}");
        let rig = exchanged(&rig(STICKS), "noise_n = 0.003 }", &other);
        let folder = bench(RECIPE, &rig);
        let tripped = folder.palpate_ends(4, RUN).running();
        assert!(tripped.contains("axes-differ"), "{axes}: {tripped}");
        // a dead axis is found by the first drag along the other one
        let rows = if axes == "dead x" { 2 } else { 0 };
        assert_eq!(folder.column("run/presses.csv", "press").len(), rows, "{axes}");
    }
}

#[test]
fn a_drag_needs_three_axes_and_a_rig_that_allows_it() {
    let refused = |recipe: &str, rig: &str| bench(recipe, rig).palpate_ends(2, RUN).err;
    let one_axis = palpate_testing::shipped_text("rigs/sim.toml");
    assert!(refused(RECIPE, &one_axis).contains("the load cell has one axis"));
    assert!(refused(RECIPE, &rig_with_three_axes()).contains("the rig allows no drag"));
    let far = refused(&RECIPE.replace("mm = 0.4", "mm = 0.7"), &rig(STICKS));
    assert!(far.contains("this drag of 0.7 mm can end with 1.185 N sideways, over the limit of 0.8"), "{far}");
    assert!(far.contains("drag at most 0.44 mm; or press with at most 0.15 N"), "{far}");
    let by_depth = refused(&RECIPE.replace("force_n = 1.0", "depth_mm = 0.3"), &rig(STICKS));
    assert!(by_depth.contains("a drag needs a press by force"), "{by_depth}");
}
