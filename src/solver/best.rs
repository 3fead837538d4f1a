//! The method that errs least on held-out presses.

use super::fitted::{Candidate, Choice};
use super::heldout::HeldPress;

/// How far off a method was in its trials, in the mean: location, mm, and force, N. A press without an answer counts with the
/// largest error that there was.
pub(super) fn candidate(solver: &str, trials: &[HeldPress]) -> Candidate {
    let mean = |error: &dyn Fn(&HeldPress) -> Option<f64>| {
        let errors: Vec<Option<f64>> = trials.iter().map(error).collect();
        let largest = errors.iter().flatten().copied().reduce(f64::max)?;
        Some(errors.iter().map(|error| error.unwrap_or(largest)).sum::<f64>() / errors.len() as f64)
    };
    Candidate {
        solver: solver.to_owned(),
        location_error_mm: mean(&|trial| Some(trial.answer.as_ref().ok()?.place.distance_mm(trial.place))),
        force_error_n: mean(&|trial| Some((trial.answer.as_ref().ok()?.force_n - trial.force_n).abs())),
    }
}

/// Ranks candidates by their location error; those without one come last, in the order given.
pub(super) fn choice(mut candidates: Vec<Candidate>) -> Choice {
    let error = |candidate: &Candidate| candidate.location_error_mm.unwrap_or(f64::INFINITY);
    candidates.sort_by(|a, b| error(a).total_cmp(&error(b)));
    Choice { candidates }
}
