//! Files of other programs and the lake, with the feature `files`, read by their own programs.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod export;
mod import;
mod killed;
mod lake;
mod long;
mod over_time;
mod recorded;
mod series;

use palpate_testing::TestFolder;

/// A recipe with every kind of step that takes a tenth of a second: staircases of all units, a grid, random places, a rule.
const RECIPE: &str = r#"
name = "every"
rig = "sim"

[record]
series = "window"

[evaluate]
solvers = ["pearson"]

[accept]
method = "pearson"
location_mean_mm = 5.0

[[step]]
phase = "characterisation"
units = "all"
staircase = { to_n = 1.0, step_n = 0.5, repeats = 2 }

[[step]]
phase = "calibration"
grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 1.5 }
force_n = 1.0

[[step]]
phase = "test"
random = { count = 20, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0], force_n = [0.8, 1.0] }
"#;

/// A folder with complete runs of that recipe, each with its labels.
fn bench<'a>(runs: impl IntoIterator<Item = (&'a str, &'a str)>) -> TestFolder {
    let bench = TestFolder::with([("every.toml", RECIPE)]);
    for (seed, (run, labels)) in runs.into_iter().enumerate() {
        let output = bench.palpate(&format!("run every.toml --out {run} --seed {} {labels}", seed + 1));
        assert!(matches!(output.code, Some(0 | 1)), "{}\n{}", output.out, output.err);
    }
    bench
}
