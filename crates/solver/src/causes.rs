//! Decides what a misfit means: one known contact, a shear, two contacts, or a broken unit.
//!
//! Each explanation has unknowns that one contact doesn't have, and fits better by a gain. A single contact exceeds the limit of each
//! gain at the same false-alarm rate, so gains over their limits are comparable. [`explain`] alone decides.

use crate::SolveError;
use crate::two::{Pair, TwoContacts, limit};
use crate::vector::{ShearPrior, VectorMap, VectorWorkspace};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::ArrayLayout;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// MisfitCause of a reading that isn't that of one contact without shear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MisfitCause {
    /// One contact with a force along the surface.
    Shear,
    /// Two contacts.
    TwoContacts,
    /// One contact, and a unit, counted from 0, that doesn't read it.
    BrokenUnit(usize),
    /// One contact beyond the calibrated area.
    Outside,
}

/// One of several explanations of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The cause.
    pub cause: MisfitCause,
    /// Decrease of the sum of squares compared with one contact.
    pub gain: f64,
    /// Limit that the gain exceeds for single contacts only at the false-alarm rate.
    pub gain_most: f64,
}

impl Candidate {
    /// Returns the part of the gain over its limit.
    pub fn excess(&self) -> f64 {
        self.gain - self.gain_most
    }
}

/// What a reading means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Explanation {
    /// One known contact.
    OneContact,
    /// This cause explains the reading clearly better than the others.
    Is(MisfitCause),
    /// Not one known contact: both causes explain the reading, the first at least as well.
    Either(MisfitCause, MisfitCause),
}

/// Difference of the sums of squares up to which two explanations are as good: odds of one to twenty.
const NEARLY_AS_LIKELY: f64 = 6.0;
/// Number of single contacts from which limits are learned.
const SINGLE_CONTACTS: usize = 500;

/// Returns what a reading means, from the gains of the explanations.
pub fn explain(candidates: &[Candidate]) -> Explanation {
    let mut sorted: Vec<&Candidate> = candidates.iter().filter(|candidate| candidate.excess() > 0.0).collect();
    sorted.sort_by(|a, b| b.excess().total_cmp(&a.excess()));
    match sorted[..] {
        [] => Explanation::OneContact,
        [best, second, ..] if best.excess() - second.excess() < NEARLY_AS_LIKELY => {
            Explanation::Either(best.cause, second.cause)
        }
        [best, ..] => Explanation::Is(best.cause),
    }
}

/// Tries all explanations on the map of a calibration.
#[derive(Clone, Debug)]
pub struct Causes {
    map: Arc<VectorMap>,
    two: TwoContacts,
    /// Each unit with its outputs.
    units: Vec<(usize, Range<usize>)>,
    limits: GainLimits,
}

/// Gains of the explanations that a single contact exceeds only at the false-alarm rate.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct GainLimits {
    two: f64,
    shear: f64,
    broken: f64,
}

impl Causes {
    /// Learns the limits from the calibration's presses.
    pub fn new(map: impl Into<Arc<VectorMap>>, layout: &ArrayLayout) -> Self {
        Causes::of(map.into(), layout.units().enumerate().collect(), None)
    }

    /// Prepares an array with these units. Learns the limits if they aren't known.
    pub(crate) fn of(map: Arc<VectorMap>, units: Vec<(usize, Range<usize>)>, limits: Option<GainLimits>) -> Self {
        if let Some(limits) = limits {
            return Causes { two: TwoContacts::limited(map.clone(), limits.two), map, units, limits };
        }
        let two = TwoContacts::new(map.clone());
        let singles = map.single_contacts(SINGLE_CONTACTS);
        let limits = GainLimits { two: two.gain_most, shear: f64::INFINITY, broken: f64::INFINITY };
        let share = map.false_alarms;
        let mut causes = Causes { map, two, units, limits };
        let tried: Vec<Option<Vec<Candidate>>> =
            in_parallel(&singles, |outputs| causes.candidates(outputs, &mut VectorWorkspace::default()).ok());
        let most = |is_it: fn(&MisfitCause) -> bool| {
            let all = tried.iter().flatten().flatten().filter(|candidate| is_it(&candidate.cause));
            limit(all.map(|candidate| candidate.gain).collect(), share)
        };
        causes.limits.shear = most(|cause| *cause == MisfitCause::Shear);
        causes.limits.broken = most(|cause| matches!(cause, MisfitCause::BrokenUnit(_)));
        causes
    }

    pub(crate) fn limits(&self) -> GainLimits {
        self.limits
    }

    /// The map of the calibration.
    pub fn map(&self) -> &VectorMap {
        &self.map
    }

    /// Returns all explanations of a reading. Of the units, only the one whose absence explains most is a candidate, if the rest then
    /// fits. A shear is one if the calibration shows its effect.
    ///
    /// # Errors
    /// The reading has another number of outputs, a number isn't finite, or no press explains any of it.
    pub fn candidates(&self, outputs: &[f64], w: &mut VectorWorkspace) -> Result<Vec<Candidate>, SolveError> {
        Ok(self.compared(outputs, w)?.0)
    }

    /// Returns all explanations of a reading, and the best pair of contacts.
    pub(crate) fn compared(
        &self,
        outputs: &[f64],
        w: &mut VectorWorkspace,
    ) -> Result<(Vec<Candidate>, Option<Pair>), SolveError> {
        self.map.check(outputs)?;
        let (one, pair, gain) = self.two.gain(outputs, w).ok_or_else(|| self.map.unexplained(outputs, w))?;
        let mut candidates = vec![Candidate { cause: MisfitCause::TwoContacts, gain, gain_most: self.limits.two }];
        if self.map.knows_shear()
            && let Some(fit) = self.map.best(outputs, ShearPrior::Usual, 0..0, w)
        {
            let gain = one.chi2 - fit.chi2;
            candidates.push(Candidate { cause: MisfitCause::Shear, gain, gain_most: self.limits.shear });
        }
        let without = self.units.iter().filter_map(|(unit, outputs_of)| {
            Some((*unit, outputs_of, self.map.best(outputs, ShearPrior::Zero, outputs_of.clone(), w)?.chi2))
        });
        if let Some((unit, outputs_of, chi2)) = without.min_by(|a, b| a.2.total_cmp(&b.2)) {
            let (gain, gain_most) = (one.chi2 - chi2, self.limits.broken);
            // without a unit another contact is explained better too, but not well
            if gain <= gain_most || self.map.fits_without(outputs, outputs_of.clone(), w) {
                candidates.push(Candidate { cause: MisfitCause::BrokenUnit(unit), gain, gain_most });
            }
        }
        let (gain, gain_most) = (one.beyond, self.map.beyond_most());
        candidates.push(Candidate { cause: MisfitCause::Outside, gain, gain_most });
        Ok((candidates, pair))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_excess_wins_and_equals_are_both_named() {
        let candidate = |cause: MisfitCause, gain: f64, gain_most: f64| Candidate { cause, gain, gain_most };
        let explained = |two: f64, shear: f64, broken: f64| {
            explain(&[
                candidate(MisfitCause::TwoContacts, two, 20.0),
                candidate(MisfitCause::Shear, shear, 10.0),
                candidate(MisfitCause::BrokenUnit(3), broken, 12.0),
            ])
        };
        assert_eq!(explained(19.0, 9.0, 12.0), Explanation::OneContact);
        assert_eq!(explained(45.0, 9.0, 11.0), Explanation::Is(MisfitCause::TwoContacts));
        assert_eq!(explained(45.0, 30.0, 5.0), Explanation::Either(MisfitCause::TwoContacts, MisfitCause::Shear));
        assert_eq!(explained(30.0, 30.0, 5.0), Explanation::Is(MisfitCause::Shear), "with fewer unknowns");
        assert_eq!(explained(19.0, 9.0, 13.0), Explanation::Is(MisfitCause::BrokenUnit(3)));
    }
}
