//! Basic quantities, with units: places, limits, travel, the array's layout, force readings, data on a load cell's gain, and
//! random streams.
//!
//! Units are at the end of every name. Two frames are used and never mixed: the **stage frame** (coordinates of the controller,
//! [`Position`]) and the **specimen frame** ([`Place`] plus a `z_mm` that grows into the specimen and is zero at its nominal
//! surface). [`Frame`] converts from one to the other.

mod abilities;
pub mod any_number;
mod cells;
mod certificate;
mod ewma;
mod frame;
mod identity;
mod layout;
mod limits;
mod number;
mod reading;
mod steps;
mod stream;
mod tilt;

pub use abilities::{StageAbilities, StageBounds};
pub use cells::cell_centres;
pub use certificate::{
    AxesCheck, COVERAGE, CROSSTALK_MOST, GAIN_OFF_MOST, LoadCellCertificate, StageCertificate, StatedError,
    TemperatureEffect, WeightCheck,
};
pub use ewma::Ewma;
pub use frame::{Axis, Down, Frame, Place, Position};
pub use identity::{Identity, SHOWN_MAX_CHARS, shortened, shown};
pub use layout::ArrayLayout;
pub use limits::{Limits, Range, Travel};
pub use number::{hexadecimal, percentile, round, seconds};
pub use reading::{ForceReading, Health};
pub use steps::{FINEST_STEP_MM, Steps};
pub use stream::{RandomStream, stream};
pub use tilt::{TILT_MOST_DEG, Tilt};

/// Standard gravity, m/s^2.
pub const GRAVITY_M_S2: f64 = 9.806_65;
