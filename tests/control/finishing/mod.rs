//! Stages that finish each motion: printers and arms. Judged by the true values.
//!
//! `PALPATE_TESTS=full` makes 5,000 runs with each.

mod klipper;
mod marlin;
mod ur;

use super::families::{Family, When};
use crate::faults::bounded;
use palpate_control::Strategy;
use palpate_core::quantity::{Place, stream};
use palpate_data::recipe::Plan;
use palpate_run::rig::RigSpec;
use palpate_sim::scene::{ContactLaw, FaultKind, Mounting, SceneFault};
use palpate_testing::campaign;
use palpate_testing::executions::{Deaths, end_of, executed_with, in_parallel, must_be_none, plan};
use rand::RngExt;
use std::collections::BTreeMap;
use std::fmt::Debug;

/// Runs with a fault: quick and full.
const RUNS: (usize, usize) = (48, 5000);

/// Latest beginning of a fault, s.
const FAULT_FROM_S: f64 = 40.0;

/// Largest fraction of the sound runs that may end: a touch too light for twenty readings moves the outputs.
const FALSE_MOST: f64 = 0.01;

/// What is wrong with a run: nothing, the stage, or the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrong<K> {
    Nothing,
    Stage(K),
    Scene(FaultKind),
}

/// A stage that finishes each motion, and what it presses.
struct Finishing<K: 'static> {
    family: Family<K>,
    /// Set force, and the limit of the specimen, N.
    force_n: f64,
    limit_n: f64,
    /// Stiffnesses of the specimen, N/mm.
    stiffnesses_n_mm: &'static [f64],
    /// Faults of the stage; each is twice as frequent as one of the scene.
    faults: &'static [K],
    /// Whether the protocol mends a fault, so that it doesn't end a run.
    is_mended: fn(K) -> bool,
}

impl<K: Copy + Debug + PartialEq + Sync + Send> Finishing<K> {
    /// Returns its rig over a specimen of this stiffness, with a cell that converts at this rate.
    fn rig(&self, stiffness_n_mm: f64, conversions_hz: f64) -> RigSpec {
        let mut spec = self.family.spec();
        (spec.limits.force_n, spec.limits.stiffness_n_mm) = (self.limit_n, stiffness_n_mm);
        spec.load_cell.conversions_hz = conversions_hz;
        spec.scene.contact = ContactLaw { linear_n_mm: stiffness_n_mm, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
        spec.scene.relaxation.clear();
        spec
    }

    fn presses(&self, spec: &RigSpec, count: usize, seed: u64) -> Plan {
        let force_n = self.force_n;
        let text = format!(
            "name = \"finishing\"\nchecks = \"none\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.0\nsample_s = 0.2\n[[step]]\n\
             phase = \"calibration\"\nrandom = {{ count = {count}, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0] }}\nforce_n = {force_n}\n"
        );
        plan(spec, &text, seed)
    }

    /// Presses at places over the specimen. Prints and checks how far off the forces are, and how long a press takes.
    fn check_presses(&self, (stiffness_n_mm, conversions_hz): (f64, f64), most_s: f64) {
        let spec = self.rig(stiffness_n_mm, conversions_hz);
        let plan = self.presses(&spec, campaign::size(60, 100), 1);
        let executed = executed_with(&spec, &plan, Deaths::Ignored, &|_| {});
        assert!(executed.ending.halt.is_none(), "{stiffness_n_mm} N/mm: {:?}", executed.ending.text());
        let contacts = || executed.ledger.contacts();
        let off_n = contacts().map(|contact| (contact.truth[0].force_true_n - self.force_n).abs());
        let worst_n = off_n.fold(0.0, f64::max);
        let times_s: Vec<f64> = contacts().filter_map(|contact| contact.levels[0].t_s).collect();
        let each_s = (times_s[times_s.len() - 1] - times_s[0]) / (times_s.len() - 1) as f64;
        let step_n = spec.stage.steps.reach_n(stiffness_n_mm);
        println!(
            "{}: {stiffness_n_mm} N/mm at {conversions_hz} readings/s: {worst_n:.4} N off at most (half a step: {step_n} N), peak {:.3} N, \
             {each_s:.2} s a press",
            self.family.rig, executed.truth.force_n
        );
        // noise of the mean, and the distance below the level that it makes the loop keep
        assert!(worst_n < 2.0 * step_n + 0.015 && executed.truth.force_n < self.force_n + step_n + 0.015);
        assert!(each_s < most_s, "{each_s} s");
    }

    /// Makes runs with one fault each. None may exceed the force limit. Returns what was wrong and how each run ended.
    fn check_faults(&self, more: &[u64]) -> Vec<(Wrong<K>, &'static str)> {
        let seeds: Vec<u64> = (0..campaign::size(RUNS.0, RUNS.1) as u64).chain(more.iter().copied()).collect();
        let outcomes = in_parallel(&seeds, |&seed| {
            let mut rng = stream(seed, 0, "runs of a printer");
            let stiffness_n_mm = self.stiffnesses_n_mm[rng.random_range(0..self.stiffnesses_n_mm.len())];
            let mut spec = self.rig(stiffness_n_mm, 80.0);
            let within_mm = 0.9 * spec.frame.uncertainty_mm;
            let z_mm = rng.random_range(-within_mm..=within_mm);
            spec.scene.mounting = Some(Mounting { origin: Place::default(), rotation_deg: 0.0, z_mm });
            let (wrong, from_s) = (self.wrong(seed), rng.random_range(0.0..FAULT_FROM_S));
            if let Wrong::Scene(kind) = wrong {
                spec.scene.faults = vec![SceneFault { kind, from_s, value: None }];
            }
            let executed = executed_with(&spec, &self.presses(&spec, 3, seed), Deaths::Ignored, &|rig| {
                if let Wrong::Stage(kind) = wrong {
                    self.family.install(&spec, rig, Some((When::At(from_s), kind)));
                }
            });
            (wrong, executed.truth.force_n, end_of(&executed.ending))
        });
        let over = seeds.iter().zip(&outcomes).filter(|(_, (_, force_n, _))| *force_n > self.limit_n);
        let broken = over.map(|(seed, (wrong, force_n, end))| format!("seed {seed}: {wrong:?}, {force_n:.3} N, {end}"));
        must_be_none(&broken.collect::<Vec<_>>());
        let mut ends: BTreeMap<&str, usize> = BTreeMap::new();
        outcomes.iter().for_each(|(_, _, end)| *ends.entry(end).or_default() += 1);
        let most_n = outcomes.iter().map(|(_, force_n, _)| *force_n).fold(0.0, f64::max);
        let (count, limit_n) = (outcomes.len(), self.limit_n);
        println!("{}: {count} runs, largest force {most_n:.3} of {limit_n} N, ends {ends:?}", self.family.rig);
        let is_sound = |wrong: &Wrong<K>| match wrong {
            Wrong::Nothing => true,
            Wrong::Stage(kind) => (self.is_mended)(*kind),
            Wrong::Scene(_) => false,
        };
        let sound: Vec<_> = outcomes.iter().filter(|(wrong, ..)| is_sound(wrong)).collect();
        let false_ends: Vec<_> = sound.iter().filter(|(_, _, end)| *end != "-").collect();
        println!("{} sound runs, ended all the same: {false_ends:?}", sound.len());
        assert!(false_ends.len() as f64 <= FALSE_MOST * sound.len() as f64, "{false_ends:?}");
        outcomes.into_iter().map(|(wrong, _, end)| (wrong, end)).collect()
    }

    fn wrong(&self, seed: u64) -> Wrong<K> {
        // a contact harder than declared isn't one of them: a rig's motions are safe for its declaration
        let scenes: Vec<FaultKind> = bounded().into_iter().filter(|kind| *kind != FaultKind::HardContact).collect();
        let twice = 2 * self.faults.len();
        match seed as usize % (1 + twice + scenes.len()) {
            0 => Wrong::Nothing,
            nth if nth <= twice => Wrong::Stage(self.faults[(nth - 1) % self.faults.len()]),
            nth => Wrong::Scene(scenes[nth - 1 - twice]),
        }
    }

    /// Checks that a plan with the velocity strategy is refused.
    fn check_velocity_is_refused(&self) {
        let spec = self.rig(self.stiffnesses_n_mm[0], 80.0);
        let text = format!(
            "name = \"fast\"\n[press]\nstrategy = \"velocity\"\n[[step]]\nphase = \"test\"\nrandom = {{ count = 2, x_mm = [-5.0, 5.0], \
             y_mm = [-5.0, 5.0] }}\nforce_n = {}\n",
            self.force_n
        );
        let recipe = palpate_data::recipe::parse("fast.toml", &text).expect("a recipe");
        assert!(recipe.steps.iter().all(|step| step.manner.strategy == Strategy::Velocity));
        let refused = Plan::new(&recipe, &spec.ground(), 1).expect_err("it can't change its speed");
        let refused = format!("{refused:?}");
        assert!(refused.contains("finishes each motion unchanged"), "{refused}");
    }
}
