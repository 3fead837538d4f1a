//! A fit with all that a session needs of it: what a sensor file holds.

use super::field::Area;
use super::{Broken, Calibration, Fault, FitError, Fitted, ForceKnown, Prepared, Setting, Solver as _};
use crate::quantity::ArrayLayout;
use serde::{Deserialize, Serialize};

/// A method fitted to a calibration, with its setting, and with the calibration itself if there is room for it.
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

/// Where a fit holds: what its calibration contains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validity {
    /// The outputs of a reading.
    pub units: usize,
    /// Presses that it was fitted to.
    pub presses: usize,
    /// How many places they are at.
    pub places: usize,
    /// The least and the largest x of a press, specimen frame, mm.
    pub x_mm: [f64; 2],
    /// The same of y, mm.
    pub y_mm: [f64; 2],
    /// The least and the largest force of a press, N; none where forces aren't known.
    pub force_n: Option<[f64; 2]>,
}

/// Why bytes are no model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the numbers of the model can't be read: {0}")]
pub struct ModelError(#[from] postcard::Error);

impl Model {
    /// Fits the method of that name, as [`fit`](super::fit).
    ///
    /// # Errors
    /// No method of that name, another array's layout, or a calibration that the method can't be fitted to.
    pub fn fit(name: &str, calibration: Calibration, setting: &Setting<'_>) -> Result<Self, FitError> {
        let fitted = super::fit(name, &calibration, setting)?;
        let Setting { layout, load, common_offset, false_alarms, forces_n, .. } = *setting;
        let (layout, validity) = (layout.cloned(), Validity::of(&calibration));
        Ok(Model {
            fitted,
            layout,
            load,
            common_offset,
            false_alarms,
            forces_n,
            validity,
            calibration: Some(calibration),
        })
    }

    /// The method.
    pub fn fitted(&self) -> &Fitted {
        &self.fitted
    }

    /// Where it holds.
    pub fn validity(&self) -> &Validity {
        &self.validity
    }

    /// What it was fitted to, if it is kept.
    pub fn calibration(&self) -> Option<&Calibration> {
        self.calibration.as_ref()
    }

    /// The setting of the fit.
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

    /// The same without its calibration: it can't be fitted again where a unit is missing or broken.
    pub fn without_calibration(self) -> Self {
        Model { calibration: None, ..self }
    }

    /// All of it as bytes (postcard, whose specification is version 1), every number as it is.
    ///
    /// # Errors
    /// None that is known.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelError> {
        Ok(postcard::to_allocvec(self)?)
    }

    /// A model from its bytes: it answers as the one that was written, to the last bit.
    ///
    /// # Errors
    /// The bytes aren't a model of this version.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        Ok(postcard::from_bytes(bytes)?)
    }

    /// The same method, fitted without these units beside those that are left out already; none without the calibration.
    pub(super) fn fit_without(&self, units: &[usize], fault: Fault) -> Option<Result<Fitted, FitError>> {
        let calibration = self.calibration.clone()?;
        let mut broken = self.fitted.broken().to_vec();
        broken.extend(units.iter().map(|&unit| Broken { unit, fault }));
        let name = self.fitted.name();
        let fitted = Prepared::without(calibration, &self.setting(), broken).and_then(|prepared| prepared.fit(name));
        Some(fitted.map(|fitted| fitted.widened_as(&self.fitted)))
    }

    /// Multiplies what is stated of the errors of location and of force.
    pub(super) fn widen(&mut self, location: f64, force: f64) {
        self.fitted.widen(location, force);
    }

    /// Puts another fit in the place of the one that there is.
    pub(super) fn replace(&mut self, fitted: Fitted) {
        self.fitted = fitted;
    }
}

impl Validity {
    fn of(calibration: &Calibration) -> Self {
        let forces = || calibration.points().map(|point| point.force_n);
        let force_n = [forces().fold(f64::INFINITY, f64::min), forces().fold(0.0, f64::max)];
        // a calibration has a point at least
        let area = Area::around(calibration.points().map(|point| point.place)).unwrap_or_default();
        Validity {
            units: calibration.units(),
            presses: calibration.len(),
            places: calibration.by_place().len(),
            x_mm: [area.least.x_mm, area.most.x_mm],
            y_mm: [area.least.y_mm, area.most.y_mm],
            force_n: calibration.forces_are_known().then_some(force_n),
        }
    }
}
