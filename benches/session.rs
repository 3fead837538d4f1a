//! What an answer of a session costs, beside the same session whose searches for units at fault are never made, and a fit:
//! `cargo bench --bench session`.
//!
//! It measures and prints; it doesn't judge. Each reading is a new contact: another place, force and noise. Times are of the processor,
//! the least of several streams that are solved in turn. `PALPATE_BENCH` chooses among the sensors and methods by a part of a line.
#![allow(clippy::print_stdout, reason = "it prints its results")]

use cpu_time::ProcessTime;
use palpate_solver::{Calibration, CalibrationPoint, Fits, Model, Session, Setting};
use palpate_testing::skins::GridSkin;
use std::hint::black_box;
use std::sync::Arc;

/// Columns and rows of units, presses along x and y, readings.
const SENSORS: [([usize; 2], [usize; 2], usize); 4] =
    [([3, 3], [25, 25], 20_000), ([8, 8], [40, 25], 20_000), ([16, 12], [50, 40], 2_000), ([32, 24], [13, 13], 2_000)];
const METHODS: [&str; 4] = ["pearson", "surrogate", "blend", "best"];
/// How often each stream is solved.
const REPETITIONS: usize = 5;
/// Ratio of all outputs of another session, at most.
const GAINS: f64 = 0.05;

fn main() {
    let chosen = std::env::var("PALPATE_BENCH").unwrap_or_default();
    println!(
        "                                   us an answer            searches              us of a refit, and of the fit"
    );
    for (units, presses, readings) in SENSORS {
        let mut skin = GridSkin::new(units[0], units[1]);
        let rows = skin.grid(presses[0], presses[1]);
        let points: Vec<CalibrationPoint<'_>> = rows
            .iter()
            .map(|(place, force_n, outputs)| CalibrationPoint { place: *place, force_n: *force_n, outputs })
            .collect();
        let calibration = Calibration::new(&points).expect("pressed points");
        let fresh: Vec<Vec<f64>> = skin.random(readings).into_iter().map(|(_, _, outputs)| outputs).collect();
        for method in METHODS {
            let name = format!("{} x {} {method}", units[0] * units[1], presses[0] * presses[1]);
            if !name.contains(&chosen) {
                continue;
            }
            let began = ProcessTime::now();
            let model = Model::fit(method, calibration.clone(), &Setting::of_layout(Some(&skin.layout)));
            let fit_s = began.elapsed().as_secs_f64();
            let fits = Arc::new(Fits::new(model.expect("a calibration with contrast")));
            for (stream, readings) in streams(&fresh) {
                print_cost(&format!("{name}, {stream}"), &fits, &readings, fit_s);
            }
        }
    }
}

/// Readings of a good sensor, of one with a weak output, and in another session.
fn streams(fresh: &[Vec<f64>]) -> [(&'static str, Vec<Vec<f64>>); 4] {
    let changed = |change: &dyn Fn(usize, usize, f64) -> f64| -> Vec<Vec<f64>> {
        let row = |(line, row): (usize, &Vec<f64>)| {
            row.iter().enumerate().map(|(unit, output)| change(line, unit, *output)).collect()
        };
        fresh.iter().enumerate().map(row).collect()
    };
    let middle = fresh[0].len() / 2;
    [
        ("healthy", fresh.to_vec()),
        ("broken", changed(&|line, unit, output| if unit == middle && line >= 200 { 0.3 * output } else { output })),
        ("session", changed(&|_, unit, output| output * (1.0 + GAINS * ((unit * 7919 % 201) as f64 / 100.0 - 1.0)))),
        ("held", vec![fresh[0].clone(); fresh.len()]),
    ]
}

fn print_cost(name: &str, fits: &Arc<Fits>, readings: &[Vec<f64>], fit_s: f64) {
    let (mut never_s, mut searching_s) = (f64::INFINITY, f64::INFINITY);
    let (mut searches_s, mut changes) = (Vec::new(), 0);
    for _ in 0..REPETITIONS {
        let mut session = Session::sharing(fits.clone()).deferring();
        let began = ProcessTime::now();
        for reading in readings {
            _ = black_box(session.solve(black_box(reading)));
        }
        never_s = never_s.min(began.elapsed().as_secs_f64());
        let mut session = Session::sharing(fits.clone()).deferring();
        let mut searched = Vec::new();
        let began = ProcessTime::now();
        for reading in readings {
            _ = black_box(session.solve(black_box(reading)));
            if let Some(search) = session.search() {
                let search_began = ProcessTime::now();
                session.accept(search.run());
                searched.push(search_began.elapsed().as_secs_f64());
            }
        }
        let all_s = began.elapsed().as_secs_f64() - searched.iter().take(2).sum::<f64>();
        searching_s = searching_s.min(all_s);
        (searches_s, changes) = (searched, session.changes().len());
    }
    let us = |s: f64| 1e6 * s / readings.len() as f64;
    let ms: Vec<String> = searches_s.iter().map(|s| format!("{:.1}", 1e3 * s)).collect();
    println!(
        "{name:<34} {:>9.2} {:>9.2} {:>6.3}  {changes} changes, searches of {} ms, fit {:.0} ms",
        us(never_s),
        us(searching_s),
        searching_s / never_s,
        ms.join(" "),
        1e3 * fit_s
    );
}
