//! Settings of a fit, in addition to its calibration.

use super::{Calibration, SolveError};
use palpate_core::quantity::ArrayLayout;
use serde::{Deserialize, Serialize};

/// Input of a fit in addition to the calibration.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// Positions of the units, for methods that need them: for the closest unit, or for the elastic response at each unit.
    /// Without a layout, the unit with the largest calibrated output at a point counts as its closest unit.
    pub layout: Option<&'a ArrayLayout>,
    /// Whether expected contacts have the same force as the calibration.
    pub load: ForceKnown,
    /// Whether all outputs may have the same unknown offset, which is then solved for with every reading. If there is no offset,
    /// forward methods lose some of their accuracy by this. Pearson's correlation doesn't depend on the offset.
    pub common_offset: bool,
    /// Fraction of single contacts that may be called something else: the false-alarm rate of each verdict.
    pub false_alarms: f64,
    /// Expected forces, N. By default from a tenth of the calibration's force to the calibration's force.
    pub forces_n: Option<(f64, f64)>,
    /// Whether a method without a map of the array learns its errors from held-out presses. Otherwise its answers have no errors
    /// and are all called ok, at a hundredth of the cost.
    pub appraised: bool,
}

/// Whether the force of expected contacts is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ForceKnown {
    /// The force is unknown. Only quantities that don't depend on the amplitude determine the place.
    #[default]
    Unknown,
    /// Every contact is assumed to have the force of the calibration, so the amplitude shows the place too.
    Constant,
}

impl ForceKnown {
    /// Returns the force of a contact, N. If the load is constant, it is the calibration's force. Otherwise it follows from the
    /// solved logarithm.
    ///
    /// # Errors
    /// Returns an error if the force isn't finite.
    pub(super) fn force_n(self, calibrated_n: f64, log_solved: f64) -> Result<f64, SolveError> {
        let force_n = match self {
            ForceKnown::Unknown => log_solved.exp(),
            ForceKnown::Constant => calibrated_n,
        };
        if force_n.is_finite() { Ok(force_n) } else { Err(SolveError::OutOfProportion) }
    }
}

/// Least expected force as a fraction of the calibration's force, unless it is given. The paper tests at a tenth.
const LEAST_FORCE_SHARE: f64 = 0.1;

/// Fraction of the accepted false alarms that a limit of one contact causes among the calibration's own presses.
const OF_FALSE_ALARMS: f64 = 0.5;

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
    /// Returns the default setting, with a layout.
    pub fn of_layout(layout: Option<&'a ArrayLayout>) -> Self {
        Setting { layout, ..Setting::default() }
    }

    /// Returns the least and the largest factor by which calibration presses are scaled to represent the expected forces. Presses
    /// of several forces or depths, or of unknown forces, aren't scaled.
    pub(super) fn shares(&self, calibration: &Calibration) -> (f64, f64) {
        let has_depths = calibration.depth_curve().is_some();
        let stands_for_itself = has_depths || !calibration.forces_are_known() || calibration.has_several_forces();
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

    /// Fraction of the calibration's own presses that a limit of one contact may exclude. It is smaller than the accepted fraction of
    /// false alarms, because the limit is learned from few presses, and contacts between their places differ more from the map.
    pub(super) fn excluded_share(&self) -> f64 {
        OF_FALSE_ALARMS * self.false_alarms
    }

    /// Number of unknowns for which a reading is solved.
    pub(super) fn unknowns(&self) -> usize {
        let of_contact = match self.load {
            ForceKnown::Unknown => 3,
            ForceKnown::Constant => 2,
        };
        of_contact + usize::from(self.common_offset)
    }
}
