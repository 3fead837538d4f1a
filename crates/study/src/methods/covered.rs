//! Fraction of cases in which the truth is within a method's stated half-widths.

use super::specimen::KnownContact;
use palpate_core::quantity::Place;
use palpate_core::quantity::round;
use palpate_solver::Solution;
use serde::Serialize;

/// Stated coverage, %: the fraction of answers whose truth is within the stated half-width if the statement is correct.
pub const STATED_PERCENT: [f64; 2] = [68.0, 95.0];

/// Measured coverage, 0 to 1, for each of [`STATED_PERCENT`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FoundCoverage {
    /// Coverage of the distance between true and solved place.
    pub location: [f64; 2],
    /// Coverage of the force; null if the true force is unknown.
    pub force: Option<[f64; 2]>,
}

/// Number of truths within the stated half-widths.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Covered {
    location: Count,
    force: Count,
}

/// Number of answers, and number of answers within each stated half-width.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    of: usize,
    within: [usize; 2],
}

impl Covered {
    /// Counts one answer. If there are two contacts, the nearer one is the truth.
    pub(super) fn count(&mut self, truth: &KnownContact, solution: &Solution) {
        let Some(half) = solution.half_widths else { return };
        let found = solution.place;
        let is_nearer = |second: &Place| found.distance_mm(*second) < found.distance_mm(truth.place);
        let there = truth.second.filter(is_nearer).unwrap_or(truth.place);
        self.location.add(found.distance_mm(there), [half.half68_mm, half.half95_mm]);
        if let Some(force_n) = truth.force_n {
            self.force.add(solution.force_n - force_n, [half.half68_n, half.half95_n]);
        }
    }

    /// Adds the counts of `other`.
    pub(super) fn add(&mut self, other: Covered) {
        self.location.merge(other.location);
        self.force.merge(other.force);
    }

    /// Returns the coverage; `None` if no half-widths were stated.
    pub(super) fn found(&self) -> Option<FoundCoverage> {
        Some(FoundCoverage { location: self.location.shares()?, force: self.force.shares() })
    }
}

impl Count {
    fn add(&mut self, error: f64, half: [f64; 2]) {
        self.of += 1;
        for (within, half) in self.within.iter_mut().zip(half) {
            *within += usize::from(error.abs() <= half);
        }
    }

    fn merge(&mut self, other: Count) {
        self.of += other.of;
        self.within.iter_mut().zip(other.within).for_each(|(within, others)| *within += others);
    }

    fn shares(&self) -> Option<[f64; 2]> {
        (self.of > 0).then(|| self.within.map(|within| round(within as f64 / self.of as f64, 6)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_solver::{ContactVerdict, HalfWidths};

    #[test]
    fn errors_are_counted_within_what_is_stated() {
        let place = Place::new(1.0, 2.0);
        let half_widths = Some(HalfWidths { half68_mm: 0.25, half95_mm: 0.5, half68_n: 0.5, half95_n: 1.0 });
        let (covariance, other, misfit, verdict) = (None, None, None, ContactVerdict::Ok);
        let solution = Solution {
            depth: None,
            place,
            force_n: 1.0,
            covariance,
            half_widths,
            other,
            misfit,
            verdict,
            is_calibrated_load: false,
        };
        let truth = |x_mm: f64, force_n| KnownContact { place: Place::new(x_mm, 2.05), force_n, second: None };
        let mut covered = Covered::default();
        covered.count(&truth(1.3, Some(2.2)), &solution);
        assert_eq!(covered.found().unwrap().force, Some([0.0, 0.0]));
        covered.count(&truth(1.1, Some(1.4)), &solution);
        covered.count(&truth(2.0, None), &solution);
        covered.count(&truth(1.0, None), &Solution { half_widths: None, ..solution });
        let found = covered.found().unwrap();
        assert_eq!(
            (found.location, found.force),
            ([1.0 / 3.0, 2.0 / 3.0].map(|share| round(share, 6)), Some([0.5, 0.5]))
        );
        let two = KnownContact { place: Place::new(9.0, 9.0), force_n: None, second: Some(place) };
        let mut nearer = Covered::default();
        nearer.count(&two, &solution);
        assert_eq!(nearer.found().unwrap(), FoundCoverage { location: [1.0, 1.0], force: None });
        assert_eq!(Covered::default().found(), None);
    }
}
