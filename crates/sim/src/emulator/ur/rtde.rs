//! One link of the Real-Time Data Exchange in version 2 (document: "RTDE guide").
//!
//! The guide leaves open what a broken package does: a size below that of a header closes the link, and an unknown or
//! malformed package is answered with a text message. Before version 2 is agreed on, nothing can be set up. Data
//! packages are sent in multiples of the control cycle. If the client doesn't take them, packages are skipped and the
//! most recent one is sent.

use super::robot::{EARLY_S, Robot};
use super::variables::{Output, input};
use super::{Link, VERSION};
use crate::emulator::Owed;
use crate::scene::Scene;

/// Bytes of a package before its content: size and type.
const HEADER: usize = 3;
/// Longest list of names, bytes.
const NAMES_MOST: usize = 2048;
/// Frequency of the control cycle, Hz.
const MOST_HZ: f64 = 500.0;

/// One link.
#[derive(Default)]
pub(super) struct Rtde {
    /// Time at which the link was first served, s.
    since_s: Option<f64>,
    received: Vec<u8>,
    is_broken: bool,
    is_agreed: bool,
    outputs: Vec<Output>,
    frequency_hz: f64,
    /// Recipes of inputs: names, and lengths, bytes. Their numbers begin at 1.
    inputs: Vec<Vec<(String, usize)>>,
    /// Time of the next data package, s; `None` while paused.
    next_s: Option<f64>,
}

impl Link for Rtde {
    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.received.append(inbox);
        let size = usize::from(u16::from_be_bytes(*self.received.first_chunk()?));
        self.is_broken |= size < HEADER;
        (!self.is_broken && self.received.len() >= size).then(|| self.received.drain(..size).collect())
    }

    fn answer(&mut self, request: &[u8], robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let (kind, content) = (request[HEADER - 1], &request[HEADER..]);
        match (kind, content) {
            (b'V', &[high, low]) => {
                let is_known = [high, low] == [0, 2];
                self.is_agreed |= is_known;
                package(kind, &[u8::from(is_known)])
            }
            (b'v', []) => package(kind, &VERSION.map(u32::to_be_bytes).concat()),
            (b'O' | b'I' | b'U', _) if !self.is_agreed => message("only version 2 is spoken"),
            (b'O', _) => self.set_up_outputs(content, now_s).unwrap_or_else(|| message("outputs can't be set up")),
            (b'I', _) => self.set_up_inputs(content).unwrap_or_else(|| message("inputs can't be set up")),
            (b'S', []) if self.outputs.is_empty() && self.inputs.is_empty() => {
                [package(kind, &[0]), message("no recipe is set up")].concat()
            }
            (b'S' | b'P', []) => {
                self.next_s = (kind == b'S').then(|| self.due_after_s(now_s));
                package(kind, &[1])
            }
            (b'U', _) => {
                self.take_inputs(content, robot, scene, now_s).unwrap_or_else(|| message("inputs don't fit a recipe"))
            }
            _ => message("unknown or malformed package"),
        }
    }

    fn owed(&mut self, robot: &Robot, scene: &mut Scene, now_s: f64) -> Owed {
        if self.is_broken || *self.since_s.get_or_insert(now_s) < robot.rtde_lost_until_s {
            return Owed::HungUp;
        }
        match self.next_s.filter(|_| !self.outputs.is_empty() && !robot.rtde_silent) {
            None => Owed::Nothing,
            Some(next_s) if next_s > now_s + EARLY_S => Owed::At(next_s),
            Some(_) => {
                self.next_s = Some(self.due_after_s(now_s));
                let cycle_s = ((now_s + EARLY_S) * MOST_HZ).floor() / MOST_HZ;
                let readings = robot.readings(cycle_s, scene, now_s);
                let values = self.outputs.iter().flat_map(|output| (output.read)(&readings, output.register));
                Owed::Ready(package(b'U', &[1].into_iter().chain(values).collect::<Vec<u8>>()))
            }
        }
    }
}

impl Rtde {
    /// Time of the first data package after a time, s: the first control cycle at which it is due.
    fn due_after_s(&self, now_s: f64) -> f64 {
        let number = ((now_s + EARLY_S) * self.frequency_hz).floor() + 1.0;
        (number * MOST_HZ / self.frequency_hz - EARLY_S).ceil() / MOST_HZ
    }

    fn set_up_outputs(&mut self, content: &[u8], now_s: f64) -> Option<Vec<u8>> {
        let (frequency, list) = content.split_first_chunk()?;
        let frequency_hz = Some(f64::from_be_bytes(*frequency)).filter(|hz| (1.0..=MOST_HZ).contains(hz))?;
        let outputs: Vec<Option<Output>> = names(list)?.into_iter().map(Output::named).collect();
        let answer = set_up(b'O', 1, outputs.iter().map(|output| Some(output.as_ref()?.kind)));
        if let Some(outputs) = outputs.into_iter().collect() {
            (self.outputs, self.frequency_hz) = (outputs, frequency_hz);
            self.next_s = self.next_s.map(|_| self.due_after_s(now_s));
        }
        Some(answer)
    }

    fn set_up_inputs(&mut self, content: &[u8]) -> Option<Vec<u8>> {
        let (names, number) = (names(content)?, u8::try_from(self.inputs.len() + 1).ok()?);
        let answer = set_up(b'I', number, names.iter().map(|name| Some(input(name)?.0)));
        let recipe = names.into_iter().map(|name| Some((name.to_owned(), input(name)?.1)));
        self.inputs.extend(recipe.collect::<Option<Vec<_>>>());
        Some(answer)
    }

    /// Takes the inputs of a data package, and returns the answer, which is empty; `None` if it doesn't fit a recipe.
    fn take_inputs(&self, content: &[u8], robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Option<Vec<u8>> {
        let (&number, mut rest) = content.split_first()?;
        let (mut slides, mut fraction) = (false, None);
        for (name, length) in self.inputs.get(usize::from(number).checked_sub(1)?)? {
            let (value, more) = rest.split_at_checked(*length)?;
            rest = more;
            match name.as_str() {
                "speed_slider_mask" => slides = value.iter().any(|&byte| byte != 0),
                "speed_slider_fraction" => fraction = value.try_into().ok().map(f64::from_be_bytes),
                _ => {}
            }
        }
        if let Some(fraction) = fraction.filter(|fraction| slides && rest.is_empty() && !fraction.is_nan()) {
            robot.move_slider(fraction, scene, now_s);
        }
        rest.is_empty().then(Vec::new)
    }
}

/// Returns the answer to a setup: the number of the recipe, or 0 if a name is unknown, and the types.
fn set_up(kind: u8, number: u8, kinds: impl Iterator<Item = Option<&'static str>>) -> Vec<u8> {
    let kinds: Vec<&str> = kinds.map(|kind| kind.unwrap_or("NOT_FOUND")).collect();
    let number = if kinds.contains(&"NOT_FOUND") { 0 } else { number };
    package(kind, &[&[number], kinds.join(",").as_bytes()].concat())
}

/// Returns a text message: its length, its text, those of its source, and its level (1: error).
fn message(text: &str) -> Vec<u8> {
    package(b'M', &[&[text.len() as u8], text.as_bytes(), b"\x04RTDE\x01"].concat())
}

fn package(kind: u8, content: &[u8]) -> Vec<u8> {
    let size = (HEADER + content.len()) as u16;
    [&size.to_be_bytes()[..], &[kind], content].concat()
}

/// Splits a list of names. It may end with a comma. `None` if it is no text, or too long.
fn names(content: &[u8]) -> Option<Vec<&str>> {
    let text = std::str::from_utf8(content).ok().filter(|text| text.len() <= NAMES_MOST)?;
    Some(text.strip_suffix(',').unwrap_or(text).split(',').collect())
}
