//! Faults that a test gives a stage of the process protocol.

use crate::emulator::faults::{DeviceFault, FaultAfterBytes, Faults};

/// A fault of the stage.
pub type ProcessStageFault = DeviceFault<ProcessStageFaultKind>;
/// A fault of the stage after some bytes.
pub type ProcessStageFaultAfterBytes = FaultAfterBytes<ProcessStageFaultKind>;

/// Kinds of fault. Each happens once. What a program has unlearned it doesn't learn again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProcessStageFaultKind {
    /// The next answer isn't sent.
    LostAnswer,
    /// The next answer is sent twice.
    DoubledAnswer,
    /// `status` reports a motion from now on, also of axes at rest.
    NeverDone,
    /// The program counts zero where the axes are, and believes what it knew of home and travel.
    LosesCount,
    /// What the program counts changes by these distances, mm, and nothing moves.
    CountsJump([f64; 3]),
    /// The program restarts: it isn't prepared, doesn't know home, and counts zero where the axes are. Motions end.
    Restart,
    /// `stop` has no effect from now on.
    IgnoresStop,
    /// `to_mm` is taken for a distance from now on.
    ToIsRelative,
    /// Another client of the same device sends these requests, separated by `\n`.
    Other(&'static str),
}

impl ProcessStageFaultKind {
    /// Whether it happens at its time, not with something that is sent.
    pub(super) fn is_timed(self) -> bool {
        !matches!(self, ProcessStageFaultKind::LostAnswer | ProcessStageFaultKind::DoubledAnswer)
    }
}

/// Faults that are expected, and those that last.
pub(super) struct StageFaults {
    pub pending: Faults<ProcessStageFaultKind>,
    /// Bytes of the line under way, if they are counted.
    pub held: Vec<u8>,
    pub never_done: bool,
    pub ignores_stop: bool,
    pub to_is_relative: bool,
}

impl StageFaults {
    pub(super) fn new(timed: &[ProcessStageFault], after_bytes: &[ProcessStageFaultAfterBytes]) -> Self {
        let pending = Faults::new(timed, after_bytes);
        StageFaults { pending, held: Vec::new(), never_done: false, ignores_stop: false, to_is_relative: false }
    }

    /// Time of the next one that happens by itself, s; infinite without one.
    pub(super) fn next_s(&self) -> f64 {
        self.pending.next_s(ProcessStageFaultKind::is_timed)
    }

    /// Returns what arrives of an answer.
    pub(super) fn said(&mut self, reply: Vec<u8>, now_s: f64) -> Vec<u8> {
        let fault = if reply.is_empty() { None } else { self.pending.take(now_s, |kind| !kind.is_timed()) };
        match fault {
            Some(ProcessStageFaultKind::LostAnswer) => Vec::new(),
            Some(_) => reply.repeat(2),
            None => reply,
        }
    }
}
