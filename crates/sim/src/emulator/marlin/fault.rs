//! Faults that a test gives the board, each at its time.

/// A fault of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarlinFault {
    /// Time from which it can happen, s.
    pub from_s: f64,
    /// What happens.
    pub kind: MarlinFaultKind,
}

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
    fn is_timed(self) -> bool {
        !matches!(self, MarlinFaultKind::LostOk | MarlinFaultKind::GarbledLine)
    }
}

/// Faults that haven't happened yet.
pub(super) struct MarlinFaults(pub Vec<MarlinFault>);

impl MarlinFaults {
    /// Whether a fault of a kind that belongs to something sent happens now.
    pub(super) fn take(&mut self, kind: MarlinFaultKind, now_s: f64) -> bool {
        let found = self.0.iter().position(|fault| fault.kind == kind && fault.from_s <= now_s);
        found.map(|index| self.0.remove(index)).is_some()
    }

    /// Time of the next timed fault, s; infinite without one.
    pub(super) fn next_s(&self) -> f64 {
        self.timed().map(|(_, fault)| fault.from_s).fold(f64::INFINITY, f64::min)
    }

    /// Takes the next timed fault. A chatter stays, for its next report.
    pub(super) fn take_next(&mut self) -> Option<MarlinFaultKind> {
        let next = self.timed().min_by(|one, other| one.1.from_s.total_cmp(&other.1.from_s));
        let (index, MarlinFault { kind, .. }) = next?;
        match kind {
            MarlinFaultKind::Chatter { every_s } => self.0[index].from_s += every_s.max(0.001),
            _ => drop(self.0.remove(index)),
        }
        Some(kind)
    }

    fn timed(&self) -> impl Iterator<Item = (usize, MarlinFault)> + '_ {
        self.0.iter().copied().enumerate().filter(|(_, fault)| fault.kind.is_timed())
    }
}
