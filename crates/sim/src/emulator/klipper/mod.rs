//! A 3D printer with stock Klipper 0.12, reached through the HTTP port of Moonraker (documents: docs/Status_Reference.md,
//! docs/G-Codes.md and docs/API_Server.md of Klipper3d/klipper and its klippy folder; docs/external_api of Arksine/moonraker
//! and its moonraker/components folder). Requests are JSON-RPC in the bodies of POST, one in each.
//!
//! A script is answered when its last line is carried out. A move is carried out when it is planned. So only M400 waits for the
//! axes, and it looks every 0.1 s. Klipper runs one script at a time: others wait, also on other connections. Queries
//! don't wait. A connection answers one request after another.
//!
//! A script may save the coordinates and restore them, so that its relative moves leave no trace. A script that is refused ends at that
//! line, and what it set until then stays.
//!
//! Each move begins and ends with a rest. G28 finds no endstop, and moves nothing. There is no extruder, no heater, no file and no
//! subscription. Axes whose motors are off stay where they are.

mod api;
mod board;
mod gcode;
mod http;
mod printer;
#[cfg(test)]
mod tests;
mod toolhead;

use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
pub use board::{KlipperBoard, KlipperFault, KlipperFaultAfterBytes, KlipperFaultKind};

use palpate_core::parallel::lock;
use printer::{KlipperPrinter, Ticket};
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use tokio::sync::Notify;

/// Number of requests that wait on one connection. Further ones are lost.
const WAITING_MOST: usize = 64;

/// A printer with Klipper and Moonraker, ready and not homed. One value of this type is one connection. Each served link opens its
/// own.
pub struct KlipperEmulator {
    printer: Shared<KlipperPrinter>,
    bell: Arc<Notify>,
    /// Bytes of a request that isn't complete. An inbox is too small for the longest ones.
    received: Vec<u8>,
    held: Vec<u8>,
    /// Requests that wait for their turn.
    waiting: VecDeque<Vec<u8>>,
    turn: Turn,
    /// Whether Moonraker closes the connection. It takes no further request.
    closes: bool,
}

/// What a connection does.
enum Turn {
    /// It takes the next request.
    Next,
    /// It waits for the outcome of a call with this id.
    Called(Value, Ticket),
    /// It sends an answer at a time, s. If that is infinite, the answer is lost, and no other follows.
    Late(f64, Vec<u8>),
}

impl KlipperEmulator {
    /// Creates a printer that has been switched on. Its axes aren't homed, and count 0 at their present places in the scene.
    pub fn new(board: KlipperBoard, scene: &Scene) -> Self {
        KlipperEmulator::on(Arc::new(Mutex::new(KlipperPrinter::new(board, scene))), Arc::default())
    }

    fn on(printer: Shared<KlipperPrinter>, bell: Arc<Notify>) -> Self {
        let (received, held, waiting) = (Vec::new(), Vec::new(), VecDeque::new());
        KlipperEmulator { printer, bell, received, held, waiting, turn: Turn::Next, closes: false }
    }

    /// Lets the printer continue and answers what can be answered. Returns the answers, and the time of the next event, s.
    fn go_on(&mut self, scene: &mut Scene, now_s: f64) -> (Vec<u8>, f64) {
        let shared = self.printer.clone();
        let mut printer = lock(&shared);
        printer.run(scene, now_s);
        if now_s < printer.moonraker_s {
            (self.closes, self.turn) = (true, Turn::Next);
        }
        let mut answers = Vec::new();
        loop {
            self.turn = match &mut self.turn {
                Turn::Next => match self.waiting.pop_front() {
                    Some(request) if !self.closes => {
                        let read = http::read(&request);
                        self.closes = !matches!(read, Ok((_, false)));
                        match read {
                            Ok((json, _)) => api::call(json, &mut printer, scene, now_s),
                            Err(status) => Turn::Late(
                                now_s,
                                http::answer(status, &json!({"error": {"message": status}}).to_string(), true),
                            ),
                        }
                    }
                    _ => break,
                },
                Turn::Called(id, ticket) => {
                    let Some(outcome) = ticket.get() else { break };
                    let at_s = match printer.faults.take(now_s, KlipperFaultKind::is_of_answer) {
                        Some(KlipperFaultKind::LostAnswer) => f64::INFINITY,
                        Some(KlipperFaultKind::SlowAnswer(later_s)) => now_s + later_s,
                        _ => now_s,
                    };
                    Turn::Late(at_s, api::answer(id, outcome, self.closes))
                }
                Turn::Late(at_s, _) if *at_s > now_s => break,
                Turn::Late(_, answer) => {
                    answers.append(answer);
                    Turn::Next
                }
            };
        }
        if std::mem::take(&mut printer.stirred) {
            self.bell.notify_waiters();
        }
        let late_s = if let Turn::Late(at_s, _) = self.turn { at_s } else { f64::INFINITY };
        (answers, printer.next_s().min(late_s))
    }
}

impl Instrument for KlipperEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        lock(&self.printer).faults.admit(inbox, &mut self.held, |bytes| {
            self.received.append(bytes);
            http::take(&mut self.received)
        })
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        if self.waiting.len() < WAITING_MOST && !request.is_empty() {
            self.waiting.push_back(request.to_vec());
        }
        self.go_on(scene, now_s).0
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        Some(Arc::new(Mutex::new(KlipperEmulator::on(self.printer.clone(), self.bell.clone()))))
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        let (answers, next_s) = self.go_on(scene, now_s);
        match () {
            () if !answers.is_empty() => Owed::Ready(answers),
            () if self.closes && matches!(self.turn, Turn::Next) => Owed::HungUp,
            () if next_s.is_finite() => Owed::At(next_s),
            () => Owed::Nothing,
        }
    }
}
