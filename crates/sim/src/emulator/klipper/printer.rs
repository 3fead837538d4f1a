//! Klipper's host: its state, scripts one after another, the idle timeout and faults (Klipper's klippy/klippy.py, gcode.py,
//! webhooks.py and klippy/extras/idle_timeout.py).

use super::board::KlipperBoard;
use super::commands::{GcodeMove, POLL_S};
use super::fault::{KlipperFaultKind, KlipperFaults};
use super::klippy::{Klippy, SHUTDOWN, TIMER_TOO_CLOSE};
use super::toolhead::Toolhead;
use crate::scene::Scene;
use serde_json::Value;
use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

/// Time from a restart until Moonraker finds Klipper again, s.
const DISCONNECTED_S: f64 = 1.0;
/// Time from then until Klipper is ready, s.
const STARTUP_S: f64 = 2.0;
/// Time for which a restarting Moonraker accepts no connections, s.
const MOONRAKER_S: f64 = 3.0;
/// Time after the last move until the printer counts as ready instead of printing, s (READY_TIMEOUT).
const READY_S: f64 = 0.5;
/// Number of stored responses.
const STORE_MOST: usize = 100;

/// Result of a request, or a code and a message.
pub(super) type Outcome = Result<Value, (i64, String)>;

/// Outcome of a request that is answered later.
pub(super) type Ticket = Arc<OnceLock<Outcome>>;

/// A printer with its host.
pub(super) struct KlipperPrinter {
    pub toolhead: Toolhead,
    pub gcode: GcodeMove,
    pub klippy: Klippy,
    /// Scripts, the running one first.
    scripts: VecDeque<Script>,
    pub idle_timeout_s: f64,
    /// Time from which the idle timeout counts at the earliest, s.
    pub idle_from_s: f64,
    pub faults: KlipperFaults,
    /// Last time at which Moonraker went down, and at which it accepts connections again, s.
    pub moonraker_s: (f64, f64),
    /// Commands and responses: time, s, type and text.
    pub store: VecDeque<(f64, &'static str, String)>,
    /// Whether something happened that another connection may wait for.
    pub stirred: bool,
}

/// A script that runs or waits for its turn.
struct Script {
    lines: VecDeque<String>,
    stall: Stall,
    ticket: Ticket,
}

/// What a script waits for.
pub(super) struct Stall {
    /// End of the wait, s.
    pub until_s: f64,
    /// What follows.
    pub then: Then,
}

/// What follows a wait.
pub(super) enum Then {
    /// The next line.
    GoOn,
    /// The homing of further axes.
    Home(VecDeque<usize>),
    /// A restart of the host.
    Restart,
}

/// What happens at a time.
#[derive(Clone, Copy)]
enum Event {
    Fault,
    Stage,
    Flush,
    Script,
    Idle,
}

impl KlipperPrinter {
    /// Creates a printer that is switched on and ready.
    pub(super) fn new(board: KlipperBoard, scene: &Scene) -> Self {
        KlipperPrinter {
            gcode: GcodeMove::default(),
            klippy: Klippy::Ready,
            scripts: VecDeque::new(),
            idle_timeout_s: board.idle_timeout_s,
            idle_from_s: 0.0,
            faults: KlipperFaults(board.faults.clone()),
            moonraker_s: (f64::NEG_INFINITY, 0.0),
            store: VecDeque::new(),
            stirred: false,
            toolhead: Toolhead::new(board, scene),
        }
    }

    /// Lets everything happen that is due.
    pub(super) fn run(&mut self, scene: &mut Scene, now_s: f64) {
        loop {
            let (at_s, event) = self.next_event();
            if at_s > now_s {
                return;
            }
            self.stirred = true;
            match event {
                Event::Fault => match self.faults.take_next() {
                    Some(KlipperFaultKind::Shutdown) => self.shut_down(TIMER_TOO_CLOSE, scene, now_s),
                    Some(KlipperFaultKind::McuRestart) => self.restart(scene, now_s),
                    Some(KlipperFaultKind::MoonrakerRestart) => self.moonraker_s = (at_s, at_s + MOONRAKER_S),
                    Some(KlipperFaultKind::IdleTimeout) => self.rest(scene, now_s),
                    _ => {}
                },
                Event::Stage => {
                    self.klippy = match self.klippy {
                        Klippy::Disconnected(_) => Klippy::Startup(at_s + STARTUP_S),
                        _ => Klippy::Ready,
                    }
                }
                Event::Flush => self.toolhead.flush(at_s, scene, now_s),
                Event::Script => self.carry_on(scene, now_s),
                Event::Idle => self.rest(scene, now_s),
            }
        }
    }

    /// Time of the next event, s.
    pub(super) fn next_s(&self) -> f64 {
        self.next_event().0
    }

    /// Queues a script. Klipper runs one at a time.
    pub(super) fn begin(&mut self, script: &str, now_s: f64) -> Ticket {
        let ticket = Ticket::default();
        let lines = script.split('\n').map(str::to_owned).collect();
        let stall = Stall { until_s: now_s, then: Then::GoOn };
        self.scripts.push_back(Script { lines, stall, ticket: ticket.clone() });
        ticket
    }

    /// Stops for good, with a reason. Motion ends at once, and the motors are off.
    pub(super) fn shut_down(&mut self, reason: &str, scene: &mut Scene, now_s: f64) {
        if !matches!(self.klippy, Klippy::Ready) {
            return;
        }
        self.klippy = Klippy::Shutdown(format!("{reason}{SHUTDOWN}"));
        self.toolhead.cut_off(scene, now_s);
        if let Some(script) = self.scripts.front_mut() {
            script.stall.until_s = script.stall.until_s.min(now_s + POLL_S);
        }
        self.inform("Klipper state: Shutdown", now_s);
    }

    /// State of the idle timeout, and the time for which it counts as printing, s.
    pub(super) fn activity(&self, now_s: f64) -> (&'static str, f64) {
        let busy = self.toolhead.is_queueing() || !self.scripts.is_empty();
        match self.toolhead.plan.active_s {
            None => ("Idle", 0.0),
            Some(since_s) if busy || now_s < self.toolhead.plan.print_time_s + READY_S => ("Printing", now_s - since_s),
            Some(_) => ("Ready", 0.0),
        }
    }

    /// Reports a message to the terminals.
    pub(super) fn inform(&mut self, message: &str, now_s: f64) {
        let message = message.trim().replace('\n', "\n// ");
        self.respond(format!("// {message}"), now_s);
    }

    /// Reports a line to the terminals.
    pub(super) fn respond(&mut self, line: String, now_s: f64) {
        self.note("response", line, now_s);
    }

    /// Stores a command or a response.
    pub(super) fn note(&mut self, kind: &'static str, text: String, now_s: f64) {
        self.store.push_back((now_s, kind, text));
        if self.store.len() > STORE_MOST {
            self.store.pop_front();
        }
    }

    fn next_event(&self) -> (f64, Event) {
        let stage_s = match self.klippy {
            Klippy::Disconnected(until_s) | Klippy::Startup(until_s) => until_s,
            _ => f64::INFINITY,
        };
        let script_s = self.scripts.front().map_or(f64::INFINITY, |script| script.stall.until_s);
        let can_rest = matches!(self.klippy, Klippy::Ready) && self.scripts.is_empty() && !self.toolhead.is_queueing();
        let idle_s = match self.toolhead.plan.active_s {
            Some(_) if can_rest => {
                self.idle_from_s.max(self.toolhead.plan.print_time_s + READY_S) + self.idle_timeout_s
            }
            _ => f64::INFINITY,
        };
        [
            (stage_s, Event::Stage),
            (self.toolhead.flush_s, Event::Flush),
            (script_s, Event::Script),
            (idle_s, Event::Idle),
        ]
        .into_iter()
        .fold((self.faults.next_s(), Event::Fault), |one, other| if other.0 < one.0 { other } else { one })
    }

    /// Lets the running script go on after a wait, until its next one or its end.
    fn carry_on(&mut self, scene: &mut Scene, now_s: f64) {
        let Some(mut script) = self.scripts.pop_front() else { return };
        let ready = matches!(self.klippy, Klippy::Ready);
        let mut stalled = match std::mem::replace(&mut script.stall.then, Then::GoOn) {
            Then::GoOn => Ok(None),
            Then::Home(_) if !ready => Err("Homing failed due to printer shutdown".to_owned()),
            Then::Home(axes) if axes.is_empty() => Ok(None),
            Then::Home(axes) => Ok(Some(self.home(axes, scene, now_s))),
            Then::Restart => {
                let _ = script.ticket.set(Ok("ok".into()));
                return self.restart(scene, now_s);
            }
        };
        loop {
            stalled = match stalled {
                Ok(Some(stall)) => {
                    script.stall = stall;
                    return self.scripts.push_front(script);
                }
                Ok(None) => match script.lines.pop_front() {
                    Some(line) => self.execute(&line, scene, now_s),
                    None => {
                        let _ = script.ticket.set(Ok("ok".into()));
                        return;
                    }
                },
                Err(message) => {
                    self.gcode.last_mm = self.toolhead.commanded_mm;
                    self.respond(format!("!! {}", message.trim().lines().next().unwrap_or_default()), now_s);
                    let _ = script.ticket.set(Err((400, message)));
                    return;
                }
            };
        }
    }

    /// Switches the motors off after the idle timeout.
    fn rest(&mut self, scene: &mut Scene, now_s: f64) {
        self.toolhead.motors_off(scene, now_s);
        self.toolhead.plan.active_s = None;
    }

    /// Restarts the host and the microcontroller. All that wait for Klipper get an error.
    fn restart(&mut self, scene: &mut Scene, now_s: f64) {
        for script in self.scripts.drain(..) {
            let _ = script.ticket.set(Err((503, "Klippy Disconnected".into())));
        }
        self.toolhead.cut_off(scene, now_s);
        let board = self.toolhead.board.clone();
        self.idle_timeout_s = board.idle_timeout_s;
        self.toolhead = Toolhead::new(board, scene);
        self.gcode = GcodeMove::default();
        self.klippy = Klippy::Disconnected(now_s + DISCONNECTED_S);
    }
}
