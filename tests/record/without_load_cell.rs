//! Runs on a rig without a load cell: depths count from a surface that the array felt, or that a person confirmed.

use palpate_testing::TestFolder;

/// The simulated rig without its load cell.
fn rig() -> String {
    let text = include_str!("../../rigs/sim.toml");
    let (before, cell) = text.split_once("[load_cell]").expect("it has one");
    let after = cell.find("\n[").map_or("", |at| &cell[at..]);
    format!("load_cell = \"none\"\n{before}{after}")
}

const RECIPE: &str = r#"name = "deep"

[[step]]
phase = "calibration"
grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 3.0 }
depth_mm = [0.3, 0.6]

[[step]]
phase = "test"
random = { count = 6, x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], depth_mm = [0.2, 0.6] }
"#;

#[test]
fn array_feels_the_surface_and_presses_go_to_their_depth() {
    let rig = rig();
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run deep.toml --rig rig.toml --simulate --out run");
    let header = bench.read("run/presses.csv");
    assert!(!header.lines().next().unwrap().contains("force"), "{header}");
    let truth = bench.column("run/scene.csv", "depth_peak_mm");
    let set = bench.column("run/presses.csv", "depth_set_mm");
    let number = |text: &String| text.parse::<f64>().unwrap();
    for (truth, set) in truth.iter().map(number).zip(set.iter().map(number)) {
        assert!((truth - set).abs() < 0.05, "{truth} mm in place of {set} mm");
    }
    assert!(bench.column("run/scene.csv", "force_peak_n").iter().map(number).all(|force_n| force_n < 2.0));
    bench.palpate_ends(0, "verify run");
}

#[test]
fn touch_is_confirmed_for_a_sensor_in_a_mounting() {
    let rig = rig();
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    let begun = "run deep.toml --rig rig.toml --simulate --out run --confirmed touch";
    assert!(bench.palpate_ends(2, begun).err.contains("--mounting NAME"));
    bench.palpate_ends(0, &format!("{begun} --sensor A1 --mounting 1"));
    assert!(bench.read("run/journal.jsonl").contains(r#""by":"person""#));
}

#[test]
fn force_is_refused_without_a_load_cell() {
    let (rig, by_force) = (rig(), RECIPE.replace("depth_mm = [0.3, 0.6]", "force_n = 0.5"));
    let bench = TestFolder::with([("force.toml", by_force.as_str()), ("rig.toml", rig.as_str())]);
    let refused = bench.palpate_ends(2, "run force.toml --rig rig.toml --simulate --out run").err;
    assert!(refused.contains("has no load cell"), "{refused}");
}
