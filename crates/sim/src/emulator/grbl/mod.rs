//! GRBL 1.1h on a frame of three axes (manual: doc/markdown and doc/csv of gnea/grbl). It receives lines, answers each with one
//! `ok` or `error:N`, and receives single bytes that act at once.
//!
//! Homing counts as in the stock build: a + end is 0, and an axis stands at minus its pull-off after homing to it; one that homes
//! to its - end stands at minus the travel plus the pull-off. z is homed first. The settings are those of a frame that is ready for
//! use; a [`Board`] can have others, and a client can write them.
//!
//! Opening the port resets the board, as the DTR line of an Uno does: it ignores everything until its bootloader ends, then sends
//! its welcome, and the position is lost.
//!
//! The emulator supports the lines that clients send: G0, G1, G4, G10, G20, G21, G90 to G92.1, G53, and jogs. A jog states G91 and G21
//! for its own line only, and begins where the planned motions end (jog.c and gcode.c). G54 and G94 are accepted without effect. All other lines are answered with an error. Single bytes other than `?`, a jog's cancel and a reset are
//! accepted without effect. Corners aren't rounded: axes stop at them.
//!
//! A line that homes, dwells, or needs room in the planner is answered when that is done. Later lines wait, but single bytes act.
//! During homing only a reset acts, and a `?` is answered once at the end of homing.

mod board;
mod fault;
mod gcode;
mod line;
pub(in crate::emulator) mod machine;
mod report;
mod settings;
#[cfg(test)]
mod tests;

use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
pub use board::{MotionBoard, ROOM_MM};
pub(in crate::emulator) use settings::BoardSettings;

use fault::GrblError;
use gcode::{BlockOrder, GcodeLine, Modal};
use line::{GrblInput, LineReader};
use machine::{Activity, Homed, Machine, PlannedLine};
use report::{RX_MOST, Reporter, StatusReport};
use std::collections::VecDeque;
use std::sync::Arc;
use tokio::sync::Notify;

/// Largest distance of a target beyond the travel that counts as rounding, mm.
const ROUNDING_MM: f64 = 1e-9;

/// Replacement for a line that was too long. No line contains this byte.
const OVERLONG: u8 = b'\t';
/// End of the request of a line. It distinguishes a line from a single byte.
const RUN: u8 = b'\n';

const SOFT_RESET: u8 = 0x18;
const JOG_CANCEL: u8 = 0x85;

/// A GRBL 1.1h with three axes.
///
/// If homing is enabled, the controller is locked at power-on. The present place of each axis counts as zero until it is homed.
pub struct GrblEmulator {
    machine: Machine,
    modal: Modal,
    reader: LineReader,
    reporter: Reporter,
    lock: LockState,
    /// Lines that came and haven't run yet, at most as many as fit into the serial buffer.
    waiting: VecDeque<String>,
    /// Condition that the first of them waits for.
    stall: Option<Stall>,
    /// Homing that has started.
    homing: Option<Homed>,
    /// Whether a `?` came during homing.
    asked: bool,
    /// Whether a line that caused an alarm still waits for its `ok`, which comes with the reset.
    unanswered: bool,
    /// Whether the port was opened since the last request.
    opened: bool,
    /// Time at which the bootloader ends, s.
    boots_until_s: Option<f64>,
    bell: Arc<Notify>,
}

/// State of the lock.
#[derive(Clone, Copy, Debug, PartialEq)]
enum LockState {
    Open,
    /// Locked until homed or unlocked: no line of G-code runs.
    Alarm,
    /// Locked until reset: nothing is answered.
    Critical,
}

impl GrblEmulator {
    /// Creates a controller that is switched on at the present place of the scene's axes.
    pub fn new(board: MotionBoard, scene: &Scene) -> Self {
        GrblEmulator {
            lock: lock_at_start(&board),
            machine: Machine::new(board, scene),
            modal: Modal::default(),
            reader: LineReader::default(),
            reporter: Reporter::default(),
            waiting: VecDeque::new(),
            stall: None,
            homing: None,
            asked: false,
            unanswered: false,
            opened: false,
            boots_until_s: None,
            bell: Arc::default(),
        }
    }
}

impl Instrument for GrblEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        Some(match self.reader.take(inbox)? {
            GrblInput::RealTime(byte) => vec![byte],
            GrblInput::Line(None) => vec![OVERLONG, RUN],
            GrblInput::Line(Some(line)) => [line.as_bytes(), &[RUN]].concat(),
        })
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        self.opened = self.machine.board.boot_s.is_some();
        None
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut reply = Reply::default();
        if self.boots(&mut reply, scene, now_s).is_some() {
            return Vec::new(); // the bootloader takes no line
        }
        self.machine.settle(scene, now_s);
        match request {
            [line @ .., RUN] => self.keep(&String::from_utf8_lossy(line)),
            [byte] => self.act(*byte, &mut reply, scene, now_s),
            _ => {}
        }
        self.run_waiting(&mut reply, scene, now_s);
        self.bell.notify_waiters();
        reply.0.into_bytes()
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        let mut reply = Reply::default();
        match self.boots(&mut reply, scene, now_s) {
            Some(until_s) => return Owed::At(until_s),
            None if !reply.0.is_empty() => return Owed::Ready(reply.0.into_bytes()),
            None if self.waiting.is_empty() => return Owed::Nothing,
            None => {}
        }
        self.machine.settle(scene, now_s);
        self.run_waiting(&mut reply, scene, now_s);
        match self.next_s() {
            _ if !reply.0.is_empty() => Owed::Ready(reply.0.into_bytes()),
            Some(next_s) => Owed::At(next_s),
            None => Owed::Nothing,
        }
    }
}

/// Reason why a line waits.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stall {
    /// Room in the planner, with no jog being cancelled.
    Room,
    /// Rest of the axes, expected at `still_s`, and then the time `dwell_s`.
    Dwell { still_s: f64, dwell_s: f64 },
    /// A time, s.
    Until(f64),
}

/// Reply lines.
#[derive(Default)]
struct Reply(String);

impl Reply {
    fn line(&mut self, line: impl AsRef<str>) {
        self.0 += line.as_ref();
        self.0 += "\r\n";
    }

    fn alarm(&mut self, number: u8) {
        self.line(format!("ALARM:{number}"));
    }
}

impl GrblEmulator {
    /// Resets the board if its port was opened, and sends the welcome when it is ready. Returns the time until which it boots, s.
    fn boots(&mut self, reply: &mut Reply, scene: &mut Scene, now_s: f64) -> Option<f64> {
        if let Some(boot_s) = self.machine.board.boot_s.filter(|_| std::mem::take(&mut self.opened)) {
            self.machine.power_cycle(scene, now_s);
            self.homing = None;
            self.unanswered = false;
            self.lock = lock_at_start(&self.machine.board);
            self.forget_lines();
            self.reader.clear();
            self.boots_until_s = Some(now_s + boot_s);
        }
        let until_s = self.boots_until_s?;
        if now_s < until_s {
            self.reader.clear();
            return Some(until_s);
        }
        self.boots_until_s = None;
        self.restart(reply, scene, now_s);
        None
    }

    fn take_line(&mut self, line: &str, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        match self.run(line, reply, scene, now_s) {
            Ok(()) if self.unanswered => {}
            Ok(()) => reply.line("ok"),
            Err(fault) => reply.line(format!("error:{}", fault as u8)),
        }
    }

    fn run(&mut self, line: &str, reply: &mut Reply, scene: &mut Scene, now_s: f64) -> Result<(), GrblError> {
        match line.as_bytes() {
            [OVERLONG] => Err(GrblError::Overlong),
            [] => Ok(()),
            [b'$', ..] => self.run_system(&line[1..], reply, scene, now_s),
            _ if self.lock != LockState::Open || self.machine.activity() == Activity::Jog => Err(GrblError::Locked),
            _ => self.run_gcode(line, reply, scene, now_s),
        }
    }

    fn run_gcode(&mut self, line: &str, reply: &mut Reply, scene: &mut Scene, now_s: f64) -> Result<(), GrblError> {
        let at_mm = self.machine.parsed_mm(scene, now_s);
        let offset_mm = self.modal.offset_mm();
        match GcodeLine::parse(line)?.execute(&mut self.modal, at_mm)? {
            BlockOrder::Go { to_mm, .. } if self.beyond_travel(to_mm) => {
                self.machine.cancel(scene, now_s);
                self.lock = LockState::Critical;
                self.unanswered = true;
                reply.alarm(2);
                reply.line("[MSG:Reset to continue]");
            }
            BlockOrder::Go { to_mm, feed_mm_min } => {
                self.machine.add(
                    PlannedLine { to_mm, feed_mm_min, most_mm_s2: f64::INFINITY, jog: false },
                    scene,
                    now_s,
                );
            }
            BlockOrder::Dwell(_) | BlockOrder::Nothing => {}
        }
        if self.modal.offset_mm() != offset_mm {
            self.reporter.offset_changed();
        }
        Ok(())
    }

    /// Runs a line that began with `$`. The `$` is already removed.
    fn run_system(&mut self, command: &str, reply: &mut Reply, scene: &mut Scene, now_s: f64) -> Result<(), GrblError> {
        let activity = self.machine.activity();
        match command {
            "$" if activity == Activity::Run => return Err(GrblError::NotIdle),
            "$" => self.machine.board.settings.lines().for_each(|line| reply.line(line)),
            "G" => reply.line(report::modes(&self.modal)),
            "X" => {
                if self.lock == LockState::Alarm {
                    self.lock = LockState::Open;
                    reply.line("[MSG:Caution: Unlocked]");
                }
            }
            jog if jog.starts_with('J') => return self.jog(&jog[1..], scene, now_s),
            _ if activity != Activity::Idle => return Err(GrblError::NotIdle),
            "#" => report::parameters(&self.modal).iter().for_each(|line| reply.line(line)),
            "I" => report::build_info(self.machine.board.sets_origin).iter().for_each(|line| reply.line(line)),
            "H" if !self.machine.board.settings.homes() => return Err(GrblError::HomingDisabled),
            "H" => {
                if let Some(homed) = self.homing.take() {
                    self.machine.is_home(homed);
                    self.lock = LockState::Open;
                }
            }
            setting => {
                let (number, value) = setting.split_once('=').ok_or(GrblError::InvalidStatement)?;
                let number = number.parse().map_err(|_| GrblError::InvalidStatement)?;
                let (value, rest) = gcode::number(value.as_bytes()).ok_or(GrblError::BadNumber)?;
                if !rest.is_empty() {
                    return Err(GrblError::InvalidStatement);
                }
                self.machine.board.settings.write(number, value)?;
            }
        }
        Ok(())
    }

    /// Runs a jog: the text after `$J`. In an alarm the jog is refused because GRBL isn't idle, not because of the lock.
    fn jog(&mut self, jog: &str, scene: &mut Scene, now_s: f64) -> Result<(), GrblError> {
        let ready = matches!(self.machine.activity(), Activity::Idle | Activity::Jog);
        if self.lock != LockState::Open || !ready {
            return Err(GrblError::NotIdle);
        }
        let words = jog.strip_prefix('=').ok_or(GrblError::BadJog)?;
        let at_mm = self.machine.parsed_mm(scene, now_s);
        if let BlockOrder::Go { to_mm, feed_mm_min } = GcodeLine::parse(words)?.jog(&self.modal, at_mm)? {
            if self.beyond_travel(to_mm) {
                return Err(GrblError::TravelExceeded);
            }
            self.machine.add(PlannedLine { to_mm, feed_mm_min, most_mm_s2: f64::INFINITY, jog: true }, scene, now_s);
        }
        Ok(())
    }

    /// Handles a byte that acts at once.
    fn act(&mut self, byte: u8, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        match byte {
            SOFT_RESET => self.reset(reply, scene, now_s),
            b'?' if self.homing.is_some() => self.asked = true,
            _ if self.lock == LockState::Critical || self.homing.is_some() => {}
            b'?' => self.tell_status(reply, scene, now_s),
            JOG_CANCEL if self.machine.activity() == Activity::Jog => self.machine.cancel(scene, now_s),
            _ => {}
        }
    }

    fn tell_status(&mut self, reply: &mut Reply, scene: &Scene, now_s: f64) {
        let status = self.status(scene, now_s);
        reply.line(self.reporter.status(&status));
    }

    /// Resets GRBL (0x18). If something moved, the position is lost.
    fn reset(&mut self, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        let in_motion = self.machine.activity() != Activity::Idle;
        match (self.homing.take(), self.lock) {
            (Some(_), _) => {
                reply.alarm(6);
                self.lock = LockState::Alarm;
            }
            (None, LockState::Open) if in_motion => {
                reply.alarm(3);
                self.lock = LockState::Alarm;
            }
            (None, LockState::Critical) => self.lock = LockState::Alarm,
            _ => {}
        }
        if std::mem::take(&mut self.unanswered) {
            reply.line("ok");
        }
        self.restart(reply, scene, now_s);
    }

    /// Restores the power-on state, except for the settings, the position and the lock.
    fn restart(&mut self, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        self.machine.cut_off(scene, now_s);
        self.modal = self.modal.after_reset();
        self.reporter = Reporter::default();
        self.reader.clear();
        self.forget_lines();
        self.asked = false;
        reply.line("");
        reply.line("Grbl 1.1h ['$' for help]");
        if self.lock == LockState::Alarm {
            reply.line("[MSG:'$H'|'$X' to unlock]");
        }
    }

    fn status(&self, scene: &Scene, now_s: f64) -> StatusReport {
        let activity = self.machine.activity();
        let state = match activity {
            _ if self.lock != LockState::Open => "Alarm",
            Activity::Idle => "Idle",
            Activity::Run => "Run",
            Activity::Jog => "Jog",
        };
        StatusReport {
            state: state.into(),
            busy: activity != Activity::Idle,
            places_mm: self.machine.places_mm(scene, now_s),
            offset_mm: self.modal.offset_mm(),
            speed_mm_s: self.machine.speed_mm_s(scene, now_s),
            switches: self.machine.switches(scene, now_s),
        }
    }

    fn beyond_travel(&self, to_mm: [f64; 3]) -> bool {
        let board = &self.machine.board;
        board.settings.limits_softly()
            && (0..3).any(|n| {
                let (least_mm, most_mm) = board.soft_limits_mm(n);
                to_mm[n] < least_mm - ROUNDING_MM || to_mm[n] > most_mm + ROUNDING_MM
            })
    }
}

/// State of the lock at power-on (build option HOMING_INIT_LOCK, which stock builds have).
fn lock_at_start(board: &MotionBoard) -> LockState {
    if board.settings.homes() { LockState::Alarm } else { LockState::Open }
}

impl GrblEmulator {
    /// Stores a line until it can be run. A line for which the buffer has no room is lost.
    fn keep(&mut self, line: &str) {
        let taken: usize = self.waiting.iter().map(|line| line.len() + 1).sum();
        if self.waiting.is_empty() || taken + line.len() < RX_MOST {
            self.waiting.push_back(line.into());
        }
    }

    fn forget_lines(&mut self) {
        self.waiting.clear();
        self.stall = None;
    }

    /// Runs the lines that no longer have to wait.
    fn run_waiting(&mut self, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        while let Some(line) = self.waiting.front().cloned() {
            if self.lock == LockState::Critical {
                self.forget_lines(); // it answers nothing until it is reset
                return;
            }
            let stall = self.stall.or_else(|| self.begin_to_wait(&line, scene, now_s));
            self.stall = stall.and_then(|stall| self.still_waits(stall, now_s));
            if self.stall.is_some() {
                return;
            }
            self.waiting.pop_front();
            self.take_line(&line, reply, scene, now_s);
            if std::mem::take(&mut self.asked) {
                self.tell_status(reply, scene, now_s);
            }
        }
    }

    /// Time from which the first line may be run, s. `None` if the line waits for another event.
    fn next_s(&self) -> Option<f64> {
        Some(match self.stall? {
            Stall::Room => self.machine.ready_s(),
            Stall::Dwell { still_s, .. } => still_s,
            Stall::Until(at_s) => at_s,
        })
    }

    /// Returns the reason for which a line has to wait. Starts homing if the line requests it.
    fn begin_to_wait(&mut self, line: &str, scene: &mut Scene, now_s: f64) -> Option<Stall> {
        let activity = self.machine.activity();
        if line == "$H" && self.machine.board.settings.homes() {
            if activity != Activity::Idle {
                return None;
            }
            let homed = self.machine.home(scene, now_s);
            self.homing = Some(homed);
            return Some(Stall::Until(homed.end_s));
        }
        if let Some(dwell_s) = GcodeLine::parse(line).ok().and_then(|block| block.dwell_s()) {
            let runs = self.lock == LockState::Open && activity != Activity::Jog;
            return runs.then_some(Stall::Dwell { still_s: now_s, dwell_s });
        }
        let moves = !line.starts_with('$') || line.starts_with("$J");
        moves.then_some(Stall::Room)
    }

    fn still_waits(&self, stall: Stall, now_s: f64) -> Option<Stall> {
        match stall {
            Stall::Room => (self.machine.ready_s() > now_s).then_some(stall),
            Stall::Dwell { still_s, dwell_s } => {
                let still_s = self.machine.end_s().max(still_s);
                if still_s > now_s {
                    Some(Stall::Dwell { still_s, dwell_s })
                } else {
                    self.still_waits(Stall::Until(still_s + dwell_s), now_s)
                }
            }
            Stall::Until(at_s) => (at_s > now_s).then_some(stall),
        }
    }
}
