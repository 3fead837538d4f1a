//! The method that errs least on held-out presses.

use super::fitted::{Candidate, Choice};
use super::heldout::HeldPress;
use std::collections::BTreeMap;

/// A method is tried no further if its mean error on the first part of the places is larger than the least by this factor, and by so
/// many standard errors of the difference.
const HOPELESS: f64 = 1.3;
const HOPELESS_SIGMAS: f64 = 3.0;
/// The fewest places from which that can be told.
const FEWEST_PLACES: usize = 30;

/// How far off a method was in its trials, in the mean: location, mm, and force, N. A press without an answer counts with the
/// largest error that there was.
fn candidate(solver: &str, trials: &[HeldPress]) -> Candidate {
    Candidate {
        solver: solver.to_owned(),
        location_error_mm: mean(&location_errors(trials)),
        force_error_n: mean(&errors(trials, |trial| Some((trial.answer.as_ref().ok()?.force_n - trial.force_n).abs()))),
    }
}

/// Ranks methods by the location error of their trials: first those that were tried on all parts of the places, then those that were
/// given up, last those without an error, in the order given.
pub(super) fn choice(names: &[&str], trials: &[Vec<HeldPress>]) -> Choice {
    let most = trials.iter().map(Vec::len).max().unwrap_or(0);
    let ranked = names.iter().zip(trials).map(|(name, trials)| (trials.len() < most, candidate(name, trials)));
    let mut ranked: Vec<(bool, Candidate)> = ranked.collect();
    let key = |(is_given_up, candidate): &(bool, Candidate)| match candidate.location_error_mm {
        Some(error_mm) => (u8::from(*is_given_up), error_mm),
        None => (2, 0.0),
    };
    ranked.sort_by(|a, b| key(a).0.cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1)));
    Choice { candidates: ranked.into_iter().map(|(_, candidate)| candidate).collect() }
}

/// Which methods are worth trying on the other parts of the places, by their trials on the first. `counts` says of a method whether
/// others are compared with it.
pub(super) fn hopeful(trials: &[Vec<HeldPress>], counts: impl Fn(usize) -> bool) -> Vec<bool> {
    let errors: Vec<Vec<f64>> = trials.iter().map(|trials| location_errors(trials)).collect();
    let ranked = |method: &usize| mean(&errors[*method]);
    let best = (0..trials.len())
        .filter(|&method| counts(method) && ranked(&method).is_some())
        .min_by(|a, b| ranked(a).unwrap_or(f64::INFINITY).total_cmp(&ranked(b).unwrap_or(f64::INFINITY)));
    let Some(best) =
        best.filter(|&best| by_place(&trials[best], location_errors(&trials[best])).len() >= FEWEST_PLACES)
    else {
        return vec![true; trials.len()];
    };
    let is_hopeful = |method: usize| match (ranked(&method), ranked(&best)) {
        (Some(mean_mm), Some(least_mm)) => {
            mean_mm <= HOPELESS * least_mm || lead_sigmas(&trials[best], &trials[method]) < HOPELESS_SIGMAS
        }
        _ => false,
    };
    (0..trials.len()).map(is_hopeful).collect()
}

/// By how many standard errors one method's location errors are smaller than another's on the same presses, counted by
/// place.
fn lead_sigmas(leader: &[HeldPress], other: &[HeldPress]) -> f64 {
    let errors = location_errors(other).into_iter().zip(location_errors(leader));
    let means = by_place(leader, errors.map(|(other, leader)| other - leader));
    let Some(lead) = mean(&means) else { return 0.0 };
    let n = means.len() as f64;
    let variance = means.iter().map(|mean| (mean - lead).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    lead / (variance / n).sqrt()
}

/// The mean at each place of values, one a trial.
fn by_place(trials: &[HeldPress], values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut places: BTreeMap<(i64, i64), (f64, f64)> = BTreeMap::new();
    for (trial, value) in trials.iter().filter(|trial| trial.is_inside).zip(values) {
        let um = |mm: f64| (1000.0 * mm).round() as i64;
        let (sum, count) = places.entry((um(trial.place.x_mm), um(trial.place.y_mm))).or_default();
        *sum += value;
        *count += 1.0;
    }
    places.into_values().map(|(sum, count)| sum / count).collect()
}

fn location_errors(trials: &[HeldPress]) -> Vec<f64> {
    errors(trials, |trial| Some(trial.answer.as_ref().ok()?.place.distance_mm(trial.place)))
}

/// The error of each trial inside the area; none at all where no trial has an answer.
fn errors(trials: &[HeldPress], error: impl Fn(&HeldPress) -> Option<f64>) -> Vec<f64> {
    let errors: Vec<Option<f64>> = trials.iter().filter(|trial| trial.is_inside).map(error).collect();
    let Some(largest) = errors.iter().flatten().copied().reduce(f64::max) else { return Vec::new() };
    errors.into_iter().map(|error| error.unwrap_or(largest)).collect()
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
