//! Executes a plan on a rig: prepares the instruments, makes each press, records it, and always parks the stage.
//!
//! [`palpate_control`] decides; this module carries out the decisions. It prints nothing, but informs a [`Listener`] of all
//! events.

mod after_leaving;
mod again;
mod air;
mod align;
mod at_rest;
mod cancel;
mod causes;
mod check_weight;
mod checks;
mod clock;
mod doubt;
mod drag;
mod examine;
mod execute;
mod feel;
mod felt_by_array;
mod findings;
mod home;
mod last_resort;
mod late;
mod missed;
mod monitors;
mod motion;
mod no_load_outputs;
mod pace;
mod past;
mod press;
mod ready;
mod rehearsal;
mod retraction;
mod rig_control;
mod series;
mod shift;
mod shown;
mod unforced_motion;
mod watched_cell;
mod window;
mod without_cell;

pub use align::{AlignError, Alignment, align, plan as align_plan};
pub use cancel::Cancel;
pub use check_weight::{
    Ask, AxesMeasurement, CellAfter, KnownWeight, LoadCellVerdict, WEIGHT_TIMES, WEIGHT_WAIT, Weighing,
    WeightMeasurement, WeightResult, judged,
};
pub use examine::{Examination, ForceCheck, NoLoadCell, examine};
pub use execute::{Ending, Listener, RunJob, execute, execute_on};
pub use findings::Finding;
pub use home::{Retracted, retract};
pub use last_resort::LAST_RESORT_SHARE;
pub use pace::keep_pace;
pub use ready::NOISE_SHARE;
pub use rehearsal::{EarlyEnd, Rehearsal, rehearse};
pub use retraction::{LargestForce, Remaining};
pub use shown::{FINGER_WAIT, ShownBy};

use palpate_control::{SafetyRule, Trip};
use palpate_data::dataset::DatasetError;
use palpate_link::device::{DeviceError, DeviceProblem};

/// Reason why a run ended before its plan did.
#[derive(Debug)]
pub enum Halt {
    /// A person requested the stop.
    Cancelled,
    /// A safety rule was broken.
    Tripped(Trip),
    /// A monitored value was outside its bounds for too long. The run can continue later.
    OutOfBounds(String),
    /// A device failed.
    Device(DeviceError),
    /// A reading of the array or of a monitor was missed, and its time may be over soon.
    Missed(DeviceError),
    /// The record couldn't be written.
    Record(DatasetError),
    /// No reading has confirmed that z moves away from the specimen when it is commanded to.
    Unconfirmed(String),
}

impl Halt {
    /// Whether a safety rule was broken or a device failed, so that the specimen may have risen.
    pub(crate) fn is_fault(&self) -> bool {
        matches!(self, Halt::Tripped(_) | Halt::Device(_) | Halt::Missed(_))
    }
}

impl From<Trip> for Halt {
    fn from(trip: Trip) -> Self {
        Halt::Tripped(trip)
    }
}

impl From<DeviceError> for Halt {
    fn from(error: DeviceError) -> Self {
        match error.problem {
            DeviceProblem::Guarded { limit_n } => Trip::new(SafetyRule::Guarded, limit_n, limit_n, "N").into(),
            _ => Halt::Device(error),
        }
    }
}

impl From<DatasetError> for Halt {
    fn from(error: DatasetError) -> Self {
        Halt::Record(error)
    }
}

#[cfg(test)]
mod tests;
