//! Half-widths that contain a stated fraction of all errors.

use super::Covariance;
use super::heldout::HeldPress;
use super::rescaled::Rescaled;
use serde::{Deserialize, Serialize};

/// Largest errors of a solution in 68 and in 95 of 100 cases. They are learned from calibration presses at held-out places, so
/// they contain the map's errors and not only noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfWidths {
    /// Distance between true and solved place that 68 % of solutions don't exceed, mm.
    pub half68_mm: f64,
    /// Distance that 95 % of solutions don't exceed, mm.
    pub half95_mm: f64,
    /// Difference between true and solved force that 68 % of solutions don't exceed, N.
    pub half68_n: f64,
    /// Difference that 95 % of solutions don't exceed, N.
    pub half95_n: f64,
}

impl HalfWidths {
    /// Returns the same half-widths, increased according to the misfit of a reading that fits worse than one contact.
    pub(super) fn widened(self, misfit: f64) -> Self {
        let by = misfit.sqrt().max(1.0);
        self.times(by, by)
    }

    /// Returns the same half-widths, multiplied by one factor for location and one for force.
    pub(super) fn times(self, location: f64, force: f64) -> Self {
        let HalfWidths { half68_mm, half95_mm, half68_n, half95_n } = self;
        HalfWidths {
            half68_mm: location * half68_mm,
            half95_mm: location * half95_mm,
            half68_n: force * half68_n,
            half95_n: force * half95_n,
        }
    }

    /// Whether all half-widths are finite.
    pub fn is_finite(&self) -> bool {
        [self.half68_mm, self.half95_mm, self.half68_n, self.half95_n].iter().all(|half| half.is_finite())
    }
}

/// Factors that convert a method's own error scale to half-widths (split conformal prediction with a scaled score, Lei et al.
/// 2018, section 5.2).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Widths {
    location: [f64; 2],
    force: [f64; 2],
    /// Factor of the variance of the method's map in errors of location.
    map_error: f64,
}

/// Factor by which the variance of a map is raised until it explains the errors, and its largest product.
const MAP_ERROR_STEP: f64 = 1.5;
const MOST_MAP_ERROR: f64 = 100.0;
/// Ratio of the errors to those of noise from which they are the map's.
const FAR_FROM_NOISE: f64 = 1.4;

/// Fractions of errors that the half-widths contain.
const SHARES: [f64; 2] = [0.68, 0.95];

/// Distance that contains 68 % of normal errors, divided by the square root of the sum of the variances of x and y; and 95 %.
const NORMAL_68: f64 = 1.0675;
const NORMAL_95: f64 = 1.7308;

/// Least number of presses from which the factors can be learned.
pub(super) const FEWEST_TRIALS: usize = 20;

impl Widths {
    /// Those of normal errors, whose covariance is the stated one.
    pub(crate) const NORMAL: Widths = Widths { location: [NORMAL_68, NORMAL_95], force: [1.0, 1.96], map_error: 1.0 };

    /// Returns the half-widths that trials show; `None` if there are few trials. `scale` gives the scales of a trial's errors: of
    /// the location, mm, and of the force, N, and the part of their squares that is due to the map's error.
    pub(crate) fn of<'t>(
        trials: impl IntoIterator<Item = &'t HeldPress>,
        scale: impl Fn(&HeldPress) -> Option<(f64, f64, f64)>,
    ) -> Option<Self> {
        let scored = trials.into_iter().filter_map(|trial| {
            let (answer, (scale_mm, scale_n, of_map)) = (trial.answer.as_ref().ok()?, scale(trial)?);
            let off_n = (answer.force_n - trial.force_n).abs();
            Some([answer.place.distance_mm(trial.place) / scale_mm, off_n / scale_n, of_map])
        });
        let scored: Vec<[f64; 3]> = scored.collect();
        let with = |map_error: f64| {
            let location = quantiles(scored.iter().map(|s| s[0] / grown(s[2], map_error)).collect())?;
            Some(Widths { location, force: quantiles(scored.iter().map(|s| s[1]).collect())?, map_error })
        };
        let mut widths = with(1.0)?;
        // Errors that are far from those of noise are the map's. Such an error is smaller at a place that isn't held out, because the
        // next calibrated place is closer.
        if widths.location[0] > FAR_FROM_NOISE * NORMAL_68 {
            while widths.location[0] > NORMAL_68 && widths.map_error < MOST_MAP_ERROR {
                widths = with(widths.map_error * MAP_ERROR_STEP)?;
            }
        }
        Some(widths)
    }

    /// Returns a covariance from noise alone, enlarged to the observed errors. The scale of the location is the square root of
    /// the sum of both variances; 68 % of normal errors are within 1.07 of it. The scale of the force is one standard deviation.
    pub(crate) fn applied(&self, covariance: Covariance, of_map: f64) -> Covariance {
        let of_location = (grown(of_map, self.map_error) * self.location[0] / NORMAL_68).max(1.0);
        covariance.widened([of_location, of_location, self.force[0].max(1.0)])
    }

    /// Returns the same widths times factors.
    pub(crate) fn rescaled(self, rescaled: &Rescaled) -> Self {
        let times = |of: [f64; 2], by: [f64; 2]| [of[0] * by[0], of[1] * by[1]];
        Widths {
            location: times(self.location, rescaled.location),
            force: times(self.force, rescaled.force),
            map_error: self.map_error * rescaled.map_error,
        }
    }

    /// Part of the half-widths' squares that is due to the map's error, where it is this part of the scales' squares.
    pub(crate) fn of_map(&self, of_map: f64) -> f64 {
        self.map_error * of_map / grown(of_map, self.map_error).powi(2)
    }

    /// Returns the half-widths for these scales of the errors, and the part of their squares that is due to the map's error.
    pub(crate) fn at(&self, scale_mm: f64, scale_n: f64, of_map: f64) -> HalfWidths {
        let by = grown(of_map, self.map_error);
        HalfWidths {
            half68_mm: by * self.location[0] * scale_mm,
            half95_mm: by * self.location[1] * scale_mm,
            half68_n: self.force[0] * scale_n,
            half95_n: self.force[1] * scale_n,
        }
    }
}

/// Factor by which a scale grows if the variance of the map grows by a factor.
fn grown(of_map: f64, map_error: f64) -> f64 {
    (1.0 + of_map * (map_error - 1.0)).sqrt()
}

/// Returns the scores below which a further score is with the probabilities [`SHARES`]; `None` if there are few scores.
fn quantiles(scores: Vec<f64>) -> Option<[f64; 2]> {
    let scores = sorted(scores);
    (scores.len() >= FEWEST_TRIALS).then(|| SHARES.map(|share| ranked(&scores, share)))
}

/// Returns the score below which a further score is with a probability of 68 %, from any number of scores; `None` if there are no
/// scores.
pub(super) fn rank_68(scores: Vec<f64>) -> Option<f64> {
    let scores = sorted(scores);
    (!scores.is_empty()).then(|| ranked(&scores, SHARES[0]))
}

fn sorted(mut scores: Vec<f64>) -> Vec<f64> {
    scores.retain(|score| !score.is_nan());
    scores.sort_by(f64::total_cmp);
    scores
}

/// Returns the score of rank (n + 1) p, rounded up, among n sorted scores.
fn ranked(scores: &[f64], share: f64) -> f64 {
    let n = scores.len();
    scores[(((n + 1) as f64 * share).ceil() as usize).clamp(1, n) - 1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::LocatedContact;
    use palpate_core::quantity::Place;

    #[test]
    fn ranks_are_those_of_a_further_score() {
        let scores = |n: usize| (1..=n).map(|i| i as f64).collect::<Vec<f64>>();
        assert_eq!(quantiles(scores(19)), None);
        assert_eq!(quantiles(scores(20)), Some([15.0, 20.0]));
        assert_eq!(quantiles(scores(99)), Some([68.0, 95.0]));
        let mut with_nan = scores(99);
        with_nan.push(f64::NAN);
        assert_eq!(quantiles(with_nan), Some([68.0, 95.0]));
    }

    #[test]
    fn half_widths_are_the_errors_that_a_further_press_doesnt_exceed() {
        // 0.01 to 0.99 mm, and 0.001 to 0.099 N
        let trial = |i: u32| {
            let (off_mm, off_n) = (0.01 * f64::from(i), 0.001 * f64::from(i));
            let answer =
                LocatedContact { place: Place::new(off_mm, 0.0), force_n: 1.0 - off_n, ..LocatedContact::PLAIN };
            let (place, force_n) = (Place::default(), 1.0);
            HeldPress { place, force_n, is_inside: true, loudness: 1.0, answer: Ok(answer) }
        };
        let trials: Vec<HeldPress> = (1..=99).map(trial).collect();
        let widths = Widths::of(&trials, |_| Some((0.5, 2.0, 0.0))).unwrap();
        let halves = |scale_mm: f64, scale_n: f64| {
            let HalfWidths { half68_mm, half95_mm, half68_n, half95_n } = widths.at(scale_mm, scale_n, 0.0);
            [half68_mm, half95_mm, half68_n, half95_n].map(|half| (half * 1e6).round() / 1e6)
        };
        assert_eq!(halves(0.5, 2.0), [0.68, 0.95, 0.068, 0.095]);
        assert_eq!(halves(1.0, 6.0), [1.36, 1.9, 0.204, 0.285], "they grow with the scales");
    }

    #[test]
    fn misfit_and_errors_beyond_the_noise_only_widen_half_widths() {
        let half = HalfWidths { half68_mm: 0.1, half95_mm: 0.2, half68_n: 0.3, half95_n: 0.4 };
        assert_eq!((half.widened(4.0), half.widened(0.25)), (half.times(2.0, 2.0), half));
        let sds = |location: f64, force: f64| {
            let widths = Widths { location: [location * NORMAL_68, 9.0], force: [force, 9.0], map_error: 1.0 };
            let sd = widths.applied(Covariance([[0.01, 0.0, 0.0], [0.0, 0.04, 0.0], [0.0, 0.0, 0.09]]), 0.0);
            [sd.x_mm(), sd.y_mm(), sd.force_n()].map(|sd| (sd * 1e6).round() / 1e6)
        };
        assert_eq!(sds(2.0, 3.0), [0.2, 0.4, 0.9]);
        assert_eq!([sds(1.0, 1.0), sds(0.5, 0.5)], [[0.1, 0.2, 0.3]; 2]);
    }
}
