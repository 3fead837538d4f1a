//! Force from readings over time: skins that creep, and skins that don't. `evaluate`, `fit`, `solve` and `serve` of a series.

use crate::serve::Server;
use palpate_core::quantity::{RandomStream, stream};
use palpate_solver::{HistoryRegression, HistorySession, Series, Unanswered, evaluate_history};
use palpate_testing::{SMALL, TestFolder, campaign};
use rand::RngExt;
use serde_json::Value;
use std::sync::Arc;

const INTERVAL_S: f64 = 0.1;

/// A skin with creep and hysteresis, as shares of its output, and noise as a share of its range.
#[derive(Clone, Copy)]
struct Skin {
    creep: f64,
    hysteresis: f64,
    noise: f64,
}

const SPEEDS: [f64; 3] = [0.05, 0.2, 0.8];

const STATIC: Skin = Skin { creep: 0.0, hysteresis: 0.0, noise: 0.005 };
const SLOW: Skin = Skin { creep: 0.2, hysteresis: 0.1, noise: 0.005 };

/// Loads from 0 to 2 N: ramps up and down at a speed, N/s, and a random walk.
fn loads(rng: &mut RandomStream, speeds: &[f64], count: usize) -> Vec<f64> {
    let (mut force_n, mut up) = (0.0, true);
    let mut loads = Vec::new();
    for speed in speeds {
        for _ in 0..count {
            force_n += if up { speed * INTERVAL_S } else { -speed * INTERVAL_S };
            if !(0.0..=2.0).contains(&force_n) {
                up = !up;
            }
            force_n = force_n.clamp(0.0, 2.0);
            loads.push(force_n);
        }
        for _ in 0..count {
            force_n = (force_n + rng.random_range(-0.1..0.1)).clamp(0.0, 2.0);
            loads.push(force_n);
        }
    }
    loads
}

/// Readings of two taxels of a skin: time, outputs, force.
fn readings(skin: Skin, seed: u64, speeds: &[f64], count: usize) -> Vec<(f64, Vec<f64>, f64)> {
    let mut rng = stream(seed, 0, "a skin over time");
    let loads = loads(&mut rng, speeds, count);
    let (mut crept, mut played) = ([0.0; 2], 0.0f64);
    loads
        .into_iter()
        .enumerate()
        .map(|(row, force_n)| {
            for (crept, tau_s) in crept.iter_mut().zip([1.0f64, 30.0]) {
                *crept += (force_n - *crept) * (1.0 - (-INTERVAL_S / tau_s).exp());
            }
            played = played.clamp(force_n - 0.2, force_n + 0.2);
            let slow = force_n + skin.creep / 2.0 * (crept[0] + crept[1]) + skin.hysteresis * 5.0 * (force_n - played);
            let noise = |rng: &mut RandomStream| {
                (0..4).map(|_| rng.random_range(-1.0..1.0)).sum::<f64>() * 3f64.sqrt() / 2.0 * skin.noise * 2.0
            };
            let outputs = vec![slow + 0.1 * slow * slow + noise(&mut rng), 0.6 * slow + noise(&mut rng)];
            (INTERVAL_S * row as f64, outputs, force_n)
        })
        .collect()
}

fn series(readings: &[(f64, Vec<f64>, f64)]) -> Series {
    Series::new(readings.iter().map(|(t_s, outputs, force_n)| (*t_s, outputs.as_slice(), *force_n))).expect("a series")
}

#[test]
fn a_skin_that_creeps_is_solved_by_its_history() {
    let evaluation = evaluate_history(&series(&readings(SLOW, 1, &SPEEDS, 600))).expect("an evaluation");
    println!("{evaluation:?}");
    assert!(evaluation.choice.is_used && evaluation.used == evaluation.with_memories, "{evaluation:?}");
    assert!(evaluation.used.rmse_n < 0.7 * evaluation.newest.rmse_n, "{evaluation:?}");
}

/// Loads at a speed that the calibration never had.
#[test]
fn history_holds_at_another_speed_and_refuses_a_gap() {
    for seed in 0..campaign::size(2, 20) as u64 {
        let calibration = series(&readings(SLOW, seed, &SPEEDS, 600));
        let test = readings(SLOW, seed + 1000, &[0.4], 600);
        let regression = HistoryRegression::fit(&calibration).expect("a regression");
        let newest = HistoryRegression::fit_newest(&calibration).expect("a regression");
        let [regression, newest] = [regression, newest].map(Arc::new);
        let rmse_n = |regression: &Arc<HistoryRegression>| {
            let mut session = HistorySession::new(regression.clone());
            let square = |(t_s, outputs, force_n): &(f64, Vec<f64>, f64)| {
                (session.solve(*t_s, outputs).expect("no gap") - force_n).powi(2)
            };
            (test.iter().map(square).sum::<f64>() / test.len() as f64).sqrt()
        };
        let (with_history_n, newest_n) = (rmse_n(&regression), rmse_n(&newest));
        println!("seed {seed}: {with_history_n:.4} N with history, {newest_n:.4} N without");
        assert!(with_history_n < 0.7 * newest_n, "seed {seed}");
        let mut session = HistorySession::new(regression);
        let (t_s, outputs, _) = &test[0];
        session.solve(*t_s, outputs).expect("the first reading");
        assert!(matches!(session.solve(t_s + 5.0, outputs), Err(Unanswered::Gap { gap_s }) if gap_s == 5.0));
        session.solve(t_s + 5.0 + INTERVAL_S, outputs).expect("history begins again");
    }
}

#[test]
fn a_static_skin_is_solved_by_its_newest_reading() {
    let seeds = campaign::size(6, 100);
    let is_used = |seed: &usize| {
        let evaluation =
            evaluate_history(&series(&readings(STATIC, *seed as u64, &SPEEDS, 300))).expect("an evaluation");
        assert!(evaluation.used.rmse_n < 1.02 * evaluation.newest.rmse_n, "{evaluation:?}");
        evaluation.choice.is_used
    };
    let used = (0..seeds).filter(is_used).count();
    println!("history was used for {used} of {seeds} static skins");
    assert!(20 * used <= seeds, "{used} of {seeds}");
}

/// The command reads the columns of a table without places, with times in ms.
#[test]
fn a_table_with_times_is_evaluated_by_its_history() {
    let table = table_in_ms(&readings(SLOW, 1, &SPEEDS, 300));
    let bench = TestFolder::with([("series.csv", table.as_str()), ("columns.toml", COLUMNS)]);
    let output = bench.palpate_ends(0, "evaluate series.csv --history --columns columns.toml");
    assert!(
        output.out.starts_with("1800 readings in 180 s, solved without each of 5 blocks of time in turn"),
        "{}",
        output.out
    );
    assert!(output.out.contains("earlier readings lower the error by "), "{}", output.out);
    let object = &bench.palpate_ends(0, "evaluate series.csv --history --columns columns.toml --json").json_lines()[0];
    assert_eq!((object["rows"].as_u64(), object["is_used"].as_bool()), (Some(1800), Some(true)));
    bench.write("back.csv", &table.replacen("\n100,", "\n0,", 1));
    let refused = bench.palpate_ends(2, "evaluate back.csv --history --columns columns.toml").err;
    assert!(refused.contains("reading 1 isn't later than the one before"), "{refused}");
    let refused = bench.palpate_ends(2, "evaluate series.csv --history").err;
    assert!(refused.contains("t_s"), "{refused}");
}

const COLUMNS: &str = "t_s = \"ms\"\nforce_n = \"Fz\"\noutputs = [\"a\", \"b\"]\nscale = { t_s = 0.001 }\n";

fn table_in_ms(readings: &[(f64, Vec<f64>, f64)]) -> String {
    let rows = readings.iter();
    let rows =
        rows.map(|(t_s, outputs, force_n)| format!("{:.0},{force_n},{},{}\n", 1000.0 * t_s, outputs[0], outputs[1]));
    format!("ms,Fz,a,b\n{}", rows.collect::<String>())
}

/// A folder with a series, and the sensor file that is fitted to it.
fn fitted(readings: &[(f64, Vec<f64>, f64)]) -> TestFolder {
    let bench = TestFolder::with([("series.csv", table_in_ms(readings).as_str()), ("columns.toml", COLUMNS)]);
    let fitted = bench.palpate_ends(0, "fit series.csv --history --columns columns.toml --out s.palpate");
    let start =
        format!("history, fitted to {} readings of 2 outputs\nearlier readings lower the error by ", readings.len());
    assert!(fitted.err.starts_with(&start) && fitted.err.lines().count() == 2, "{}", fitted.err);
    assert!(fitted.out.starts_with("s.palpate: history, 1 kB\nnext: palpate solve "), "{}", fitted.out);
    bench
}

fn ndjson(t_s: f64, outputs: &[f64]) -> String {
    format!("{}\n", serde_json::json!({ "t_s": t_s, "outputs": outputs }))
}

fn forces(answers: &[Value]) -> Vec<f64> {
    answers.iter().map(|answer| answer["force_n"].as_f64().expect("a force")).collect()
}

#[test]
fn every_way_to_solve_a_series_gives_the_forces_of_its_regression() {
    let readings = readings(SLOW, 3, &[0.2], 300);
    let bench = fitted(&readings);
    let mut session = HistorySession::new(HistoryRegression::fit(&series(&readings)).expect("a regression"));
    let expected: Vec<f64> =
        readings.iter().map(|(t_s, outputs, _)| session.solve(*t_s, outputs).expect("a force")).collect();
    let is_near = |found: &[f64], most: f64| {
        found.len() == expected.len()
            && found.iter().zip(&expected).all(|(found, force_n)| (found - force_n).abs() < most)
    };
    let csv = bench.palpate_reads("solve --model s.palpate --columns columns.toml", &bench.read("series.csv"));
    assert!(csv.out.starts_with("t_s,force_n,verdict\n0.0,"), "{}", csv.out);
    let row = |line: &str| line.split(',').nth(1).and_then(|cell| cell.parse().ok()).expect("a force");
    assert!(is_near(&csv.out.lines().skip(1).map(row).collect::<Vec<f64>>(), 1e-6), "{}", csv.out);
    let times = csv.out.lines().skip(1).zip(&readings).all(|(line, (t_s, ..))| {
        (line.split(',').next().and_then(|cell| cell.parse::<f64>().ok()).expect("a time") - t_s).abs() < 1e-9
    });
    assert!(times, "{}", csv.out);
    let lines: String = readings.iter().map(|(t_s, outputs, _)| ndjson(*t_s, outputs)).collect();
    let json = bench.palpate_reads("solve --model s.palpate --json", &lines).json_lines();
    assert!(is_near(&forces(&json), 1e-6) && json[1]["verdict"] == "ok" && json[1]["t_s"] == 0.1, "{json:?}");
    let unfitted = "solve --calibration series.csv --history --columns columns.toml --json";
    assert!(forces(&bench.palpate_reads(unfitted, &lines).json_lines()) == forces(&json), "JSON has times in s");
    let served = Server::start(&bench, "--model s.palpate --json").answers(lines.as_bytes());
    let served: Vec<Value> = served.lines().map(|line| serde_json::from_str(line).expect("an object")).collect();
    assert!(forces(&served) == forces(&json), "{served:?}");
    // a run keeps the times of the table that it was imported from; its numbers are rounded
    bench.palpate_ends(0, "import series.csv --columns columns.toml --out run");
    bench.palpate_ends(0, "fit run --history --out run.palpate");
    let of_run = bench.palpate_reads("solve --model run.palpate --json", &lines).json_lines();
    assert!(is_near(&forces(&of_run), 1e-3), "{of_run:?}");
    let [of_run, of_table] = ["run", "series.csv --columns columns.toml"]
        .map(|source| bench.palpate_ends(0, &format!("evaluate {source} --history")).out);
    assert_eq!(of_run, of_table);
}

#[test]
fn a_gap_a_time_that_goes_back_and_a_missing_output_have_no_answer() {
    let readings = readings(SLOW, 3, &[0.2], 300);
    let bench = fitted(&readings);
    let outputs = &readings[0].1;
    let lines = [
        ndjson(0.0, outputs),
        ndjson(0.1, &[outputs[0], f64::NAN]),
        ndjson(0.2, outputs),
        ndjson(0.2, outputs),
        ndjson(3.4, outputs),
        ndjson(3.5, outputs),
        ndjson(-9.0, outputs),
        ndjson(-8.9, outputs),
    ];
    let errors = [
        None,
        Some("output 2 is not a finite number"),
        None,
        Some("its time of 0.2 s isn't later than 0.2 s, that of the reading before"),
        Some("no reading for 3.20 s: after more than 10 intervals of the calibration its history begins again"),
        None,
        Some("its time of -9 s isn't later than 3.5 s, that of the reading before"),
        None,
    ];
    let answers = bench.palpate_reads("solve --model s.palpate --json", &lines.concat()).json_lines();
    let found: Vec<Option<&str>> = answers.iter().map(|answer| answer["error"].as_str()).collect();
    assert_eq!(found, errors);
    for answer in &answers {
        assert_eq!(answer["force_n"].is_null(), answer["verdict"] == "unsolved", "{answer}");
    }
}

#[test]
fn a_reading_without_a_time_is_refused_with_what_to_add() {
    let bench = fitted(&readings(SLOW, 3, &[0.2], 300));
    let words = |text: &str| text.split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ");
    let no_time =
        "stdin, line 1: t_s, the time of the reading, is missing or isn't a number help: a sensor with a history needs";
    for (lines, expected) in [
        (
            "out_1,out_2\n1,2\n",
            "stdin, line 1: column `t_s` is missing help: required: t_s, the time of each reading, s, and",
        ),
        ("1,2\n", no_time),
        ("[1,2]\n", no_time),
        ("{\"t_s\":\"noon\",\"outputs\":[1,2]}\n", no_time),
        ("t_s,out_1,out_2\n0.1,1,2\n,1,2\n", &no_time.replace("line 1", "line 3")),
    ] {
        let refused = bench.palpate_reads("solve --model s.palpate --quiet", lines);
        assert!(refused.code == Some(2) && words(&refused.err).contains(expected), "{lines}: {}", refused.err);
    }
    let kept = bench
        .palpate_reads("solve --model s.palpate --keep-going", "{\"outputs\":[1,2]}\n{\"t_s\":0,\"outputs\":[1,2]}\n");
    let rows: Vec<&str> = kept.out.lines().collect();
    assert!(rows.len() == 3 && rows[0] == "line,id,t_s,force_n,verdict,error", "{}", kept.out);
    assert!(rows[1].starts_with("1,,,,unsolved,\"stdin, line 1: t_s") && rows[2].starts_with("2,,0,"), "{}", kept.out);
}

#[test]
fn other_commands_refuse_the_sensor_file_of_a_series() {
    let bench = fitted(&readings(SLOW, 3, &[0.2], 300));
    for command in ["export --model s.palpate --format c", "adapt --from s.palpate --with series.csv --out b.palpate"] {
        let refused = bench.palpate_ends(2, command).err;
        assert!(refused.contains("s.palpate solves a series of readings; only `solve` and `serve`"), "{refused}");
        assert!(refused.contains("without --history"), "{refused}");
    }
    let refused = bench.palpate_ends(2, "adapt --from a.csv --with b.csv --history --out b.palpate").err;
    assert!(refused.contains("`adapt` doesn't know series of readings"), "{refused}");
    bench.write("small.toml", SMALL);
    bench.palpate_ends(0, "run small.toml --rig sim --out presses --evaluate recipe");
    for command in ["fit presses --history --out c.palpate", "evaluate presses --history"] {
        let refused = bench.palpate_ends(2, command).err;
        assert!(refused.contains("presses: a run knows its presses, not what happened between them"), "{refused}");
    }
    bench.palpate_ends(0, "import series.csv --columns x_mm=ms,y_mm=Fz,outputs=a,b --out untimed");
    let refused = bench.palpate_ends(2, "fit untimed --history --out c.palpate").err;
    assert!(refused.contains("untimed: its readings have no times") && refused.contains("t_s=time"), "{refused}");
}
