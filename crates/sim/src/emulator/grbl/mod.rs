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
mod errors;
mod fault;
mod gcode;
mod line;
pub(in crate::emulator) mod machine;
mod report;
mod settings;
#[cfg(test)]
mod tests;
mod waiting;

use super::faults::Faults;
use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
pub use board::{MotionBoard, ROOM_MM};
pub use fault::{GrblFault, GrblFaultAfterBytes, GrblFaultKind, GrblWelcome};
pub(in crate::emulator) use settings::BoardSettings;

use errors::GrblError;
use gcode::{BlockOrder, GcodeLine, Modal};
use line::{GrblInput, LineReader};
use machine::{Activity, Homed, Machine, PlannedLine};
use report::{Reporter, StatusReport};
use std::collections::VecDeque;
use std::sync::Arc;
use tokio::sync::Notify;
use waiting::{Stall, WaitingLine};

/// Largest distance of a target beyond the travel that counts as rounding, mm.
const ROUNDING_MM: f64 = 1e-9;

/// Replacement for a line that was too long. No line contains this byte.
const OVERLONG: u8 = b'\t';
/// End of the request of a line. It distinguishes a line from a single byte.
const RUN: u8 = b'\n';

const SOFT_RESET: u8 = 0x18;
const HOLD: u8 = b'!';
const RESUME: u8 = b'~';
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
    waiting: VecDeque<WaitingLine>,
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
    /// How its welcome arrives then.
    welcome: GrblWelcome,
    faults: Faults<GrblFaultKind>,
    held: Vec<u8>,
    /// Whether the board was reset by what came last.
    is_fresh: bool,
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
            faults: Faults::new(&board.faults, &board.faults_after_bytes),
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
            welcome: GrblWelcome::Clean,
            held: Vec::new(),
            is_fresh: false,
            bell: Arc::default(),
        }
    }
}

impl Instrument for GrblEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.faults.admit(inbox, &mut self.held, |bytes| {
            Some(match self.reader.take(bytes)? {
                GrblInput::RealTime(byte) => vec![byte],
                GrblInput::Line(None) => vec![OVERLONG, RUN],
                GrblInput::Line(Some(line)) => [line.as_bytes(), &[RUN]].concat(),
            })
        })
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        self.opened = self.machine.board.boot_s.is_some();
        None
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut reply = Reply::default();
        self.go_on(&mut reply, scene, now_s);
        let is_lost = std::mem::take(&mut self.is_fresh) || self.boots_until_s.is_some();
        match request {
            _ if is_lost => {} // the bootloader takes no line
            [line @ .., RUN] => {
                self.keep(WaitingLine { text: String::from_utf8_lossy(line).into_owned(), is_others: false });
            }
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
        self.go_on(&mut reply, scene, now_s);
        self.is_fresh = false;
        self.run_waiting(&mut reply, scene, now_s);
        let fault_s = self.faults.next_s(GrblFaultKind::is_timed);
        match self.boots_until_s.or(self.stall_ends_s()).map_or(fault_s, |next_s| next_s.min(fault_s)) {
            _ if !reply.0.is_empty() => Owed::Ready(reply.0.into_bytes()),
            next_s if next_s.is_finite() => Owed::At(next_s),
            _ => Owed::Nothing,
        }
    }
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
    /// Lets everything happen that is due, but for lines that wait.
    fn go_on(&mut self, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        self.faults.come(now_s);
        if std::mem::take(&mut self.opened) {
            self.power_cycle(GrblWelcome::Clean, scene, now_s);
        }
        self.machine.settle(scene, now_s);
        while let Some(kind) = self.faults.take(now_s, GrblFaultKind::is_timed) {
            match kind {
                GrblFaultKind::Restart(welcome) => self.power_cycle(welcome, scene, now_s),
                GrblFaultKind::CountsJump(by) => self
                    .machine
                    .miscount(std::array::from_fn(|n| f64::from(by[n]) / self.machine.board.settings.steps_per_mm(n))),
                GrblFaultKind::Other(text) if self.boots_until_s.is_none() => self.take_others(text, scene, now_s),
                _ => {}
            }
        }
        if let Some(until_s) = self.boots_until_s {
            self.reader.clear();
            if now_s >= until_s {
                self.boots_until_s = None;
                let mut said = Reply::default();
                self.restart(&mut said, scene, now_s);
                if self.welcome != GrblWelcome::Lost {
                    let clean = GrblWelcome::Clean.text();
                    reply.0 += &said.0.replacen(clean, self.welcome.text(), 1);
                }
            }
        }
    }

    /// Resets the board: it boots, and counts from zero where it is.
    fn power_cycle(&mut self, welcome: GrblWelcome, scene: &mut Scene, now_s: f64) {
        self.machine.power_cycle(scene, now_s);
        self.homing = None;
        self.unanswered = false;
        self.lock = lock_at_start(&self.machine.board);
        self.forget_lines();
        (self.welcome, self.is_fresh) = (welcome, true);
        self.boots_until_s = Some(now_s + self.machine.board.boot_s.unwrap_or(0.0));
    }

    /// Takes what another sender sends. It needs no room, because that sender waits for its answers.
    fn take_others(&mut self, text: &str, scene: &mut Scene, now_s: f64) {
        let (mut reader, mut bytes) = (LineReader::default(), format!("{text}\n").into_bytes());
        while let Some(input) = reader.take(&mut bytes) {
            match input {
                GrblInput::RealTime(byte) => self.act(byte, &mut Reply::default(), scene, now_s),
                GrblInput::Line(Some(text)) => self.waiting.push_back(WaitingLine { text, is_others: true }),
                GrblInput::Line(None) => {}
            }
        }
    }

    fn take_line(&mut self, line: &str, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        match self.run(line, reply, scene, now_s) {
            Ok(()) if self.unanswered => {}
            Ok(()) => self.ok(reply, now_s),
            Err(fault) => reply.line(format!("error:{}", fault as u8)),
        }
    }

    fn ok(&mut self, reply: &mut Reply, now_s: f64) {
        let times = match self.faults.take(now_s, |kind| !kind.is_timed()) {
            Some(GrblFaultKind::LostOk) => 0,
            Some(_) => 2,
            None => 1,
        };
        (0..times).for_each(|_| reply.line("ok"));
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
            JOG_CANCEL | HOLD if self.machine.activity() == Activity::Jog => self.machine.cancel(scene, now_s),
            HOLD if self.lock == LockState::Open => self.machine.hold(scene, now_s),
            RESUME => self.machine.resume(scene, now_s),
            _ => {}
        }
    }

    fn tell_status(&mut self, reply: &mut Reply, scene: &Scene, now_s: f64) {
        let status = self.status(scene, now_s);
        reply.line(self.reporter.status(&status));
    }

    /// Resets GRBL (0x18). If something moved, the position is lost.
    fn reset(&mut self, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        let rests = |rests_s| rests_s <= now_s;
        let in_motion = self.machine.activity() != Activity::Idle && !self.machine.held_s().is_some_and(rests);
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
        reply.line(GrblWelcome::Clean.text());
        if self.lock == LockState::Alarm {
            reply.line("[MSG:'$H'|'$X' to unlock]");
        }
    }

    fn status(&self, scene: &Scene, now_s: f64) -> StatusReport {
        let activity = self.machine.activity();
        let held_s = self.machine.held_s();
        let state = match activity {
            _ if self.lock != LockState::Open => "Alarm",
            _ if held_s.is_some_and(|rests_s| rests_s > now_s) => "Hold:1",
            _ if held_s.is_some() => "Hold:0",
            Activity::Idle => "Idle",
            Activity::Run => "Run",
            Activity::Jog => "Jog",
        };
        StatusReport {
            state: state.into(),
            busy: activity != Activity::Idle || held_s.is_some(),
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
