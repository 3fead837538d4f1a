//! A method fitted to an old calibration that few new presses have updated.

use super::adapt::{ArrayChange, Older, Update};
use super::rescaled::{HeldAnswer, Rescaled};
use super::{Calibration, FitError, Fitted, Model, PreparedCalibration, Setting, Solver as _, Workspace};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::Place;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Method for the array in its present state, and what is known about the method.
pub struct Adapted {
    /// The method. Its half-widths and its limits of a misfit are those that the new presses show, each held out.
    pub model: Model,
    /// Change of gains and places between the old calibration and the new presses; none for [`Update::Unchanged`] and
    /// [`Update::NewAlone`].
    pub change: ArrayChange,
    /// Way in which the method was made: the one with the smallest location error on held-out presses, among those whose error is
    /// smaller than that of the unchanged calibration by more than chance; or among all if the unchanged one is useless.
    pub update: Update,
    /// Every way that was tried.
    pub tried: Vec<TriedUpdate>,
    /// Number of new presses.
    pub presses: usize,
    /// Mean distance of the new presses from their mean place, mm: the error of an answer that is always this place.
    pub mean_place_mm: f64,
}

/// A way that was tried on the new presses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriedUpdate {
    /// The way.
    pub update: Update,
    /// Mean errors on the new presses, each solved by a method that was made without its place.
    pub held_out: MeanErrors,
}

/// Mean errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeanErrors {
    /// Distance between true and solved place, mm.
    pub location_mm: f64,
    /// Difference between true and solved force, N.
    pub force_n: f64,
}

/// Reason why few presses can't update a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AdaptError {
    /// The presses are from another array.
    #[error("the old calibration has {old} outputs per press, the new presses have {new}")]
    Units {
        /// Number of units in the old calibration.
        old: usize,
        /// Number of units in the new presses.
        new: usize,
    },
    /// There are too few presses.
    #[error("there are {presses} new presses; {FEWEST_PRESSES} are required")]
    TooFew {
        /// Number of presses.
        presses: usize,
    },
    /// A calibration knows its presses by depth.
    #[error("a calibration by depth can't be updated by a few presses: press all its places again")]
    ByDepth,
    /// The method can't be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// Smallest number of new presses.
pub(crate) const FEWEST_PRESSES: usize = 5;

/// Largest probability, by Student's t test, that chance alone gives a way its advantage over the unchanged calibration on held-out
/// presses. Above it the way isn't used.
const BY_CHANCE: f64 = 0.1;

/// Largest number of parts into which the new presses are divided. One part at a time is held out.
const MOST_PARTS: usize = 10;

impl Adapted {
    /// Updates a calibration and fits the method of that name to it. Tries each [`Update`] on the new presses, of which one part at a
    /// time is held out.
    ///
    /// # Errors
    /// The presses are from another array or too few, or the method can't be fitted to the calibration.
    pub fn new(name: &str, old: &Calibration, new: &Calibration, setting: &Setting<'_>) -> Result<Self, AdaptError> {
        if old.units() != new.units() {
            return Err(AdaptError::Units { old: old.units(), new: new.units() });
        }
        if new.len() < FEWEST_PRESSES {
            return Err(AdaptError::TooFew { presses: new.len() });
        }
        if old.depth_curve().or(new.depth_curve()).is_some() {
            return Err(AdaptError::ByDepth);
        }
        let session = NewSession::new(name, old, new, setting)?;
        let trials = session.trials();
        let best = best(&trials);
        let (model, change) = session.model(best)?;
        let tried = trials.iter().map(|tried| TriedUpdate { update: tried.update, held_out: tried.mean() }).collect();
        let (presses, mean_place_mm) = (new.len(), session.mean_place_mm());
        Ok(Adapted { model, change, update: best.update, tried, presses, mean_place_mm })
    }

    /// Returns the errors of the method that was chosen.
    pub fn held_out(&self) -> MeanErrors {
        let chosen = self.tried.iter().find(|tried| tried.update == self.update);
        chosen.map(|tried| tried.held_out).unwrap_or_default()
    }

    /// Whether the method is more accurate than an answer that is always the mean place.
    pub fn beats_mean_place(&self) -> bool {
        self.held_out().location_mm < self.mean_place_mm
    }
}

/// New presses, and the old calibration that they update.
struct NewSession<'a> {
    name: &'a str,
    setting: Setting<'a>,
    old: PreparedCalibration<'a>,
    older: Older<'a>,
    old_presses: &'a Calibration,
    new: &'a Calibration,
    /// Method fitted to the old calibration. Methods for changed presses have the same name, because few presses don't show which
    /// method is best.
    unchanged: Fitted,
    /// Name of the method for the new presses alone; `None` if none can be fitted to them.
    alone: Option<&'static str>,
    /// Part in which each new press is held out. Presses at one place are in the same part.
    part_of: Vec<usize>,
    parts: usize,
}

/// A way, and its answer to each new press by a method that was made without the press's place; `None` if there was no answer.
struct UpdateTrials {
    update: Update,
    answers: Vec<Option<HeldAnswer>>,
    /// Distance of each press from the mean place, mm.
    from_mean_mm: Vec<f64>,
}

/// Answers to the presses of a part, unless no method can be fitted to the others.
type HeldAnswers = Result<Vec<Option<HeldAnswer>>, FitError>;

impl<'a> NewSession<'a> {
    fn new(name: &'a str, old: &'a Calibration, new: &'a Calibration, setting: &Setting<'a>) -> Result<Self, FitError> {
        let spots = new.by_place();
        let parts = spots.len().min(MOST_PARTS);
        let mut part_of = vec![0; new.len()];
        for (spot, presses) in spots.iter().enumerate() {
            presses.iter().for_each(|&press| part_of[press] = spot % parts);
        }
        let prepared = PreparedCalibration::new(old.clone(), setting)?;
        let unchanged = prepared.fit(name)?;
        let alone = super::fit(name, new, setting).ok().map(|fitted| fitted.name());
        let (older, setting) = (Older::new(old)?, *setting);
        Ok(NewSession { name, setting, old: prepared, older, old_presses: old, new, unchanged, alone, part_of, parts })
    }

    /// Returns the ways that may work. Without forces nothing shows a common gain.
    fn updates(&self) -> impl Iterator<Item = Update> {
        let (shows_gain, has_alone) = (self.older.fit(self.new).forces_are_known, self.alone.is_some());
        Update::ALL.into_iter().filter(move |update| match update {
            Update::CommonGain => shows_gain,
            Update::NewAlone => has_alone,
            _ => true,
        })
    }

    /// Returns the method that some new presses give, the presses to which it is fitted, and the change.
    fn fit(&self, update: Update, new: &Calibration) -> Result<(Fitted, Calibration, ArrayChange), FitError> {
        let none = ArrayChange::none(new.units());
        if update == Update::Unchanged {
            return Ok((self.old.fit(self.name)?, self.old_presses.clone(), none));
        }
        if let (Update::NewAlone, Some(name)) = (update, self.alone) {
            let prepared = PreparedCalibration::new(new.clone(), &self.setting)?;
            return Ok((prepared.fit_with_trials_of(&self.old, name)?, new.clone(), none));
        }
        let change = self.older.change(new, update);
        let presses = match update {
            Update::Corrected => self.older.corrected(&change, new),
            _ => self.older.changed(&change),
        };
        Ok((self.old.fit_again(self.unchanged.name(), &presses)?, presses, change))
    }

    /// Returns the model of a way, with the stated errors and the limits that its trials show.
    fn model(&self, trials: &UpdateTrials) -> Result<(Model, ArrayChange), FitError> {
        let (fitted, presses, change) = self.fit(trials.update, self.new)?;
        let answers: Vec<HeldAnswer> = trials.answers.iter().flatten().copied().collect();
        let rescaled = Rescaled::of(&answers, self.older.fit(self.new).forces_are_known);
        // another fit of the new presses alone has its own trials
        let needed = (trials.update != Update::NewAlone).then_some(rescaled);
        Ok((Model::of(fitted.rescaled(&rescaled).needing(needed), presses, &self.setting), change))
    }

    /// Returns the presses of the selected parts.
    fn presses(&self, is_of: impl Fn(usize) -> bool) -> Vec<usize> {
        (0..self.new.len()).filter(|&press| is_of(self.part_of[press])).collect()
    }

    /// Returns the trials of each way for which a method can be fitted.
    fn trials(&self) -> Vec<UpdateTrials> {
        let of_update = |update| (0..self.parts).map(move |part| (update, part));
        let jobs: Vec<(Update, usize)> = self.updates().flat_map(of_update).collect();
        let tried = in_parallel(&jobs, |&(update, part)| self.without(part, update));
        let from_mean_mm = self.distances_mm();
        let of = |(update, tried): (Update, &[HeldAnswers])| {
            let mut answers = vec![None; self.new.len()];
            for (part, found) in tried.iter().enumerate() {
                let presses = self.presses(|of| of == part);
                presses.into_iter().zip(found.as_ref().ok()?).for_each(|(press, answer)| answers[press] = *answer);
            }
            Some(UpdateTrials { update, answers, from_mean_mm: from_mean_mm.clone() })
        };
        self.updates().zip(tried.chunks(self.parts)).filter_map(of).collect()
    }

    /// Returns the answers to the presses of a part by a way that doesn't know them.
    fn without(&self, part: usize, update: Update) -> HeldAnswers {
        let [held, others] = [self.presses(|of| of == part), self.presses(|of| of != part)];
        // all at one place: there is nothing to learn
        if update == Update::Unchanged || others.is_empty() {
            return Ok(self.answers(&self.unchanged, &held));
        }
        Ok(self.answers(&self.fit(update, &self.new.subset(&others))?.0, &held))
    }

    fn answers(&self, fitted: &Fitted, presses: &[usize]) -> Vec<Option<HeldAnswer>> {
        let mut workspace = Workspace::default();
        let answer = |&press: &usize| HeldAnswer::of(fitted, &self.new.point(press), &mut workspace);
        presses.iter().map(answer).collect()
    }

    /// Distance of each new press from their mean place, mm.
    fn distances_mm(&self) -> Vec<f64> {
        let of = |coordinate: fn(Place) -> f64| {
            self.new.points().map(|point| coordinate(point.place)).sum::<f64>() / self.new.len() as f64
        };
        let middle = Place::new(of(|place| place.x_mm), of(|place| place.y_mm));
        self.new.points().map(|point| point.place.distance_mm(middle)).collect()
    }

    fn mean_place_mm(&self) -> f64 {
        self.distances_mm().iter().sum::<f64>() / self.new.len() as f64
    }
}

impl UpdateTrials {
    /// Location error of each press, mm. A press without an answer counts with its distance from the mean place.
    fn location_mm(&self) -> impl Iterator<Item = f64> {
        let error = |(answer, from_mean_mm): (&Option<HeldAnswer>, &f64)| {
            answer.map_or(*from_mean_mm, |answer| answer.errors.location_mm)
        };
        self.answers.iter().zip(&self.from_mean_mm).map(error)
    }

    fn mean(&self) -> MeanErrors {
        let known = self.answers.iter().flatten();
        MeanErrors {
            location_mm: self.location_mm().sum::<f64>() / self.answers.len() as f64,
            force_n: known.clone().map(|answer| answer.errors.force_n).sum::<f64>() / known.count().max(1) as f64,
        }
    }

    /// Whether the location errors are smaller than another way's on the same presses, by more than chance.
    fn leads(&self, other: &UpdateTrials) -> bool {
        let leads: Vec<f64> = other.location_mm().zip(self.location_mm()).map(|(other, own)| other - own).collect();
        let (count, free) = (leads.len() as f64, leads.len() as f64 - 1.0);
        let mean = leads.iter().sum::<f64>() / count;
        let variance = leads.iter().map(|lead| (lead - mean).powi(2)).sum::<f64>() / free;
        let sigmas = StudentsT::new(0.0, 1.0, free).map_or(f64::INFINITY, |t| t.inverse_cdf(1.0 - BY_CHANCE));
        mean > sigmas * (variance / count).sqrt()
    }
}

/// Returns the way with the smallest error among those that lead the unchanged calibration, which is the first one; the unchanged
/// calibration if none does. If the unchanged calibration is no better than the mean place, every smaller error counts as a lead.
fn best(trials: &[UpdateTrials]) -> &UpdateTrials {
    let (unchanged, others) = (&trials[0], &trials[1..]);
    let location_mm = |tried: &UpdateTrials| tried.mean().location_mm;
    let is_useless = location_mm(unchanged) * unchanged.answers.len() as f64 >= unchanged.from_mean_mm.iter().sum();
    let leads = |tried: &&UpdateTrials| match is_useless {
        true => location_mm(tried) < location_mm(unchanged),
        false => tried.leads(unchanged),
    };
    let leading = others.iter().filter(leads);
    leading.min_by(|a, b| location_mm(a).total_cmp(&location_mm(b))).unwrap_or(unchanged)
}
