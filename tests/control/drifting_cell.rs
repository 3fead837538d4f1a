//! A load cell whose zero drifts fast, as one that gets warm: how runs end. Only the limit must hold.

use super::glitches::{most_of_set, recipe};
use palpate_control::Strategy;
use palpate_testing::campaign;
use palpate_testing::executions::{BENCHES, bench, end_of, executed, in_parallel, must_be_none, plan};
use std::collections::BTreeMap;

/// Drifts of a load cell, N/s: none, and up to those of a cell that gets warm.
const DRIFTS_N_S: [f64; 5] = [0.013, 0.0, 0.001, 0.004, 0.020];

/// Seeds of a condition in the full tier, and presses: quick, and full.
const SEEDS: usize = 20;
const PRESSES: (usize, usize) = (4, 25);

/// Noise of a good and of a bad load cell, N.
const NOISES_N: [f64; 2] = [0.002, 0.05];

/// Limit of the specimen, N, and the set force as the recipe has it: well within the limit.
const DRIFT_LIMIT_N: f64 = 5.0;
const DRIFT_SET_N: &str = "[2.0, 2.0]";

/// Declarations of this specimen: its depth at some 4 N, mm, and its stiffness there, N/mm.
const DRIFT_DEPTH_MM: f64 = 3.0;
const DRIFT_STIFFNESS_N_MM: f64 = 3.0;

/// Odd seeds drift up, even ones down.
#[test]
fn a_drifting_cell_stays_within_the_limit() {
    let drifts = &DRIFTS_N_S[..campaign::size(1, DRIFTS_N_S.len()).min(DRIFTS_N_S.len())];
    let noises = &NOISES_N[..campaign::size(1, NOISES_N.len()).min(NOISES_N.len())];
    let seeds = 1..=campaign::size(1, SEEDS) as u64;
    let presses = campaign::size(PRESSES.0, PRESSES.1).min(PRESSES.1);
    let conditions: Vec<(f64, f64)> =
        noises.iter().flat_map(|noise_n| drifts.iter().map(move |drift_n_s| (*noise_n, *drift_n_s))).collect();
    let tasks: Vec<((f64, f64), u64)> =
        conditions.iter().flat_map(|condition| seeds.clone().map(move |seed| (*condition, seed))).collect();
    let ends = in_parallel(&tasks, |&((noise_n, drift_n_s), seed)| {
        let mut spec = bench(BENCHES[0].0);
        let limits = &mut spec.limits;
        limits.force_n = DRIFT_LIMIT_N;
        (limits.depth_mm, limits.stiffness_n_mm) = (DRIFT_DEPTH_MM, DRIFT_STIFFNESS_N_MM);
        let cell = spec.scene.load_cell.get_or_insert_default();
        let sign = if seed % 2 == 0 { -1.0 } else { 1.0 };
        (cell.noise_n, cell.drift_n_s) = (noise_n, sign * drift_n_s);
        let strategy = Strategy::ALL[seed as usize % Strategy::ALL.len()];
        let run = executed(&spec, &plan(&spec, &recipe(strategy, presses, DRIFT_SET_N), seed));
        (end_of(&run.ending), run.truth.force_n, most_of_set(&run), run.ledger.contacts().count())
    });
    for condition in &conditions {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        let (mut most_n, mut of_set, mut made) = (0.0_f64, 0.0_f64, 0);
        for (_, (end, force_n, share, contacts)) in tasks.iter().zip(&ends).filter(|(task, _)| task.0 == *condition) {
            *counts.entry(*end).or_default() += 1;
            (most_n, of_set, made) = (most_n.max(*force_n), of_set.max(*share), made + contacts);
        }
        let (noise_n, drift_n_s) = condition;
        println!(
            "sd {noise_n} N, {} mN/s: {counts:?}, {made} presses, {of_set:.3} x set, {most_n:.3} N",
            1e3 * drift_n_s
        );
    }
    let is_over = |(_, (_, force_n, ..)): &(_, &(_, f64, _, _))| *force_n > DRIFT_LIMIT_N;
    let over = tasks.iter().zip(&ends).filter(is_over).map(|(task, end)| format!("{task:?}: {end:?}"));
    must_be_none(&over.collect::<Vec<_>>());
}
