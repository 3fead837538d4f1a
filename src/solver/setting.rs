//! The settings of a fit, beside its calibration.

use super::{Calibration, SolveError};
use crate::quantity::ArrayLayout;
use serde::{Deserialize, Serialize};

/// What a fit is given in addition to the calibration.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// Where the units are, for methods that ask: the closest one, or the elastic response at each. Without it the unit with the
    /// largest calibrated output at a point counts as its closest.
    pub layout: Option<&'a ArrayLayout>,
    /// Whether expected contacts press as hard as the calibration did.
    pub load: ForceKnown,
    /// Whether all outputs may be off by one and the same amount, which is then solved for with every reading: forward methods pay
    /// for it with some of their accuracy where there is none. Pearson's correlation never sees it.
    pub common_offset: bool,
    /// How many single contacts may be called something else: the share of false alarms of each verdict.
    pub false_alarms: f64,
    /// The expected forces, N; without it from a tenth of the calibration's to the calibration's.
    pub forces_n: Option<(f64, f64)>,
    /// Whether a method without a map of the array learns from presses that are held out how far it is off. Otherwise its answers
    /// come without errors and are all called ok, at a hundredth of the cost.
    pub appraised: bool,
}

/// Whether the force of expected contacts is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ForceKnown {
    /// It isn't: only what doesn't depend on the amplitude determines the place.
    #[default]
    Unknown,
    /// Assume that every contact has the force of the calibration: the amplitude shows the place too.
    Constant,
}

impl ForceKnown {
    /// The force of a contact, N: the calibration's where the load is constant, else the one whose logarithm was solved.
    ///
    /// # Errors
    /// It isn't finite.
    pub(super) fn force_n(self, calibrated_n: f64, log_solved: f64) -> Result<f64, SolveError> {
        let force_n = match self {
            ForceKnown::Unknown => log_solved.exp(),
            ForceKnown::Constant => calibrated_n,
        };
        if force_n.is_finite() { Ok(force_n) } else { Err(SolveError::OutOfProportion) }
    }
}

/// The least expected force over the calibration's, unless it is given: the paper tests at a tenth.
const LEAST_FORCE_SHARE: f64 = 0.1;

impl Default for Setting<'_> {
    fn default() -> Self {
        Setting {
            layout: None,
            load: ForceKnown::default(),
            common_offset: false,
            false_alarms: 0.01,
            forces_n: None,
            appraised: true,
        }
    }
}

impl<'a> Setting<'a> {
    /// The default, with a layout.
    pub fn of_layout(layout: Option<&'a ArrayLayout>) -> Self {
        Setting { layout, ..Setting::default() }
    }

    /// By what presses of a calibration are scaled, least and most, to represent the expected forces. Presses of several forces, or
    /// of unknown ones, stand for themselves.
    pub(super) fn shares(&self, calibration: &Calibration) -> (f64, f64) {
        let stands_for_itself = !calibration.forces_are_known() || calibration.has_several_forces();
        match (self.load, self.forces_n) {
            _ if stands_for_itself => (1.0, 1.0),
            (ForceKnown::Constant, _) => (1.0, 1.0),
            (ForceKnown::Unknown, Some((least, most))) => {
                let force_n = calibration.typical_force_n();
                (least / force_n, most / force_n)
            }
            (ForceKnown::Unknown, None) => (LEAST_FORCE_SHARE, 1.0),
        }
    }

    /// How many unknowns a reading is solved for.
    pub(super) fn unknowns(&self) -> usize {
        let of_contact = match self.load {
            ForceKnown::Unknown => 3,
            ForceKnown::Constant => 2,
        };
        of_contact + usize::from(self.common_offset)
    }
}
