//! Place and force vector of one contact: x, y, and the force along x, y and into the specimen.
//!
//! A [`VectorCalibration`] is presses and drags of known force. It gives the outputs per newton along each axis at each place: three
//! columns. A [`VectorMap`] smooths the columns over the places. A reading is a sum of the columns at its place, so the force follows
//! from the place, and only the place is searched for.

mod calibration;
mod descent;
mod dragged;
mod evaluation;
mod map;
mod model;
mod session;
mod solution;
mod solve;
mod superposed;

pub use calibration::{VectorCalibration, VectorRow};
pub(crate) use descent::{ShearPrior, VectorFit};
pub use dragged::DraggedRow;
pub use evaluation::VectorErrors;
pub use map::VectorMap;
pub use model::{VECTOR_METHOD, VectorModel};
pub use session::{VectorFits, VectorSession};
pub use solution::{VECTOR_NUMBERS, VectorSolution, VectorVerdict};
pub(crate) use solve::AxisBuffers;
pub use solve::VectorWorkspace;
pub use superposed::{PairShares, SuperposedPresses};

use crate::Covariance;
use palpate_core::quantity::Place;

/// Axis of the force into the specimen; 0 and 1 are along x and y.
pub(crate) const PRESS: usize = 2;

/// Contact with a force of three axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VectorContact {
    /// Place of the contact, specimen frame, mm.
    pub place: Place,
    /// Force into the specimen, N.
    pub press_n: f64,
    /// Force along the surface.
    pub shear: Shear,
    /// Covariance of x, y (mm), and the force along x, y and into the specimen (N). It includes the error of the map. If the shear
    /// isn't determinable, it includes a shear of the usual size.
    pub covariance: VectorCovariance,
    /// Sum of squares of the reading that the contact leaves, in units of its noise and the map's error.
    pub chi2: f64,
    /// The same sum divided by the limit that one contact exceeds only at the false-alarm rate.
    pub misfit: f64,
    /// Decrease of `chi2` if the contact could lie beyond the border of the calibrated area.
    pub beyond: f64,
}

/// Force along the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shear {
    /// Force along x and y, N.
    Force([f64; 2]),
    /// The outputs can't show it: its error would be as large as a usual shear, see [`USUAL_SHEAR_SHARE`].
    NotDeterminable {
        /// Expected error of the vector, N; infinite if nothing is known about the effect of a shear.
        bound_n: f64,
    },
}

/// Covariance of x, y (mm), and the force along x, y and into the specimen (N), in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VectorCovariance(pub [[f64; 5]; 5]);

impl VectorCovariance {
    /// Returns the one-sigma error of each component.
    pub fn sd(&self) -> [f64; 5] {
        std::array::from_fn(|i| self.0[i][i].max(0.0).sqrt())
    }

    /// Returns the mean errors of the location (mm), of the force into the specimen and of the shear vector (N), of an answer without
    /// bias.
    pub fn mean_errors(&self) -> [f64; 3] {
        let c = &self.0;
        let pair = |i: usize| Covariance([[c[i][i], c[i][i + 1], 0.0], [c[i + 1][i], c[i + 1][i + 1], 0.0], [0.0; 3]]);
        let press = Covariance([[0.0; 3], [0.0; 3], [0.0, 0.0, c[4][4]]]);
        [pair(0).mean_distance_mm(), press.mean_force_error_n(), pair(2).mean_distance_mm()]
    }

    /// Returns the root mean square of the error of the shear vector, N.
    pub fn shear_n(&self) -> f64 {
        (self.0[2][2] + self.0[3][3]).max(0.0).sqrt()
    }
}

/// Largest usual shear, as a fraction of the force into the specimen. A shear is stated only if its expected error is smaller than
/// the root mean square of shears up to this one.
pub const USUAL_SHEAR_SHARE: f64 = 0.5;

/// Reason why a vector calibration isn't usable.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VectorError {
    /// A row has another number of outputs.
    #[error("row {row} has {found} outputs, the first row {expected}")]
    Outputs {
        /// Number of the row, counted from 1.
        row: usize,
        /// Its number of outputs.
        found: usize,
        /// Number of outputs of the first row.
        expected: usize,
    },
    /// A number isn't finite.
    #[error("row {row} has a number that is not finite")]
    NotFinite {
        /// Number of the row, counted from 1.
        row: usize,
    },
    /// Nothing shows the effect of a force into the specimen.
    #[error("no place has presses that determine the outputs per newton into the specimen")]
    NoPress,
    /// A press can't be determined.
    #[error("the array has {outputs} outputs, a contact with a force vector requires 3")]
    TooFewOutputs {
        /// Number of outputs.
        outputs: usize,
    },
    /// Most forces point away from the specimen.
    #[error("most forces are negative, but a press is positive")]
    Pulls,
    /// The places don't span an area.
    #[error("the presses are at {places} places, the map requires {needed} that span an area")]
    TooFewPlaces {
        /// Number of places.
        places: usize,
        /// Number of places required.
        needed: usize,
    },
}

#[cfg(test)]
mod tests;
