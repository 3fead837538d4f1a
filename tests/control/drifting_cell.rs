//! A load cell whose zero drifts, as one that gets warm: each run is complete, and the stated uncertainty covers the force.

use super::families::{ESP301, KLIPPER, rig_of, shipped_rig};
use super::glitches::{most_of_set, recipe};
use palpate_control::{SafetyRule, Strategy};
use palpate_core::quantity::{COVERAGE, LoadCellCertificate, Range, StatedError};
use palpate_run::rig::RigSpec;
use palpate_testing::executions::{BENCHES, ExecutedRun, bench, end_of, executed, in_parallel, must_be_none, plan};
use palpate_testing::{campaign, shipped_text};

/// Drifts of a load cell, N/s: none, that of a cell that warms up, and those of wrists (4 N in five minutes).
const DRIFTS_N_S: [f64; 5] = [0.013, 0.020, 0.0, 0.001, 0.004];

/// Noise of a good and of a bad load cell, and its reading without a load, N.
const NOISES_N: [f64; 2] = [0.002, 0.05];
const OFFSETS_N: [f64; 2] = [0.0, 10.0];

/// Set forces and limits, N.
const FORCES_N: [(f64, f64); 2] = [(2.0, 5.0), (5.0, 8.0)];

/// Seeds of a condition in the full tier, and presses: quick, and full.
const SEEDS: usize = 5;
const PRESSES: (usize, usize) = (4, 25);

/// Expanded uncertainty of the cell by its certificate, percent: a good one, so that the zero's part counts.
const U_PERCENT: f64 = 0.1;

/// Declarations of this specimen: its depth at some 6 N, mm, and its stiffness there, N/mm.
const DRIFT_DEPTH_MM: f64 = 4.0;
const DRIFT_STIFFNESS_N_MM: f64 = 4.0;

/// Largest true force over the set one.
const MOST: f64 = 1.1;

/// Least shares of forces within the stated standard uncertainty, and within twice of it.
const COVERED: [f64; 2] = [0.68, 0.95];

/// A load cell and what it presses.
#[derive(Clone, Copy, Debug)]
struct Drifting {
    noise_n: f64,
    drift_n_s: f64,
    offset_n: f64,
    force_n: f64,
    limit_n: f64,
}

impl Drifting {
    /// All of them; in the quick tier one.
    fn some() -> Vec<Drifting> {
        let all = NOISES_N.into_iter().flat_map(|noise_n| {
            DRIFTS_N_S.into_iter().flat_map(move |drift_n_s| {
                OFFSETS_N.into_iter().flat_map(move |offset_n| {
                    FORCES_N.into_iter().map(move |(force_n, limit_n)| Drifting {
                        noise_n,
                        drift_n_s,
                        offset_n,
                        force_n,
                        limit_n,
                    })
                })
            })
        });
        let all: Vec<Drifting> = all.collect();
        all[..campaign::size(1, all.len()).min(all.len())].to_vec()
    }

    /// A rig with this cell. Odd seeds drift up, even ones down.
    fn spec(&self, seed: u64) -> RigSpec {
        // the fast bench reads 10 N at most
        let mut spec = if self.offset_n == 0.0 { bench(BENCHES[0].0) } else { with_hx711() };
        let limits = &mut spec.limits;
        limits.force_n = self.limit_n;
        (limits.depth_mm, limits.stiffness_n_mm) = (DRIFT_DEPTH_MM, DRIFT_STIFFNESS_N_MM);
        let cell = spec.scene.load_cell.get_or_insert_default();
        let sign = if seed.is_multiple_of(2) { -1.0 } else { 1.0 };
        (cell.noise_n, cell.drift_n_s, cell.offset_n) = (self.noise_n, sign * self.drift_n_s, self.offset_n);
        spec.load_cell.air_n = Some(Range { min: -5.0, max: 15.0 });
        let stated = StatedError::Relative { u_percent: U_PERCENT, k: COVERAGE };
        spec.load_cell.certificate =
            Some(LoadCellCertificate { number: "1".into(), date: "2026-05-04".into(), stated, temperature: None });
        spec
    }

    fn executed(&self, seed: u64) -> ExecutedRun {
        let spec = self.spec(seed);
        let strategy = Strategy::ALL[seed as usize % Strategy::ALL.len()];
        let presses = campaign::size(PRESSES.0, PRESSES.1).min(PRESSES.1);
        executed(&spec, &plan(&spec, &recipe(strategy, presses, &format!("[{0}, {0}]", self.force_n)), seed))
    }
}

/// The paper's stage with an HX711 that reads 40 N, 80 times a second.
fn with_hx711() -> RigSpec {
    let text = shipped_text(ESP301.rig);
    let cell = "{ lines = \"hx711\", newton_per_unit = 0.000005 }";
    let text =
        text.replace("{ modbus = \"generic-rs485\" }", cell).replace("conversions_hz = 200.0", "conversions_hz = 80.0");
    rig_of(ESP301.rig, &text)
}

/// Errors of the forces of a run, in stated standard uncertainties.
fn errors(run: &ExecutedRun) -> Vec<f64> {
    let of_press = run.ledger.contacts().map(|contact| {
        let (level, truth) = (&contact.levels[0], &contact.truth[0]);
        let error_n = level.force_n.expect("a force") - truth.force_true_n;
        error_n / level.u_force_n.expect("a certificate makes an uncertainty")
    });
    of_press.collect()
}

#[test]
fn a_drifting_cell_presses_as_a_steady_one() {
    let conditions = Drifting::some();
    let seeds = 1..=campaign::size(2, SEEDS) as u64;
    let tasks: Vec<(usize, u64)> =
        (0..conditions.len()).flat_map(|nth| seeds.clone().map(move |seed| (nth, seed))).collect();
    let ends = in_parallel(&tasks, |&(nth, seed)| {
        let run = conditions[nth].executed(seed);
        (end_of(&run.ending), run.ending.text(), run.truth.force_n, most_of_set(&run), errors(&run))
    });
    let mut broken = Vec::new();
    for (nth, condition) in conditions.iter().enumerate() {
        let of_condition: Vec<_> =
            tasks.iter().zip(&ends).filter(|((of, _), _)| *of == nth).map(|(_, end)| end).collect();
        let errors: Vec<f64> = of_condition.iter().flat_map(|(.., errors)| errors).copied().collect();
        let within = |k: f64| errors.iter().filter(|error| error.abs() <= k).count() as f64 / errors.len() as f64;
        let covered = [within(1.0), within(COVERAGE)];
        let of_set = of_condition.iter().fold(0.0, |most: f64, (_, _, _, of_set, _)| most.max(*of_set));
        println!(
            "{condition:?}: {} presses, {of_set:.3} x set, {:.0} and {:.0} % within one and two u",
            errors.len(),
            100.0 * covered[0],
            100.0 * covered[1]
        );
        let halted =
            of_condition.iter().filter(|(end, ..)| *end != "-").map(|(_, text, ..)| format!("{condition:?}: {text:?}"));
        broken.extend(halted);
        let is_over = of_condition.iter().any(|(_, _, force_n, ..)| *force_n > condition.limit_n) || of_set > MOST;
        // random deviation of so many presses, 3 sd
        let chance = |share: f64| 3.0 * (share * (1.0 - share) / errors.len() as f64).sqrt();
        let is_uncovered = covered.iter().zip(COVERED).any(|(covered, least)| *covered < least - chance(least));
        if is_over || is_uncovered {
            broken.push(format!("{condition:?}: {of_set:.3} x set, {covered:?}"));
        }
    }
    must_be_none(&broken);
}

/// Drifts between what a press bears and what noise hides in half a second, N/s, on a slow link and on a printer.
#[test]
fn a_slow_drift_is_seen_before_the_first_press() {
    let rigs = ["rigs/sim.toml", KLIPPER.rig];
    let all: Vec<(&str, f64)> = rigs
        .into_iter()
        .flat_map(|rig| [0.0033, -0.0067, 0.0025, 0.0067, -0.0033, -0.0025].map(move |drift_n_s| (rig, drift_n_s)))
        .collect();
    let tried: Vec<(&str, f64)> = all.iter().step_by(campaign::every(6, 1)).copied().collect();
    let ends = in_parallel(&tried, |&(rig, drift_n_s)| {
        let mut spec = shipped_rig(rig);
        let cell = spec.scene.load_cell.get_or_insert_default();
        (cell.noise_n, cell.drift_n_s) = (0.003, drift_n_s);
        let recipe = recipe(Strategy::Guarded, campaign::size(3, 25), "[1.0, 1.0]");
        executed(&spec, &plan(&spec, &recipe, 1)).ending.text()
    });
    let halted = tried.iter().zip(&ends).filter(|(_, text)| text.is_some());
    must_be_none(&halted.map(|(rig, text)| format!("{rig:?}: {text:?}")).collect::<Vec<_>>());
}

/// A fifth of the limit in 15 s, 27 mN/s with 2 N.
#[test]
fn a_drift_that_a_press_cannot_bear_is_refused_before_contact() {
    let drifting = Drifting { noise_n: 0.002, drift_n_s: 0.040, offset_n: 0.0, force_n: 1.0, limit_n: 2.0 };
    let run = drifting.executed(1);
    let text = run.ending.text().unwrap_or_default();
    assert_eq!(end_of(&run.ending), SafetyRule::Drifts.name(), "{text}");
    assert!(text.contains("limit 0.0267 N/s"), "{text}");
    assert_eq!(run.truth.force_n, 0.0);
}

/// The message states the least force limit that would pass, and it does, where less doesn't.
#[test]
fn the_stated_force_limit_passes() {
    let drifting = |limit_n: f64| Drifting { noise_n: 0.002, drift_n_s: 0.040, offset_n: 0.0, force_n: 1.0, limit_n };
    let refused = drifting(2.0).executed(1).ending.text().unwrap_or_default();
    let (_, after) = refused.split_once("a `limits.force_n` of at least ").expect("a force limit");
    let least_n: f64 = after.split_once(" N").and_then(|(least_n, _)| least_n.parse().ok()).expect("a number");
    assert!((least_n - 3.0).abs() < 0.05, "0.040 N/s for 15 s are a fifth of it: {refused}");
    let (less, passes) = (drifting(least_n - 0.1).executed(1), drifting(least_n).executed(1));
    assert_eq!(end_of(&less.ending), SafetyRule::Drifts.name(), "{:?}", less.ending.text());
    assert_eq!(passes.ending.text(), None);
    assert!(most_of_set(&passes) <= MOST, "{}", most_of_set(&passes));
}

/// In a rest of five minutes, a drift of 2 mN/s moves the zero by 0.6 N. The air before was too short for this rate to count.
#[test]
fn a_zero_that_drifts_too_far_in_a_rest_is_named_a_drift() {
    let mut spec = shipped_rig("rigs/sim.toml");
    let cell = spec.scene.load_cell.get_or_insert_default();
    (cell.noise_n, cell.drift_n_s) = (0.003, 0.002);
    let recipe = "name = \"rests\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.0\nsample_s = 0.1\n[[step]]\n\
                  phase = \"characterisation\"\nunits = [1, 5]\n\
                  staircase = { to_n = 1.5, step_n = 0.5, repeats = 3, rest_s = 300.0 }\n";
    let text = executed(&spec, &plan(&spec, recipe, 1)).ending.text().unwrap_or_default();
    assert!(text.starts_with("drifts: 0.0020 N/s, limit 0.0017 N/s; let the load cell warm up"), "{text}");
}

/// In a long hold, a drift that forces aren't corrected by moves the zero by more than a touch: 1 mN/s in 30 s, and 2 mN/s in 120 s. Whatever rule
/// it breaks, the drift is named.
#[test]
fn a_drift_that_a_long_hold_does_not_bear_is_named() {
    let all = [(30, 0.001), (30, -0.001), (120, 0.001), (120, -0.001), (120, 0.002)];
    let texts = in_parallel(&all, |&(hold_s, drift_n_s)| {
        let mut spec = shipped_rig("rigs/sim.toml");
        let cell = spec.scene.load_cell.get_or_insert_default();
        (cell.noise_n, cell.drift_n_s) = (0.003, drift_n_s);
        let recipe =
            recipe(Strategy::Guarded, 4, "[0.6, 1.0]").replace("hold_s = 0.0", &format!("hold_s = {hold_s}.0"));
        let run = executed(&spec, &plan(&spec, &recipe, 1));
        (run.ending.text().unwrap_or_default(), run.truth.force_n)
    });
    let is_named = |(text, force_n): &(String, f64)| text.starts_with("drifts: ") && *force_n <= MOST;
    let unnamed = all.iter().zip(&texts).filter(|(_, end)| !is_named(end));
    must_be_none(&unnamed.map(|(tried, end)| format!("{tried:?}: {end:?}")).collect::<Vec<_>>());
}
