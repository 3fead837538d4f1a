//! Faults that a test gives the controller.

use crate::emulator::faults::{DeviceFault, FaultAfterBytes};
use palpate_core::quantity::Axis;

/// A fault of the controller.
pub type EspFault = DeviceFault<EspFaultKind>;
/// A fault of the controller after some bytes.
pub type EspFaultAfterBytes = FaultAfterBytes<EspFaultKind>;

/// Kinds of fault. Each happens once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EspFaultKind {
    /// The next answer isn't sent.
    LostAnswer,
    /// The next answer is sent twice.
    DoubledAnswer,
    /// `MD?` reports 0 from now on, also of axes at rest.
    NeverDone,
    /// The controller restarts: motions end, all settings are those of power-on, and each axis counts zero where it is. What comes
    /// meanwhile is lost.
    Restart {
        /// Whether the motors are on afterwards, as a start-up program can have it.
        motors_on: bool,
        /// Time of the restart, s.
        takes_s: f64,
    },
    /// The direction of an axis changes, as a wrong cable or a stage file does it. It counts on from what it counts.
    Mirrored(Axis),
    /// Another host at another port sends these lines, separated by `\n`. Its errors are in the queue that all ports share.
    Other(&'static str),
}

impl EspFaultKind {
    /// Whether it happens at its time, not with something that is sent.
    pub(super) fn is_timed(self) -> bool {
        !matches!(self, EspFaultKind::LostAnswer | EspFaultKind::DoubledAnswer)
    }
}
