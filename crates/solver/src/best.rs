//! Chooses the method with the smallest errors on held-out presses.

use super::expectation::mean_and_sd;
use super::fitted::{Tie, TriedMethod};
use super::heldout::HeldPress;
use palpate_core::quantity::Place;
use std::collections::BTreeMap;

/// Method and its trials.
pub(super) struct MethodTrials {
    /// Name of the method.
    pub solver: &'static str,
    /// Results on presses whose place was held out; empty if the method couldn't be fitted.
    pub trials: Vec<HeldPress>,
    /// Whether the presses' forces are known; if not, there are no force errors.
    pub forces_are_known: bool,
}

/// Ratio of a method's mean error on the first part of the places to the least mean error above which the method isn't tried
/// further. The second constant is the number of standard errors by which the difference must also exceed zero.
const HOPELESS: f64 = 1.3;
const HOPELESS_SIGMAS: f64 = 3.0;
/// Number of standard errors below which the difference of two methods' errors is small, and the fraction of the error below which
/// it always is.
const TIE_SIGMAS: f64 = 2.0;
const TIE_LEAD: f64 = 0.02;
/// Largest ratio of two mean force errors that counts as an improvement. The second constant is the allowed factor for the
/// location error.
const FORCE_GAIN: f64 = 0.6;
const LOCATION_COST: f64 = 1.1;
/// Mean of the length of a normal vector in the plane, divided by the square root of the sum of both variances.
const MEAN_OF_SD: f64 = 0.886;
/// Least number of places from which this can be decided.
const FEWEST_PLACES: usize = 30;

impl MethodTrials {
    /// Returns the mean error of location, mm, and of force, N, where forces are known. A press without an answer counts with the
    /// largest error that occurred.
    pub(crate) fn candidate(&self) -> TriedMethod {
        let force_errors = self.errors(|trial| Some((trial.answer.as_ref().ok()?.force_n - trial.force_n).abs()));
        TriedMethod {
            solver: self.solver.to_owned(),
            location_error_mm: mean(&self.location_errors()),
            force_error_n: mean(&force_errors).filter(|_| self.forces_are_known),
        }
    }

    /// Whether its mean force error is much smaller than another's: then its force is worth a slightly larger location error.
    pub(crate) fn has_much_less_force_error_than(&self, other: &MethodTrials) -> bool {
        let of = |tried: &MethodTrials| tried.candidate().force_error_n;
        of(self).zip(of(other)).is_some_and(|(own_n, other_n)| own_n <= FORCE_GAIN * other_n)
    }

    /// Mean distance of the trials' places from their mean, mm: the error of an answer that is always the mean place.
    pub(crate) fn mean_place_error_mm(&self) -> Option<f64> {
        let places = || self.inside().map(|trial| trial.place);
        let of = |coordinate: fn(Place) -> f64| mean(&places().map(coordinate).collect::<Vec<f64>>());
        let middle = Place::new(of(|place| place.x_mm)?, of(|place| place.y_mm)?);
        mean(&places().map(|place| place.distance_mm(middle)).collect::<Vec<f64>>())
    }

    /// Mean location error divided by the mean that the standard deviations of the method itself explain.
    pub(crate) fn mean_of_stated(&self) -> Option<f64> {
        let answered = || self.inside().filter_map(|trial| Some((trial, trial.answer.as_ref().ok()?)));
        let errors = answered().map(|(trial, answer)| answer.place.distance_mm(trial.place)).sum::<f64>();
        let stated = answered().map(|(_, answer)| MEAN_OF_SD * answer.scale_mm).sum::<f64>();
        (stated > 0.0).then_some(errors / stated)
    }

    fn location_errors(&self) -> Vec<f64> {
        self.errors(|trial| Some(trial.answer.as_ref().ok()?.place.distance_mm(trial.place)))
    }

    /// Returns the error of each trial inside the area. Returns an empty list if no trial has an answer.
    fn errors(&self, error: impl Fn(&HeldPress) -> Option<f64>) -> Vec<f64> {
        let errors: Vec<Option<f64>> = self.inside().map(error).collect();
        let Some(largest) = errors.iter().flatten().copied().reduce(f64::max) else { return Vec::new() };
        errors.into_iter().map(|error| error.unwrap_or(largest)).collect()
    }

    fn inside(&self) -> impl Iterator<Item = &HeldPress> {
        self.trials.iter().filter(|trial| trial.is_inside)
    }

    /// Returns the mean of the values at each place. There is one value for each trial inside the area.
    fn by_place(&self, values: impl IntoIterator<Item = f64>) -> Vec<f64> {
        let mut places: BTreeMap<(i64, i64), (f64, f64)> = BTreeMap::new();
        for (trial, value) in self.inside().zip(values) {
            let um = |mm: f64| (1000.0 * mm).round() as i64;
            let (sum, count) = places.entry((um(trial.place.x_mm), um(trial.place.y_mm))).or_default();
            *sum += value;
            *count += 1.0;
        }
        places.into_values().map(|(sum, count)| sum / count).collect()
    }

    /// Returns the factor by which the mean location error is smaller than the other method's; 1 if the factor is unknown.
    pub(crate) fn lead(&self, other: &MethodTrials) -> f64 {
        let errors_mm = mean(&other.location_errors()).zip(mean(&self.location_errors()));
        errors_mm.map_or(1.0, |(other_mm, own_mm)| other_mm / own_mm)
    }

    /// Returns the number of standard errors by which the location errors are smaller than the other method's. Both methods are
    /// compared on the same presses, counted by place.
    pub(crate) fn lead_sigmas(&self, other: &MethodTrials) -> f64 {
        let errors = other.location_errors().into_iter().zip(self.location_errors());
        let means = self.by_place(errors.map(|(other, own)| other - own));
        if means.is_empty() {
            return 0.0;
        }
        let (lead, sd) = mean_and_sd(means.iter().copied());
        lead / (sd / (means.len() as f64 - 1.0).max(1.0).sqrt())
    }
}

/// Ranks methods by location error. First come the methods that were tried on all parts of the places, then those that were given
/// up. Methods without an error come last, in the given order.
pub(super) fn ranked(tried: &[MethodTrials]) -> Vec<&MethodTrials> {
    let most = tried.iter().map(|tried| tried.trials.len()).max().unwrap_or(0);
    let key = |tried: &MethodTrials| match mean(&tried.location_errors()) {
        Some(error_mm) => (u8::from(tried.trials.len() < most), error_mm),
        None => (2, 0.0),
    };
    let mut ranked: Vec<_> = tried.iter().map(|tried| (key(tried), tried)).collect();
    ranked.sort_by(|(a, _), (b, _)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    ranked.into_iter().map(|(_, tried)| tried).collect()
}

/// Returns the rank of the method to choose. `may_lead` states whether the method at a rank may be chosen for its location error.
/// Another method is chosen if it has a much smaller force error and nearly as small a location error.
/// `may_lead_by_force` states whether it may.
pub(super) fn leader(
    ranked: &[&MethodTrials],
    may_lead: impl Fn(&usize) -> bool,
    may_lead_by_force: impl Fn(&usize) -> bool,
) -> usize {
    let first = (0..ranked.len()).find(&may_lead).unwrap_or(0);
    let is_near = |rank: &usize| ranked[*rank].lead(ranked[first]) >= 1.0 / LOCATION_COST;
    let has_less = |rank: &usize| ranked[*rank].has_much_less_force_error_than(ranked[first]);
    let is_better = |rank: &usize| *rank != first && is_near(rank) && has_less(rank) && may_lead_by_force(rank);
    (0..ranked.len()).find(is_better).unwrap_or(first)
}

/// Returns the methods that are nearly as good as the first one, with the standard errors of the difference of their errors.
pub(super) fn ties(ranked: &[&MethodTrials]) -> Vec<Tie> {
    let Some((first, others)) = ranked.split_first() else { return Vec::new() };
    let is_whole =
        |other: &&&MethodTrials| other.trials.len() == first.trials.len() && !other.location_errors().is_empty();
    let tie = |other: &&MethodTrials| Tie { solver: other.solver.to_owned(), sigmas: first.lead_sigmas(other).abs() };
    let is_tie =
        |tie: &Tie, other: &&MethodTrials| tie.sigmas < TIE_SIGMAS || (first.lead(other) - 1.0).abs() < TIE_LEAD;
    others
        .iter()
        .filter(is_whole)
        .map(|other| (tie(other), other))
        .filter(|(tie, other)| is_tie(tie, other))
        .map(|(tie, _)| tie)
        .collect()
}

/// Returns for each method whether it should be tried on the other parts of the places, according to its trials on the first
/// part. `counts` states whether others are compared with a method.
pub(super) fn hopeful(tried: &[MethodTrials], counts: impl Fn(&MethodTrials) -> bool) -> Vec<bool> {
    let ranked = tried.iter().filter(|tried| counts(tried));
    let ranked = ranked.filter_map(|tried| Some((tried, mean(&tried.location_errors())?)));
    let best = ranked.min_by(|a, b| a.1.total_cmp(&b.1));
    let Some((best, least_mm)) = best.filter(|(best, _)| best.by_place(best.location_errors()).len() >= FEWEST_PLACES)
    else {
        return vec![true; tried.len()];
    };
    let is_hopeful = |tried: &MethodTrials| {
        let mean_mm = mean(&tried.location_errors());
        mean_mm.is_some_and(|mean_mm| mean_mm <= HOPELESS * least_mm || best.lead_sigmas(tried) < HOPELESS_SIGMAS)
            || tried.has_much_less_force_error_than(best)
    };
    tried.iter().map(is_hopeful).collect()
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LocatedContact, SolveError};

    /// A method whose answers are all off by so much.
    fn tried(solver: &'static str, location_error_mm: f64, force_error_n: f64) -> MethodTrials {
        let trial = |index: u32| {
            let place = Place::new(f64::from(index), 0.0);
            let place_found = Place::new(f64::from(index), location_error_mm);
            let answer: Result<LocatedContact, SolveError> =
                Ok(LocatedContact { place: place_found, force_n: 1.0 + force_error_n, ..LocatedContact::PLAIN });
            HeldPress { place, force_n: 1.0, is_inside: true, loudness: 1.0, answer }
        };
        MethodTrials { solver, trials: (0..40).map(trial).collect(), forces_are_known: true }
    }

    #[test]
    fn a_method_with_much_less_force_error_is_chosen_where_its_location_error_is_nearly_as_small() {
        let leader_of = |second: MethodTrials| {
            let tried = [tried("a", 0.100, 0.040), second];
            leader(&ranked(&tried), |_| true, |_| true)
        };
        assert_eq!(leader_of(tried("b", 0.109, 0.023)), 1);
        assert_eq!(leader_of(tried("b", 0.109, 0.025)), 0, "not much less force error");
        assert_eq!(leader_of(tried("b", 0.112, 0.001)), 0, "too far off");
        let two = [tried("a", 0.100, 0.040), tried("b", 0.109, 0.001)];
        assert_eq!(leader(&ranked(&two), |_| true, |rank| *rank == 0), 0, "it may not be chosen");
        let two = two.map(|tried| MethodTrials { forces_are_known: false, ..tried });
        assert_eq!(leader(&ranked(&two), |_| true, |_| true), 0, "forces that aren't known can't decide");
    }

    #[test]
    fn methods_with_nearly_equal_errors_are_ties() {
        let mut scattered = tried("b", 0.110, 0.040);
        for (index, trial) in scattered.trials.iter_mut().enumerate() {
            if let Ok(answer) = &mut trial.answer {
                answer.place.y_mm += if index % 2 == 0 { 0.1 } else { -0.1 };
            }
        }
        let (first, near, far) = (tried("a", 0.100, 0.040), tried("c", 0.101, 0.040), tried("d", 0.110, 0.040));
        let names = |ranked: &[&MethodTrials]| ties(ranked).into_iter().map(|tie| tie.solver).collect::<Vec<_>>();
        assert_eq!(names(&[&first, &near, &scattered, &far]), ["c", "b"]);
        assert_eq!(names(&[&first, &tried("e", f64::NAN, 0.0)]), [""; 0]);
        assert_eq!(names(&[]), [""; 0]);
    }

    #[test]
    fn a_method_that_is_far_behind_is_tried_further_for_its_force_alone() {
        let tried = [tried("a", 0.100, 0.040), tried("b", 0.150, 0.039), tried("c", 0.150, 0.001)];
        assert_eq!(hopeful(&tried, |_| true), [true, false, true]);
        let tried = tried.map(|tried| MethodTrials { forces_are_known: false, ..tried });
        assert_eq!(hopeful(&tried, |_| true), [true, false, false]);
    }
}
