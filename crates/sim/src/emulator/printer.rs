//! Faults that a test gives a printer, each at its time.

/// A fault of a printer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrinterFault<K> {
    /// Time from which it can happen, s.
    pub from_s: f64,
    /// What happens.
    pub kind: K,
}

/// Faults that haven't happened yet.
pub(super) struct PrinterFaults<K>(pub Vec<PrinterFault<K>>);

impl<K: Copy> PrinterFaults<K> {
    /// Time of the next fault of some kinds, s; infinite without one.
    pub(super) fn next_s(&self, wanted: impl Fn(K) -> bool) -> f64 {
        self.0.iter().filter(|fault| wanted(fault.kind)).map(|fault| fault.from_s).fold(f64::INFINITY, f64::min)
    }

    /// Takes the next fault of some kinds, if its time has come.
    pub(super) fn take(&mut self, now_s: f64, wanted: impl Fn(K) -> bool) -> Option<K> {
        let next_s = self.next_s(&wanted);
        let index = self.0.iter().position(|fault| wanted(fault.kind) && fault.from_s == next_s && next_s <= now_s)?;
        Some(self.0.remove(index).kind)
    }
}
