//! A method fitted to an old calibration that few new presses have updated.

use super::adapt::{ArrayChange, Older, Update};
use super::competition::{HeldParts, UpdateTrials, best};
use super::{Calibration, FitError, Fitted, Model, PreparedCalibration, Setting, Solver as _};

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
const FEWEST_PRESSES: usize = 5;

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
        let parts = HeldParts::of(new);
        let mut trials = vec![parts.trials_of(Update::Unchanged, &session.unchanged)];
        trials.extend(parts.trials(&session.updates(), |update, known| Ok(session.fit(update, known)?.0)));
        let best = best(&trials);
        let (model, change) = session.into_model(best)?;
        let tried = trials.iter().map(UpdateTrials::tried).collect();
        let (presses, mean_place_mm) = (new.len(), parts.mean_place_mm());
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
}

impl<'a> NewSession<'a> {
    fn new(name: &str, old: &'a Calibration, new: &'a Calibration, setting: &Setting<'a>) -> Result<Self, FitError> {
        let prepared = PreparedCalibration::new(old.clone(), setting)?;
        let unchanged = prepared.fit(name)?;
        let alone = super::fit(name, new, setting).ok().map(|fitted| fitted.name());
        let (older, setting) = (Older::new(old)?, *setting);
        Ok(NewSession { setting, old: prepared, older, old_presses: old, new, unchanged, alone })
    }

    /// Returns the ways that may work and change something. Without forces nothing shows a common gain.
    fn updates(&self) -> Vec<Update> {
        let may_work = |update: &Update| match update {
            Update::Unchanged => false,
            Update::CommonGain => self.forces_are_known(),
            Update::NewAlone => self.alone.is_some(),
            Update::Gains | Update::GainsAndPlaces | Update::Corrected => true,
        };
        Update::ALL.into_iter().filter(may_work).collect()
    }

    fn forces_are_known(&self) -> bool {
        self.older.fit(self.new).forces_are_known
    }

    /// Returns the method that some new presses give, the presses to which it is fitted, and the change.
    fn fit(&self, update: Update, new: &Calibration) -> Result<(Fitted, Calibration, ArrayChange), FitError> {
        if let (Update::NewAlone, Some(name)) = (update, self.alone) {
            let prepared = PreparedCalibration::new(new.clone(), &self.setting)?;
            let fitted = prepared.fit_with_trials_of(&self.old, name)?;
            return Ok((fitted, new.clone(), ArrayChange::none(new.units())));
        }
        let change = self.older.change(new, update);
        let presses = match update {
            Update::Corrected => self.older.corrected(&change, new),
            _ => self.older.changed(&change),
        };
        Ok((self.old.fit_again(self.unchanged.name(), &presses)?, presses, change))
    }

    /// Returns the model of a way, with the stated errors and the limits that its trials show.
    fn into_model(self, trials: &UpdateTrials) -> Result<(Model, ArrayChange), FitError> {
        let rescaled = trials.rescaled(self.forces_are_known());
        let (fitted, presses, change) = match trials.update {
            Update::Unchanged => {
                (self.unchanged, self.old_presses.clone(), ArrayChange::none(self.old_presses.units()))
            }
            update => self.fit(update, self.new)?,
        };
        // another fit of the new presses alone has its own trials
        let needed = (trials.update != Update::NewAlone).then_some(rescaled);
        Ok((Model::of(fitted.rescaled(&rescaled).needing(needed), presses, &self.setting), change))
    }
}
