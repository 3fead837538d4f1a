//! Faults that a test gives the controller.

use crate::emulator::faults::{DeviceFault, FaultAfterBytes};

/// A fault of the controller.
pub type XpsFault = DeviceFault<XpsFaultKind>;
/// A fault of the controller after some bytes on all sockets.
pub type XpsFaultAfterBytes = FaultAfterBytes<XpsFaultKind>;

/// Kinds of fault. Each happens once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum XpsFaultKind {
    /// The next answer isn't sent.
    LostAnswer,
    /// The next answer is sent twice.
    DoubledAnswer,
    /// The controller restarts: motions end, all settings are those of power-on, no group is initialised, and each positioner counts
    /// zero where it is. All sockets are closed, and new ones are until it is ready.
    Restart {
        /// Time of the restart, s.
        takes_s: f64,
    },
    /// Another client on sockets of its own makes these calls, separated by `\n`. It doesn't wait for one to end before the next.
    Other(&'static str),
}

impl XpsFaultKind {
    /// Whether it happens at its time, not with something that is sent.
    pub(super) fn is_timed(self) -> bool {
        !matches!(self, XpsFaultKind::LostAnswer | XpsFaultKind::DoubledAnswer)
    }
}
