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

/// A cell whose axes read 3 % of each other's force: `doctor` measures it along each axis, and each axis' uncertainty contains it.
#[test]
fn crosstalk_is_measured_and_enters_the_uncertainty_of_each_axis() {
    let rig = exchanged(&rig_with_three_axes(), "noise_n = 0.003", "noise_n = 0.003, crosstalk_percent = 3.0");
    let bench = TestFolder::with([("sideways.toml", RECIPE), ("rig.toml", rig.as_str())]);
    let doctor = "doctor rig.toml --check-weight-n 0.5 --check-weight-u-n 0.0005";
    let output = bench.palpate_ends(0, &format!("{doctor} --three-axes"));
    assert!(
        output.err.contains("let the weight pull the tip toward +y of the specimen (0.5 N, 3 of 3)"),
        "{}",
        output.err
    );
    assert!(output.out.contains("largest crosstalk +3.0") && output.out.contains("over 2 %:"), "{}", output.out);
    assert!(output.out.ends_with("written: `axes_check` of [load_cell] in rig.toml\n"), "{}", output.out);
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
    bench.palpate_ends(0, "run sideways.toml --rig rig.toml --simulate --out run");
    let numbers = |column: &str| -> Vec<f64> {
        bench.column("run/presses.csv", column).iter().map(|cell| cell.parse().unwrap()).collect()
    };
    let forces_n = numbers("force_n");
    for (side_n, u_n) in
        [("force_x_n", "u_force_x_n"), ("force_y_n", "u_force_y_n")].map(|(n, u)| (numbers(n), numbers(u)))
    {
        for ((side_n, u_n), force_n) in side_n.iter().zip(&u_n).zip(&forces_n) {
            assert!((side_n - 0.03 * force_n).abs() < 0.004 && (u_n - 0.03 * force_n).abs() < 0.002, "{side_n} {u_n}");
        }
    }
    let one_axis = TestFolder::with([("rig.toml", palpate_testing::shipped_text("rigs/sim.toml").as_str())]);
    let refused = one_axis.palpate_ends(2, &format!("{doctor} --three-axes"));
    assert!(refused.err.contains("--three-axes: the load cell has one axis"), "{}", refused.err);
}

#[test]
fn a_mirrored_axis_is_found_by_a_weight_along_it_and_nothing_is_written() {
    let rig = exchanged(&rig_with_three_axes(), "noise_n = 0.003", "noise_n = 0.003, sideways = \"mirrored\"");
    let bench = TestFolder::with([("rig.toml", rig.as_str())]);
    let output = bench.palpate_ends(4, "doctor rig.toml --check-weight-n 0.5 --check-weight-u-n 0.0005 --three-axes");
    assert!(output.err.contains("a force of 1 N along x reads -1.0"), "{}", output.err);
    assert!(output.err.lines().all(|line| line.chars().count() <= 80), "{}", output.err);
    assert!(!bench.read("rig.toml").contains("axes_check"));
}

/// Presses at one place have the characteristics of a run, not a regression of their forces.
#[test]
fn a_run_at_one_place_is_evaluated_as_a_run() {
    let recipe = "name = \"staircase\"\n[[step]]\nphase = \"characterisation\"\nlist = { places_mm = [[0.0, 0.0]] }\n\
                  staircase = { to_n = 1.0, step_n = 0.25, repeats = 4, rest_s = 0.0 }\n";
    let bench = TestFolder::with([("one.toml", recipe), ("rig.toml", rig_with_three_axes().as_str())]);
    bench.palpate_ends(0, "run one.toml --rig rig.toml --simulate --out run --evaluate recipe");
    let out = bench.palpate_ends(0, "evaluate run").out;
    assert!(!out.contains("force vector"), "{out}");
}
