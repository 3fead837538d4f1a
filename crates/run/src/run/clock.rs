//! Time since the run's start.

use palpate_link::time::Instant;

/// Clock of the time since the run's start. A continued run counts from the time that it had reached.
#[derive(Clone, Copy, Debug)]
pub(super) struct RunClock {
    began: Instant,
    before_s: f64,
}

impl RunClock {
    /// Creates a clock that continues from `before_s`, s.
    pub(super) fn going_on_from(before_s: f64) -> Self {
        RunClock { began: Instant::now(), before_s }
    }

    /// Returns the time of an instant, s since the run's start.
    pub(super) fn at_s(&self, instant: Instant) -> f64 {
        self.before_s + (instant - self.began).as_secs_f64()
    }

    /// Returns the time now, s since the run's start.
    pub(super) fn now_s(&self) -> f64 {
        self.at_s(Instant::now())
    }
}
