//! A stage with a printer's steps under faults: for any fault and any height of the surface, the specimen's limits aren't exceeded. Judged
//! by the true values.
//!
//! `PALPATE_TESTS=full` makes 60 runs of 49 presses, each with a fault.

use crate::faults::bounded;
use palpate_control::Strategy;
use palpate_core::quantity::{Place, Steps, stream};
use palpate_data::recipe::Plan;
use palpate_run::rig::{self, RigSpec};
use palpate_sim::scene::{FaultKind, Mounting, SceneFault};
use palpate_testing::executions::{end_of, executed, in_parallel, must_be_none, plan};
use palpate_testing::{campaign, shipped_text};
use rand::RngExt;
use std::collections::BTreeMap;

/// Runs with a fault: quick and full.
const RUNS: (usize, usize) = (8, 60);

/// The force of the presses, N.
const FORCE_N: f64 = 0.5;

/// Largest part of a peak that a scene may miss between two looks, N.
const PEAK_N: f64 = 0.0005;

/// Steps of z, mm: of printers with finer and coarser screws.
const STEPS_MM: [f64; 4] = [0.000_625, 0.0025, 0.005, 0.01];

/// The faults. A contact much harder than declared isn't one of them: a rig's speed is safe for its declaration.
fn kinds() -> Vec<FaultKind> {
    bounded().into_iter().filter(|kind| *kind != FaultKind::HardContact).collect()
}

fn printer() -> RigSpec {
    let text = shipped_text("rigs/printer.toml");
    rig::parse("printer.toml", &text, &|_| unreachable!("no map of its own")).expect("the shipped rig").simulated()
}

fn seven_by_seven(spec: &RigSpec, strategy: Strategy, seed: u64) -> Plan {
    let text = format!(
        "name = \"printer\"\n[press]\nforce_tolerance_n = 0.02\nstrategy = \"{}\"\n[[step]]\nphase = \"calibration\"\n\
         grid = {{ x_mm = [-4.5, 4.5], y_mm = [-4.5, 4.5], spacing_mm = 1.5 }}\nforce_n = {FORCE_N}\n",
        strategy.name()
    );
    plan(spec, &text, seed)
}

#[test]
fn printer_press_is_within_half_a_step_at_its_recorded_place() {
    for strategy in Strategy::ALL {
        let spec = printer();
        let executed = executed(&spec, &seven_by_seven(&spec, strategy, 1));
        assert!(executed.ending.halt.is_none(), "{strategy:?}: {:?}", executed.ending.text());
        let rows: Vec<_> = executed.ledger.contacts().collect();
        let (mut worst_n, mut presses) = (0.0f64, 0);
        for contact in &rows {
            let (press, truth) = (&contact.levels[0], &contact.truth[0]);
            if press.phase.is_some_and(|phase| phase.name() == "calibration") {
                presses += 1;
                worst_n = worst_n.max((truth.force_true_n - FORCE_N).abs());
            }
            for (at_mm, step_mm) in [(press.x_mm, 0.0125), (press.y_mm, 0.0125), (press.z_mm.unwrap(), 0.0025)] {
                let steps = at_mm / step_mm;
                assert!((steps - steps.round()).abs() < 1e-3, "{strategy:?}: {at_mm} mm is no step");
            }
        }
        println!("{strategy:?}: {presses} presses, {worst_n:.4} N off at most; peak {:.4} N", executed.truth.force_n);
        assert!(presses == 49 && worst_n < 0.02 && executed.truth.force_n < FORCE_N + 0.02, "{strategy:?}");
    }
}

#[test]
fn force_limit_holds_on_a_printer_with_every_failure() {
    let runs = campaign::size(RUNS.0, RUNS.1) as u64;
    // a sound run shows the times at which something may fail
    let sound: Vec<(f64, f64)> = Strategy::ALL
        .map(|strategy| {
            let spec = printer();
            let executed = executed(&spec, &seven_by_seven(&spec, strategy, 1));
            (executed.ready_s, executed.virtual_s)
        })
        .to_vec();
    let seeds: Vec<u64> = (1..=runs).collect();
    let seen = in_parallel(&seeds, |&seed| {
        let mut rng = stream(seed, 0, "printer");
        let nth = rng.random_range(0..Strategy::ALL.len());
        let kinds = kinds();
        let kind = kinds[rng.random_range(0..kinds.len())];
        let from_s = if rng.random_bool(0.2) { 0.0..sound[nth].0 } else { sound[nth].0..sound[nth].1 };
        let mut spec = printer();
        spec.stage.steps = Steps { mm: [0.0125, 0.0125, STEPS_MM[rng.random_range(0..STEPS_MM.len())]], ..Steps::FINE };
        // the phase of the steps below the surface isn't known
        let off_mm = rng.random_range(-0.25..0.25);
        spec.scene.mounting = Some(Mounting { origin: Place::default(), rotation_deg: 0.0, z_mm: off_mm });
        spec.scene.faults = vec![SceneFault { kind, from_s: rng.random_range(from_s), value: None }];
        let executed = executed(&spec, &seven_by_seven(&spec, Strategy::ALL[nth], seed));
        (seed, kind, end_of(&executed.ending), executed.truth, spec)
    });
    let mut ends = BTreeMap::<&str, usize>::new();
    let (mut force_n, mut depth_mm, mut broken) = (0.0f64, 0.0f64, Vec::new());
    for (seed, kind, end, worst, spec) in &seen {
        *ends.entry(end).or_default() += 1;
        (force_n, depth_mm) = (force_n.max(worst.force_n), depth_mm.max(worst.depth_mm));
        let is_within = worst.force_n <= spec.limits.force_n + PEAK_N && worst.depth_mm <= spec.limits.depth_mm;
        if !is_within || worst.slid_mm > 0.0 {
            broken.push(format!("seed {seed}, {kind:?}, {end}: {:.3} N, {:.3} mm", worst.force_n, worst.depth_mm));
        }
        // a motion that the permit refuses is a fault of the loop
        if *end == "not-permitted" {
            broken.push(format!("seed {seed}, {kind:?}: a motion wasn't permitted"));
        }
    }
    println!("{runs} runs: at most {force_n:.3} N and {depth_mm:.3} mm; ends: {ends:?}");
    must_be_none(&broken);
}
