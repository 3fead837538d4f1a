//! An amplifier GSV-8 of ME-Messsysteme with a sensor with six axes, as the vendor's own package for Python reads it
//! (me-systeme/gsv8pypi_python3).

use super::{BoardFirmware, CellScale, Port, axes};
use crate::scene::{Scene, SceneDevice};

/// Baud rate of the vendor's library.
const BAUD: f64 = 115_200.0;

/// First and last byte of every frame.
const PREFIX: u8 = 0xAA;
const SUFFIX: u8 = 0x85;

/// Second byte: the kind of the frame, a serial interface, and a number. That of a measurement is one less than its channels.
const MEASUREMENT: u8 = 0x10;
const ANSWER: u8 = 0x50;
const QUESTION: u8 = 0x90;

/// Third byte of a measurement: the mark of a status, floats, and an overdriven input.
const FLOATS: u8 = 0x80 | 0x30;
const OVERDRIVEN: u8 = 0x01;

/// Commands, and the answer to one that isn't known.
const STOP: u8 = 0x23;
const START: u8 = 0x24;
const UNKNOWN_COMMAND: u8 = 0x40;

/// Number of channels: the forces, the torques, which are 0, and two that are free.
const CHANNELS: usize = 8;

/// An amplifier that sends from the start, until it is asked to stop.
pub struct Gsv8 {
    rate_hz: f64,
    range_n: f64,
    mounting: [[f64; 3]; 3],
    scale: CellScale,
    is_sending: bool,
}

impl Gsv8 {
    /// Creates an amplifier that sends `rate_hz` measurements per second, of forces up to `range_n` along each axis. `mounting` is the
    /// matrix from the forces of the tip on the specimen along x, y and the press to those along the axes of the sensor.
    pub fn new(rate_hz: f64, range_n: f64, mounting: [[f64; 3]; 3]) -> Self {
        Gsv8 { rate_hz, range_n, mounting, scale: CellScale::NEWTON, is_sending: true }
    }

    /// Gives it another calibration.
    #[must_use]
    pub fn scaled(self, scale: CellScale) -> Self {
        Gsv8 { scale, ..self }
    }
}

impl BoardFirmware for Gsv8 {
    fn device(&self) -> SceneDevice {
        SceneDevice::LoadCell
    }

    fn port(&self) -> Port {
        Port::serial(BAUD)
    }

    fn start(&mut self) -> Vec<u8> {
        self.is_sending = true;
        Vec::new()
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        self.is_sending.then(|| 1.0 / self.rate_hz)
    }

    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let (forces_n, is_beyond) = axes::read(scene, now_s, &self.mounting, self.range_n);
        let mut reading = vec![f64::from(if is_beyond { FLOATS | OVERDRIVEN } else { FLOATS })];
        reading.extend(forces_n.map(|force_n| self.scale.number(force_n)));
        reading.resize(1 + CHANNELS, 0.0);
        reading
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        let Some((status, channels)) = reading.split_first() else { return Vec::new() };
        let mut frame = vec![PREFIX, MEASUREMENT | (CHANNELS as u8 - 1), *status as u8];
        frame.extend(channels.iter().flat_map(|value| (*value as f32).to_be_bytes()));
        frame.push(SUFFIX);
        frame
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        loop {
            let begin = inbox.iter().position(|&byte| byte == PREFIX).unwrap_or(inbox.len());
            inbox.drain(..begin);
            let &[_, kind, ..] = &inbox[..] else { return None };
            // prefix, kind, command, parameters, suffix
            let length = 4 + usize::from(kind & 0x0F);
            if kind & 0xF0 == QUESTION && inbox.len() < length {
                return None;
            }
            if kind & 0xF0 == QUESTION && inbox[length - 1] == SUFFIX {
                return Some(inbox.drain(..length).collect());
            }
            inbox.remove(0);
        }
    }

    fn answer(&mut self, request: &[u8], _: &mut Scene, _: f64) -> Vec<u8> {
        let error = match request {
            [_, _, STOP, ..] => {
                self.is_sending = false;
                0
            }
            [_, _, START, ..] => {
                self.is_sending = true;
                0
            }
            _ => UNKNOWN_COMMAND,
        };
        vec![PREFIX, ANSWER, error, SUFFIX]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::Instrument;
    use crate::emulator::lines::tests::{listen, opened};
    use crate::emulator::lines::{STRAIGHT, SerialBoard};
    use crate::emulator::tests::{pressed, scene};

    #[test]
    fn a_frame_is_that_of_the_vendors_package() {
        let mut amplifier = Gsv8::new(100.0, 2.0, [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        for (force_n, golden) in [(1.5, "aa17b0 bfc00000"), (2.5, "aa17b1 c0000000")] {
            let reading = amplifier.read(&mut pressed(force_n), 1.0);
            let hex: String = amplifier.line(&reading).iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(hex, format!("{}{}85", golden.replace(' ', ""), "0".repeat(7 * 8)));
        }
    }

    #[test]
    fn it_sends_until_it_is_asked_to_stop() {
        let (mut amplifier, mut scene) = (opened(SerialBoard::new(Gsv8::new(100.0, 2.0, STRAIGHT))), scene());
        let frames = |heard: Vec<(f64, Vec<u8>)>| heard.iter().map(|(_, bytes)| bytes.len()).sum::<usize>() / 36;
        assert!(frames(listen(&mut amplifier, &mut scene, 0.0, 1.0)) >= 98);
        let mut inbox = vec![0x00, 0xAA, 0x17, 0xAA, 0x90, 0x23, 0x85, 0xAA, 0x91, 0x77, 0x01, 0x85, 0xAA, 0x90];
        let mut now_s = 1.0;
        for answer in [[0xAA, 0x50, 0x00, 0x85], [0xAA, 0x50, 0x40, 0x85]] {
            let request = amplifier.take_request(&mut inbox).expect("a question");
            amplifier.answer(&request, &mut scene, now_s);
            let heard: Vec<u8> = listen(&mut amplifier, &mut scene, now_s, now_s + 1.0)
                .into_iter()
                .flat_map(|(_, bytes)| bytes)
                .collect();
            assert!(heard.ends_with(&answer) && heard.len() <= 4 + 36, "{heard:02x?}");
            now_s += 1.0;
        }
        assert_eq!(amplifier.take_request(&mut inbox), None);
        inbox.extend([0x24, 0x85]);
        let request = amplifier.take_request(&mut inbox).expect("a question");
        amplifier.answer(&request, &mut scene, now_s);
        assert!(frames(listen(&mut amplifier, &mut scene, now_s, now_s + 1.0)) >= 98);
    }
}
