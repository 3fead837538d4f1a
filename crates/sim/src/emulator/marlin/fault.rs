//! Faults that a test gives the board.

use crate::emulator::faults::{DeviceFault, FaultAfterBytes};

/// A fault of the board.
pub type MarlinFault = DeviceFault<MarlinFaultKind>;
/// A fault of the board after some bytes.
pub type MarlinFaultAfterBytes = FaultAfterBytes<MarlinFaultKind>;

/// Kinds of fault. All but the chatter happen once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MarlinFaultKind {
    /// The next `ok` isn't sent.
    LostOk,
    /// The next `ok` is sent twice.
    DoubledOk,
    /// One bit of the next line is wrong: the lowest of its command's letter.
    GarbledLine,
    /// Temperatures are reported unasked, again and again after this time, s.
    Chatter {
        /// Time between two reports, s.
        every_s: f64,
    },
    /// The next command never ends, such as one that waits for a person: `busy` comes for ever (host_keepalive in gcode.cpp).
    Busy,
    /// The board resets, such as by its watchdog or a weak supply. Place, line number, modes and queue are lost, and it announces itself so.
    Restart(Announced),
    /// The drivers switch the motors off, and the firmware doesn't notice. Motions in the queue aren't made, but are counted as
    /// made at once.
    MotorsOff,
    /// The counted steps change by these numbers, and nothing moves.
    CountsJump([i32; 3]),
    /// Another host at the board's second port, a touch screen or a person at its menu sends these lines, separated by `\n`. They wait
    /// behind those that have come, and share modes and coordinates with them. Line numbers are those of each port (queue.cpp).
    Other(&'static str),
}

/// How a restart is announced. Stock Marlin sends no line end before its announcement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Announced {
    /// `start` on a line of its own, then version and settings: MarlinCore.cpp before 2.0.6 and from 2.0.8 on.
    Start,
    /// `echo:start` (`SERIAL_ECHO_MSG("start")`, MarlinCore.cpp of 2.0.6 and 2.0.7; the log of OctoPrint's issue 3904).
    EchoStart,
    /// `start` behind what was on its line, as in `FR_NO_FILESYSTEMstart` (Marlin's issue 28328). Here: two stray bytes.
    Stray,
    /// `start` with one damaged byte, and the rest as it is.
    Damaged,
    /// `ok T:start`: the reset came within an answer (the log of Marlin's issue 7758).
    WithinAnswer,
    /// `sta`, and the rest is lost, so that the next answer is on the same line.
    Cut,
    /// Nothing, as if the host doesn't listen while a native USB port comes back, or the lines are lost.
    Silent,
}

impl Announced {
    /// First line of the announcement, as it arrives.
    pub(super) fn first_line(self) -> &'static str {
        match self {
            Announced::Start => "start",
            Announced::EchoStart => "echo:start",
            Announced::Stray => "\u{0}\u{7f}start",
            Announced::Damaged => "sdart",
            Announced::WithinAnswer => "ok T:start",
            Announced::Cut => "sta",
            Announced::Silent => "",
        }
    }
}

impl MarlinFaultKind {
    /// Whether it happens at its time, not with something that is sent.
    pub(super) fn is_timed(self) -> bool {
        use MarlinFaultKind::{Busy, DoubledOk, GarbledLine, LostOk};
        !matches!(self, LostOk | DoubledOk | GarbledLine | Busy)
    }
}
