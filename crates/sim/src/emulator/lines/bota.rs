//! A Bota Systems sensor with six axes on a serial line, as Bota's own example for Python reads it (`bota_serial_example.py`).

use super::{BoardFirmware, CellScale, Port, axes};
use crate::scene::{Scene, SceneDevice};

/// Baud rate of the example.
const BAUD: f64 = 460_800.0;

/// First byte of a frame.
const HEADER: u8 = 0xAA;

/// State of a sensor beyond its range.
const OVER_RANGE: f64 = 2.0;

/// Temperature that it sends, degrees Celsius.
const TEMPERATURE: f64 = 25.0;

/// Number of counts of its clock in microseconds.
const CLOCK: f64 = 4_294_967_296.0;

/// A sensor that sends frames by its own clock. The command `C` leads to its configuration mode, which is silent, and `R` back. What it is
/// asked to configure there is acknowledged, and has no effect. Torques are 0.
pub struct Bota {
    rate_hz: f64,
    range_n: f64,
    mounting: [[f64; 3]; 3],
    scale: CellScale,
    is_configured: bool,
}

impl Bota {
    /// Creates a sensor that sends `rate_hz` frames per second, of forces up to `range_n` along each axis. `mounting` is the matrix from
    /// the forces of the tip on the specimen along x, y and the press to those along its axes.
    pub fn new(rate_hz: f64, range_n: f64, mounting: [[f64; 3]; 3]) -> Self {
        Bota { rate_hz, range_n, mounting, scale: CellScale::NEWTON, is_configured: false }
    }

    /// Gives it another calibration.
    #[must_use]
    pub fn scaled(self, scale: CellScale) -> Self {
        Bota { scale, ..self }
    }
}

impl BoardFirmware for Bota {
    fn device(&self) -> SceneDevice {
        SceneDevice::LoadCell
    }

    fn port(&self) -> Port {
        Port::serial(BAUD)
    }

    fn start(&mut self) -> Vec<u8> {
        self.is_configured = false;
        b"App Init\r\n".to_vec()
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        (!self.is_configured).then(|| 1.0 / self.rate_hz)
    }

    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let (forces_n, is_beyond) = axes::read(scene, now_s, &self.mounting, self.range_n);
        let [x, y, z] = forces_n.map(|force_n| self.scale.number(force_n));
        let state = if is_beyond { OVER_RANGE } else { 0.0 };
        let time_us = (now_s * 1e6).floor().rem_euclid(CLOCK);
        vec![state, x, y, z, 0.0, 0.0, 0.0, time_us, TEMPERATURE]
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        let &[state, x_n, y_n, z_n, x_nm, y_nm, z_nm, time_us, temperature] = reading else { return Vec::new() };
        let mut data = (state as u16).to_le_bytes().to_vec();
        data.extend([x_n, y_n, z_n, x_nm, y_nm, z_nm].iter().flat_map(|value| (*value as f32).to_le_bytes()));
        data.extend((time_us as u32).to_le_bytes());
        data.extend((temperature as f32).to_le_bytes());
        let sum = crc_x25(&data).to_le_bytes();
        [&[HEADER], &data[..], &sum].concat()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        // requests have no end: what comes at once is one
        (!inbox.is_empty()).then(|| std::mem::take(inbox))
    }

    fn answer(&mut self, request: &[u8], _: &mut Scene, _: f64) -> Vec<u8> {
        match request {
            [b'C', ..] => {
                self.is_configured = true;
                b"r,0,C,0\r\n".to_vec()
            }
            [b'R', ..] if self.is_configured => {
                self.is_configured = false;
                b"r,0,R,0\r\n".to_vec()
            }
            [letter @ (b'c' | b'f'), ..] if self.is_configured => [b"r,0,", &[*letter][..], b",0\r\n"].concat(),
            _ => Vec::new(),
        }
    }
}

/// CRC-16/X-25, from the highest bit down: bytes are mirrored on their way in, and the result on its way out.
fn crc_x25(bytes: &[u8]) -> u16 {
    let register = bytes.iter().fold(0xFFFF_u16, |register, byte| {
        (0..8).fold(register ^ u16::from(byte.reverse_bits()) << 8, |register, _| match register & 0x8000 {
            0 => register << 1,
            _ => register << 1 ^ 0x1021,
        })
    });
    !register.reverse_bits()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::Instrument;
    use crate::emulator::lines::tests::{listen, opened};
    use crate::emulator::lines::{STRAIGHT, SerialBoard};
    use crate::emulator::tests::{pressed, scene};

    #[test]
    fn check_sum_has_the_check_value_of_the_catalogue() {
        assert_eq!(crc_x25(b"123456789"), 0x906E);
    }

    #[test]
    fn a_frame_is_that_of_the_example() {
        let frame = Bota::new(100.0, 2.0, STRAIGHT).line(&[2.0, 0.5, -0.25, 1.5, 0.01, 0.02, 0.03, 1e6, 25.0]);
        let golden = "aa 0200 0000003f 000080be 0000c03f 0ad7233c 0ad7a33c 8fc2f53c 40420f00 0000c841 99df";
        let hex: String = frame.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hex, golden.replace(' ', ""));
    }

    #[test]
    fn a_press_is_along_the_axis_of_the_mounting_and_one_beyond_the_range_is_reported() {
        let mut sensor = Bota::new(100.0, 2.0, [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);
        let reading = sensor.read(&mut pressed(1.5), 1.0);
        assert_eq!(reading, [0.0, 0.0, 0.0, -1.5, 0.0, 0.0, 0.0, 1e6, 25.0]);
        assert_eq!(sensor.read(&mut pressed(2.5), 1.0)[..4], [2.0, 0.0, 0.0, -2.0]);
    }

    #[test]
    fn it_is_silent_while_it_is_configured() {
        let (mut sensor, mut scene) = (opened(SerialBoard::new(Bota::new(100.0, 2.0, STRAIGHT))), scene());
        let count = |heard: Vec<(f64, Vec<u8>)>| heard.iter().map(|(_, bytes)| bytes.len()).sum::<usize>();
        assert!(count(listen(&mut sensor, &mut scene, 0.0, 1.0)) > 98 * 37);
        for (request, answer) in [("C", "r,0,C,0\r\n"), ("f,512,0,0,1", "r,0,f,0\r\n")] {
            let from_s = if request == "C" { 1.0 } else { 2.0 };
            sensor.answer(request.as_bytes(), &mut scene, from_s);
            let heard: Vec<u8> = listen(&mut sensor, &mut scene, from_s, from_s + 1.0)
                .into_iter()
                .flat_map(|(_, bytes)| bytes)
                .collect();
            assert!(heard.ends_with(answer.as_bytes()) && heard.len() < answer.len() + 2 * 37, "{heard:?}");
        }
        sensor.answer(b"R", &mut scene, 3.0);
        assert!(count(listen(&mut sensor, &mut scene, 3.0, 4.0)) > 98 * 37);
    }
}
