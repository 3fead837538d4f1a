//! Ways to calibrate a new sensor of a design.

use super::posterior::ArrayPosterior;
use super::{Prior, each_output};
use crate::adapt::Fit;
use crate::competition::{HeldParts, UpdateTrials, best};
use crate::correction::Correction;
use crate::fitted::Answering;
use crate::forward::{Forward, MapKind};
use crate::method::SURROGATE;
use crate::rescaled::Rescaled;
use crate::widths::FEWEST_TRIALS;
use crate::{ArrayChange, Calibration, FitError, Fitted, Model, PreparedCalibration, Setting, TriedUpdate, Update};

/// Presses of a new sensor of a design.
pub(super) struct NewSensor<'a> {
    pub prior: &'a Prior,
    pub new: &'a Calibration,
    pub setting: &'a Setting<'a>,
}

/// The model that the new presses prefer.
pub(super) struct ChosenModel {
    pub model: Model,
    pub update: Update,
    pub tried: Vec<TriedUpdate>,
}

/// Ways that compete. All invert a smooth map: a regression of places is flattered by held-out presses of one force on a grid.
const WAYS: [Update; 3] = [Update::GainsAndPlaces, Update::Corrected, Update::NewAlone];

impl NewSensor<'_> {
    /// Returns the map of the design after the change that some presses show, and the presses of the design that it represents.
    pub(super) fn map(&self, update: Update, known: &Calibration) -> (Forward, Calibration, ArrayChange) {
        let (prior, fit) = (self.prior, Fit { map: &self.prior.map, new: known, forces_are_known: true });
        let posterior = ArrayPosterior::of(&fit, &prior.units, &prior.spread);
        let change = each_output(&posterior.moved, &prior.units, prior.outputs());
        let correction = if update == Update::Corrected { fit.correction(&change) } else { None };
        let response = prior.response(&change, &posterior.covariances, correction.as_ref());
        let changed = prior.map.changed(&prior.calibration, &change);
        let presses = correction.iter().fold(changed, |changed, correction: &Correction| correction.added_to(&changed));
        (Forward::new(MapKind::Smooth, response, &presses, self.setting), presses, change)
    }

    /// Lets the ways compete; `None` with few presses. The design's own way comes first.
    pub(super) fn chosen(&self) -> Result<Option<ChosenModel>, FitError> {
        if self.new.len() < FEWEST_TRIALS {
            return Ok(None);
        }
        let parts = HeldParts::of(self.new);
        // trials of the trials would take most of the time
        let held = NewSensor { setting: &Setting { appraised: false, ..*self.setting }, ..*self };
        let trials = parts.trials(&WAYS, |update, known| Ok(held.fit(update, known)?.0));
        if trials.is_empty() {
            return Ok(None);
        }
        let best = best(&trials);
        let (fitted, presses) = self.fit(best.update, self.new)?;
        // presses alone have their own trials
        let rescaled = if best.update == Update::NewAlone { Rescaled::NONE } else { best.rescaled(true) };
        let model = Model::of(fitted.rescaled(&rescaled).needing(Some(rescaled)), presses, self.setting);
        let tried = trials.iter().map(UpdateTrials::tried).collect();
        Ok(Some(ChosenModel { model, update: best.update, tried }))
    }

    /// Returns the method that some presses give, which states its errors, and the presses that it represents.
    pub(super) fn fit(&self, update: Update, known: &Calibration) -> Result<(Fitted, Calibration), FitError> {
        if update == Update::NewAlone {
            let fitted = PreparedCalibration::new(known.clone(), self.setting)?.fit(SURROGATE)?;
            return Ok((fitted, known.clone()));
        }
        let (forward, presses, _) = self.map(update, known);
        let answering = Answering::Forward(Box::new(forward.stating_normal_errors()));
        Ok((Fitted::new(answering, presses.units()), presses))
    }
}
