//! One link of the Real-Time Data Exchange (document: "RTDE guide").
//!
//! A link speaks version 1 of the protocol until version 2 is negotiated. The guide leaves open what a broken package
//! does: a size below that of a header closes the link, and an unknown or malformed package is answered with a text
//! message. Data packages are sent in multiples of the control cycle. If the client doesn't take them, packages are
//! skipped and the most recent one is sent.

use super::link::Link;
use super::robot::{EARLY_S, Robot};
use super::variables::{Input, Output};
use super::{CYCLE_S, VERSION};
use crate::emulator::Owed;
use crate::scene::Scene;

/// Bytes of a package before its content: size and type.
const HEADER: usize = 3;
/// Longest list of names, bytes.
const NAMES_MOST: usize = 2048;
/// Frequency of the control cycle, and that of version 1, Hz.
const MOST_HZ: f64 = 500.0;
const V1_HZ: f64 = 125.0;
/// Levels of a text message.
const ERROR: u8 = 1;
const WARNING: u8 = 2;

/// One link.
pub(super) struct Rtde {
    number: u64,
    /// Number of times that RTDE had been lost when the link was first served.
    losses: Option<u64>,
    received: Vec<u8>,
    is_broken: bool,
    version: u16,
    outputs: Vec<Output>,
    frequency_hz: f64,
    /// Recipes of inputs. Their numbers begin at 1.
    inputs: Vec<Vec<Input>>,
    /// Number of the next data package since time zero; `None` while paused.
    next: Option<u64>,
}

impl Link for Rtde {
    fn open(robot: &mut Robot) -> Rtde {
        robot.links += 1;
        Rtde {
            number: robot.links,
            losses: None,
            received: Vec::new(),
            is_broken: false,
            version: 1,
            outputs: Vec::new(),
            frequency_hz: V1_HZ,
            inputs: Vec::new(),
            next: None,
        }
    }

    fn close(&mut self, robot: &mut Robot) {
        robot.inputs.retain(|(_, link)| *link != self.number);
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.received.append(inbox);
        let size = usize::from(u16::from_be_bytes(*self.received.first_chunk()?));
        if size < HEADER {
            self.is_broken = true;
            self.received.clear();
        }
        (!self.is_broken && self.received.len() >= size).then(|| self.received.drain(..size).collect())
    }

    fn answer(&mut self, request: &[u8], robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let (kind, content) = (request[HEADER - 1], &request[HEADER..]);
        match (kind, content) {
            (b'V', &[high, low]) => {
                let version = u16::from_be_bytes([high, low]);
                let is_known = [1, 2].contains(&version);
                self.version = if is_known { version } else { self.version };
                package(kind, &[u8::from(is_known)])
            }
            (b'v', []) => package(kind, &VERSION.map(u32::to_be_bytes).concat()),
            (b'O', _) => self.set_up_outputs(content, now_s),
            (b'I', _) => self.set_up_inputs(content, robot),
            (b'S', []) if self.outputs.is_empty() && self.inputs.is_empty() => {
                [package(kind, &[0]), self.message("no recipe is set up", ERROR)].concat()
            }
            (b'S', []) => {
                self.next = Some(self.first_after(now_s));
                package(kind, &[1])
            }
            (b'P', []) => {
                self.next = None;
                package(kind, &[1])
            }
            (b'U', _) => match self.take_inputs(content, robot, scene, now_s) {
                Some(()) => Vec::new(),
                None => self.message("input package doesn't fit its recipe", ERROR),
            },
            _ => self.message("unknown or malformed package", WARNING),
        }
    }

    fn owed(&mut self, robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Owed {
        let is_lost = *self.losses.get_or_insert(robot.rtde_losses) != robot.rtde_losses;
        if self.is_broken || is_lost || now_s < robot.rtde_lost_until_s {
            return Owed::HungUp;
        }
        let Some(next) = self.next.filter(|_| !self.outputs.is_empty() && !robot.rtde_silent) else {
            return Owed::Nothing;
        };
        if self.due_s(next) > now_s + EARLY_S {
            return Owed::At(self.due_s(next));
        }
        let first_after = self.first_after(now_s);
        self.next = Some(first_after);
        Owed::Ready(self.data(self.due_s(first_after - 1), robot, scene, now_s))
    }
}

impl Rtde {
    /// Time of a data package, s: the first control cycle at which it is due.
    fn due_s(&self, package: u64) -> f64 {
        (package as f64 * MOST_HZ / self.frequency_hz - EARLY_S).ceil().max(0.0) * CYCLE_S
    }

    /// Number of the first data package after a time.
    fn first_after(&self, now_s: f64) -> u64 {
        let mut package = ((now_s - CYCLE_S).max(0.0) * self.frequency_hz) as u64;
        while self.due_s(package) <= now_s + EARLY_S {
            package += 1;
        }
        package.max(1)
    }

    fn data(&self, at_s: f64, robot: &Robot, scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let readings = robot.readings(scene, now_s);
        let mut data = Vec::with_capacity(HEADER + 1 + 48 * self.outputs.len());
        data.extend([0, 0, b'U']);
        if self.version > 1 {
            data.push(1);
        }
        for output in &self.outputs {
            output.write(robot, &readings, at_s, &mut data);
        }
        let size = (data.len() as u16).to_be_bytes();
        data[..2].copy_from_slice(&size);
        data
    }

    fn set_up_outputs(&mut self, content: &[u8], now_s: f64) -> Vec<u8> {
        let split = content.split_first_chunk().filter(|_| self.version > 1);
        let (frequency_hz, names) = match (self.version, split) {
            (1, _) => (V1_HZ, content),
            (_, Some((hz, names))) => (f64::from_be_bytes(*hz), names),
            (_, None) => return self.message("malformed setup of outputs", ERROR),
        };
        let Some(names) = self::names(names).filter(|_| (1.0..=MOST_HZ).contains(&frequency_hz)) else {
            return self.message("outputs can't be set up", ERROR);
        };
        let outputs: Vec<Option<Output>> = names.into_iter().map(Output::named).collect();
        let kinds: Vec<&str> = outputs.iter().map(|output| output.map_or("NOT_FOUND", Output::kind)).collect();
        let outputs: Option<Vec<Output>> = outputs.into_iter().collect();
        let number = u8::from(outputs.is_some());
        if let Some(outputs) = outputs {
            (self.outputs, self.frequency_hz) = (outputs, frequency_hz);
            self.next = self.next.map(|_| self.first_after(now_s));
        }
        let kinds = kinds.join(",").into_bytes();
        package(b'O', &if self.version > 1 { [vec![number], kinds].concat() } else { kinds })
    }

    fn set_up_inputs(&mut self, content: &[u8], robot: &mut Robot) -> Vec<u8> {
        let Some(names) = names(content) else { return self.message("inputs can't be set up", ERROR) };
        let inputs: Vec<Option<Input>> = names.into_iter().map(Input::named).collect();
        let kind = |input: &Option<Input>| match input {
            None => "NOT_FOUND",
            Some(input) if robot.inputs.iter().any(|(used, link)| used == input && *link != self.number) => "IN_USE",
            Some(input) => input.kind().0,
        };
        let kinds: Vec<&str> = inputs.iter().map(kind).collect();
        let is_free = !kinds.contains(&"IN_USE") && self.inputs.len() < 255;
        let inputs: Option<Vec<Input>> = inputs.into_iter().collect();
        let mut number = 0;
        if let Some(inputs) = inputs.filter(|_| is_free) {
            robot.inputs.extend(inputs.iter().map(|input| (*input, self.number)));
            self.inputs.push(inputs);
            number = self.inputs.len() as u8;
        }
        package(b'I', &[vec![number], kinds.join(",").into_bytes()].concat())
    }

    /// Takes the inputs of a data package; `None` if it doesn't fit a recipe.
    fn take_inputs(&mut self, content: &[u8], robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Option<()> {
        let (&number, mut rest) = content.split_first()?;
        let inputs = self.inputs.get(usize::from(number).checked_sub(1)?)?;
        if inputs.iter().map(|input| input.kind().1).sum::<usize>() != rest.len() {
            return None;
        }
        let (mut slides, mut fraction, mut mask) = (false, None, [0_u64; 2]);
        for input in inputs {
            let (value, more) = rest.split_at_checked(input.kind().1)?;
            rest = more;
            match *input {
                Input::SliderMask => slides = value.iter().any(|&byte| byte != 0),
                Input::SliderFraction => fraction = Some(f64::from_be_bytes(value.try_into().ok()?)),
                Input::OutputMask(from) => mask[usize::from(from / 8)] = u64::from(value[0]) << from,
                Input::OutputBits(from) => {
                    let (mask, bits) = (mask[usize::from(from / 8)], u64::from(value[0]) << from);
                    robot.digital_outputs = robot.digital_outputs & !mask | bits & mask;
                }
                Input::Integer(_) | Input::Double(_) | Input::Bit(_) | Input::Other(_) => {}
            }
        }
        if let Some(fraction) = fraction.filter(|_| slides) {
            robot.move_slider(fraction, scene, now_s);
        }
        Some(())
    }

    /// Returns a text message.
    fn message(&self, text: &str, level: u8) -> Vec<u8> {
        let source = "RTDE";
        package(
            b'M',
            &match self.version {
                1 => [&[level], text.as_bytes()].concat(),
                _ => {
                    [&[text.len() as u8], text.as_bytes(), &[source.len() as u8], source.as_bytes(), &[level]].concat()
                }
            },
        )
    }
}

fn package(kind: u8, content: &[u8]) -> Vec<u8> {
    let size = (HEADER + content.len()) as u16;
    [&size.to_be_bytes()[..], &[kind], content].concat()
}

/// Splits a list of names. It may end with a comma. `None` if it isn't one, or is too long.
fn names(content: &[u8]) -> Option<Vec<&str>> {
    let text = std::str::from_utf8(content).ok().filter(|text| text.len() <= NAMES_MOST)?;
    let text = text.strip_suffix(',').unwrap_or(text);
    (!text.is_empty()).then(|| text.split(',').collect())
}
