//! Faults that a test gives the printer, each at its time.

/// A fault of the printer or its host.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KlipperFault {
    /// Time from which it can happen, s.
    pub from_s: f64,
    /// What happens.
    pub kind: KlipperFaultKind,
}

/// Kinds of fault. Each happens once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KlipperFaultKind {
    /// The microcontroller shuts down with `Timer too close`: the motion ends at once, and the motors are off.
    Shutdown,
    /// The microcontroller and Klipper restart. The motion ends at once, and nothing is homed.
    McuRestart,
    /// Moonraker restarts: all connections hang up, and for 3 s new ones do at once. The printer moves on.
    MoonrakerRestart,
    /// The next answer is never sent. Its connection stays open, and answers nothing more.
    LostAnswer,
    /// The next answer is sent later by this time, s.
    SlowAnswer(f64),
    /// The motors are switched off as after the idle timeout.
    IdleTimeout,
}

impl KlipperFaultKind {
    /// Whether it happens at its time, not with an answer.
    fn is_timed(self) -> bool {
        !matches!(self, KlipperFaultKind::LostAnswer | KlipperFaultKind::SlowAnswer(_))
    }
}

/// Faults that haven't happened yet.
pub(super) struct KlipperFaults(pub Vec<KlipperFault>);

impl KlipperFaults {
    /// Takes the next fault that belongs to an answer, if its time has come.
    pub(super) fn take_of_answer(&mut self, now_s: f64) -> Option<KlipperFaultKind> {
        let index = self.0.iter().position(|fault| !fault.kind.is_timed() && fault.from_s <= now_s)?;
        Some(self.0.remove(index).kind)
    }

    /// Time of the next timed fault, s; infinite without one.
    pub(super) fn next_s(&self) -> f64 {
        self.0.iter().filter(|fault| fault.kind.is_timed()).map(|fault| fault.from_s).fold(f64::INFINITY, f64::min)
    }

    /// Takes the next timed fault.
    pub(super) fn take_next(&mut self) -> Option<KlipperFaultKind> {
        let next_s = self.next_s();
        let index = self.0.iter().position(|fault| fault.kind.is_timed() && fault.from_s == next_s)?;
        Some(self.0.remove(index).kind)
    }
}
