//! A value with the uncertainty from the scatter of its repeats.

use crate::acceptance::bound::CONFIDENCE;
use statrs::distribution::{ContinuousCDF, StudentsT};
use statrs::statistics::Statistics as _;

/// Uncertainty of a characteristic from its repeats, in the unit of the value. Assumes that repeats are normally distributed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RepeatUncertainty {
    /// Standard uncertainty of the value.
    pub u: f64,
    /// Number of repeats in the mean.
    pub n: usize,
    /// One-sided 95 % upper bound of its magnitude, by Student's t. For several levels and places, the largest of their bounds.
    pub upper: f64,
}

/// Mean of repeats. Its uncertainty requires at least two repeats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RepeatMean {
    pub value: f64,
    pub known: Option<RepeatUncertainty>,
}

impl RepeatMean {
    /// Returns the mean of repeats; `None` if there are no repeats.
    pub(super) fn of(repeats: &[f64]) -> Option<RepeatMean> {
        let n = repeats.len() as f64;
        let value = if repeats.is_empty() { return None } else { repeats.mean() };
        let known = StudentsT::new(0.0, 1.0, n - 1.0).ok().filter(|_| n > 1.0).map(|student| {
            let u = repeats.std_dev() / n.sqrt();
            RepeatUncertainty { u, n: repeats.len(), upper: value.abs() + student.inverse_cdf(CONFIDENCE) * u }
        });
        Some(RepeatMean { value, known })
    }

    /// Returns the mean difference between two lists of repeats. If the repeats are pairs, the differences of the pairs are
    /// averaged. Otherwise the means are subtracted, and the uncertainty is unknown.
    pub(super) fn of_difference(before: &[f64], after: &[f64]) -> Option<RepeatMean> {
        if before.len() == after.len() {
            let differences: Vec<f64> = before.iter().zip(after).map(|(before, after)| after - before).collect();
            return RepeatMean::of(&differences);
        }
        let (before, after) = (RepeatMean::of(before)?, RepeatMean::of(after)?);
        Some(RepeatMean { value: after.value - before.value, known: None })
    }

    pub(super) fn less(self, other: f64) -> RepeatMean {
        let (value, moved) = (self.value - other, (self.value - other).abs() - self.value.abs());
        RepeatMean { value, known: self.known.map(|known| RepeatUncertainty { upper: known.upper + moved, ..known }) }
    }

    pub(super) fn magnitude(self) -> RepeatMean {
        RepeatMean { value: self.value.abs(), ..self }
    }

    /// Converts to another unit by multiplying by `factor`.
    pub(super) fn scaled(self, factor: f64) -> RepeatMean {
        let size = factor.abs();
        let known = self.known.map(|known| RepeatUncertainty { u: size * known.u, upper: size * known.upper, ..known });
        RepeatMean { value: factor * self.value, known }
    }

    /// Returns the estimate with the larger magnitude, with the larger of the two bounds.
    pub(super) fn worse(self, other: RepeatMean) -> RepeatMean {
        let worst = if other.value.abs() > self.value.abs() { other } else { self };
        let known = self.known.zip(other.known).zip(worst.known);
        let known = known.map(|((a, b), worst)| RepeatUncertainty { upper: a.upper.max(b.upper), ..worst });
        RepeatMean { known, ..worst }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uncertainty_of_a_mean_follows_from_its_repeats() {
        let estimate = RepeatMean::of(&[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        let RepeatUncertainty { u, n, upper } = estimate.known.unwrap();
        assert_eq!(n, 5);
        assert!((estimate.value - 3.0).abs() < 1e-12 && (u - 0.5f64.sqrt()).abs() < 1e-12);
        assert!((upper - (3.0 + 2.131_847 * u)).abs() < 1e-5, "{upper}"); // t of 4 degrees of freedom, 95 %
        assert_eq!(RepeatMean::of(&[7.0]), Some(RepeatMean { value: 7.0, known: None }));
        assert_eq!(RepeatMean::of(&[]), None);
    }

    #[test]
    fn error_shared_by_repeats_cancels_in_their_difference() {
        let (before, after) = ([1.0, 2.0, 4.0], [1.1, 2.1, 4.1]);
        let estimate = RepeatMean::of_difference(&before, &after).unwrap();
        assert!((estimate.value - 0.1).abs() < 1e-12 && estimate.known.unwrap().u < 1e-12, "{estimate:?}");
        assert_eq!(RepeatMean::of_difference(&before[..2], &after).unwrap().known, None);
    }

    #[test]
    fn the_worse_of_two_has_the_larger_bound() {
        let (sure, unsure) = (RepeatMean::of(&[-3.0, -3.0]).unwrap(), RepeatMean::of(&[0.0, 4.0]).unwrap());
        let worse = sure.worse(unsure);
        assert_eq!(worse.value, -3.0);
        assert_eq!(worse.known.unwrap(), RepeatUncertainty { u: 0.0, n: 2, upper: unsure.known.unwrap().upper });
        let half = worse.scaled(-0.5);
        assert_eq!((half.value, half.known.unwrap().u), (1.5, 0.0));
    }
}
