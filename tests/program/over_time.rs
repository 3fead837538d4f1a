//! A run in a scene with every effect over time.

use palpate_testing::{SMALL, TestFolder, exchanged, shipped_text};

const TERMS: &str = r#"
taxel_lag_s = 0.05
taxel_creep = [{ share = 0.2, time_s = 1.0 }, { share = 0.1, time_s = 30.0 }]
wear = { gain_per_press = -1e-4, zero_per_press = 1e-5 }
temperature.mean_c = 23.0
temperature.amplitude_c = 2.0
temperature.period_s = 600.0
temperature.drift_c_h = 0.5
temperature.reference_c = 20.0
temperature.taxel_zero_per_c = 0.001
temperature.taxel_gain_per_c = -0.002
temperature.load_cell_zero_n_per_c = 0.002
temperature.load_cell_gain_per_c = 0.0005
"#;

#[test]
fn a_run_whose_skin_creeps_wears_and_warms_up_can_be_repeated() {
    let rig = shipped_text("rigs/sim.toml") + TERMS;
    let held = exchanged(SMALL, "[press]", "[press]\nhold_s = 5.0");
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("r.toml", SMALL), ("held.toml", held.as_str())]);
    for run in ["r.toml --out plain", "r.toml --rig rig.toml --out run", "r.toml --rig rig.toml --out again"] {
        bench.palpate_ends(0, &format!("run {run}"));
    }
    bench.palpate_ends(0, "run held.toml --rig rig.toml --out held");
    assert_eq!(bench.read("run/presses.csv"), bench.read("again/presses.csv"));
    let loaded = |run| bench.column(&format!("{run}/presses.csv"), "out_5")[1].parse::<f64>().expect("a reading");
    let [plain, short, long] = ["plain", "run", "held"].map(loaded);
    assert!(plain * 1.03 < short && short * 1.05 < long, "the output grows: {plain} {short} {long}");
}
