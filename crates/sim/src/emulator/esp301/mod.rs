//! The Newport ESP301 with three VP-25XL stages: text lines in, text lines out. It follows the manual of the ESP300/301 and
//! observations of a real ESP301 with firmware 1.1.1.
//!
//! Axes 1, 2 and 3 are x, y and z. If the manual isn't clear, this controller follows the stricter of two readings. A target is
//! accepted only by an axis at rest (x32, or x30 while it homes), a line has at most 80 characters, and numbers have no exponent.
//! Groups are refused (27), because the rig doesn't use them. Jogs, resets, waits except `WS`, and settings of jerks and acceleration
//! limits are unknown here (6), because no client of this program sends them.
//!
//! `PR` moves by a distance from where the controller wants the axis to be, not from where the encoder reads it, so its rounding doesn't
//! add up over many moves. Its target is checked like that of `PA`.

mod drive;
mod errors;
mod fault;
mod syntax;
#[cfg(test)]
mod tests;

use super::faults::Faults;
use super::{Instrument, Owed};
use crate::scene::{Scene, SceneDevice};
pub use fault::{EspFault, EspFaultAfterBytes, EspFaultKind};

use drive::{Drive, UNIT_LAST, decimal};
use errors::{AxisFault, ErrorQueue, EspError, General};
use palpate_core::quantity::Axis;
use std::sync::Arc;
use syntax::{Argument, EspCommand};
use tokio::sync::Notify;

/// Answer to `VE?`, from the recorded controller.
const VERSION: &str = "ESP301 Version 1.1.1 16/01/14";
/// Serial number of the first axis' stage. The other stages have the following numbers.
const FIRST_SERIAL: usize = 171_801;
/// Longest stall, s. A longer wait for a motion ends early. Otherwise a wrong `VA` could block the program for ever.
const STALL_MOST_S: f64 = 86_400.0;
/// Longest time that `WS` adds, ms.
const DELAY_MOST_MS: f64 = 60_000.0;
/// Commands that concern one axis and need its number.
const OF_ONE_AXIS: [&[u8; 2]; 25] = [
    b"ID", b"MO", b"MF", b"PA", b"PR", b"OR", b"OH", b"SH", b"DH", b"SN", b"VA", b"VU", b"AC", b"AG", b"SL", b"SR",
    b"VB", b"JH", b"JL", b"FR", b"SU", b"QM", b"QS", b"KP", b"LC",
];

/// Answer to a command: a line, or nothing.
type EspReply = Result<Option<String>, EspError>;

/// A Newport ESP301 motion controller with three VP-25XL stages: 12.5 mm to either side, 25 mm/s.
///
/// At power-on its motors are off. The present place of each axis counts as zero until the axis is homed.
pub struct Esp301Emulator {
    drives: [Drive; 3],
    errors: ErrorQueue,
    deaf_until_s: f64,
    /// Time until which it restarts and takes nothing, s.
    restarts_until_s: f64,
    never_done: bool,
    faults: Faults<EspFaultKind>,
    held: Vec<u8>,
    /// There if faults happen that nobody asks for.
    bell: Option<Arc<Notify>>,
}

impl Esp301Emulator {
    /// Creates a controller that is switched on at the present place of the scene's axes.
    pub fn new(scene: &Scene) -> Self {
        let drives = Axis::ALL.map(|axis| Drive::new(axis, scene));
        Esp301Emulator {
            drives,
            errors: ErrorQueue::default(),
            deaf_until_s: 0.0,
            restarts_until_s: 0.0,
            never_done: false,
            faults: Faults::new(&[], &[]),
            held: Vec::new(),
            bell: None,
        }
    }

    /// Gives the controller faults: at their times, and after some bytes.
    #[must_use]
    pub fn with_faults(self, timed: &[EspFault], after_bytes: &[EspFaultAfterBytes]) -> Self {
        Esp301Emulator { faults: Faults::new(timed, after_bytes), bell: Some(Arc::default()), ..self }
    }
}

impl Instrument for Esp301Emulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.faults.admit(inbox, &mut self.held, syntax::take_line)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let is_lost = self.go_on(scene, now_s) || now_s < self.restarts_until_s;
        let reply = if is_lost { String::new() } else { self.run_line(request, scene, now_s) };
        if let Some(bell) = &self.bell {
            bell.notify_waiters();
        }
        let fault = if reply.is_empty() { None } else { self.faults.take(now_s, |kind| !kind.is_timed()) };
        match fault {
            Some(EspFaultKind::LostAnswer) => Vec::new(),
            Some(_) => reply.repeat(2).into_bytes(),
            None => reply.into_bytes(),
        }
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        self.bell.clone()
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        self.go_on(scene, now_s);
        let next_s = self.faults.next_s(EspFaultKind::is_timed);
        if next_s.is_finite() { Owed::At(next_s) } else { Owed::Nothing }
    }

    /// Time until which the command port is deaf, s. A wait or a reset stalls the port on every link.
    fn deaf_until_s(&self) -> f64 {
        self.deaf_until_s
    }
}

impl Esp301Emulator {
    /// Lets the faults happen that are due. Returns whether what came last is lost in a restart.
    fn go_on(&mut self, scene: &mut Scene, now_s: f64) -> bool {
        self.faults.come(now_s);
        let mut is_lost = false;
        let at_s = self.faults.next_s(EspFaultKind::is_timed);
        while let Some(kind) = self.faults.take(now_s, EspFaultKind::is_timed) {
            self.notice(scene, now_s);
            match kind {
                EspFaultKind::NeverDone => self.never_done = true,
                EspFaultKind::Restart { motors_on, takes_s } => {
                    self.restart(motors_on, at_s + takes_s, scene, now_s);
                    is_lost = at_s == now_s;
                }
                EspFaultKind::Mirrored(axis) => self.drives[axis.index()].mirror(scene, now_s),
                EspFaultKind::Other(lines) if now_s >= self.restarts_until_s => {
                    for line in lines.lines() {
                        self.run_line(line.as_bytes(), scene, now_s);
                    }
                }
                _ => {}
            }
        }
        is_lost
    }

    fn restart(&mut self, motors_on: bool, until_s: f64, scene: &mut Scene, now_s: f64) {
        self.drives = Axis::ALL.map(|axis| {
            self.drives[axis.index()].cut_power(scene, now_s);
            let mut fresh = Drive::new(axis, scene);
            fresh.motor_on = motors_on;
            fresh
        });
        (self.errors, self.never_done, self.deaf_until_s) = (ErrorQueue::default(), false, 0.0);
        self.restarts_until_s = until_s;
        self.held.clear();
    }

    /// Carries out the commands of a line, and returns the answer.
    fn run_line(&mut self, line: &[u8], scene: &mut Scene, now_s: f64) -> String {
        let mut reply = String::new();
        for command in syntax::commands(line) {
            self.notice(scene, now_s);
            match command.and_then(|command| self.run(&command, scene, now_s)) {
                Ok(Some(line)) => reply += &(line + "\r\n"),
                Ok(None) => {}
                Err(fault) => self.errors.push(fault, now_s),
            }
        }
        reply
    }

    /// Updates the state of motions that have ended. The update happens when the controller next looks, which has the same effect
    /// as an update at the motion's end.
    fn notice(&mut self, scene: &Scene, now_s: f64) {
        for drive in &mut self.drives {
            if let Some((fault, at_s)) = drive.notice(scene, now_s) {
                self.errors.push(fault, at_s);
            }
        }
    }

    fn run(&mut self, command: &EspCommand, scene: &mut Scene, now_s: f64) -> EspReply {
        match &command.name {
            b"VE" => tell(command, || VERSION.into()),
            b"TE" => tell(command, || self.errors.pop_code()),
            b"TB" => tell(command, || self.errors.pop_message(now_s)),
            b"TP" => self.tell_of_axes(command, |drive| drive.place(scene, now_s)),
            b"DP" => self.tell_of_axes(command, |drive| drive.setpoint(scene, now_s)),
            b"MD" => self.tell_of_axes(command, |drive| u8::from(!drive.moving() && !self.never_done).to_string()),
            b"ST" => self.halt(command.axis_or_all()?, now_s, |drive| drive.stop(scene, now_s)),
            // all axes, even with the number that some clients put before it
            b"AB" => self.halt(None, now_s, |drive| drive.cut_power(scene, now_s)),
            b"WS" => self.wait(command, scene, now_s),
            // the configuration word of limits and faults, and the controller's activity
            b"ZB" if command.argument == Argument::Query => Ok(Some("0H".to_owned())),
            b"TX" => tell(command, || "P".into()),
            name if OF_ONE_AXIS.contains(&name) => self.run_on_axis(command, scene, now_s),
            // HN, HL, HS and the like: groups
            [b'H', _] => Err(General::NOT_ALLOWED.into()),
            _ => Err(General::UNKNOWN_COMMAND.into()),
        }
    }

    fn run_on_axis(&mut self, command: &EspCommand, scene: &mut Scene, now_s: f64) -> EspReply {
        let axis = command.axis()?;
        let drive = &mut self.drives[axis.index()];
        let out_of_range = drive.fault(AxisFault::PARAMETER_OUT_OF_RANGE);
        let argument = &command.argument;
        let number = || argument.number(out_of_range);
        let asked = *argument == Argument::Query;
        match &command.name {
            b"ID" => return tell(command, || format!("VP-25XL, SN{}", FIRST_SERIAL + axis.index())),
            // MF? reports the same as MO?: whether the motor is on
            b"MO" | b"MF" if asked => return Ok(Some(u8::from(drive.motor_on).to_string())),
            b"MO" => drive.motor_on = true,
            b"MF" => return self.halt(Some(axis), now_s, |drive| drive.cut_power(scene, now_s)),
            b"PA" if asked => return Ok(Some(drive.target())),
            b"PA" => drive.go_to(number()?, scene, now_s)?,
            b"PR" => drive.go_by(number()?, scene, now_s)?,
            b"OR" => drive.home(whole(number()?, 6, out_of_range)? as u8, scene, now_s)?,
            b"DH" => drive.define(argument.number_or(0.0, out_of_range)?, scene, now_s)?,
            b"SN" if asked => return Ok(Some(drive.unit.to_string())),
            b"SN" => drive.unit = whole(number()?, UNIT_LAST, out_of_range)?,
            name if asked => return Ok(drive.number(name).map(decimal)),
            name => drive.set_number(name, number()?, scene, now_s)?,
        }
        Ok(None)
    }

    /// Returns one axis' answer, or all axes' answers separated by a comma and a blank (manual, page TP).
    fn tell_of_axes(&self, command: &EspCommand, mut each: impl FnMut(&Drive) -> String) -> EspReply {
        let axis = command.axis_or_all()?;
        tell(command, || match axis {
            Some(axis) => each(&self.drives[axis.index()]),
            None => self.drives.iter().map(each).collect::<Vec<_>>().join(", "),
        })
    }

    /// Halts one axis or all axes. An interrupted homing reports an error.
    fn halt(&mut self, axis: Option<Axis>, now_s: f64, mut halt: impl FnMut(&mut Drive) -> bool) -> EspReply {
        for each in Axis::ALL.into_iter().filter(|each| axis.is_none_or(|axis| axis == *each)) {
            let drive = &mut self.drives[each.index()];
            if halt(drive) {
                self.errors.push(drive.fault(AxisFault::HOMING_ABORTED), now_s);
            }
        }
        Ok(None)
    }

    /// Handles the waits. After `WS[ms]` and `WPx` the port accepts nothing until the axis (or all axes) stopped, or passed x.
    /// After `WTms` it accepts nothing for a time.
    fn wait(&mut self, command: &EspCommand, scene: &Scene, now_s: f64) -> EspReply {
        let out_of_range = General::PARAMETER_OUT_OF_RANGE.into();
        let axis = command.axis_or_all()?;
        let ends = Axis::ALL.into_iter().filter(|each| axis.is_none_or(|axis| axis == *each));
        let until_s = ends.map(|axis| self.drives[axis.index()].end_s(scene)).fold(now_s, f64::max);
        let delay_ms = command.argument.number_or(0.0, out_of_range)?;
        if !(0.0..=DELAY_MOST_MS).contains(&delay_ms) {
            return Err(out_of_range);
        }
        self.deaf_until_s = (until_s + delay_ms / 1000.0).min(now_s + STALL_MOST_S);
        Ok(None)
    }
}

/// Returns the answer to a query, with or without its question mark.
fn tell(command: &EspCommand, answer: impl FnOnce() -> String) -> EspReply {
    if command.argument.tells() { Ok(Some(answer())) } else { Err(General::PARAMETER_OUT_OF_RANGE.into()) }
}

/// Returns an integer from 0 to `last`.
fn whole(number: f64, last: u16, out_of_range: EspError) -> Result<u16, EspError> {
    (0..=last).find(|&whole| f64::from(whole) == number).ok_or(out_of_range)
}
