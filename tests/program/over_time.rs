//! A run in a scene with every effect over time.

use palpate_testing::{SMALL, TestFolder, shipped_text};

const TERMS: &str = r#"
taxel_lag_s = 0.05

[[scene.taxel_creep]]
share = 0.2
time_s = 1.0

[[scene.taxel_creep]]
share = 0.1
time_s = 30.0

[scene.wear]
gain_per_press = -1e-4
zero_per_press = 1e-5

[scene.temperature]
mean_c = 23.0
amplitude_c = 2.0
period_s = 600.0
drift_c_h = 0.5
reference_c = 20.0
taxel_zero_per_c = 0.001
taxel_gain_per_c = -0.002
load_cell_zero_n_per_c = 0.002
load_cell_gain_per_c = 0.0005
"#;

#[test]
fn a_run_whose_skin_creeps_wears_and_warms_up_can_be_repeated() {
    let rig = shipped_text("rigs/sim.toml") + TERMS;
    let held = SMALL.replace("force_tolerance_n = 0.05", "force_tolerance_n = 0.05\nhold_s = 5.0");
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("r.toml", SMALL), ("held.toml", held.as_str())]);
    for (run, command) in [
        ("plain", "run r.toml --out plain"),
        ("run", "run r.toml --rig rig.toml --out run"),
        ("again", "run r.toml --rig rig.toml --out again"),
        ("held", "run held.toml --rig rig.toml --out held"),
    ] {
        bench.palpate_ends(0, command);
        assert_eq!(bench.manifest(run)["status"], "complete");
    }
    assert_eq!(bench.read("run/presses.csv"), bench.read("again/presses.csv"));
    let first_loaded =
        |run: &str| bench.column(&format!("{run}/presses.csv"), "out_5")[1].parse::<f64>().expect("a reading");
    let [plain, short, long] = ["plain", "run", "held"].map(first_loaded);
    assert!(plain * 1.03 < short && short * 1.05 < long, "the output grows: {plain} {short} {long}");
}
