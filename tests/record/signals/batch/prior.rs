//! A batch with a design's prior: few presses, sensors of another design, and sensors that need more presses.

use super::{events, piped, results};
use palpate_data::acceptance::SensorVerdict;
use palpate_run::batch::{BatchEvent, Ended};
use palpate_testing::{TestFolder, exchanged, shipped_text};

const FULL: &str = r#"
name = "full"

[press]
force_tolerance_n = 0.02
strategy = "map"

[[step]]
phase = "calibration"
grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 1.0 }
force_n = 1.0
"#;

const FEW: &str = r#"
name = "few"

[press]
force_tolerance_n = 0.02
strategy = "map"

[[step]]
phase = "calibration"
cells = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], columns = 3, rows = 3 }
force_n = 1.0

[[step]]
phase = "test"
random = { count = 30, x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], force_n = [0.3, 1.0] }

[accept]
location_mean_mm = 0.4
force_mean_n = 0.06
"#;

const BATCH: &str = r#"
name = "day"
design = "skin"
rig = "rig.toml"
recipes = ["few.toml", "full.toml"]
serials = { prefix = "A-", first = 1, last = 9 }
reference = { serial = "REF", every = 2 }

[prior]
runs = ["full/1", "full/2", "full/3"]
"#;

const LAYER: &str = "elastomer = { depth_mm = 5.0 }";

/// The rig of the batch, with another line for the layer.
fn rig(layer: &str) -> String {
    exchanged(&shipped_text("rigs/batch.toml"), LAYER, layer)
}

fn bench() -> TestFolder {
    let bench = TestFolder::with([
        ("b.toml", BATCH),
        ("few.toml", FEW),
        ("full.toml", FULL),
        ("rig.toml", rig(LAYER).as_str()),
    ]);
    for seed in 1..=3 {
        bench.palpate_ends(0, &format!("run full.toml --rig rig.toml --seed {seed} --out full/{seed}"));
    }
    bench
}

fn result(bench: &TestFolder, serial: &str) -> Ended {
    let all = events(bench, "runs/day");
    (*results(&all, serial).last().expect("a result")).clone()
}

#[test]
fn nine_presses_calibrate_a_sensor_of_the_design_and_others_are_refused_or_get_a_full_grid() {
    let bench = bench();
    let output = bench.palpate_ends(0, "batch check b.toml");
    assert!(output.out.contains("prior of 3 sensors"), "{}", output.out);

    let output = piped(&bench, "batch run b.toml", &["REF", "A-1", "A-2", "REF", "A-3"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    for serial in ["A-1", "A-2", "A-3"] {
        let ended = result(&bench, serial);
        assert_eq!(ended.verdict, Some(SensorVerdict::Accepted), "{ended:?}");
        assert_eq!((ended.runs.len(), ended.calibration_presses, ended.change.len()), (1, 9, 9));
        let model = ended.model.expect("a sensor file");
        assert!(bench.path(&format!("runs/day/{model}")).is_file());
    }
    // `evaluate`, `report` and `certificate` repeat the batch's verdict
    let ended = result(&bench, "A-1");
    let location_mm = ended.found.iter().find(|found| found.figure == "location_mean_mm").and_then(|found| found.value);
    let location = format!("{:.3}", location_mm.expect("a location error"));
    let output = bench.palpate_ends(0, "evaluate runs/day/runs/A-1");
    assert!(output.out.contains("calibrated with the prior of its design"), "{}", output.out);
    assert!(output.out.contains(&location), "{location}: {}", output.out);
    // the half-widths come from the same presses, so these presses don't check them
    assert!(!output.out.contains("half68_mm"), "{}", output.out);
    let output = bench.palpate_ends(0, "report runs/day/runs/A-1");
    assert!(output.out.contains(&format!("accepted, {location} mm")), "{}", output.out);
    assert!(!bench.palpate("evaluate runs/day/runs/A-1 --solver pearson").out.contains("the prior of its design"));
    // the half-widths come from the sensor's own test
    let readings = bench.read("runs/day/runs/A-1/presses.csv");
    let lines: Vec<&str> = readings.lines().collect();
    let output = piped(&bench, "solve --model runs/day/sensors/A-1.palpate --json --quiet", &lines);
    assert_eq!(output.out.matches("\"half68_mm\":0.").count(), lines.len() - 1, "{}", output.out);
    let reference = result(&bench, "REF");
    assert!(reference.verdict.is_none() && reference.model.is_none() && reference.change.len() == 9);

    // from 20 presses on, other ways compete, and these presses give the half-widths, which the test presses check
    bench.write("twenty.toml", &exchanged(FEW, "columns = 3, rows = 3", "columns = 5, rows = 4"));
    bench.write("b20.toml", &exchanged(&exchanged(BATCH, "few.toml", "twenty.toml"), "\"day\"", "\"twenty\""));
    let output = piped(&bench, "batch run b20.toml", &["REF", "A-1"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    // without the taxels' noise, 20 presses show what moved taxels change beside gains and places
    let scene = exchanged(&rig(LAYER), "place_spread_mm = 0.1", "place_spread_mm = 0.2");
    let quiet: Vec<&str> = scene.lines().filter(|line| !line.starts_with("taxel_noise")).collect();
    bench.write("rig.toml", &quiet.join("\n"));
    let output = piped(&bench, "batch run b20.toml", &["A-2"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    let all = events(&bench, "runs/twenty");
    let [keeps, corrects] = ["A-1", "A-2"].map(|serial| *results(&all, serial).last().expect("a result"));
    assert!(keeps.verdict == Some(SensorVerdict::Accepted) && keeps.reasons.is_empty(), "{keeps:?}");
    let reason = corrects.reasons.first().expect("a reason");
    let errors_mm: Vec<f64> = reason.split(" mm").filter_map(|part| part.rsplit(' ').next()?.parse().ok()).collect();
    assert!(reason.starts_with("calibrated with a correction of the prior's map: mean error 0."), "{corrects:?}");
    assert!(errors_mm[0] < 0.98 * errors_mm[1], "a lead that is worth another way: {reason}");
    assert!(bench.palpate("evaluate runs/twenty/runs/A-1").out.contains("location inside stated 68 %"));

    // a layer that is 10 % thicker: the next recipe, which calibrates it without the prior
    bench.write("rig.toml", &rig("elastomer = { depth_mm = 5.5 }"));
    let output = piped(&bench, "batch run b.toml", &["A-4"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    let ended = result(&bench, "A-4");
    assert_eq!((ended.runs.len(), ended.calibration_presses), (2, 178), "{ended:?}");
    assert_eq!(ended.verdict, Some(SensorVerdict::Accepted), "{ended:?}");
    assert!(ended.reasons[0].starts_with("calibrated without the prior: all responses are +"), "{:?}", ended.reasons);

    // another layer, a dead unit, and a weak one
    for (serial, more, reason) in [
        ("A-5", "elastomer = { depth_mm = 6.5 }", "refused: "),
        (
            "A-6",
            "elastomer = { depth_mm = 5.0 }\ntaxel_fault = [{ unit = 3, kind = \"dead\" }]",
            "refused: unit 3 reads nothing",
        ),
        (
            "A-7",
            "elastomer = { depth_mm = 5.0 }\ntaxel_fault = [{ unit = 3, kind = \"drifted\", gain_percent = -70.0 }]",
            "refused: unit 3 reads 0.29 times what the design reads",
        ),
    ] {
        bench.write("rig.toml", &rig(more));
        let output = piped(&bench, "batch run b.toml", &["later", serial]);
        assert_eq!(output.code, Some(0), "{}", output.err);
        let ended = result(&bench, serial);
        assert_eq!(ended.verdict, Some(SensorVerdict::NotAccepted), "{ended:?}");
        assert!(ended.reasons[0].starts_with(reason), "{:?}", ended.reasons);
        assert!(ended.model.is_none() && ended.runs.len() == 1 && ended.refused);
        let output = bench.palpate_ends(1, &format!("evaluate runs/day/runs/{serial}"));
        assert!(output.out.contains("NOT ACCEPTED") && output.out.contains("refused: "), "{}", output.out);
    }
    let alarms = events(&bench, "runs/day").into_iter().filter(|event| matches!(event, BatchEvent::Alarm(_))).count();
    println!("{alarms} alarms");
}

#[test]
fn a_prior_needs_full_calibrations_of_some_sensors() {
    let bench = TestFolder::with([("few.toml", FEW), ("full.toml", FULL), ("rig.toml", rig(LAYER).as_str())]);
    bench.write("b.toml", &BATCH.replace(", \"full/2\", \"full/3\"", ""));
    let output = bench.palpate_ends(2, "batch check b.toml");
    assert!(output.err.contains("`runs` names 1 run folders, expected 3 to 100"), "{}", output.err);
    bench.write("b.toml", BATCH);
    let output = bench.palpate_ends(2, "batch check b.toml");
    assert!(output.err.contains("`prior.runs` names full/1, but full/1 is not a folder"), "{}", output.err);
    bench.palpate_ends(0, "run full.toml --rig rig.toml --seed 1 --out full/1");
    bench.write("b.toml", &BATCH.replace("\"full/2\", \"full/3\"", "\"full/1\", \"full/1\""));
    let output = bench.palpate_ends(2, "batch check b.toml");
    assert!(output.err.contains("names the sensor of full/1 twice"), "{}", output.err);
    bench.palpate_ends(0, "run full.toml --rig rig.toml --seed 1 --out full/2");
    bench.palpate_ends(0, "run full.toml --rig rig.toml --seed 1 --out full/3");
    bench.write("b.toml", BATCH);
    let output = bench.palpate_ends(2, "batch check b.toml");
    assert!(output.err.contains("twice") || output.err.contains("don't differ"), "{}", output.err);
}
