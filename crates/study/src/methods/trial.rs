//! One method on some readings: its errors, stated uncertainty and time.

use super::covered::{Covered, FoundCoverage};
use super::cramer_rao::MeanBound;
use super::specimen::KnownReadings;
use palpate_core::quantity::round;
use palpate_solver::{
    BEST, Calibration, ContactVerdict, ErrorSummary, FORCE_REFERENCE_N, FitError, Fitted, LOCATION_REFERENCE_MM,
    PreparedCalibration, SOLVERS, Setting, Solver, Workspace,
};
use serde::Serialize;
use statrs::statistics::Statistics as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A method that was fitted or couldn't be fitted.
#[derive(Clone)]
pub struct StudiedMethod {
    /// Requested name.
    pub name: &'static str,
    /// Result of the fit. Methods that are the same share it.
    pub fitted: Result<Arc<Fitted>, FitError>,
}

impl StudiedMethod {
    /// Returns every method, and the choice among them last.
    pub fn all(calibration: &Calibration, setting: &Setting<'_>) -> Vec<StudiedMethod> {
        let prepared = PreparedCalibration::new(calibration.clone(), setting);
        let fit = |name| prepared.as_ref().map_err(Clone::clone)?.fit(name).map(Arc::new);
        let best = StudiedMethod { name: BEST, fitted: fit(BEST) };
        let is_best = |name: &str| best.fitted.as_ref().is_ok_and(|best| best.name() == name);
        let of = |name| {
            // the same method on the same presses is the same again
            let fitted = if is_best(name) { best.fitted.clone() } else { fit(name) };
            StudiedMethod { name, fitted }
        };
        SOLVERS.into_iter().map(of).chain([best.clone()]).collect()
    }

    /// Returns the names in the same order.
    pub fn names() -> impl Iterator<Item = &'static str> {
        SOLVERS.into_iter().chain([BEST])
    }
}

/// Results of a method under one condition. Times are measured; everything else follows from the seed.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MethodRow {
    /// Name of the study.
    pub study: &'static str,
    /// Letter of the noise, or name of the run or the table.
    pub scene: String,
    /// Name of the method.
    pub solver: &'static str,
    /// Method chosen by "best", if it chose the same one each time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen: Option<&'static str>,
    /// Varied condition.
    pub condition: &'static str,
    /// Value of the condition, in the unit that the condition names.
    pub value: f64,
    /// Value in words, if it isn't a quantity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub text: Option<&'static str>,
    /// Number of presses of the calibration.
    pub calibration_presses: usize,
    /// Number of calibrations that were made.
    pub calibrations: usize,
    /// Time of one calibration, minutes, if the study computes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub minutes: Option<f64>,
    /// Number of readings that were solved.
    pub points: usize,
    /// Number of these readings with an answer.
    pub answers: usize,
    /// Distance from the true place, mm; from the nearer place if there are two contacts. Null without answers.
    pub location_error_mm: Option<ErrorSummary>,
    /// Half the 95 % confidence interval of its mean, mm: 1.96 standard errors.
    pub location_error_within_mm: Option<f64>,
    /// Difference from the true force, N; null if the true force is unknown or isn't a single force.
    pub force_error_n: Option<ErrorSummary>,
    /// Measured time of a solve, ns.
    pub ns_per_solve: Option<f64>,
    /// Measured time of an answer of `palpate solve`, ns, which includes reading its line, watching for broken outputs and writing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ns_per_answer: Option<f64>,
    /// Fraction of the readings without an answer, or with a verdict other than ok.
    pub flagged: Option<f64>,
    /// Fraction of the readings without an answer, or with errors above 1 mm or 0.1 N. If there are two contacts, the answer is
    /// farther than 1 mm from both.
    pub wrong: Option<f64>,
    /// Fraction that is wrong and isn't flagged.
    pub wrong_unflagged: Option<f64>,
    /// Fraction of cases in which the truth is within the method's stated half-widths; null if it states none.
    pub coverage: Option<FoundCoverage>,
    /// Smallest possible mean distance, mm.
    pub location_bound_mm: Option<f64>,
    /// Smallest possible mean force error, N.
    pub force_bound_n: Option<f64>,
    /// Name of the bound.
    pub bound: Option<&'static str>,
    /// Whether no other method of its scene is both faster and more accurate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pareto: Option<bool>,
    /// Reason why there is no method.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// Name of the Cramer-Rao bound.
pub(crate) const CRAMER_RAO: &str = "cramer-rao";
/// Name of the bound from the errors that a method states itself.
pub(super) const STATED: &str = "stated by surrogate";

/// Results of a method on readings, added up over any number of calibrations.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    calibrations: usize,
    points: usize,
    locations_mm: Vec<f64>,
    forces_n: Vec<f64>,
    flagged: usize,
    wrong: usize,
    wrong_unflagged: usize,
    covered: Covered,
    taken: Duration,
    chosen: Vec<&'static str>,
    refused: Option<String>,
}

impl Tally {
    /// Solves all readings.
    pub fn of(method: &StudiedMethod, readings: &KnownReadings) -> Tally {
        let solver = match &method.fitted {
            Ok(solver) => solver,
            Err(refused) => return Tally { refused: Some(refused.to_string()), ..Tally::default() },
        };
        let mut tally = Tally { calibrations: 1, points: readings.truths.len(), ..Tally::default() };
        if method.name == BEST {
            tally.chosen.push(solver.name());
        }
        let mut workspace = Workspace::default();
        let began = Instant::now();
        let solved: Vec<_> = readings.iter().map(|(_, outputs)| solver.solve(outputs, &mut workspace)).collect();
        tally.taken = began.elapsed();
        for ((truth, _), solved) in readings.iter().zip(solved) {
            let Ok(solution) = solved else {
                (tally.flagged, tally.wrong) = (tally.flagged + 1, tally.wrong + 1);
                continue;
            };
            let to_first_mm = solution.place.distance_mm(truth.place);
            let to_second_mm = truth.second.map_or(f64::INFINITY, |second| solution.place.distance_mm(second));
            let location_mm = to_first_mm.min(to_second_mm);
            let force_n = truth.force_n.map(|force_n| (solution.force_n - force_n).abs());
            let is_wrong =
                location_mm > LOCATION_REFERENCE_MM || force_n.is_some_and(|error| error > FORCE_REFERENCE_N);
            let is_flagged = solution.verdict != ContactVerdict::Ok;
            tally.covered.count(truth, &solution);
            tally.locations_mm.push(location_mm);
            tally.forces_n.extend(force_n);
            tally.flagged += usize::from(is_flagged);
            tally.wrong += usize::from(is_wrong);
            tally.wrong_unflagged += usize::from(is_wrong && !is_flagged);
        }
        tally
    }

    /// Adds the readings of `other`.
    pub fn add(&mut self, other: Tally) {
        self.calibrations += other.calibrations;
        self.points += other.points;
        self.locations_mm.extend(other.locations_mm);
        self.forces_n.extend(other.forces_n);
        self.flagged += other.flagged;
        self.wrong += other.wrong;
        self.wrong_unflagged += other.wrong_unflagged;
        self.covered.add(other.covered);
        self.taken += other.taken;
        self.chosen.extend(other.chosen);
        self.refused = self.refused.take().or(other.refused);
    }

    /// Returns the row of a method's results. The study fills in the condition.
    pub fn row(&self, solver: &'static str, least: Option<(MeanBound, &'static str)>) -> MethodRow {
        let share = |count: usize| (self.points > 0).then(|| grain(count as f64 / self.points as f64));
        let chosen = self.chosen.first().filter(|first| self.chosen.iter().all(|chosen| chosen == *first));
        MethodRow {
            solver,
            chosen: chosen.copied(),
            calibrations: self.calibrations,
            points: self.points,
            answers: self.locations_mm.len(),
            location_error_mm: summed(&self.locations_mm),
            location_error_within_mm: within(&self.locations_mm).map(grain),
            force_error_n: summed(&self.forces_n),
            ns_per_solve: (self.points > 0).then(|| round(self.taken.as_nanos() as f64 / self.points as f64, 1)),
            flagged: share(self.flagged),
            wrong: share(self.wrong),
            wrong_unflagged: share(self.wrong_unflagged),
            coverage: self.covered.found(),
            location_bound_mm: least.map(|(least, _)| grain(least.location_mm)),
            force_bound_n: least.map(|(least, _)| grain(least.force_n)),
            bound: least.map(|(_, whose)| whose),
            refused: self.refused.clone(),
            ..MethodRow::default()
        }
    }
}

impl MethodRow {
    /// Returns the mean location error, mm.
    pub fn mean_mm(&self) -> Option<f64> {
        self.location_error_mm.map(|error| error.mean)
    }
}

/// Returns a summary of some errors.
fn summed(errors: &[f64]) -> Option<ErrorSummary> {
    // an answer far outside any scene would make a sum that JSON can't express
    let ErrorSummary { mean, median, p95, max } = ErrorSummary::of(errors).filter(|sum| sum.mean.is_finite())?;
    Some(ErrorSummary { mean: grain(mean), median: grain(median), p95: grain(p95), max: grain(max) })
}

/// Returns 1.96 standard errors of the mean.
fn within(errors: &[f64]) -> Option<f64> {
    Some(1.96 * errors.std_dev() / (errors.len() as f64).sqrt()).filter(|within| within.is_finite())
}

/// Rounds to the reported precision: a nanometre, a micronewton, a millionth.
fn grain(value: f64) -> f64 {
    round(value, 6)
}
