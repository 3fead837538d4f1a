//! One strategy on one bench in one scene, executed to its end or its trip, with the results.

use super::bench::executed;
use super::{StudyError, bound};
use palpate_control::Strategy;
use palpate_core::quantity::round;
use palpate_core::quantity::{ArrayLayout, Range};
use palpate_data::dataset::evaluate::Trial;
use palpate_data::dataset::{Press, PressTruth, Presses, RecordedContact};
use palpate_data::recipe::{GridOrder, Manner, Phase, Places, Plan, Recipe, Step, StepLoad};
use palpate_run::rig::RigSpec;
use palpate_run::run::{Ending, Halt};
use palpate_solver::{ErrorSummary, Evaluation, SOLVERS};
use serde::Serialize;

/// Distance between places, mm. The second constant is the window, s. Both are those of the paper's calibration.
const PITCH_MM: f64 = 0.5;
pub(super) const WINDOW_S: f64 = 0.1;

/// Part of the study to which a condition belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StudyPart {
    /// Time per press as a function of the force error.
    Tolerance,
    /// A specimen stiffer or softer than declared.
    Mismatch,
    /// Scenes on which the loop is tried.
    Scenes,
    /// Cost of the permit's caution.
    Caution,
    /// Kinds of stages.
    Stages,
}

/// One measurement: a square of places pressed with one force by one strategy.
#[derive(Clone, Debug)]
pub struct LoopCondition {
    /// Part of the study.
    pub part: StudyPart,
    /// Name of the bench.
    pub bench: &'static str,
    /// Name of the scene.
    pub scene: String,
    /// The bench with all changes.
    pub spec: RigSpec,
    /// Method by which the force is found.
    pub strategy: Strategy,
    /// Requested force, N.
    pub force_n: f64,
    /// Largest allowed difference between the force in the window and the requested force, N.
    pub tolerance_n: f64,
    /// Places along a side of the square.
    pub side: usize,
    /// Number of presses after the square, at random places on the same square, with random forces of 0.1 to 1 N.
    pub tests: usize,
    /// Random seed for all noise and the specimen.
    pub seed: u64,
}

/// Results of a condition. Errors and peaks are relative to the truth; presses that teach don't count.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConditionOutcome {
    /// Part of the study.
    pub part: StudyPart,
    /// Method by which the force was found.
    pub strategy: Strategy,
    /// Name of the bench.
    pub rig: &'static str,
    /// Name of the scene.
    pub scene: String,
    /// Limits that were set: force, depth, declared stiffness.
    pub limits: String,
    /// The declared stiffness, N/mm.
    pub declared_n_mm: f64,
    /// Requested force, N.
    pub force_set_n: f64,
    /// Requested tolerance, N.
    pub tolerance_n: f64,
    /// Number of planned presses.
    pub points: usize,
    /// Number of completed presses.
    pub done: usize,
    /// Time from one press to the next, median, s; `None` if fewer than two presses were made.
    pub median_s: Option<f64>,
    /// Time from one press to the next, 95th percentile, s.
    pub p95_s: Option<f64>,
    /// Shortest possible time, s.
    pub bound_s: f64,
    /// Ratio of the median to `bound_s`.
    pub ratio: Option<f64>,
    /// Mean of |true force in the window - set force|, mN.
    pub error_mean_mn: Option<f64>,
    /// 95th percentile of the same difference, mN.
    pub error_p95_mn: Option<f64>,
    /// Largest value of the same difference, mN.
    pub error_max_mn: Option<f64>,
    /// Mean of true force - set force, mN.
    pub bias_mn: Option<f64>,
    /// Largest true force at any time minus the set force, mN.
    pub peak_over_mn: Option<f64>,
    /// Number of presses whose force, measured by the load cell, was off by more than the tolerance.
    pub flagged: usize,
    /// Number of broken rules; execution ends at the first.
    pub trips: usize,
    /// Name of the broken rule, or of the device that failed.
    pub rule: Option<String>,
    /// Force that broke the rule, N, if a force did.
    pub trip_force_n: Option<f64>,
    /// Report about the trip.
    pub text: Option<String>,
    /// Whether no other outcome of its rig and part is both faster and more accurate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pareto: Option<bool>,
    /// Time from the run's start to the last press of the square, minutes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub minutes: Option<f64>,
    /// Mean distance between true and solved place in the test, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub location_error_mm: Option<f64>,
    /// Mean difference between solved and set force in the test, N.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solved_force_error_n: Option<f64>,
}

impl ConditionOutcome {
    /// Whether no press was completed. Such a row has no numbers, so a comparison that leaves it out would pass.
    pub fn has_no_press(&self) -> bool {
        self.done == 0
    }
}

impl LoopCondition {
    /// Executes the condition in virtual time, without files.
    ///
    /// # Errors
    /// The bench can't execute the plan.
    pub fn measure(&self) -> Result<ConditionOutcome, StudyError> {
        let plan = self.plan()?;
        let (contacts, ending) = executed(&plan, &self.spec)?;
        Ok(self.outcome(&plan, &contacts, &ending))
    }

    fn plan(&self) -> Result<Plan, StudyError> {
        let half_mm = PITCH_MM * (self.side.max(2) - 1) as f64 / 2.0;
        let square = Range { min: -half_mm, max: half_mm };
        let manner = Manner {
            force_tolerance_n: self.tolerance_n,
            sample_s: WINDOW_S,
            strategy: self.strategy,
            ..Manner::PAPER
        };
        let grid = Places::Grid { x_mm: square, y_mm: square, spacing_mm: PITCH_MM, order: GridOrder::Raster };
        let mut steps = vec![Step::new(Phase::Calibration, grid, StepLoad::Force(self.force_n), manner)];
        if self.tests > 0 {
            let random = Places::Random { count: self.tests as u64, x_mm: square, y_mm: square };
            steps.push(Step::new(Phase::Test, random, StepLoad::RandomForce(Range { min: 0.1, max: 1.0 }), manner));
        }
        let recipe = Recipe::new("study", steps);
        Ok(Plan::new(&recipe, &self.spec.ground(), self.seed)?)
    }

    fn outcome(&self, plan: &Plan, contacts: &[RecordedContact], ending: &Ending) -> ConditionOutcome {
        let ordinary = |contact: &&RecordedContact| phase(contact) == Some(Phase::Calibration);
        let made: Vec<&RecordedContact> = contacts.iter().filter(ordinary).collect();
        let misses_mn: Vec<f64> = made.iter().flat_map(|contact| misses_mn(contact)).collect();
        let error_mn = ErrorSummary::of(&misses_mn.iter().map(|miss| miss.abs()).collect::<Vec<f64>>());
        let time_s = ErrorSummary::of(&intervals_s(contacts));
        let bound_s = bound::least_on_s(&self.spec, self.force_n, PITCH_MM, WINDOW_S);
        let peak_mn =
            made.iter().flat_map(|contact| &contact.truth).map(|truth| to_mn(truth.force_peak_n)).reduce(f64::max);
        let limits = &self.spec.limits;
        let trip = match &ending.halt {
            Some(Halt::Tripped(trip)) => Some(trip),
            _ => None,
        };
        let rule = ending.halt.as_ref().map(|_| trip.map_or("device", |trip| trip.rule.name()).to_owned());
        let solved =
            (self.tests > 0 && ending.halt.is_none()).then(|| solved(contacts, &self.spec.array.layout)).flatten();
        ConditionOutcome {
            part: self.part,
            strategy: self.strategy,
            rig: self.bench,
            scene: self.scene.clone(),
            limits: format!("{} N, {} mm, {} N/mm", limits.force_n, limits.depth_mm, limits.stiffness_n_mm),
            declared_n_mm: limits.stiffness_n_mm,
            force_set_n: self.force_n,
            tolerance_n: self.tolerance_n,
            points: plan.entries.iter().filter(|entry| entry.phase == Phase::Calibration).count(),
            done: made.len(),
            median_s: time_s.map(|time| grain(time.median)),
            p95_s: time_s.map(|time| grain(time.p95)),
            bound_s: grain(bound_s),
            ratio: time_s.map(|time| grain(time.median / bound_s)),
            error_mean_mn: error_mn.map(|error| grain(error.mean)),
            error_p95_mn: error_mn.map(|error| grain(error.p95)),
            error_max_mn: error_mn.map(|error| grain(error.max)),
            bias_mn: error_mn.map(|_| grain(misses_mn.iter().sum::<f64>() / misses_mn.len() as f64)),
            peak_over_mn: peak_mn.map(|peak_mn| grain(peak_mn - to_mn(self.force_n))),
            flagged: made.iter().flat_map(|contact| &contact.levels).filter(|press| press.is_flagged()).count(),
            trips: usize::from(rule.is_some()),
            rule,
            trip_force_n: trip.filter(|trip| trip.unit == "N").map(|trip| grain(trip.measured)),
            text: ending.text(),
            pareto: None,
            minutes: solved.as_ref().and_then(|_| last_s(&made)).map(|last_s| grain(last_s / 60.0)),
            location_error_mm: solved.as_ref().map(|solved| grain(solved.location_error_mm.mean)),
            solved_force_error_n: solved.and_then(|solved| solved.force_error_n).map(|error| grain(error.mean)),
        }
    }
}

/// Purpose of a press.
pub(super) fn phase(contact: &RecordedContact) -> Option<Phase> {
    contact.levels.first().and_then(|press| press.phase)
}

/// Rounds to the reported precision: 0.1 ms, 0.1 uN.
fn grain(value: f64) -> f64 {
    round(value, 4)
}

/// Results of the paper's solver for the test presses, calibrated on the square.
fn solved(contacts: &[RecordedContact], layout: &ArrayLayout) -> Option<Evaluation> {
    Trial::of_run(&Presses::of_contacts("the study", contacts), Some(layout)).ok()?.answers(SOLVERS[0]).ok()
}

fn misses_mn(contact: &RecordedContact) -> impl Iterator<Item = f64> {
    let of = |(press, truth): (&Press, &PressTruth)| Some(to_mn(truth.force_true_n - press.force_set_n?));
    contact.levels.iter().zip(&contact.truth).filter_map(of)
}

/// Times from one press of the square to the next, s. Times before and after a training press are excluded.
fn intervals_s(contacts: &[RecordedContact]) -> Vec<f64> {
    let begun = |contact: &RecordedContact| contact.levels.first().filter(|press| press.is_of(Phase::Calibration))?.t_s;
    contacts.windows(2).filter_map(|pair| Some(begun(&pair[1])? - begun(&pair[0])?)).collect()
}

/// Time at which the last window of some presses ended, s from the run's start.
pub(super) fn last_s(made: &[&RecordedContact]) -> Option<f64> {
    made.iter().flat_map(|contact| &contact.levels).filter_map(|press| Some(press.t_s? + WINDOW_S)).reduce(f64::max)
}

fn to_mn(force_n: f64) -> f64 {
    1000.0 * force_n
}
