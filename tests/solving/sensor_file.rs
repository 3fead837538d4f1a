//! `palpate fit` and `palpate solve --model`: a calibrated sensor as a file.

use palpate_solver::{Calibration, CalibrationPoint, Model, SOLVERS, Session, Setting};
use palpate_testing::{CommandOutput, TestFolder};
use serde_json::Value;
use std::fs::{self, File};
use std::path::Path;

/// A calibration of 49 presses on four units, and readings.
const CALIBRATION: &str = include_str!("sensor_files/calibration.csv");
const READINGS: &str = include_str!("sensor_files/readings.csv");

/// Methods that together have all parts of any method.
const WRITTEN: [&str; 4] = ["pearson", "surrogate", "blend", "extra-trees"];

#[test]
fn loaded_model_answers_the_same_to_the_last_bit() {
    // a fifth unit that is dead: it is left out
    let rows: Vec<Vec<f64>> = numbers(CALIBRATION).map(|row| row.into_iter().chain([0.7]).collect()).collect();
    let calibration = Calibration::new(&rows.iter().map(|row| point(row)).collect::<Vec<_>>()).unwrap();
    let mut readings: Vec<Vec<f64>> =
        numbers(READINGS).map(|row| row.into_iter().chain([f64::NAN]).collect()).collect();
    readings[1][2] = f64::NAN;
    readings[3][0] = f64::INFINITY;
    readings[5].pop();
    for name in SOLVERS.into_iter().filter(|name| *name != "physics").chain(["best"]) {
        let made = Model::fit(name, calibration.clone(), &Setting::default()).unwrap();
        let bytes = made.to_bytes().unwrap();
        let read = Model::from_bytes(&bytes).unwrap();
        assert_eq!(read.to_bytes().unwrap(), bytes, "{name}");
        let [mut made, mut read] = [made, read].map(Session::new);
        for reading in &readings {
            let answers = [made.solve(reading), read.solve(reading)].map(|answer| format!("{answer:?}"));
            assert_eq!(answers[0], answers[1], "{name}: {reading:?}");
        }
        assert_eq!(read.broken().len(), 1, "{name}");
    }
}

/// After a change of a struct of a model, older files can't be read any more: then increase `sensor_file::MARK`, and make these files again
/// (`palpate fit calibration.csv --solver NAME --out NAME.palpate`, `palpate solve --model`).
#[test]
fn files_of_removed_methods_are_refused() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/solving/sensor_files");
    for name in palpate_solver::REMOVED {
        let file = folder.join(format!("{name}.palpate"));
        let output = solved(&TestFolder::with([]), &format!("--model {}", file.display()), 2);
        assert!(output.running().contains(&format!("has the method `{name}`, which was removed")), "{}", output.err);
        assert!(output.running().contains("fit the sensor again"), "{}", output.err);
    }
}

#[test]
fn stored_files_of_this_version_give_their_stored_answers() {
    for name in WRITTEN {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/solving/sensor_files");
        let bench = TestFolder::with([]);
        let file = folder.join(format!("{name}.palpate"));
        let output = solved(&bench, &format!("--model {} --quiet", file.display()), 0);
        let expected = fs::read_to_string(folder.join(format!("{name}.csv"))).unwrap();
        for (found, expected) in output.out.lines().zip(expected.lines()) {
            // the stored answers are older than the column of units at fault
            let found = found.rsplit_once(',').filter(|(_, last)| ["", "left_out"].contains(last)).unwrap().0;
            assert_eq!(found.matches(',').count(), expected.matches(',').count(), "{name}: {found} for {expected}");
            let cells = found.split(',').zip(expected.split(','));
            for (found, expected) in cells {
                let pair = found.parse::<f64>().ok().zip(expected.parse::<f64>().ok());
                let alike = pair.is_some_and(|(found, expected)| (found - expected).abs() < 2e-6);
                assert!(alike || found == expected, "{name}: {found} for {expected}");
            }
        }
        assert_eq!(output.out.lines().count(), expected.lines().count(), "{name}");
    }
}

#[test]
fn a_sensor_file_answers_as_its_calibration_does() {
    let bench = TestFolder::with([("a.csv", CALIBRATION)]);
    let output = bench.palpate("fit a.csv --out sensor.palpate");
    assert_eq!(output.code, Some(0), "{}", output.err);
    assert!(
        output.out.starts_with("sensor.palpate: ") && output.out.contains(" kB\nnext: palpate solve "),
        "{}",
        output.out
    );
    assert!(output.err.contains("chosen by cross-validation"), "{}", output.err);
    let by_file = solved(&bench, "--model sensor.palpate", 0);
    assert_eq!(by_file.out, solved(&bench, "--calibration a.csv", 0).out);
    assert!(by_file.err.ends_with(", fitted to 49 presses of 4 outputs\n"), "{}", by_file.err);

    let bytes = fs::read(bench.path("sensor.palpate")).unwrap();
    let mut lines = bytes.splitn(3, |byte| *byte == b'\n');
    assert_eq!(lines.next(), Some(&b"palpate sensor 2"[..]));
    let card: Value = serde_json::from_slice(lines.next().unwrap()).unwrap();
    assert_eq!(card["valid"]["x_mm"], serde_json::json!([-3.0, 3.0]), "{card}");
    assert_eq!(card["valid"]["force_n"], serde_json::json!([0.8, 1.2]), "{card}");
    assert_eq!(card["made_from"][0]["name"], "a.csv", "{card}");
    assert_eq!(card["bytes"], lines.next().unwrap().len(), "{card}");
    // fitted again, it replaces the old one
    assert_eq!(bench.palpate("fit a.csv --solver pearson --out sensor.palpate").code, Some(0));
}

#[test]
fn damaged_sensor_file_error_names_the_damage() {
    let bench = TestFolder::with([("a.csv", CALIBRATION)]);
    assert_eq!(bench.palpate("fit a.csv --solver pearson --out a.palpate").code, Some(0));
    let whole = fs::read(bench.path("a.palpate")).unwrap();
    let refused = |bytes: &[u8]| {
        fs::write(bench.path("b.palpate"), bytes).unwrap();
        let output = solved(&bench, "--model b.palpate", 2);
        assert_eq!(output.out, "", "no line was answered");
        output.running()
    };
    let end = whole.len() - 1;
    let text = String::from_utf8_lossy(&whole).into_owned();
    for (bytes, said) in [
        (Vec::new(), "b.palpate isn't a sensor file: it doesn't begin with `palpate sensor 2`"),
        (CALIBRATION.as_bytes().to_vec(), "b.palpate isn't a sensor file"),
        (whole[..10].to_vec(), "isn't a sensor file"),
        (b"palpate sensor 2".to_vec(), "b.palpate is damaged: its first line is incomplete"),
        (whole[..40].to_vec(), "b.palpate is damaged: its second line is incomplete"),
        (whole[..end].to_vec(), "b.palpate is damaged: its model has"),
        ([&whole[..end], &[!whole[end]]].concat(), "its model has changed since it was written (its SHA-256 differs)"),
        (whole.repeat(2), "b.palpate is damaged: its model has"),
        (b"palpate sensor 1\n{}\n".to_vec(), "is a sensor file of version 1; this program reads version 2"),
        (b"palpate sensor 2\n{\"method\": 1}\n".to_vec(), "b.palpate is damaged: its second line: "),
    ] {
        let output = refused(&bytes);
        assert!(output.contains(said), "{said}\n{output}");
    }
    // numbers that aren't a model, with their own hash
    let card = text.lines().nth(1).unwrap();
    let card: Value = serde_json::from_str(card).unwrap();
    for numbers in [&b""[..], b"\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01", &[0; 64]] {
        let mut card = card.clone();
        card["bytes"] = numbers.len().into();
        card["sha256"] = sha256(numbers).into();
        let output = refused(&[format!("palpate sensor 2\n{card}\n").as_bytes(), numbers].concat());
        assert!(output.contains("is damaged: the numbers of the model can't be read"), "{output}");
    }
}

#[test]
fn only_a_sensor_file_is_replaced_and_a_model_takes_no_setting() {
    let bench = TestFolder::with([("a.csv", CALIBRATION)]);
    let output = bench.palpate("fit a.csv --out a.csv");
    assert_eq!(output.code, Some(2));
    assert!(output.running().contains("a.csv already exists and isn't a sensor file"), "{}", output.err);
    assert_eq!(bench.read("a.csv"), CALIBRATION);
    let output = bench.palpate("fit a.csv --out none/a.palpate");
    assert_eq!(output.code, Some(5), "{}", output.err);
    assert!(output.running().contains("writing none/a.palpate: "), "{}", output.err);
    for words in ["--solver pearson", "--constant-load", "--calibration a.csv", "--false-alarms 0.1"] {
        let output = bench.palpate(&format!("solve --model a.palpate {words}"));
        assert_eq!(output.code, Some(2));
        assert!(output.err.contains("cannot be used with"), "{words}: {}", output.err);
    }
    assert!(bench.palpate_ends(2, "solve").running().contains("add --model FILE"));
    let output = solved(&bench, "--model none.palpate", 2);
    assert!(output.running().contains("reading none.palpate: "), "{}", output.err);
}

#[test]
fn presses_beyond_the_file_limit_are_left_out() {
    let rows: Vec<Vec<f64>> = (0..36 * 9)
        .map(|press| {
            let (x_mm, y_mm) = ((press % 6) as f64, (press / 6 % 6) as f64);
            let unit = |unit: usize| {
                let wobble = ((press * 31 + unit * 17) % 97) as f64 / 9700.0;
                1.0 + (0.2 * x_mm + unit as f64).sin() + (0.2 * y_mm - 3.0 * unit as f64).cos() + wobble
            };
            [x_mm, y_mm, 1.0].into_iter().chain((0..700).map(unit)).collect()
        })
        .collect();
    let calibration = Calibration::new(&rows.iter().map(|row| point(row)).collect::<Vec<_>>()).unwrap();
    let model = Model::fit("pearson", calibration, &Setting::default()).unwrap();
    let file = palpate_data::dataset::sensor_file::SensorFile::within(3 << 20, model, None, Vec::new()).unwrap();
    assert!(!file.card.keeps_presses && file.card.bytes < 3 << 20, "{:?}", file.card);
    let bench = TestFolder::with([]);
    file.write(&bench.path("large.palpate")).unwrap();
    let (_, model) = palpate_data::dataset::sensor_file::read_sensor_file(&bench.path("large.palpate")).unwrap();
    let mut session = Session::new(model);
    let mut reading = rows[100][3..].to_vec();
    assert_eq!(session.solve(&reading).unwrap().place.x_mm, rows[100][0]);
    reading[7] = f64::NAN;
    let error = session.solve(&reading).unwrap_err().to_string();
    assert!(error.starts_with("outputs are missing, and the sensor file doesn't contain the presses"), "{error}");
}

fn point(row: &[f64]) -> CalibrationPoint<'_> {
    let place = palpate_core::quantity::Place::new(row[0], row[1]);
    CalibrationPoint { place, force_n: row[2], outputs: &row[3..] }
}

fn numbers(table: &str) -> impl Iterator<Item = Vec<f64>> {
    table.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
}

fn solved(bench: &TestFolder, words: &str, code: i32) -> CommandOutput {
    bench.write("readings", READINGS);
    let input = File::open(bench.path("readings")).unwrap();
    let printed: CommandOutput = bench.command(&format!("solve {words}")).stdin(input).output().unwrap().into();
    assert_eq!(printed.code, Some(code), "palpate solve {words}\n{}\n{}", printed.out, printed.err);
    printed
}

fn sha256(bytes: &[u8]) -> String {
    palpate_data::dataset::Fingerprint::of("", bytes).sha256
}
