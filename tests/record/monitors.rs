//! Monitors: their values are recorded beside each press, the next press waits for their bounds, and the temperature widens the uncertainty.

use palpate_core::quantity::Place;
use palpate_data::dataset::{Recorded, WarmedQuantity, warmed};
use palpate_solver::over_time::temperature_coefficient;
use palpate_testing::{TestFolder, campaign, exchanged, shipped_text};

const RECIPE: &str = r#"name = "monitored"

[[step]]
phase = "calibration"
list = { places_mm = [[0.0, 0.0], [3.0, -3.0], [-3.0, 1.0], [2.0, 2.0], [-1.0, -4.0],
    [4.0, 0.0], [0.0, 4.0]] }
force_n = 1.0
"#;

/// Temperature when the rig is opened, and its drift: 0.1 degrees in 6 s.
const MEAN_C: f64 = 23.0;
const DRIFT_C_H: f64 = 60.0;

/// Tables of a run that aren't views of its presses' monitors.
const OTHERS: [&str; 2] = ["presses.csv", "scene.csv"];

/// The simulated rig with a drift and these monitors; more keys of `[load_cell]`.
fn rig(monitors: &str, cell: &str) -> String {
    let scene = format!("[scene]\ntemperature = {{ mean_c = {MEAN_C}, drift_c_h = {DRIFT_C_H} }}");
    let rig = exchanged(&shipped_text("rigs/sim.toml"), "[scene]", &format!("{monitors}\n{scene}"));
    exchanged(&rig, "[array]", &format!("{cell}\n\n[array]"))
}

fn monitor(name: &str, driver: &str, more: &str) -> String {
    format!("[[monitor]]\nname = \"{name}\"\ndriver = {{ {driver} }}\nlink = \"sim\"\n{more}\n")
}

fn numbers(bench: &TestFolder, table: &str, column: &str) -> Vec<f64> {
    bench.column(table, column).iter().map(|cell| cell.parse().unwrap()).collect()
}

#[test]
fn values_beside_the_presses_are_those_of_the_scene_on_every_wire() {
    let monitors = monitor("temperature_c", "process = [\"thermometer\"]", "every_s = 0.1")
        + &monitor("board_c", "lines = \"one-number\"", "bounds = [-5, 6]")
        + &monitor("supply_v", "modbus = \"labjack-t7\"", "scale = 2.0\noffset = 1.0\nbounds = [11, 13]")
        + &monitor("strain_percent", "daqmx = \"Dev2/ai0\"", "scale = -3.0");
    let bench = TestFolder::with([("r.toml", RECIPE), ("rig.toml", rig(&monitors, "").as_str())]);
    let output = bench.palpate_ends(0, "run r.toml --rig rig.toml --seed 3 --out run");
    assert!(output.err.contains("\nmonitor temperature_c emulated array, serial number 1\n"), "{}", output.err);
    let lines = bench.read("run/monitors.csv");
    assert!(lines.starts_with("press,name,t_s,value\n0,temperature_c,"), "{lines}");
    let rows = bench.column("run/monitors.csv", "name").into_iter().zip(numbers(&bench, "run/monitors.csv", "t_s"));
    let (mut known_s, mut count) = (0.0, 0);
    for ((name, t_s), value) in rows.zip(numbers(&bench, "run/monitors.csv", "value")) {
        let expected = match name.as_str() {
            // the answer takes a millisecond
            "temperature_c" => MEAN_C + DRIFT_C_H * t_s / 3600.0,
            "board_c" => 0.5,
            "supply_v" => 12.0,
            _ => 0.0,
        };
        assert!((value - expected).abs() < 1e-4, "{name} at {t_s}: {value}, not {expected}");
        count += 1;
        if name == "temperature_c" {
            assert!(t_s > known_s, "it is read before every press: {t_s}");
            known_s = t_s;
        }
    }
    assert_eq!(count, 7 * 4);
    bench.palpate_ends(0, "run r.toml --rig rig.toml --seed 3 --out again");
    for table in OTHERS.into_iter().chain(["monitors.csv"]) {
        assert_eq!(bench.read(&format!("run/{table}")), bench.read(&format!("again/{table}")), "{table}");
    }
    bench.palpate_ends(0, "report run");
    let page = bench.read("run/report.html");
    assert!(page.contains("Monitor temperature_c") && page.contains("Monitor supply_v"));
    bench.palpate_ends(0, "export run --format csv --out exported");
    assert_eq!(numbers(&bench, "exported/monitors.csv", "value"), numbers(&bench, "run/monitors.csv", "value"));
}

#[test]
fn table_of_the_monitors_is_a_view_of_the_journal() {
    let monitors = monitor("temperature_c", "process = [\"thermometer\"]", "");
    let bench = TestFolder::with([("r.toml", RECIPE), ("rig.toml", rig(&monitors, "").as_str())]);
    bench.palpate_ends(0, "run r.toml --rig rig.toml --out run");
    let table = bench.read("run/monitors.csv");
    bench.write("run/monitors.csv", &table.replace("temperature", "humidity"));
    let output = bench.palpate_ends(1, "verify run");
    assert!(output.err.contains("monitors.csv"), "{}", output.err);
    bench.palpate_ends(0, "rebuild run");
    assert_eq!(bench.read("run/monitors.csv"), table);
    bench.palpate_ends(0, "verify run");
}

#[test]
fn presses_are_those_of_a_run_without_monitors_but_a_moment_later() {
    let monitors = monitor("temperature_c", "lines = \"one-number\"", "every_s = 0.1");
    let (with, without) = (rig(&monitors, ""), rig("", ""));
    let bench =
        TestFolder::with([("r.toml", RECIPE), ("with.toml", with.as_str()), ("without.toml", without.as_str())]);
    for name in ["with", "without"] {
        bench.palpate_ends(0, &format!("run r.toml --rig {name}.toml --seed 3 --out {name}"));
    }
    let (header, journal) = (bench.read("without/presses.csv"), bench.read("without/journal.log"));
    let header = header.lines().next().unwrap();
    assert!(!journal.contains("\"monitors\"") && bench.read("with/journal.log").contains("\"monitors\""));
    bench.palpate_ends(0, "report without");
    assert!(!bench.read("without/report.html").contains("Monitor"));
    for column in header.split(',').filter(|column| *column != "t_s") {
        let [with, without] = ["with", "without"].map(|run| bench.column(&format!("{run}/presses.csv"), column));
        assert_eq!(with, without, "{column}");
    }
    let [with, without] = ["with", "without"].map(|run| numbers(&bench, &format!("{run}/presses.csv"), "t_s"));
    assert!(with.iter().zip(&without).all(|(with, without)| (0.0..5.0).contains(&(with - without))), "{with:?}");
}

#[test]
fn a_press_waits_for_the_bounds_then_the_run_stops_and_resume_continues() {
    let bounds = |most_c: f64| format!("bounds = [18.0, {most_c}]\nevery_s = 2.0\nwait_s = 5.0");
    let monitors = |more: &str| monitor("temperature_c", "process = [\"thermometer\"]", more);
    let rig = rig(&monitors(&bounds(23.8)), "");
    let bench = TestFolder::with([("r.toml", RECIPE), ("rig.toml", rig.as_str())]);
    let output = bench.palpate_ends(130, "run r.toml --rig rig.toml --seed 3 --out run");
    let begin = output.err.find("temperature_c is 23.8").unwrap_or_else(|| panic!("{}", output.err));
    let (first, rest) = output.err[begin..].split_once('\n').unwrap();
    assert!(first.ends_with(", outside 18 to 23.8: waiting at most 5 s"), "{first}");
    assert!(
        rest.contains("the stage is parked") && rest.contains(", outside 18 to 23.8 after a wait of 5 s"),
        "{rest}"
    );
    assert!(rest.contains("help: bring the value within its bounds, then continue with `palpate resume`"), "{rest}");
    assert_eq!(rest.matches("waiting").count(), 0, "a person is informed once");
    let made = bench.column("run/presses.csv", "press").len();
    assert!((1..7).contains(&made), "{made}");
    assert!(numbers(&bench, "run/monitors.csv", "value").iter().all(|value| *value <= 23.8));
    let manifest = bench.read("run/manifest.json");
    assert!(manifest.contains("\"status\": \"stopped\"") && manifest.contains("\"failure\": \"temperature_c is"));
    // the rig is opened again, at its first temperature
    bench.palpate_ends(0, "resume run");
    assert_eq!(bench.column("run/presses.csv", "press"), ["0", "1", "2", "3", "4", "5", "6"]);
    bench.palpate_ends(0, "verify run");
}

#[test]
fn a_value_that_comes_back_in_time_only_delays_the_press() {
    let more = "bounds = [23.4, 40.0]\nevery_s = 3.0\nwait_s = 60.0";
    let rig = rig(&monitor("temperature_c", "process = [\"thermometer\"]", more), "");
    let bench = TestFolder::with([("r.toml", RECIPE), ("rig.toml", rig.as_str())]);
    let output = bench.palpate_ends(0, "run r.toml --rig rig.toml --seed 3 --out run");
    assert!(output.err.contains(", outside 23.4 to 40: waiting at most 60 s"), "{}", output.err);
    assert!(numbers(&bench, "run/monitors.csv", "t_s")[0] > 24.0, "0.4 degrees at 60 degrees an hour");
}

#[test]
fn the_temperature_widens_the_uncertainty_as_the_certificate_states() {
    let certificate =
        |more: &str| format!("certificate = {{ number = \"K-7\", date = \"2026-05-04\", u_percent = 0.2{more} }}");
    let effect = certificate(", temperature_percent_per_c = 0.1, calibrated_at_c = 13.0");
    let thermometer = monitor("temperature_c", "process = [\"thermometer\"]", "");
    let rigs = [("plain", &thermometer, certificate("")), ("warm", &thermometer, effect.clone())]
        .map(|(name, monitors, cell)| (name, rig(monitors, &cell)));
    let bench = TestFolder::with([("r.toml", RECIPE)]);
    for (name, rig) in &rigs {
        bench.write(&format!("{name}.toml"), rig);
        bench.palpate_ends(0, &format!("run r.toml --rig {name}.toml --seed 3 --out {name}"));
    }
    let values = |run: &str, column: &str| numbers(&bench, &format!("{run}/presses.csv"), column);
    let temperatures_c = numbers(&bench, "warm/monitors.csv", "value");
    let plain = values("plain", "u_force_n").into_iter().zip(values("warm", "u_force_n"));
    for (((plain_n, warm_n), force_n), warm_c) in plain.zip(values("warm", "force_n")).zip(temperatures_c) {
        let term_n = 0.001 * (warm_c - 13.0) * force_n / 3f64.sqrt();
        assert!(term_n > 0.005 && (warm_n - plain_n.hypot(term_n)).abs() < 3e-6, "{plain_n} {warm_n} {term_n}");
    }
    assert!(bench.read("warm/journal.log").contains("\"temperature_n\":"));
    assert!(!bench.read("plain/journal.log").contains("\"temperature_n\":"));
    // without a thermometer the term isn't there, and the check of the plan says so
    bench.write("blind.toml", &rig(&monitor("board_c", "lines = \"one-number\"", ""), &effect));
    let warning = "`temperature_percent_per_c` of the load cell isn't in `u_force_n`: no [[monitor]]";
    let checked = |rig: &str| bench.palpate_ends(0, &format!("check r.toml --rig {rig}.toml")).err;
    let joined = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(joined(checked("blind")).contains(warning), "{}", checked("blind"));
    assert!(!joined(checked("warm")).contains(warning) && !joined(checked("plain")).contains(warning));
}

#[test]
fn coefficients_of_zeros_and_gains_are_those_of_the_scene() {
    const ZERO: f64 = 0.002;
    const GAIN: f64 = -0.004;
    const CELL_N: f64 = 0.004;
    let thermometer = monitor("temperature_c", "process = [\"thermometer\"]", "every_s = 1.0");
    let scene = format!(
        "{thermometer}\n[scene]\ntemperature = {{ mean_c = 23.0, amplitude_c = 3.0, period_s = 500.0, taxel_zero_per_c = {ZERO}, \
         taxel_gain_per_c = {GAIN}, load_cell_zero_n_per_c = {CELL_N} }}"
    );
    let rig = exchanged(&shipped_text("rigs/sim.toml"), "[scene]", &scene);
    let presses = campaign::size(150, 1500);
    let recipe = format!(
        "name = \"r\"\nchecks = \"none\"\n[[step]]\nphase = \"cycles\"\nlist = {{ places_mm = [[0, 0]] }}\nforce_n = 1.0\n\
         cycles = {{ presses = {presses}, reference_every = 10, reference_mm = [[4, 4]] }}\n"
    );
    let bench = TestFolder::with([("r.toml", recipe.as_str()), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run r.toml --rig rig.toml --out run");
    let mut seen = 0;
    for found in warmed(&Recorded::read(&bench.path("run")).unwrap()) {
        let truth = match found.quantity {
            WarmedQuantity::ForceZero => CELL_N,
            WarmedQuantity::OutputZero(_) => ZERO,
            WarmedQuantity::LogGain(_) => GAIN,
        };
        let coefficient = temperature_coefficient(&found.points).unwrap();
        let [from, to] = coefficient.per_c.interval;
        let (value, half) = (coefficient.per_c.value, (to - from) / 2.0);
        println!("{:?}: {value:.6} ({from:.6} to {to:.6}), true {truth}", found.quantity);
        assert!((value - truth).abs() < (0.05 * truth.abs()).max(2.0 * half), "{:?}: {value}", found.quantity);
        // few presses at the reference place, where the outputs are small
        let is_faint = found.quantity == WarmedQuantity::LogGain(Place::new(4.0, 4.0));
        assert!(is_faint || half < 0.5 * truth.abs(), "{:?}: {from} to {to}", found.quantity);
        seen += 1;
    }
    assert_eq!(seen, 1 + 9 + 2);
    bench.palpate_ends(0, "report run");
    assert!(bench.read("run/report.html").contains("zero of output 9"));
}

#[test]
fn doctor_reads_the_monitors() {
    let monitors = monitor("temperature_c", "lines = \"one-number\"", "bounds = [30.0, 40.0]");
    let bench = TestFolder::with([("rig.toml", rig(&monitors, "").as_str())]);
    let output = bench.palpate_ends(0, "doctor rig.toml");
    assert!(output.out.contains("\nmonitor    temperature_c is 23.0"), "{}", output.out);
    let advice = "is outside its `bounds`: a run would wait";
    assert!(output.out.split_whitespace().collect::<Vec<_>>().join(" ").contains(advice), "{}", output.out);
}
