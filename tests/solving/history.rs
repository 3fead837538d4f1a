//! Force from readings over time: skins that creep, and skins that don't.

use palpate_core::quantity::{RandomStream, stream};
use palpate_solver::{HistoryRegression, Series, SeriesError, evaluate_history};
use palpate_testing::{TestFolder, campaign};
use rand::RngExt;

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
    assert!(evaluation.is_used && evaluation.used == evaluation.with_memories, "{evaluation:?}");
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
        let rmse_n = |regression: &HistoryRegression| {
            let mut session = regression.session();
            let square = |(t_s, outputs, force_n): &(f64, Vec<f64>, f64)| {
                (session.solve(*t_s, outputs).expect("no gap") - force_n).powi(2)
            };
            (test.iter().map(square).sum::<f64>() / test.len() as f64).sqrt()
        };
        let (with_history_n, newest_n) = (rmse_n(&regression), rmse_n(&newest));
        println!("seed {seed}: {with_history_n:.4} N with history, {newest_n:.4} N without");
        assert!(with_history_n < 0.7 * newest_n, "seed {seed}");
        let mut session = regression.session();
        let (t_s, outputs, _) = &test[0];
        session.solve(*t_s, outputs).expect("the first reading");
        assert!(matches!(session.solve(t_s + 5.0, outputs), Err(SeriesError::Gap { gap_s }) if gap_s == 5.0));
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
        evaluation.is_used
    };
    let used = (0..seeds).filter(is_used).count();
    println!("history was used for {used} of {seeds} static skins");
    assert!(20 * used <= seeds, "{used} of {seeds}");
}

/// The command reads the columns of a table without places, with times in ms.
#[test]
fn a_table_with_times_is_evaluated_by_its_history() {
    let rows = readings(SLOW, 1, &SPEEDS, 300).into_iter();
    let rows =
        rows.map(|(t_s, outputs, force_n)| format!("{:.0},{force_n},{},{}\n", 1000.0 * t_s, outputs[0], outputs[1]));
    let table = format!("ms,Fz,a,b\n{}", rows.collect::<String>());
    let columns = "t_s = \"ms\"\nforce_n = \"Fz\"\noutputs = [\"a\", \"b\"]\nscale = { t_s = 0.001 }\n";
    let bench = TestFolder::with([("series.csv", table.as_str()), ("columns.toml", columns)]);
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
