//! Stock Marlin 2.1 on a printer of three axes (documents: _gcode of MarlinFirmware/MarlinDocumentation, Marlin/src of
//! MarlinFirmware/Marlin at 2.1). It receives lines, and answers each with `ok` when it has carried it out. A motion is carried out
//! when it is in the queue.
//!
//! The end of the queue and the present place are different things: M114 states both, the first as X, Y and Z, the second as a count
//! of steps. A stock build has no EMERGENCY_PARSER; a board can have one. Without it an M112 or M410 without a number acts when its line moves from the serial
//! buffer to the command buffer (queue.cpp, `get_serial_commands`). One with a number acts when its turn comes. After M112 the motors step on for 0.6 s, and then nothing is
//! answered until a reset.
//!
//! Opening the port resets the board. What comes while it boots is lost. Then it counts its homes wherever the axes are.
//!
//! Motors that are switched off keep their places, unless the board has a `slip_mm`. Nobody pushes the axes.
//!
//! A motion begins where the last one ends, in the modes of the last G90 or G91 and G20 or G21, which all that talk to the board share.
//! G92 shifts the logical coordinates, and leaves the steps, unless the build has no workspace offsets (G92.cpp).
//!
//! The queue has 15 blocks (a ring of 16). Lines along one straight line at one rate are joined to one of them. Corners are stops.
//! The extruder is accepted and ignored, as are heaters, fan and jerk. Other commands of Marlin that no client here needs are
//! answered as unknown, also M92 with values.

mod board;
mod commands;
mod fault;
mod gcode;
mod line;
mod planner;
mod queue;
mod report;
#[cfg(test)]
mod tests;

use super::faults::Faults;
use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
pub use board::MarlinBoard;
pub use fault::{Announced, MarlinFault, MarlinFaultAfterBytes, MarlinFaultKind};

use commands::Stall;
use line::SerialLines;
use planner::MarlinPlanner;
use queue::QueuedLine;
use std::collections::VecDeque;
use std::sync::Arc;
use tokio::sync::Notify;

/// Time from one `busy` to the next, s (M113).
const KEEPALIVE_S: f64 = 2.0;
/// Time for which no motion is accepted after a quick stop, s.
const CLEANING_S: f64 = 1.0;
/// Time from a kill to the end of the steps, s.
const DYING_S: f64 = 0.6;

/// Reason that an M112 states.
const KILLED: &str = "M112 Shutdown";

/// A printer's board with Marlin.
pub struct MarlinEmulator {
    /// The board as it is after each reset.
    stock: MarlinBoard,
    planner: MarlinPlanner,
    power: Power,
    reader: SerialLines,
    held: Vec<u8>,
    /// Whether the board was reset by what came last.
    is_fresh: bool,
    /// Whether what was received before a refused line is discarded.
    flushes: bool,
    /// Number of the last line that was accepted.
    last_line: i64,
    /// Lines that came, at most as many as fit into the serial buffer.
    received: VecDeque<String>,
    /// Lines that were accepted, the one that is carried out in front.
    commands: VecDeque<QueuedLine>,
    /// What the first of them waits for; `None` before it begins.
    stall: Option<Stall>,
    /// Time until which nothing is carried out, s.
    held_s: f64,
    keepalive_s: f64,
    /// Time of the next `busy`, s.
    busy_s: f64,
    /// Time from one report of temperatures to the next, and time of the next, s (M155).
    reports: Option<(f64, f64)>,
    faults: Faults<MarlinFaultKind>,
    /// Whether the port was opened since the last request.
    opened: bool,
    bell: Arc<Notify>,
}

/// State of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Power {
    /// Boots until this time, s, and then announces itself.
    Boots(f64, Announced),
    Runs,
    /// Killed. The steps end at this time, s.
    Dies(f64),
    Dead,
}

/// What happens at a time.
#[derive(Clone, Copy, Debug)]
enum Event {
    Fault,
    Ready,
    Death,
    Command,
    Busy,
    Report,
    Rest,
}

impl MarlinEmulator {
    /// Creates a board that has been switched on. Its axes count their homes at their present places in the scene.
    pub fn new(board: MarlinBoard, scene: &Scene) -> Self {
        MarlinEmulator {
            planner: MarlinPlanner::new(board.clone(), scene),
            power: Power::Runs,
            reader: SerialLines::default(),
            held: Vec::new(),
            is_fresh: false,
            flushes: false,
            last_line: 0,
            received: VecDeque::new(),
            commands: VecDeque::new(),
            stall: None,
            held_s: 0.0,
            keepalive_s: KEEPALIVE_S,
            busy_s: f64::INFINITY,
            reports: None,
            faults: Faults::new(&board.faults, &board.faults_after_bytes),
            opened: false,
            bell: Arc::default(),
            stock: board,
        }
    }
}

impl Instrument for MarlinEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        if std::mem::take(&mut self.flushes) {
            inbox.clear();
            self.reader.clear();
        }
        self.faults.admit(inbox, &mut self.held, |bytes| self.reader.take(bytes))
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        self.opened = self.stock.boot_s.is_some();
        None
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut reply = MarlinReply::default();
        self.run(&mut reply, scene, now_s);
        let is_lost = std::mem::take(&mut self.is_fresh) || request.is_empty();
        if self.power == Power::Runs && !is_lost {
            self.receive(request, &mut reply, scene, now_s);
            self.accept_lines(&mut reply, scene, now_s);
            self.run(&mut reply, scene, now_s);
        }
        self.bell.notify_waiters();
        reply.0.into_bytes()
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        let mut reply = MarlinReply::default();
        self.run(&mut reply, scene, now_s);
        // what comes after this is no part of what was received before a refused line or a reset
        (self.flushes, self.is_fresh) = (false, false);
        match self.next_event().0 {
            _ if !reply.0.is_empty() => Owed::Ready(reply.0.into_bytes()),
            next_s if next_s.is_finite() => Owed::At(next_s),
            _ => Owed::Nothing,
        }
    }
}

/// Reply lines.
#[derive(Default)]
struct MarlinReply(String);

impl MarlinReply {
    fn line(&mut self, line: impl AsRef<str>) {
        self.0 += line.as_ref();
        self.0.push('\n');
    }
}

impl MarlinEmulator {
    /// Lets everything happen that is due.
    fn run(&mut self, reply: &mut MarlinReply, scene: &mut Scene, now_s: f64) {
        if std::mem::take(&mut self.opened) {
            self.reset(Announced::Start, scene, now_s);
        }
        self.faults.come(now_s);
        loop {
            self.planner.settle(scene, now_s);
            let (at_s, event) = self.next_event();
            if at_s > now_s {
                return;
            }
            match event {
                Event::Fault => self.fail(reply, scene, (at_s, now_s)),
                Event::Ready => self.be_ready(reply),
                Event::Death => {
                    self.power = Power::Dead;
                    self.planner.cut_off(scene, now_s);
                    self.planner.motors_off([true; 3], scene, now_s);
                }
                Event::Command => self.carry_on(reply, scene, now_s),
                Event::Busy => {
                    reply.line("echo:busy: processing");
                    self.busy_s += self.keepalive_s;
                }
                Event::Report => {
                    reply.line(report::TEMPERATURES);
                    self.reports = self.reports.map(|(every_s, next_s)| (every_s, next_s + every_s));
                }
                Event::Rest => self.planner.rest(scene, now_s),
            }
        }
    }

    /// Time of the next event, s, and the event.
    fn next_event(&self) -> (f64, Event) {
        let fault = (self.faults.next_s(MarlinFaultKind::is_timed), Event::Fault);
        let command_s = match (self.commands.is_empty(), self.stall) {
            (true, _) => f64::INFINITY,
            (false, None) => self.held_s,
            (false, Some(stall)) => self.held_s.max(stall.end_s(&self.planner)),
        };
        let running = [
            (command_s, Event::Command),
            (self.busy_s, Event::Busy),
            (self.reports.map_or(f64::INFINITY, |(_, next_s)| next_s), Event::Report),
            (self.planner.rests_s(), Event::Rest),
        ];
        match self.power {
            Power::Boots(until_s, _) => earlier(fault, (until_s, Event::Ready)),
            Power::Dies(until_s) => earlier(fault, (until_s, Event::Death)),
            Power::Dead => fault,
            Power::Runs => running.into_iter().fold(fault, earlier),
        }
    }

    fn fail(&mut self, reply: &mut MarlinReply, scene: &mut Scene, (at_s, now_s): (f64, f64)) {
        match self.faults.take(now_s, MarlinFaultKind::is_timed) {
            Some(kind @ MarlinFaultKind::Chatter { every_s }) => {
                // it happens again
                self.faults.add(MarlinFault { from_s: at_s + every_s.max(0.001), kind });
                if self.power == Power::Runs {
                    reply.line(report::TEMPERATURES);
                }
            }
            Some(MarlinFaultKind::Restart(announced)) => self.reset(announced, scene, now_s),
            Some(MarlinFaultKind::MotorsOff) => self.planner.lose_current(scene, now_s),
            Some(MarlinFaultKind::CountsJump(by)) => self.planner.miscount(by),
            Some(MarlinFaultKind::Other(lines)) if self.power == Power::Runs => {
                self.take_others(lines, reply, scene, now_s)
            }
            _ => {}
        }
    }

    /// Resets the board. The axes move on a little if they moved.
    fn reset(&mut self, announced: Announced, scene: &mut Scene, now_s: f64) {
        self.planner.reset(self.stock.clone(), scene, now_s);
        let fresh = MarlinEmulator::new(self.stock.clone(), scene);
        let old = std::mem::replace(self, fresh);
        (self.planner, self.faults, self.held, self.bell) = (old.planner, old.faults, old.held, old.bell);
        self.is_fresh = true;
        self.power = Power::Boots(now_s + self.stock.boot_s.unwrap_or(0.0), announced);
    }

    /// Runs after a reset, and announces it. What has come of a line meanwhile is lost.
    fn be_ready(&mut self, reply: &mut MarlinReply) {
        let Power::Boots(_, announced) = std::mem::replace(&mut self.power, Power::Runs) else { return };
        self.reader.clear();
        match announced {
            Announced::Silent => {}
            Announced::Cut => reply.0 += announced.first_line(),
            _ => {
                reply.line(announced.first_line());
                report::BANNER.iter().for_each(|line| reply.line(line));
                report::settings(&self.planner).iter().for_each(|line| reply.line(line));
            }
        }
    }

    /// Puts another host's lines into the command buffer. They need no room, because it waits for that itself.
    fn take_others(&mut self, lines: &str, reply: &mut MarlinReply, scene: &mut Scene, now_s: f64) {
        for text in lines.lines() {
            self.act_early(text, reply, scene, now_s);
            self.commands.push_back(QueuedLine { text: text.to_owned(), is_others: true });
        }
    }

    /// Stops for good, with a reason.
    fn kill(&mut self, reason: &str, reply: &mut MarlinReply, now_s: f64) {
        reply.line(format!("echo:{reason}"));
        reply.line("Error:Printer halted. kill() called!");
        self.power = Power::Dies(now_s + DYING_S);
    }

    /// Answers a line with `ok` and perhaps more.
    fn ok(&mut self, more: &str, reply: &mut MarlinReply, now_s: f64) {
        let fault =
            self.faults.take(now_s, |kind| matches!(kind, MarlinFaultKind::LostOk | MarlinFaultKind::DoubledOk));
        let times = match fault {
            Some(MarlinFaultKind::LostOk) => 0,
            Some(_) => 2,
            None => 1,
        };
        (0..times).for_each(|_| reply.line(format!("ok{more}")));
    }
}

fn earlier(one: (f64, Event), other: (f64, Event)) -> (f64, Event) {
    if other.0 < one.0 { other } else { one }
}
