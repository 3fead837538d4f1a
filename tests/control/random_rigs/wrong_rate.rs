//! A rate of conversions that is declared eight times too high: a run completes, or is refused before the first descent with the key to
//! change.

use super::draw::{drawn, with_cell};
use crate::families::{MARLIN, rig_of};
use palpate_core::quantity::stream;
use palpate_run::rig::RigSpec;
use palpate_sim::scene::LoadCellScene;
use palpate_testing::executions::{Deaths, executed_with, in_parallel, must_be_none, plan};
use palpate_testing::{campaign, shipped_text};
use rand::RngExt;

/// Runs, quick and full.
const RUNS: (usize, usize) = (2, 200);

/// Factor of the declared rate.
const TIMES: f64 = 8.0;

/// Families of cells, and the rates of such devices, conversions/s.
const CELLS: [(&str, [f64; 2]); 4] = [
    ("driver = { modbus = \"generic-rs485\" }\nlink = \"serial:///dev/ttyUSB7?baud=115200\"\n", [5.0, 100.0]),
    (
        "driver = { lines = \"hx711\", newton_per_unit = 0.0000025, offset = 84000.0 }\nlink = \"serial:///dev/ttyACM7?baud=115200\"\n",
        [5.0, 100.0],
    ),
    ("driver = { process = [\"python3\", \"examples/load_cell.py\"] }\n", [5.0, 100.0]),
    (
        "driver = { lines = \"ati-netft\" }\nlink = \"udp://192.168.1.1:49152\"\naxes = { x = \"x\", y = \"-y\", press = \"-z\" }\n",
        [5.0, 1000.0],
    ),
];

#[test]
fn a_rate_declared_too_high_completes_or_is_refused_before_the_first_descent() {
    let seeds: Vec<u64> = (1..=campaign::size(RUNS.0, RUNS.1) as u64).collect();
    let ends = in_parallel(&seeds, |&seed| {
        let mut rng = stream(seed, 0, "wrong rates");
        let (cell, [least_hz, most_hz]) = CELLS[seed as usize % CELLS.len()];
        let real_hz = drawn(&mut rng, least_hz, most_hz);
        let noise_n = drawn(&mut rng, 0.0003, 0.02);
        let latency_s = drawn(&mut rng, 0.001, 0.1);
        let is_cnc = rng.random_bool(0.3);
        let spec_of = |hz: f64| -> RigSpec {
            let path = if is_cnc { MARLIN.rig } else { "rigs/esp301.toml" };
            let text = with_cell(&shipped_text(path), &format!("{cell}conversions_hz = {hz:.4}\n"));
            let mut spec = rig_of(path, &text);
            spec.scene.load_cell = Some(LoadCellScene { noise_n, ..LoadCellScene::IDEAL });
            spec.scene.latencies.load_cell_s = (latency_s, 1.5 * latency_s);
            spec
        };
        let (real, wrong) = (spec_of(real_hz), spec_of(TIMES * real_hz));
        let text = "name = \"wrong\"\nchecks = \"none\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.0\nsample_s = 0.1\nstrategy = \"guarded\"\n\
            [[step]]\nphase = \"calibration\"\nrandom = { count = 6, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0], force_n = [0.3, 1.0] }\n";
        let plan = plan(&wrong, text, seed);
        let run = executed_with(&wrong, &plan, Deaths::Ignored, &|rig| *rig = real.emulators(seed).expect("emulators"));
        let text = run.ending.text();
        let is_refused = run.truth.force_n == 0.0 && text.as_ref().is_some_and(|text| text.contains("conversions_hz"));
        let is_complete = text.is_none() && run.truth.is_within(&wrong);
        let name = format!("seed {seed}: {real_hz:.1} Hz, noise {noise_n:.4}, {latency_s:.3} s, {cell:?}");
        (is_complete, (!is_complete && !is_refused).then(|| format!("{name}: {:.3} N, {text:?}", run.truth.force_n)))
    });
    println!("{} runs, {} complete", ends.len(), ends.iter().filter(|(complete, _)| *complete).count());
    must_be_none(&ends.into_iter().filter_map(|(_, end)| end).collect::<Vec<_>>());
}
