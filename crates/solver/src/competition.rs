//! Ways to make a method of few new presses compete on these presses, each of which is held out.

use super::adapt::Update;
use super::adapted::{MeanErrors, TriedUpdate};
use super::expectation::mean_and_sd;
use super::rescaled::{HeldAnswer, Rescaled};
use super::widths::FEWEST_TRIALS;
use super::{Calibration, FitError, Fitted, Workspace};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::Place;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// New presses in parts, one of which at a time is held out. Presses at one place are in the same part.
pub(super) struct HeldParts<'a> {
    new: &'a Calibration,
    part_of: Vec<usize>,
    parts: usize,
    /// Distance of each press from the mean place, mm.
    from_mean_mm: Vec<f64>,
}

/// A way, and its answer to each new press by a method that was made without the press's place; `None` if there was no answer.
pub(super) struct UpdateTrials {
    pub update: Update,
    answers: Vec<Option<HeldAnswer>>,
    /// Distance of each press from the mean place, mm.
    from_mean_mm: Vec<f64>,
}

/// Answers to the presses of a part, unless no method can be fitted to the others.
type HeldAnswers = Result<Vec<Option<HeldAnswer>>, FitError>;

/// Largest probability, by Student's t test, that chance alone gives a way its advantage over the first one on held-out presses.
/// Above it the way isn't used.
const BY_CHANCE: f64 = 0.1;

/// Smallest share of the first way's error that another way must save. A smaller lead can be sure and yet useless: it changes the
/// way and the message, and no answer.
const WORTHWHILE: f64 = 0.02;

/// Largest number of parts into which the new presses are divided.
const MOST_PARTS: usize = 10;

impl<'a> HeldParts<'a> {
    pub(crate) fn of(new: &'a Calibration) -> Self {
        let spots = new.by_place();
        let parts = spots.len().min(MOST_PARTS);
        let mut part_of = vec![0; new.len()];
        for (spot, presses) in spots.iter().enumerate() {
            presses.iter().for_each(|&press| part_of[press] = spot % parts);
        }
        let of = |coordinate: fn(Place) -> f64| {
            new.points().map(|point| coordinate(point.place)).sum::<f64>() / new.len() as f64
        };
        let middle = Place::new(of(|place| place.x_mm), of(|place| place.y_mm));
        let from_mean_mm = new.points().map(|point| point.place.distance_mm(middle)).collect();
        HeldParts { new, part_of, parts, from_mean_mm }
    }

    /// Mean distance of the new presses from their mean place, mm.
    pub(crate) fn mean_place_mm(&self) -> f64 {
        self.from_mean_mm.iter().sum::<f64>() / self.new.len() as f64
    }

    /// Returns the trials of a method that was made without the new presses.
    pub(crate) fn trials_of(&self, update: Update, fitted: &Fitted) -> UpdateTrials {
        let all: Vec<usize> = (0..self.new.len()).collect();
        UpdateTrials { update, answers: self.answers(fitted, &all), from_mean_mm: self.from_mean_mm.clone() }
    }

    /// Returns the trials of each way for which `fit` makes a method from the presses that aren't held out. There are none if all
    /// presses are at one place.
    pub(crate) fn trials(
        &self,
        updates: &[Update],
        fit: impl Fn(Update, &Calibration) -> Result<Fitted, FitError> + Sync,
    ) -> Vec<UpdateTrials> {
        if self.parts < 2 {
            return Vec::new();
        }
        let of_update = |&update| (0..self.parts).map(move |part| (update, part));
        let jobs: Vec<(Update, usize)> = updates.iter().flat_map(of_update).collect();
        let tried = in_parallel(&jobs, |&(update, part)| -> HeldAnswers {
            let known = self.new.subset(&self.presses(|of| of != part));
            Ok(self.answers(&fit(update, &known)?, &self.presses(|of| of == part)))
        });
        let of = |(&update, tried): (&Update, &[HeldAnswers])| {
            let mut answers = vec![None; self.new.len()];
            for (part, found) in tried.iter().enumerate() {
                let presses = self.presses(|of| of == part);
                presses.into_iter().zip(found.as_ref().ok()?).for_each(|(press, answer)| answers[press] = *answer);
            }
            Some(UpdateTrials { update, answers, from_mean_mm: self.from_mean_mm.clone() })
        };
        updates.iter().zip(tried.chunks(self.parts)).filter_map(of).collect()
    }

    /// Returns the presses of the selected parts.
    fn presses(&self, is_of: impl Fn(usize) -> bool) -> Vec<usize> {
        (0..self.new.len()).filter(|&press| is_of(self.part_of[press])).collect()
    }

    fn answers(&self, fitted: &Fitted, presses: &[usize]) -> Vec<Option<HeldAnswer>> {
        let mut workspace = Workspace::default();
        let answer = |&press: &usize| HeldAnswer::of(fitted, &self.new.point(press), &mut workspace);
        presses.iter().map(answer).collect()
    }
}

impl UpdateTrials {
    /// Returns the way with its mean errors.
    pub(crate) fn tried(&self) -> TriedUpdate {
        let known = self.answers.iter().flatten();
        let held_out = MeanErrors {
            location_mm: self.location_mm().sum::<f64>() / self.answers.len() as f64,
            force_n: known.clone().map(|answer| answer.errors.force_n).sum::<f64>() / known.count().max(1) as f64,
        };
        TriedUpdate { update: self.update, held_out }
    }

    /// Returns the factors for what the method of this way states.
    pub(crate) fn rescaled(&self, forces_are_known: bool) -> Rescaled {
        let answers: Vec<HeldAnswer> = self.answers.iter().flatten().copied().collect();
        Rescaled::of(&answers, forces_are_known)
    }

    /// Location error of each press, mm. A press without an answer counts with its distance from the mean place.
    fn location_mm(&self) -> impl Iterator<Item = f64> {
        let error = |(answer, from_mean_mm): (&Option<HeldAnswer>, &f64)| {
            answer.map_or(*from_mean_mm, |answer| answer.errors.location_mm)
        };
        self.answers.iter().zip(&self.from_mean_mm).map(error)
    }

    /// Whether the location errors are smaller than another way's on the same presses, by a worthwhile share and more than chance.
    fn leads(&self, other: &UpdateTrials) -> bool {
        let leads: Vec<f64> = other.location_mm().zip(self.location_mm()).map(|(other, own)| other - own).collect();
        let (mean, sd) = mean_and_sd(leads.iter().copied());
        if mean < WORTHWHILE * other.tried().held_out.location_mm {
            return false;
        }
        let free = leads.len() as f64 - 1.0;
        let sigmas = StudentsT::new(0.0, 1.0, free).map_or(f64::INFINITY, |t| t.inverse_cdf(1.0 - BY_CHANCE));
        mean > sigmas * sd / free.sqrt()
    }
}

/// Returns the way with the smallest error among those that lead the first one; the first one if none does. If the first one is no
/// better than the mean place, every smaller error counts as a lead. Otherwise the new presses alone need [`FEWEST_TRIALS`] presses.
pub(super) fn best(trials: &[UpdateTrials]) -> &UpdateTrials {
    let (first, others) = (&trials[0], &trials[1..]);
    let location_mm = |tried: &UpdateTrials| tried.tried().held_out.location_mm;
    let is_useless = location_mm(first) * first.answers.len() as f64 >= first.from_mean_mm.iter().sum();
    let leads = |tried: &&UpdateTrials| match is_useless {
        true => location_mm(tried) < location_mm(first),
        false => tried.leads(first),
    };
    // a held-out corner is where the area of few others ends, so they find it without knowing anything
    let may_lead =
        |tried: &&UpdateTrials| tried.update != Update::NewAlone || tried.answers.len() >= FEWEST_TRIALS || is_useless;
    let leading = others.iter().filter(may_lead).filter(leads);
    leading.min_by(|a, b| location_mm(a).total_cmp(&location_mm(b))).unwrap_or(first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ContactVerdict, Solution};

    /// Returns trials with those errors in mm, far from the mean place.
    fn trials(update: Update, location_mm: impl Iterator<Item = f64>) -> UpdateTrials {
        let solution = Solution::plain(Place::default(), 1.0, ContactVerdict::Ok);
        let answer =
            |location_mm| HeldAnswer { solution, errors: MeanErrors { location_mm, force_n: 0.0 }, of_map: 0.0 };
        let answers: Vec<_> = location_mm.map(|error| Some(answer(error))).collect();
        UpdateTrials { update, from_mean_mm: vec![5.0; answers.len()], answers }
    }

    #[test]
    fn another_way_needs_a_lead_that_is_sure_and_worthwhile() {
        let first_mm = || (0..20).map(|press| 0.08 + 0.001 * f64::from(press));
        let with = |saved: f64, stray_mm: f64| {
            let strays = (0..20).map(|press| if press % 2 == 0 { stray_mm } else { -stray_mm });
            let other = trials(Update::Corrected, first_mm().zip(strays).map(|(mm, stray)| (1.0 - saved) * mm + stray));
            best(&[trials(Update::GainsAndPlaces, first_mm()), other]).update
        };
        assert_eq!(with(0.01, 0.0), Update::GainsAndPlaces, "sure, but the answers stay the same");
        assert_eq!(with(0.04, 0.0), Update::Corrected);
        assert_eq!(with(0.04, 0.04), Update::GainsAndPlaces, "chance alone gives such a lead");
    }
}
