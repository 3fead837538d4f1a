//! A run with drags on a load cell of three axes: `evaluate --vector` solves its places and force vectors.

use palpate_testing::executions::rig_with_three_axes;
use palpate_testing::{TestFolder, campaign, exchanged};

/// Places along each side of the calibration.
const SIDE: (usize, usize) = (5, 25);
const TESTS: (usize, usize) = (20, 500);

/// A rig whose taxels feel the force along the surface, on a specimen on which the tip sticks.
fn rig() -> String {
    let rig = rig_with_three_axes();
    let allowed = "drag = { shear_n = 0.9, slide_mm = 1.0, stiffness_n_mm = 1.2, friction = 1.2 }";
    let rig = exchanged(&rig, "force_n = 2.0", &format!("{allowed}\nforce_n = 2.0"));
    let rig = exchanged(
        &rig,
        "grid = { rows = 3, columns = 3, pitch_mm = 4.5 }",
        "grid = { rows = 3, columns = 3, pitch_mm = 4.5 }\nchannels_per_unit = 3",
    );
    let rig = exchanged(&rig, "{ modbus = \"labjack-t7\" }", "{ daqmx = \"Dev1/ai0:26\" }");
    let rig =
        exchanged(&rig, "elastomer = { depth_mm = 5.0 }", "elastomer = { depth_mm = 5.0 }\ntaxels = { shear = true }");
    format!("{rig}\n[scene.friction]\nsticking = 1.0\nsliding = 0.9\nstiffness_n_mm = 1.0\n")
}

fn recipe(side: usize, tests: usize) -> String {
    let spacing = 10.0 / (side - 1) as f64;
    format!(
        "name = \"vectors\"\nchecks = \"none\"\n[press]\nhold_s = 0.0\n\n[[step]]\nphase = \"calibration\"\n\
         grid = {{ x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0], spacing_mm = {spacing} }}\nforce_n = 1.0\n\
         drag = {{ mm = 0.45, shear_n = 0.4, directions_deg = [0, 90, 180, 270] }}\n\n[[step]]\nphase = \"test\"\n\
         random = {{ count = {tests}, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0] }}\nforce_n = 1.0\n\
         drag = {{ mm = 0.4, shear_n = 0.3, directions_deg = [45] }}\n"
    )
}

#[test]
fn a_run_with_drags_gives_places_and_force_vectors() {
    let (side, tests) = (campaign::size(SIDE.0, SIDE.1), campaign::size(TESTS.0, TESTS.1));
    let (rig, recipe) = (rig(), recipe(side, tests));
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("vectors.toml", recipe.as_str())]);
    bench.palpate_ends(0, "run vectors.toml --rig rig.toml --simulate --out run --evaluate recipe");
    let out = bench.palpate_ends(0, "evaluate run --vector").out;
    println!("{side} x {side} places\n{out}");
    assert!(out.lines().all(|line| line.chars().count() <= 80), "{out}");
    let errors: serde_json::Value =
        serde_json::from_str(&bench.palpate_ends(0, "evaluate run --vector --json").out).unwrap();
    let number = |key: &str, at: usize| errors[key][at].as_f64().unwrap();
    // before the drag and after it
    assert_eq!((errors["presses"].as_u64(), errors["unsolved"].as_u64()), (Some(2 * tests as u64), Some(0)));
    let is_whole = side == SIDE.1;
    let most = if is_whole { [0.06, 0.012, 0.045] } else { [0.2, 0.05, 0.16] };
    for (key, most) in ["location_mm", "press_n", "shear_n"].into_iter().zip(most) {
        assert!(number(key, 0) <= most, "{key}: {errors}");
    }
    for component in errors["within"].as_array().unwrap().iter().filter(|_| is_whole) {
        let [in_68, in_95] = [0, 1].map(|level| component[level].as_f64().unwrap());
        assert!((0.60..=0.78).contains(&in_68) && (0.92..=0.985).contains(&in_95), "{errors}");
    }
    // the presses alone are solved as on a rig with one axis
    bench.palpate_ends(0, "evaluate run --solver surrogate");
}

#[test]
fn a_run_without_forces_sideways_is_refused() {
    let bench = TestFolder::with([("small.toml", palpate_testing::SMALL)]);
    bench.palpate_ends(0, "run small.toml --rig sim --out run --evaluate recipe");
    let refused = bench.palpate_ends(2, "evaluate run --vector");
    assert!(refused.err.contains("no press of the calibration has three"), "{}", refused.err);
}
