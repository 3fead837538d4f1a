//! Klipper's host: its state, scripts one after another, the idle timeout and faults (Klipper's klippy/klippy.py, mcu.py, gcode.py
//! and klippy/extras/idle_timeout.py).

use super::board::{KlipperBoard, KlipperFaultKind};
use super::gcode::{GcodeMove, POLL_S};
use super::toolhead::Toolhead;
use crate::emulator::faults::Faults;
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
/// Time after the last move from which the idle timeout counts, s (READY_TIMEOUT).
const READY_S: f64 = 0.5;
/// Message of a microcontroller that got a step too late.
const TIMER_TOO_CLOSE: &str = "MCU 'mcu' shutdown: Timer too close\nThis often indicates the host computer is overloaded. \
    Check\nfor other processes consuming excessive CPU time, high swap\nusage, disk errors, overheating, unstable voltage, \
    or\nsimilar system problems on the host computer.";
/// Advice that follows the reason of a shutdown.
const SHUTDOWN: &str = "\nOnce the underlying issue is corrected, use the\n\"FIRMWARE_RESTART\" command to reset the firmware, \
    reload the\nconfig, and restart the host software.\nPrinter is shutdown\n";
/// Message of a host that connects to the microcontroller.
const CONNECTING: &str =
    "\nPrinter is not ready\nThe klippy host software is attempting to connect.  Please\nretry in a few moments.\n";

/// Outcome of a request, once there is one: a result, or a code and a message.
pub(super) type Ticket = Arc<OnceLock<Outcome>>;
pub(super) type Outcome = Result<Value, (i64, String)>;

/// A printer with its host.
pub(super) struct KlipperPrinter {
    /// The printer as it is after each restart.
    pub stock: KlipperBoard,
    pub toolhead: Toolhead,
    pub gcode: GcodeMove,
    pub klippy: Klippy,
    pub faults: Faults<KlipperFaultKind>,
    /// Time from which Moonraker accepts connections, s.
    pub moonraker_s: f64,
    /// Whether something happened that another connection may wait for.
    pub stirred: bool,
    /// Scripts, the running one first.
    scripts: VecDeque<Script>,
}

/// A script that runs or waits for its turn.
struct Script {
    lines: VecDeque<String>,
    /// Time until which it waits, s.
    until_s: f64,
    ticket: Ticket,
}

/// State of Klipper's host software.
pub(super) struct Klippy {
    /// `ready`, `shutdown`, `disconnected` from Moonraker, or `startup`.
    pub name: &'static str,
    pub message: String,
    /// Time until which it stays, s.
    until_s: f64,
}

impl Klippy {
    fn new(name: &'static str, message: &str, until_s: f64) -> Self {
        Klippy { name, message: message.to_owned(), until_s }
    }
}

impl KlipperPrinter {
    /// Creates a printer that is switched on, and ready when it [runs](Self::run).
    pub(super) fn new(board: KlipperBoard, scene: &Scene) -> Self {
        KlipperPrinter {
            gcode: GcodeMove::default(),
            klippy: Klippy::new("startup", CONNECTING, 0.0),
            faults: Faults::new(&board.faults, &board.faults_after_bytes),
            stirred: false,
            moonraker_s: f64::NEG_INFINITY,
            scripts: VecDeque::new(),
            toolhead: Toolhead::new(board.clone(), scene),
            stock: board,
        }
    }

    /// Lets everything happen that is due.
    pub(super) fn run(&mut self, scene: &mut Scene, now_s: f64) {
        self.faults.come(now_s);
        loop {
            let [fault_s, host_s, script_s, idle_s] = self.due_s();
            match self.klippy.name {
                _ if fault_s <= now_s => match self.faults.take(now_s, |kind| !kind.is_of_answer()) {
                    Some(KlipperFaultKind::Shutdown) => self.shut_down(TIMER_TOO_CLOSE, scene, now_s),
                    Some(KlipperFaultKind::McuRestart) => self.restart(scene, now_s),
                    Some(KlipperFaultKind::MoonrakerRestart) => self.moonraker_s = fault_s + MOONRAKER_S,
                    Some(KlipperFaultKind::Other(script)) => drop(self.queue(script, now_s)),
                    _ => self.toolhead.motors_off(now_s),
                },
                "disconnected" if host_s <= now_s => {
                    self.klippy = Klippy::new("startup", CONNECTING, host_s + STARTUP_S)
                }
                _ if host_s <= now_s => self.klippy = Klippy::new("ready", "Printer is ready", f64::INFINITY),
                _ if script_s <= now_s => self.carry_on(scene, now_s),
                _ if idle_s <= now_s => self.toolhead.motors_off(now_s),
                _ => return,
            }
            self.stirred = true;
        }
    }

    /// Time of the next event, s; infinite without one.
    pub(super) fn next_s(&self) -> f64 {
        self.due_s().into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Begins a script, or lets it wait for others. Klipper runs one at a time.
    pub(super) fn begin(&mut self, script: &str, scene: &mut Scene, now_s: f64) -> Ticket {
        let ticket = self.queue(script, now_s);
        self.run(scene, now_s);
        ticket
    }

    fn queue(&mut self, script: &str, now_s: f64) -> Ticket {
        let ticket = Ticket::default();
        let lines = script.split('\n').map(str::to_owned).collect();
        self.scripts.push_back(Script { lines, until_s: now_s, ticket: ticket.clone() });
        ticket
    }

    /// Stops for good, with a reason. Motion ends at once, and the motors are off.
    pub(super) fn shut_down(&mut self, reason: &str, scene: &mut Scene, now_s: f64) {
        if self.klippy.name == "ready" {
            self.klippy = Klippy::new("shutdown", &format!("{reason}{SHUTDOWN}"), f64::INFINITY);
            self.toolhead.cut_off(scene, now_s);
            self.scripts.iter_mut().for_each(|script| script.until_s = script.until_s.min(now_s + POLL_S));
        }
    }

    /// Restarts the host and the microcontroller. All that wait for Klipper get an error.
    pub(super) fn restart(&mut self, scene: &mut Scene, now_s: f64) {
        for script in self.scripts.drain(..) {
            let _ = script.ticket.set(Err((503, "Klippy Disconnected".into())));
        }
        self.toolhead.cut_off(scene, now_s);
        self.toolhead = Toolhead::new(self.stock.clone(), scene);
        self.gcode = GcodeMove::default();
        self.klippy = Klippy::new("disconnected", "Klippy Disconnected", now_s + DISCONNECTED_S);
    }

    /// Times at which a fault happens, the host becomes another, a script continues, and the idle timeout ends, s.
    fn due_s(&self) -> [f64; 4] {
        let script_s = self.scripts.front().map_or(f64::INFINITY, |script| script.until_s);
        // the motors of axes that aren't homed are off
        let rests = self.toolhead.homed != [false; 3] && self.klippy.name == "ready" && self.scripts.is_empty();
        let idle_s = self.toolhead.print_time_s + READY_S + self.toolhead.board.idle_timeout_s;
        let fault_s = self.faults.next_s(|kind| !kind.is_of_answer());
        [fault_s, self.klippy.until_s, script_s, if rests { idle_s } else { f64::INFINITY }]
    }

    /// Lets the running script continue after a wait, until its next one or its end.
    fn carry_on(&mut self, scene: &mut Scene, now_s: f64) {
        let Some(mut script) = self.scripts.pop_front() else { return };
        let outcome = loop {
            let Some(line) = script.lines.pop_front() else { break Ok("ok".into()) };
            match self.execute(&line, scene, now_s) {
                Ok(until_s) if until_s > now_s => {
                    script.until_s = until_s;
                    return self.scripts.push_front(script);
                }
                Ok(_) => {}
                Err(message) => {
                    self.gcode.now.last_mm = self.toolhead.commanded_mm;
                    break Err((400, message));
                }
            }
        };
        let _ = script.ticket.set(outcome);
    }
}
