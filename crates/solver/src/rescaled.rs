//! Stated errors and limits of a method after presses to which it wasn't fitted.

use super::{CalibrationPoint, Fitted, HalfWidths, MeanErrors, Solution, Solver as _, Workspace};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Factors for what a method states: its half-widths, and its limits of a misfit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rescaled {
    /// Factors of the 68 % and the 95 % half-width of the location.
    pub location: [f64; 2],
    /// The same factors of the force.
    pub force: [f64; 2],
    /// Factor of the part of the location's variance that is the map's error. This part doesn't depend on the force of a contact.
    pub map_error: f64,
    /// Factor of the limits of a misfit.
    pub misfit: f64,
}

/// Answer to a press by a method that was fitted without its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeldAnswer {
    pub solution: Solution,
    pub errors: MeanErrors,
    /// Part of the location's stated variance that is the map's error, 0 to 1.
    pub of_map: f64,
}

/// Part of sound contacts whose misfit exceeds the limit.
const BEYOND: f64 = 0.005;
/// Largest factor of the map's error.
const MOST_MAP_ERROR: f64 = 1e6;
const MAP_ERROR_STEP: f64 = 1.1;

impl HeldAnswer {
    /// Returns the answer of a method; `None` if it has none.
    pub(crate) fn of(fitted: &Fitted, press: &CalibrationPoint<'_>, workspace: &mut Workspace) -> Option<Self> {
        let solution = fitted.solve(press.outputs, workspace).ok()?;
        let errors = MeanErrors {
            location_mm: solution.place.distance_mm(press.place),
            force_n: (solution.force_n - press.force_n).abs(),
        };
        let of_map = fitted.of_map(press.outputs, &solution, workspace);
        Some(HeldAnswer { solution, errors, of_map })
    }
}

impl Rescaled {
    /// Returns the factors that held-out presses show.
    pub(crate) fn of(answers: &[HeldAnswer], forces_are_known: bool) -> Self {
        let stated = || answers.iter().filter_map(|answer| Some((answer, answer.solution.half_widths?)));
        let scores = |map_error: f64, wide: bool| {
            let score = |(answer, half): (&HeldAnswer, HalfWidths)| {
                let grown = (1.0 + answer.of_map * (map_error - 1.0)).sqrt();
                answer.errors.location_mm / (grown * if wide { half.half95_mm } else { half.half68_mm })
            };
            stated().map(score).collect::<Vec<f64>>()
        };
        let mut map_error = 1.0;
        while within(scores(map_error, false), 0.68) > 1.0 && map_error < MOST_MAP_ERROR {
            map_error *= MAP_ERROR_STEP;
        }
        let location = [within(scores(map_error, false), 0.68), within(scores(map_error, true), 0.95)];
        let force = match forces_are_known {
            true => [
                within(stated().map(|(answer, half)| answer.errors.force_n / half.half68_n).collect(), 0.68),
                within(stated().map(|(answer, half)| answer.errors.force_n / half.half95_n).collect(), 0.95),
            ],
            false => [1.0; 2],
        };
        let misfits: Vec<f64> = answers.iter().filter_map(|answer| answer.solution.misfit).collect();
        Rescaled { location, force, map_error, misfit: upper_bound(&misfits).max(1.0) }
    }
}

/// Returns the score that a further score doesn't exceed with a probability: the order statistic of rank (n + 1) p, interpolated. Beyond
/// the largest score it follows the distribution of a distance in the plane with normal errors. 1 without scores.
fn within(mut scores: Vec<f64>, share: f64) -> f64 {
    scores.retain(|score| score.is_finite());
    scores.sort_by(f64::total_cmp);
    let count = scores.len();
    let Some(largest) = scores.last() else { return 1.0 };
    let rank = (count + 1) as f64 * share;
    if rank >= count as f64 {
        let tail = (1.0 - share).ln() / (1.0 / (count + 1) as f64).ln();
        return largest * tail.sqrt();
    }
    let below = (rank.floor() as usize).max(1);
    scores[below - 1] + (rank - below as f64) * (scores[below] - scores[below - 1])
}

/// Returns the value that a further value exceeds with the probability [`BEYOND`], if their logarithms are normal.
fn upper_bound(values: &[f64]) -> f64 {
    let logs: Vec<f64> = values.iter().filter(|value| **value > 0.0).map(|value| value.ln()).collect();
    let (count, free) = (logs.len() as f64, logs.len() as f64 - 1.0);
    let mean = logs.iter().sum::<f64>() / count;
    let variance = logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>() / free;
    let sigmas = StudentsT::new(0.0, 1.0, free).map_or(0.0, |t| t.inverse_cdf(1.0 - BEYOND));
    let bound = (mean + sigmas * (variance * (1.0 + 1.0 / count)).sqrt()).exp();
    if bound.is_finite() { bound } else { 1.0 }
}
