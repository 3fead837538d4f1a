//! Boards that push readings as lines or frames on a serial port or USB: what most public tactile sensors do.
//!
//! A [`SerialBoard`] runs a [`BoardFirmware`]. It takes readings by its own clock and sends each as one line. No client can slow it down,
//! and bytes that no client reads are lost. Opening the link resets a board whose USB adapter pulls its reset line (Uno, Nano). Such a
//! board is silent for its boot time, then prints its greeting, then readings. Opening a board with native USB doesn't reset it, so the
//! first line may lack its beginning.
//!
//! A pseudo-terminal doesn't show when a client opens it. On one, the board starts once, when the terminal is offered. A board has
//! one serial line, so with several clients at once each line reaches only one of them.
//!
//! - [`Hx711`]: an Arduino with the HX711 amplifier of a load cell.
//! - [`Mark10`]: a Mark-10 force gauge, which also answers requests.
//! - [`NetFt`]: an ATI Net F/T, a load cell with six axes that sends datagrams.
//! - [`Bota`], [`Gsv8`]: load cells with six axes that send frames on a serial line.
//! - [`ReSkin`]: binary frames of magnetometers, ReSkin and AnySkin.
//! - [`Velostat`]: a pressure matrix at the converter of an Arduino.
//! - [`OneNumber`]: an Arduino that prints one number a line.

pub(super) mod axes;
mod bota;
mod fault;
mod gsv8;
mod hx711;
mod mark10;
mod mlx90393;
mod net_ft;
mod one_number;
mod port;
mod print;
mod reskin;
mod scale;
#[cfg(test)]
mod tests;
mod velostat;

pub use axes::{STRAIGHT, read as read_axes};
pub use bota::Bota;
pub use fault::{Damage, DamageKind, LineFault, LineFaultKind};
pub use gsv8::Gsv8;
pub use hx711::{Hx711, Hx711Sketch};
pub use mark10::Mark10;
pub use mlx90393::REST_MICROTESLA;
pub use net_ft::NetFt;
pub use one_number::OneNumber;
pub use port::Port;
pub use reskin::ReSkin;
pub use scale::CellScale;
pub use velostat::Velostat;

use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
use fault::LineFaults;
use palpate_core::quantity::{RandomStream, stream};
use palpate_link::wire::SerialLine;
use port::Uart;
use rand::RngExt;
use std::collections::VecDeque;
use std::mem;
use std::sync::Arc;
use tokio::sync::Notify;

/// End of every line and frame: `Serial.println` of Arduino, and the manual of the Mark-10.
pub(super) const LINE_END: &[u8] = b"\r\n";

/// Number of lines that a board remembers having sent.
pub(crate) const SENT_MOST: usize = 4096;

/// Time before an event at which it counts as due, s: times are rounded on their way through the clock.
const EARLY_S: f64 = 1e-6;

/// Least time between readings, s. It bounds the work of a board whose firmware states no time at all.
const PERIOD_LEAST_S: f64 = 1e-4;

/// Longest delay after which a board still sends its late lines, s. If nothing asked it for longer, older lines are lost.
const LATE_MOST_S: f64 = 0.1;

/// What differs from board to board: its readings, and the lines that it makes of them.
pub trait BoardFirmware: Send {
    /// Role of the board in the scene.
    fn device(&self) -> SceneDevice;

    /// The port of the usual board.
    fn port(&self) -> Port;

    /// Starts after power-on or a reset. Returns the bytes that are printed before any reading.
    fn start(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// Time from one reading to the next, s. `None` if the board doesn't push now.
    fn period_s(&self, scene: &Scene) -> Option<f64>;

    /// Takes a reading: the numbers of one line, in the order and unit in which they are sent.
    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64>;

    /// Returns the line of a reading, with its end.
    fn line(&self, reading: &[f64]) -> Vec<u8>;

    /// Takes the next complete request from the front of the inbox. A board that listens to nothing discards it.
    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        inbox.clear();
        None
    }

    /// Acts on a request and returns its answer, which may be empty.
    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let _ = (request, scene, now_s);
        Vec::new()
    }
}

/// One line that a board has sent.
#[derive(Clone, Debug, PartialEq)]
pub struct Sent {
    /// Time of the reading, s.
    pub read_s: f64,
    /// Time at which the last byte of the line left the board, s.
    pub last_byte_s: f64,
    /// Numbers of the line, in the order and unit in which they were sent.
    pub reading: Vec<f64>,
    /// Whether every byte of the line was sent unchanged.
    pub whole: bool,
}

/// A board at the end of a serial line.
pub struct SerialBoard<F> {
    firmware: F,
    port: Port,
    state: BoardState,
    /// Whether a link was opened since the board last had a turn.
    opened: bool,
    /// Whether the next line lacks its beginning, because the link was opened in the middle of it.
    joined: bool,
    uart: Uart,
    damage: Option<Damage>,
    faults: LineFaults,
    rng: RandomStream,
    sent: VecDeque<Sent>,
    bell: Arc<Notify>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum BoardState {
    /// Not opened yet.
    Off,
    Booting {
        until_s: f64,
    },
    /// `next_s` is the time of the next reading, infinite if the board doesn't push.
    Running {
        next_s: f64,
    },
}

impl<F: BoardFirmware> SerialBoard<F> {
    /// Creates a board without faults, on the usual port of its firmware.
    pub fn new(firmware: F) -> Self {
        let port = firmware.port();
        SerialBoard {
            firmware,
            port,
            state: BoardState::Off,
            opened: false,
            joined: false,
            uart: Uart::new(port),
            damage: None,
            faults: LineFaults::default(),
            rng: stream(0, 0, "line damage"),
            sent: VecDeque::new(),
            bell: Arc::default(),
        }
    }

    /// Puts the board on another port.
    #[must_use]
    pub fn on(mut self, port: Port) -> Self {
        self.port = port;
        self.uart = Uart::new(port);
        self
    }

    /// Damages some of the lines.
    #[must_use]
    pub fn damaged(mut self, damage: Damage) -> Self {
        self.rng = stream(damage.seed, 0, "line damage");
        self.damage = Some(damage);
        self
    }

    /// Adds a fault at a time.
    #[must_use]
    pub fn with_fault(mut self, fault: LineFault) -> Self {
        self.fail(fault);
        self
    }

    /// Adds a fault at a time, while the board runs.
    pub fn fail(&mut self, fault: LineFault) {
        self.faults.add(fault);
        self.bell.notify_waiters();
    }

    /// The last lines that the board sent, oldest first, at most [`SENT_MOST`]. Lines that no client read are among them.
    pub fn sent(&self) -> impl DoubleEndedIterator<Item = &Sent> + ExactSizeIterator {
        self.sent.iter()
    }

    fn advance(&mut self, scene: &mut Scene, now_s: f64) {
        if mem::take(&mut self.opened) {
            self.open(now_s);
        }
        while let Some(at_s) = self.next_event_s().filter(|&at_s| at_s <= now_s + EARLY_S) {
            if let Some(reset) = self.faults.take_reset(at_s) {
                self.uart.cut(reset.at_s);
                self.state = BoardState::Booting { until_s: reset.at_s + reset.for_s };
                continue;
            }
            match self.state {
                BoardState::Off => return,
                BoardState::Booting { until_s } => self.start(scene, until_s),
                BoardState::Running { .. } if at_s < now_s - LATE_MOST_S => {
                    self.state = BoardState::Running { next_s: now_s - LATE_MOST_S };
                }
                BoardState::Running { .. } => self.push(scene, at_s, now_s),
            }
        }
    }

    fn open(&mut self, now_s: f64) {
        match (self.port.boot_s, self.state) {
            (Some(boot_s), _) => {
                self.uart.clear(now_s);
                self.state = BoardState::Booting { until_s: now_s + boot_s };
            }
            (None, _) if self.port.packets => {
                self.uart.clear(now_s);
                self.state = BoardState::Booting { until_s: now_s + self.port.setup_s };
            }
            (None, BoardState::Off) => self.state = BoardState::Booting { until_s: now_s + self.port.setup_s },
            (None, _) => {
                self.uart.clear(now_s);
                self.joined = self.next_event_s().is_some();
            }
        }
    }

    /// Time of the next reset, end of booting or reading, s. `None` if nothing happens without a request.
    fn next_event_s(&self) -> Option<f64> {
        let own_s = match self.state {
            BoardState::Off => return None,
            BoardState::Booting { until_s } => until_s,
            BoardState::Running { next_s } => next_s,
        };
        Some(own_s.min(self.faults.next_reset_s())).filter(|at_s| at_s.is_finite())
    }

    fn start(&mut self, scene: &Scene, at_s: f64) {
        let greeting = self.firmware.start();
        self.uart.send(greeting, at_s);
        self.joined = false;
        self.schedule(scene, at_s);
    }

    fn schedule(&mut self, scene: &Scene, from_s: f64) {
        let period_s = self.firmware.period_s(scene).unwrap_or(f64::INFINITY).max(PERIOD_LEAST_S);
        self.state = BoardState::Running { next_s: from_s.max(self.uart.has_room_s()) + period_s };
    }

    /// Takes the reading of `at_s` and sends it. The scene can't go back, so the reading is that of `now_s`.
    fn push(&mut self, scene: &mut Scene, at_s: f64, now_s: f64) {
        if let Some(end_s) = self.faults.end_s(LineFaultKind::Stops, at_s) {
            self.state = BoardState::Running { next_s: end_s };
            return;
        }
        let reading = self.firmware.read(scene, now_s);
        let mut line = self.firmware.line(&reading);
        let mut whole = true;
        if mem::take(&mut self.joined) && !line.is_empty() {
            line.drain(..self.rng.random_range(0..line.len()));
            whole = false;
        }
        if let Some(damage) = &self.damage {
            whole &= !damage.strike(&mut line, &mut self.rng);
        }
        let last_byte_s = self.uart.send(line, at_s);
        if self.sent.len() == SENT_MOST {
            self.sent.pop_front();
        }
        self.sent.push_back(Sent { read_s: now_s, last_byte_s, reading, whole });
        self.schedule(scene, at_s);
    }
}

impl<F: BoardFirmware> Instrument for SerialBoard<F> {
    fn device(&self) -> SceneDevice {
        self.firmware.device()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.firmware.take_request(inbox)
    }

    /// The answer is owed, so that it never interrupts a line that is being sent.
    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        self.advance(scene, now_s);
        if let BoardState::Running { .. } = self.state {
            let period_s = self.firmware.period_s(scene);
            let answer = self.firmware.answer(request, scene, now_s);
            self.uart.send(answer, now_s);
            if self.firmware.period_s(scene) != period_s {
                self.schedule(scene, now_s);
            }
            self.bell.notify_waiters();
        }
        Vec::new()
    }

    /// The rate of the link replaces that of the sketch. A board knows when its line is busy, so it times its bytes itself.
    fn on_line(&mut self, line: SerialLine) -> bool {
        self.uart.set_byte_s(line.time_s(1));
        true
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        self.opened = true;
        None
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        self.advance(scene, now_s);
        let next_event_s = self.next_event_s().unwrap_or(f64::INFINITY);
        if let Some(end_s) = self.faults.end_s(LineFaultKind::Withholds, now_s) {
            return Owed::At(end_s.min(next_event_s));
        }
        let bytes = self.uart.arrived(now_s + EARLY_S);
        if !bytes.is_empty() {
            return Owed::Pushed(bytes);
        }
        match self.uart.next_s().min(next_event_s) {
            next_s if next_s.is_finite() => Owed::At(next_s),
            _ => Owed::Nothing,
        }
    }
}
