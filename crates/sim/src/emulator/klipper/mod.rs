//! A 3D printer with stock Klipper 0.12, reached through the HTTP port of Moonraker (documents: docs/Status_Reference.md,
//! docs/G-Codes.md and docs/API_Server.md of Klipper3d/klipper and its klippy folder; docs/external_api of Arksine/moonraker
//! and its moonraker/components folder).
//!
//! A script is answered when its last line is carried out. A move is carried out when it is queued. So only M400 waits for the
//! axes, and it looks every 0.1 s. Klipper runs one script at a time: others wait, also on other connections. Queries and the
//! emergency stop don't wait. A connection answers one request after another.
//!
//! Moves end at corners with a rest. Moves along one line at one speed are joined. There is no extruder, no heater and no
//! subscription. Axes whose motors are off stay where they are.

mod api;
mod board;
mod commands;
mod fault;
mod gcode;
mod http;
mod klippy;
mod plan;
mod printer;
mod status;
#[cfg(test)]
mod tests;
mod toolhead;

use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
pub use board::KlipperBoard;
pub use fault::{KlipperFault, KlipperFaultKind};

use api::Exchange;
use http::{HttpReader, HttpRequest};
use palpate_core::parallel::lock;
use printer::KlipperPrinter;
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
    reader: HttpReader,
    /// Requests that wait for their turn.
    waiting: VecDeque<Vec<u8>>,
    exchange: Option<Exchange>,
    /// An answer that is sent later, and its time, s.
    held: Option<(f64, Vec<u8>)>,
    /// Time of the first look at this connection, s.
    opened_s: Option<f64>,
    /// Whether an answer was lost, so that no other can follow.
    mute: bool,
    /// Whether Moonraker closes the connection.
    closes: bool,
}

impl KlipperEmulator {
    /// Creates a printer that has been switched on. Its axes aren't homed, and count 0 at their present places in the scene.
    pub fn new(board: KlipperBoard, scene: &Scene) -> Self {
        KlipperEmulator::on(Arc::new(Mutex::new(KlipperPrinter::new(board, scene))), Arc::default())
    }

    fn on(printer: Shared<KlipperPrinter>, bell: Arc<Notify>) -> Self {
        KlipperEmulator {
            printer,
            bell,
            reader: HttpReader::default(),
            waiting: VecDeque::new(),
            exchange: None,
            held: None,
            opened_s: None,
            mute: false,
            closes: false,
        }
    }

    /// Lets the printer go on and answers what can be answered. Returns the answers, and the time of the next event, s.
    fn go_on(&mut self, scene: &mut Scene, now_s: f64) -> (Vec<u8>, f64) {
        let shared = self.printer.clone();
        let mut printer = lock(&shared);
        let opened_s = *self.opened_s.get_or_insert(now_s);
        printer.run(scene, now_s);
        let (down_s, up_s) = printer.moonraker_s;
        if opened_s < down_s || (down_s..up_s).contains(&now_s) {
            self.closes = true;
            (self.exchange, self.held) = (None, None);
            self.waiting.clear();
        }
        let mut answers = Vec::new();
        while !self.mute {
            if let Some((_, answer)) = self.held.take_if(|held| held.0 <= now_s) {
                answers.extend(answer);
            }
            if self.held.is_some() || self.exchange.is_none() && (self.closes || !self.begin(&mut answers)) {
                break;
            }
            let Some(exchange) = &mut self.exchange else { break };
            let Some(answer) = exchange.go_on(&mut printer, scene, now_s) else { break };
            self.closes |= exchange.closes;
            self.exchange = None;
            match printer.faults.take_of_answer(now_s) {
                Some(KlipperFaultKind::LostAnswer) => self.mute = true,
                Some(KlipperFaultKind::SlowAnswer(later_s)) => self.held = Some((now_s + later_s, answer)),
                _ => answers.extend(answer),
            }
        }
        let held_s = self.held.as_ref().map_or(f64::INFINITY, |held| held.0);
        let next_s = printer.next_s().min(held_s);
        if std::mem::take(&mut printer.stirred) {
            self.bell.notify_waiters();
        }
        (answers, next_s)
    }

    /// Begins to answer the next request. Returns whether there is one.
    fn begin(&mut self, answers: &mut Vec<u8>) -> bool {
        let Some(bytes) = self.waiting.pop_front() else { return false };
        match HttpRequest::parse(&bytes) {
            Some(request) => self.exchange = Some(Exchange::new(&request)),
            None => {
                answers.extend(http::refusal());
                self.closes = true;
            }
        }
        self.exchange.is_some()
    }
}

impl Instrument for KlipperEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.reader.take(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        if self.waiting.len() < WAITING_MOST {
            self.waiting.push_back(request.to_vec());
        }
        let (answers, _) = self.go_on(scene, now_s);
        self.bell.notify_waiters();
        answers
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
            () if self.closes && self.held.is_none() => Owed::HungUp,
            () if next_s.is_finite() => Owed::At(next_s),
            () => Owed::Nothing,
        }
    }
}
