//! Runs on a rig whose load cell has three axes: the forces sideways are recorded, and the limit is one of the whole force.

use palpate_testing::executions::rig_with_three_axes;
use palpate_testing::{TestFolder, exchanged};

const RECIPE: &str = r#"name = "sideways"

[[step]]
phase = "calibration"
list = { places_mm = [[0.0, 0.0], [3.0, -3.0]] }
force_n = 1.0
"#;

/// Slopes of the surface along x and y.
const SLOPES: [f64; 2] = [0.05, -0.03];

/// A rig with a cell of three axes on a tilted surface.
fn rig() -> String {
    let [x, y] = SLOPES;
    let tilted = format!("{}\n[scene.surface]\ntilt_mm_per_mm = {{ x = {x}, y = {y} }}\n", rig_with_three_axes());
    exchanged(&tilted, "down = \"-z\"", &format!("down = \"-z\"\ntilt_mm_per_mm = {{ x = {x}, y = {y} }}"))
}

#[test]
fn forces_sideways_of_a_tilted_surface_are_recorded() {
    let rig = rig();
    let bench = TestFolder::with([("sideways.toml", RECIPE), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run sideways.toml --rig rig.toml --simulate --out run");
    let numbers = |column: &str| -> Vec<f64> {
        bench.column("run/presses.csv", column).iter().map(|cell| cell.parse().unwrap()).collect()
    };
    let along_z = numbers("force_n"); // along the normal, which is along z within 0.2 %
    for (column, slope) in ["force_x_n", "force_y_n"].iter().zip(SLOPES) {
        for (side_n, force_n) in numbers(column).iter().zip(&along_z) {
            assert!((side_n + slope * force_n).abs() < 0.005, "{column}: {side_n} N at {force_n} N");
        }
    }
    bench.palpate_ends(0, "verify run");
    let header = bench.read("run/presses.csv").lines().next().unwrap().to_owned();
    assert!(header.contains(",u_force_n,force_x_n,force_y_n,"), "{header}");
    bench.palpate_ends(0, "export run --format csv --out exported");
}

#[test]
fn one_axis_has_no_columns_of_forces_sideways() {
    let bench = TestFolder::with([("sideways.toml", RECIPE)]);
    bench.palpate_ends(0, "run sideways.toml --rig sim --out run");
    let (header, journal) = (bench.read("run/presses.csv"), bench.read("run/journal.log"));
    assert!(!header.contains("force_x_n") && !journal.contains("force_x_n") && !journal.contains("side_mean_n"));
}
