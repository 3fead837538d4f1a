//! Faults that a test gives the board.

use crate::emulator::faults::{DeviceFault, FaultAfterBytes};

/// A fault of the board.
pub type GrblFault = DeviceFault<GrblFaultKind>;
/// A fault of the board after some bytes.
pub type GrblFaultAfterBytes = FaultAfterBytes<GrblFaultKind>;

/// Kinds of fault. Each happens once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GrblFaultKind {
    /// The next `ok` isn't sent.
    LostOk,
    /// The next `ok` is sent twice.
    DoubledOk,
    /// The board resets, such as by a weak supply: it counts from zero where it is, in the modes of power-on, without its queue (main.c).
    /// Only a board that homes is locked then.
    Restart(GrblWelcome),
    /// The counted steps change by these numbers, and nothing moves.
    CountsJump([i32; 3]),
    /// Another sender, such as a pendant or a web page, sends these lines, separated by `\n`, and real-time bytes.
    Other(&'static str),
}

/// How the welcome of a board that restarts arrives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GrblWelcome {
    /// As report.c sends it: an empty line, then the version.
    Clean,
    /// With one damaged byte.
    Damaged,
    /// Behind two stray bytes on its line, without the line end before it.
    Stray,
    /// Not at all, nor what follows it.
    Lost,
}

impl GrblWelcome {
    /// Returns the bytes, without the last line end.
    pub(super) fn text(self) -> &'static str {
        match self {
            GrblWelcome::Clean => "\r\nGrbl 1.1h ['$' for help]",
            GrblWelcome::Damaged => "\r\nGrbm 1.1h ['$' for help]",
            GrblWelcome::Stray => "\u{0}\u{7f}Grbl 1.1h ['$' for help]",
            GrblWelcome::Lost => "",
        }
    }
}

impl GrblFaultKind {
    /// Whether it happens at its time, not with something that is sent.
    pub(super) fn is_timed(self) -> bool {
        !matches!(self, GrblFaultKind::LostOk | GrblFaultKind::DoubledOk)
    }
}
