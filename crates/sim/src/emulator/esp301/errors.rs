//! The error queue: codes and texts.

use palpate_core::quantity::Axis;
use std::collections::VecDeque;

/// Largest number of errors in the queue (manual: FIFO of 10). One more error removes the oldest.
const QUEUE_MOST: usize = 10;

/// Ticks of the controller's clock per second: 400 us each, measured from a recording of a real controller.
const TICKS_HZ: f64 = 2500.0;

/// Errors of the controller: the codes of the manual's table that are possible with three axes and no options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EspError {
    /// An error that concerns no axis.
    General(General),
    /// An error of an axis; the hundreds of its code are the axis.
    OfAxis(Axis, AxisFault),
}

/// Errors below 100, and their texts. Only the text of the hardware limit is known from a real controller; the others follow its
/// style.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct General(u16, &'static str);

impl General {
    pub(super) const UNKNOWN_COMMAND: General = General(6, "COMMAND DOES NOT EXIST");
    pub(super) const PARAMETER_OUT_OF_RANGE: General = General(7, "PARAMETER OUT OF RANGE");
    pub(super) const AXIS_OUT_OF_RANGE: General = General(9, "AXIS NUMBER OUT OF RANGE");
    pub(super) const NOT_ALLOWED: General = General(27, "COMMAND NOT ALLOWED");
    pub(super) const AXIS_MISSING: General = General(37, "AXIS NUMBER MISSING");
    pub(super) const PARAMETER_MISSING: General = General(38, "COMMAND PARAMETER MISSING");
}

/// Errors of an axis, without the hundreds, and their texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct AxisFault(u16, &'static str);

impl AxisFault {
    pub(super) const PARAMETER_OUT_OF_RANGE: AxisFault = AxisFault(1, "PARAMETER OUT OF RANGE");
    pub(super) const PLUS_HARDWARE_LIMIT: AxisFault = AxisFault(4, "POSITIVE HARDWARE LIMIT DETECTED");
    pub(super) const MINUS_HARDWARE_LIMIT: AxisFault = AxisFault(5, "NEGATIVE HARDWARE LIMIT DETECTED");
    pub(super) const PLUS_SOFTWARE_LIMIT: AxisFault = AxisFault(6, "POSITIVE SOFTWARE LIMIT DETECTED");
    pub(super) const MINUS_SOFTWARE_LIMIT: AxisFault = AxisFault(7, "NEGATIVE SOFTWARE LIMIT DETECTED");
    pub(super) const SPEED_BEYOND_MOST: AxisFault = AxisFault(10, "MAXIMUM VELOCITY EXCEEDED");
    pub(super) const ACCELERATION_BEYOND_MOST: AxisFault = AxisFault(11, "MAXIMUM ACCELERATION EXCEEDED");
    pub(super) const MOTOR_NOT_ENABLED: AxisFault = AxisFault(13, "MOTOR NOT ENABLED");
    pub(super) const HOMING_ABORTED: AxisFault = AxisFault(20, "HOMING ABORTED");
    pub(super) const SPEED_OUT_OF_RANGE: AxisFault = AxisFault(24, "SPEED OUT OF RANGE");
    pub(super) const WHILE_HOMING: AxisFault = AxisFault(30, "COMMAND NOT ALLOWED DURING HOMING");
    pub(super) const WHILE_MOVING: AxisFault = AxisFault(32, "COMMAND NOT ALLOWED DURING TRAJECTORY EXECUTION");
}

impl EspError {
    /// Returns the code as the controller reports it: 104 is fault 4 of axis 1.
    pub(super) fn code(self) -> u16 {
        match self {
            EspError::General(General(code, _)) => code,
            EspError::OfAxis(axis, AxisFault(code, _)) => 100 * (axis.index() as u16 + 1) + code,
        }
    }

    /// Error text in the answer to `TB?`.
    fn text(self) -> String {
        match self {
            EspError::General(General(_, text)) => text.into(),
            EspError::OfAxis(axis, AxisFault(_, text)) => format!("AXIS-{} {text}", axis.index() + 1),
        }
    }
}

impl From<General> for EspError {
    fn from(fault: General) -> Self {
        EspError::General(fault)
    }
}

/// Queue that both `TE` and `TB` read and empty (manual, pages TE and TB).
#[derive(Default)]
pub(super) struct ErrorQueue {
    entries: VecDeque<(EspError, i32)>,
}

impl ErrorQueue {
    /// Adds a fault that happened at `at_s`.
    pub(super) fn push(&mut self, fault: EspError, at_s: f64) {
        if self.entries.len() == QUEUE_MOST {
            self.entries.pop_front();
        }
        self.entries.push_back((fault, ticks(at_s)));
    }

    /// Returns the answer to `TE`: the oldest error's code, or 0 if there is no error.
    pub(super) fn pop_code(&mut self) -> String {
        self.entries.pop_front().map_or(0, |(fault, _)| fault.code()).to_string()
    }

    /// Returns the answer to `TB`: the oldest error's code, its time (ticks) and its text. Without an error, the time is now.
    pub(super) fn pop_message(&mut self, now_s: f64) -> String {
        match self.entries.pop_front() {
            Some((fault, ticks)) => format!("{}, {ticks}, {}", fault.code(), fault.text()),
            None => format!("0, {}, NO ERROR DETECTED", ticks(now_s)),
        }
    }
}

/// Returns the controller's clock. As a signed 32-bit number, it becomes negative after ten days.
fn ticks(at_s: f64) -> i32 {
    (at_s * TICKS_HZ).floor() as i64 as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_texts_are_those_of_the_recording() {
        let mut queue = ErrorQueue::default();
        queue.push(EspError::OfAxis(Axis::X, AxisFault::PLUS_HARDWARE_LIMIT), 2_141_749_940.0 / TICKS_HZ);
        assert_eq!(queue.pop_message(0.0), "104, 2141749940, AXIS-1 POSITIVE HARDWARE LIMIT DETECTED");
        // the clock has wrapped: 2^32 - 2139482948 ticks after it started
        let now_s = (4_294_967_296.0 - 2_139_482_948.0) / TICKS_HZ;
        assert_eq!(queue.pop_message(now_s), "0, -2139482948, NO ERROR DETECTED");
    }

    #[test]
    fn the_clock_wraps_after_two_to_the_31_ticks() {
        assert_eq!(ticks(2_147_483_647.0 / TICKS_HZ), i32::MAX);
        assert_eq!(ticks(2_147_483_648.0 / TICKS_HZ), i32::MIN);
    }

    #[test]
    fn ten_errors_are_kept_and_the_oldest_goes_first() {
        let mut queue = ErrorQueue::default();
        queue.push(General::UNKNOWN_COMMAND.into(), 0.0);
        for _ in 0..QUEUE_MOST {
            queue.push(General::AXIS_MISSING.into(), 0.0);
        }
        for _ in 0..QUEUE_MOST {
            assert_eq!(queue.pop_code(), "37");
        }
        assert_eq!(queue.pop_code(), "0");
    }
}
