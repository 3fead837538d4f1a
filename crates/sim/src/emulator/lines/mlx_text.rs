//! The magnetometers of ReSkin as text (raunaqbhirangi/reskin_sensor, `arduino/5X_burst_stream/5X_burst_stream.ino`).

use super::print::print_float;
use super::{Firmware, LINE_END, Port, mlx90393};
use crate::scene::{Device, Scene};

/// Decimals of `Serial.print` of a float.
const DECIMALS: u32 = 2;

/// A board with one MLX90393 for three outputs of the scene, with native USB.
///
/// Each line has four numbers with two decimals for each chip: x, y and z in microtesla, then the temperature in °C. A tab follows
/// each number, also the last, and CR LF ends the line. The board pushes lines without a command and listens to nothing.
pub struct MlxText {
    rate_hz: f64,
}

impl MlxText {
    /// Creates the firmware with a number of lines per second. The sketch waits 0.5 ms after each line, as that of ReSkin.
    pub fn new(rate_hz: f64) -> Self {
        MlxText { rate_hz }
    }
}

impl Firmware for MlxText {
    fn device(&self) -> Device {
        Device::Array
    }

    fn port(&self) -> Port {
        Port::native_usb(mlx90393::SETUP_S)
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        Some(1.0 / self.rate_hz)
    }

    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let chips = mlx90393::read(scene, now_s);
        chips.iter().flat_map(|chip| chip.0).map(f64::from).collect::<Vec<_>>().chunks(4).flat_map(xyzt).collect()
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        let mut line = Vec::new();
        for &value in reading {
            print_float(value, DECIMALS, &mut line);
            line.push(b'\t');
        }
        line.extend_from_slice(LINE_END);
        line
    }
}

/// The numbers of a chip in the order in which the sketch prints them.
fn xyzt(txyz: &[f64]) -> Vec<f64> {
    let mut xyzt = txyz.to_vec();
    xyzt.rotate_left(1);
    xyzt
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::scene;

    #[test]
    fn a_line_has_a_tab_after_each_number_and_the_temperature_last() {
        let mut firmware = MlxText::new(400.0);
        let reading = firmware.read(&mut scene(), 0.0);
        let chip = "500.00\t500.00\t500.13\t27.35\t";
        assert_eq!(String::from_utf8(firmware.line(&reading)).expect("text"), chip.repeat(3) + "\r\n");
        assert_eq!(firmware.line(&[-12.345, 0.0]), b"-12.35\t0.00\t\r\n");
    }
}
