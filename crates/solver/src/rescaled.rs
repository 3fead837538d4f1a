//! Stated errors and limits of a method after presses to which it wasn't fitted.

use super::expectation::mean_and_sd;
use super::{CalibrationPoint, Fitted, HalfWidths, MeanErrors, Solution, Solver as _, Workspace};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Factors for what a method states: its half-widths, and its limits of a misfit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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

/// Fractions of errors that the half-widths contain.
const NARROW: f64 = 0.68;
const WIDE: f64 = 0.95;

/// Probability that the misfit of a sound contact exceeds the limit.
const BEYOND: f64 = 0.005;

/// Factor by which the map's error is raised until it explains the errors, and its largest product.
const MAP_ERROR_STEP: f64 = 1.1;
const MOST_MAP_ERROR: f64 = 1e6;

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

    /// Returns the half-widths under a limit of the misfit that is so much larger: fewer answers are widened for their misfit.
    fn half_widths(&self, limit: f64) -> Option<HalfWidths> {
        let by = |misfit: f64| misfit.sqrt().max(1.0);
        let widened = self.solution.misfit.map_or(1.0, |misfit| by(misfit / limit) / by(misfit));
        self.solution.half_widths.map(|half| half.times(widened, widened))
    }
}

impl Rescaled {
    /// No change.
    pub(crate) const NONE: Rescaled = Rescaled { location: [1.0; 2], force: [1.0; 2], map_error: 1.0, misfit: 1.0 };

    /// Returns the factors that held-out presses show. Errors larger than stated are the map's, which is that of another session. What
    /// its growth doesn't explain is a factor of the half-widths (conformal prediction with a scaled score, Lei et al. 2018, section 5.2).
    pub(crate) fn of(answers: &[HeldAnswer], forces_are_known: bool) -> Self {
        let misfits: Vec<f64> = answers.iter().filter_map(|answer| answer.solution.misfit).collect();
        let misfit = upper_bound(&misfits).max(1.0);
        let stated = || answers.iter().filter_map(|answer| Some((answer, answer.half_widths(misfit)?)));
        let scores = |map_error: f64, wide: bool| {
            let score = |(answer, half): (&HeldAnswer, HalfWidths)| {
                let grown = (1.0 + answer.of_map * (map_error - 1.0)).sqrt();
                answer.errors.location_mm / (grown * if wide { half.half95_mm } else { half.half68_mm })
            };
            stated().map(score).collect::<Vec<f64>>()
        };
        let mut map_error = 1.0;
        while within(scores(map_error, false), NARROW) > 1.0 && map_error < MOST_MAP_ERROR {
            map_error *= MAP_ERROR_STEP;
        }
        let location = [within(scores(map_error, false), NARROW), within(scores(map_error, true), WIDE)];
        let force = match forces_are_known {
            true => [
                within(stated().map(|(answer, half)| answer.errors.force_n / half.half68_n).collect(), NARROW),
                within(stated().map(|(answer, half)| answer.errors.force_n / half.half95_n).collect(), WIDE),
            ],
            false => [1.0; 2],
        };
        Rescaled { location, force, map_error, misfit }
    }

    /// Whether all factors are positive numbers.
    pub(crate) fn is_sound(&self) -> bool {
        let Rescaled { location: [a, b], force: [c, d], map_error, misfit } = *self;
        [a, b, c, d, map_error, misfit].iter().all(|factor| factor.is_finite() && *factor > 0.0)
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

/// Returns the value that a further value exceeds with the probability [`BEYOND`], if their logarithms are normal. It is at least the
/// largest value, because all are those of sound contacts, and their tail may be longer.
fn upper_bound(values: &[f64]) -> f64 {
    let logs: Vec<f64> = values.iter().filter(|value| **value > 0.0).map(|value| value.ln()).collect();
    let (mean, sd) = mean_and_sd(logs.iter().copied());
    let (count, free) = (logs.len() as f64, logs.len() as f64 - 1.0);
    let sigmas = StudentsT::new(0.0, 1.0, free).map_or(0.0, |t| t.inverse_cdf(1.0 - BEYOND));
    // the uncertainty of the mean and of the standard deviation counts too
    let bound = (mean + sigmas * sd * ((count + 1.0) / free).sqrt()).exp();
    let largest = values.iter().copied().fold(1.0, f64::max);
    if bound.is_finite() { bound.max(largest) } else { largest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ContactVerdict;
    use palpate_core::quantity::Place;

    fn answer(error_mm: f64, half68_mm: f64, misfit: f64, of_map: f64) -> HeldAnswer {
        let half = HalfWidths { half68_mm, half95_mm: 2.0 * half68_mm, half68_n: 1.0, half95_n: 2.0 };
        let plain = Solution::plain(Place::default(), 1.0, ContactVerdict::Ok);
        let solution = Solution { half_widths: Some(half), misfit: Some(misfit), ..plain };
        HeldAnswer { solution, errors: MeanErrors { location_mm: error_mm, force_n: 0.5 }, of_map }
    }

    #[test]
    fn scores_are_those_of_a_further_press() {
        let scores = |count: usize| (1..=count).map(|i| i as f64).collect::<Vec<f64>>();
        assert_eq!([within(scores(99), NARROW), within(scores(99), WIDE), within(Vec::new(), WIDE)], [68.0, 95.0, 1.0]);
        assert!((within(scores(10), NARROW) - 7.48).abs() < 1e-9);
        // the largest of ten is exceeded by one of eleven
        assert!((within(scores(10), WIDE) - 10.0 * (20f64.ln() / 11f64.ln()).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn half_widths_contain_the_errors_and_errors_of_the_map_explain_them_first() {
        let answers = |of_map: f64| (1..=99).map(|i| answer(0.1 * f64::from(i), 1.0, 0.5, of_map)).collect::<Vec<_>>();
        let noise = Rescaled::of(&answers(0.0), true);
        assert!((noise.location[0] - 6.8).abs() < 1e-9 && (noise.location[1] - 4.75).abs() < 1e-9, "{noise:?}");
        assert!((noise.force[0] - 0.5).abs() < 1e-9, "{noise:?}");
        let map = Rescaled::of(&answers(0.5), true);
        let grown = (0.5 + 0.5 * map.map_error).sqrt();
        assert!((0.95..=1.0).contains(&map.location[0]) && (grown * map.location[0] - 6.8).abs() < 1e-9, "{map:?}");
    }

    #[test]
    fn larger_limit_of_a_misfit_takes_back_what_the_smaller_one_widened() {
        // four times the limit: the stated half-width is twice that of an answer that fits
        let answers: Vec<HeldAnswer> =
            (1..=30).map(|i| answer(1.0, 2.0, if i % 2 == 0 { 4.0 } else { 4.04 }, 0.0)).collect();
        let rescaled = Rescaled::of(&answers, false);
        assert!((4.04..4.2).contains(&rescaled.misfit), "{rescaled:?}");
        assert!((rescaled.location[0] - 1.0).abs() < 0.01 && rescaled.force == [1.0; 2], "{rescaled:?}");
        let fits: Vec<HeldAnswer> = (1..=30).map(|i| answer(1.0, 2.0, 0.01 * f64::from(i), 0.0)).collect();
        assert!(Rescaled::of(&fits, false).misfit >= 1.0, "limits only grow");
    }
}
