//! The error queue: codes and texts.

use crate::quantity::Axis;
use std::collections::VecDeque;

/// Errors the queue holds (manual: FIFO of 10). One more pushes the oldest out.
const QUEUE_MOST: usize = 10;

/// Ticks of the controller's clock a second: 400 us each, measured from a recording of a real controller.
const TICKS_HZ: f64 = 2500.0;

/// What the controller complains about: the codes of the manual's table that three axes and no options can meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EspError {
    /// One that concerns no axis.
    General(General),
    /// One of an axis: its code carries the axis in the hundreds.
    OfAxis(Axis, AxisFault),
}

/// Errors below 100.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum General {
    UnknownCommand = 6,
    ParameterOutOfRange = 7,
    AxisOutOfRange = 9,
    NotAllowed = 27,
    AxisMissing = 37,
    ParameterMissing = 38,
}

/// Errors of an axis, less the hundreds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisFault {
    ParameterOutOfRange = 1,
    PlusHardwareLimit = 4,
    MinusHardwareLimit = 5,
    PlusSoftwareLimit = 6,
    MinusSoftwareLimit = 7,
    SpeedBeyondMost = 10,
    AccelerationBeyondMost = 11,
    MotorNotEnabled = 13,
    HomingAborted = 20,
    SpeedOutOfRange = 24,
    WhileHoming = 30,
    WhileMoving = 32,
}

impl EspError {
    /// The code as the controller gives it: 104 is fault 4 of axis 1.
    pub fn code(self) -> u16 {
        match self {
            EspError::General(fault) => fault as u16,
            EspError::OfAxis(axis, fault) => 100 * (axis.index() as u16 + 1) + fault as u16,
        }
    }

    /// The text of `TB?`. Only that of the hardware limit is known from a real controller; the others follow its style.
    fn text(self) -> String {
        match self {
            EspError::General(fault) => match fault {
                General::UnknownCommand => "COMMAND DOES NOT EXIST",
                General::ParameterOutOfRange => "PARAMETER OUT OF RANGE",
                General::AxisOutOfRange => "AXIS NUMBER OUT OF RANGE",
                General::NotAllowed => "COMMAND NOT ALLOWED",
                General::AxisMissing => "AXIS NUMBER MISSING",
                General::ParameterMissing => "COMMAND PARAMETER MISSING",
            }
            .into(),
            EspError::OfAxis(axis, fault) => {
                let text = match fault {
                    AxisFault::ParameterOutOfRange => "PARAMETER OUT OF RANGE",
                    AxisFault::PlusHardwareLimit => "POSITIVE HARDWARE LIMIT DETECTED",
                    AxisFault::MinusHardwareLimit => "NEGATIVE HARDWARE LIMIT DETECTED",
                    AxisFault::PlusSoftwareLimit => "POSITIVE SOFTWARE LIMIT DETECTED",
                    AxisFault::MinusSoftwareLimit => "NEGATIVE SOFTWARE LIMIT DETECTED",
                    AxisFault::SpeedBeyondMost => "MAXIMUM VELOCITY EXCEEDED",
                    AxisFault::AccelerationBeyondMost => "MAXIMUM ACCELERATION EXCEEDED",
                    AxisFault::MotorNotEnabled => "MOTOR NOT ENABLED",
                    AxisFault::HomingAborted => "HOMING ABORTED",
                    AxisFault::SpeedOutOfRange => "SPEED OUT OF RANGE",
                    AxisFault::WhileHoming => "COMMAND NOT ALLOWED DURING HOMING",
                    AxisFault::WhileMoving => "COMMAND NOT ALLOWED DURING TRAJECTORY EXECUTION",
                };
                format!("AXIS-{} {text}", axis.index() + 1)
            }
        }
    }
}

impl From<General> for EspError {
    fn from(fault: General) -> Self {
        EspError::General(fault)
    }
}

/// The queue that `TE` and `TB` both read, and empty (manual, pages TE and TB).
#[derive(Default)]
pub struct ErrorQueue {
    entries: VecDeque<(EspError, i32)>,
}

impl ErrorQueue {
    /// Notes a fault that happened at `at_s`.
    pub fn push(&mut self, fault: EspError, at_s: f64) {
        if self.entries.len() == QUEUE_MOST {
            self.entries.pop_front();
        }
        self.entries.push_back((fault, ticks(at_s)));
    }

    /// The answer to `TE`: the oldest error's code, 0 if there is none.
    pub fn pop_code(&mut self) -> String {
        self.entries.pop_front().map_or(0, |(fault, _)| fault.code()).to_string()
    }

    /// The answer to `TB`: the oldest error's code, when it happened (ticks), and its text. With no error, the time is now.
    pub fn pop_message(&mut self, now_s: f64) -> String {
        match self.entries.pop_front() {
            Some((fault, ticks)) => format!("{}, {ticks}, {}", fault.code(), fault.text()),
            None => format!("0, {}, NO ERROR DETECTED", ticks(now_s)),
        }
    }
}

/// The controller's clock: it runs into the negative after ten days, as a signed 32-bit number does.
fn ticks(at_s: f64) -> i32 {
    (at_s * TICKS_HZ).floor() as i64 as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_texts_are_those_of_the_recording() {
        let mut queue = ErrorQueue::default();
        queue.push(EspError::OfAxis(Axis::X, AxisFault::PlusHardwareLimit), 2_141_749_940.0 / TICKS_HZ);
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
        queue.push(General::UnknownCommand.into(), 0.0);
        for _ in 0..QUEUE_MOST {
            queue.push(General::AxisMissing.into(), 0.0);
        }
        for _ in 0..QUEUE_MOST {
            assert_eq!(queue.pop_code(), "37");
        }
        assert_eq!(queue.pop_code(), "0");
    }
}
