//! A fit with everything that a session needs: the content of a sensor file.

use super::field::CalibratedArea;
use super::fitted::Answering;
use super::forward::Forward;
use super::rescaled::Rescaled;
use super::{Broken, Calibration, DepthCurve, FitError, Fitted, ForceKnown, PreparedCalibration, Setting};
use palpate_core::quantity::ArrayLayout;
use serde::{Deserialize, Serialize};

/// A method fitted to a calibration, with its setting. Includes the calibration itself if there is space for it.
#[derive(Serialize, Deserialize)]
pub struct Model {
    fitted: Fitted,
    layout: Option<ArrayLayout>,
    load: ForceKnown,
    common_offset: bool,
    false_alarms: f64,
    forces_n: Option<(f64, f64)>,
    validity: Validity,
    calibration: Option<Calibration>,
}

/// Range in which a fit is valid: the range of its calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validity {
    /// Number of outputs of a reading.
    pub units: usize,
    /// Number of presses to which the method was fitted.
    pub presses: usize,
    /// Number of places of these presses.
    pub places: usize,
    /// Smallest and largest x of a press, specimen frame, mm.
    pub x_mm: [f64; 2],
    /// Smallest and largest y of a press, specimen frame, mm.
    pub y_mm: [f64; 2],
    /// Smallest and largest force of a press, N; `None` if forces are unknown.
    pub force_n: Option<[f64; 2]>,
    /// Smallest and largest depth of a press, mm; `None` unless presses are known by their depths. A sensor file has it with the curve.
    #[serde(skip)]
    pub depth_mm: Option<[f64; 2]>,
}

/// Reason why bytes aren't a model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the numbers of the model can't be read: {0}")]
pub struct ModelError(#[from] postcard::Error);

impl Model {
    /// Fits the method of that name, like [`fit`](super::fit).
    ///
    /// # Errors
    /// No method has that name, the layout belongs to another array, or the method can't be fitted to the calibration.
    pub fn fit(name: &str, calibration: Calibration, setting: &Setting<'_>) -> Result<Self, FitError> {
        Ok(Model::of(super::fit(name, &calibration, setting)?, calibration, setting))
    }

    /// Returns the model of a method that was fitted to a calibration.
    pub(super) fn of(fitted: Fitted, calibration: Calibration, setting: &Setting<'_>) -> Self {
        let Setting { layout, load, common_offset, false_alarms, forces_n, .. } = *setting;
        let (layout, validity) = (layout.cloned(), Validity::of(&calibration));
        let calibration = Some(calibration);
        Model { fitted, layout, load, common_offset, false_alarms, forces_n, validity, calibration }
    }

    /// Returns the model of an inverted map.
    pub(super) fn of_forward(forward: Forward, calibration: Calibration, setting: &Setting<'_>) -> Self {
        let fitted = Fitted::new(Answering::Forward(Box::new(forward)), calibration.units());
        Model::of(fitted, calibration, setting)
    }

    /// Returns the model with half-widths from presses that it wasn't fitted to. Other methods than an inverted map stay as they
    /// are, and so does a model whose half-widths come from its own presses, each held out.
    #[must_use]
    pub fn with_half_widths_of(self, test: &Calibration) -> Self {
        if self.fitted.needed().is_some() {
            return self;
        }
        Model { fitted: self.fitted.with_half_widths_of(test), ..self }
    }

    /// Returns the model without the half-widths of [`with_half_widths_of`](Self::with_half_widths_of), for an evaluation on the presses
    /// that gave them.
    #[must_use]
    pub fn without_half_widths(self) -> Self {
        if self.fitted.needed().is_some() {
            return self;
        }
        Model { fitted: self.fitted.without_half_widths(), ..self }
    }

    /// Returns the model of a sensor that gave `own` presses to a fit with a prior.
    pub(super) fn with_own_presses(mut self, own: &Calibration) -> Self {
        (self.validity.presses, self.validity.places) = (own.len(), own.by_place().len());
        self
    }

    /// Returns the method.
    pub fn into_fitted(self) -> Fitted {
        self.fitted
    }

    /// Returns the method.
    pub fn fitted(&self) -> &Fitted {
        &self.fitted
    }

    /// Whether solved forces are in newtons. Otherwise they are relative to the typical press of the calibration, or intensities of
    /// [depths](Self::depths_are_known).
    pub fn forces_are_known(&self) -> bool {
        self.validity.force_n.is_some()
    }

    /// Whether solutions have a depth instead of a force.
    pub fn depths_are_known(&self) -> bool {
        self.fitted.depth_curve().is_some()
    }

    /// Returns the range in which the method is valid.
    pub fn validity(&self) -> &Validity {
        &self.validity
    }

    /// Returns the calibration to which the method was fitted, if it is kept.
    pub fn calibration(&self) -> Option<&Calibration> {
        self.calibration.as_ref()
    }

    /// Returns the setting of the fit.
    pub fn setting(&self) -> Setting<'_> {
        Setting {
            layout: self.layout.as_ref(),
            load: self.load,
            common_offset: self.common_offset,
            false_alarms: self.false_alarms,
            forces_n: self.forces_n,
            appraised: true,
        }
    }

    /// Returns the model without its calibration. This model can't be refitted if a unit is missing or broken.
    pub fn without_calibration(self) -> Self {
        Model { calibration: None, ..self }
    }

    /// Serialises the complete model as bytes (postcard, whose specification is version 1), with exact numbers. The curve of a model
    /// that solves depths follows as a second value, or the factors of the errors that `adapt` found.
    ///
    /// # Errors
    /// No known case.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelError> {
        let bytes = postcard::to_allocvec(self)?;
        match (self.fitted.depth_curve(), self.fitted.needed()) {
            (Some(curve), _) => Ok(postcard::to_extend(curve, bytes)?),
            (None, Some(rescaled)) => Ok(postcard::to_extend(rescaled, bytes)?),
            (None, None) => Ok(bytes),
        }
    }

    /// Reads a model from bytes. Its answers are equal to those of the written model, to the last bit.
    ///
    /// # Errors
    /// The bytes aren't a model of this version.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        let (mut model, rest): (Model, &[u8]) = postcard::take_from_bytes(bytes)?;
        // no curve has as many bytes as the factors
        if let Ok((rescaled, [])) = postcard::take_from_bytes::<Rescaled>(rest) {
            if !rescaled.is_sound() {
                return Err(postcard::Error::DeserializeBadEncoding.into());
            }
            model.fitted = model.fitted.needing(Some(rescaled));
        } else if !rest.is_empty() {
            let curve: DepthCurve = postcard::from_bytes(rest)?;
            if !curve.is_sound() {
                return Err(postcard::Error::DeserializeBadEncoding.into());
            }
            model.validity.depth_mm = Some(curve.range_mm());
            model.calibration = model.calibration.map(|calibration| calibration.with_depth_curve(Some(curve.clone())));
            model.fitted = model.fitted.with_depth_curve(Some(curve));
        }
        Ok(model)
    }

    /// Returns the same method, fitted without these units and the units already left out. `None` without the calibration.
    pub(super) fn fit_without(&self, units: &[Broken]) -> Option<Result<Fitted, FitError>> {
        let calibration = self.calibration.clone()?;
        let broken = [self.fitted.broken(), units].concat();
        let fitted = PreparedCalibration::without(calibration, &self.setting(), broken)
            .and_then(|prepared| prepared.fit_like(&self.fitted))
            .map(|fitted| fitted.stating_as(&self.fitted));
        Some(fitted)
    }
}

impl Validity {
    fn of(calibration: &Calibration) -> Self {
        let forces = || calibration.points().map(|point| point.force_n);
        let force_n = [forces().fold(f64::INFINITY, f64::min), forces().fold(0.0, f64::max)];
        // a calibration has a point at least
        let depth_mm = calibration.depth_curve().map(DepthCurve::range_mm);
        let area = CalibratedArea::around(calibration.points().map(|point| point.place)).unwrap_or_default();
        Validity {
            units: calibration.units(),
            presses: calibration.len(),
            places: calibration.by_place().len(),
            x_mm: [area.least.x_mm, area.most.x_mm],
            y_mm: [area.least.y_mm, area.most.y_mm],
            force_n: calibration.is_in_newtons().then_some(force_n),
            depth_mm,
        }
    }
}
