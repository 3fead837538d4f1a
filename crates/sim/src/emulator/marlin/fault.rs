//! Faults that a test gives the board, each at its time.

use crate::emulator::printer::PrinterFault;

/// A fault of the board.
pub type MarlinFault = PrinterFault<MarlinFaultKind>;

/// Kinds of fault. All but the chatter happen once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MarlinFaultKind {
    /// The next `ok` isn't sent.
    LostOk,
    /// One bit of the next line is wrong: the lowest of its command's letter.
    GarbledLine,
    /// Temperatures are reported unasked, again and again after this time, s.
    Chatter {
        /// Time between two reports, s.
        every_s: f64,
    },
    /// The board resets, such as by its watchdog or a weak supply.
    Reboot,
    /// The drivers switch the motors off, and the firmware doesn't notice. Motions in the queue aren't made, but are counted as
    /// made at once.
    MotorsOff,
}

impl MarlinFaultKind {
    /// Whether it happens at its time, not with something that is sent.
    pub(super) fn is_timed(self) -> bool {
        !matches!(self, MarlinFaultKind::LostOk | MarlinFaultKind::GarbledLine)
    }
}
