//! ReSkin and AnySkin: magnetometers as binary frames (raunaqbhirangi/reskin_sensor and raunaqbhirangi/anyskin, both
//! `arduino/5X_binary_burst_stream/5X_binary_burst_stream.ino`) or as text (`arduino/5X_burst_stream/5X_burst_stream.ino`).

use super::print::print_float;
use super::scale::per_unit;
use super::{BoardFirmware, LINE_END, Port, mlx90393};
use crate::scene::{Scene, SceneDevice};

/// Decimals of `Serial.print` of a float.
const DECIMALS: u32 = 2;

/// A board with one MLX90393 for three outputs of the scene, on a Trinket M0 or QT Py, thus with native USB.
///
/// A frame has four floats for each chip, little-endian with 32 bits: temperature in °C, then x, y and z in microtesla. It ends
/// with CR LF and has no checksum; the floats may contain any bytes. With five chips it has 82 bytes. As text it has x, y, z and the
/// temperature with two decimals, each followed by a tab. The board pushes frames without a command and listens to nothing.
/// `setup()` waits until the port is opened for the first time.
pub struct ReSkin {
    rate_hz: f64,
    is_text: bool,
    microtesla_per_unit: f64,
}

impl ReSkin {
    /// Frames per second of ReSkin with five chips, as its paper states (arXiv 2111.00071: up to 400 Hz, from memory). The sketch waits 0.5
    /// ms after each frame; the remaining time is for the bus of the chips. AnySkin's sketch is the same without the wait.
    pub const RESKIN_HZ: f64 = 400.0;

    /// Creates the firmware with a number of frames per second.
    pub fn new(rate_hz: f64) -> Self {
        ReSkin { rate_hz, is_text: false, microtesla_per_unit: mlx90393::MICROTESLA_PER_UNIT }
    }

    /// Creates the firmware that sends text.
    pub fn text(rate_hz: f64) -> Self {
        ReSkin { is_text: true, ..ReSkin::new(rate_hz) }
    }

    /// Gives it the magnets of a skin in a rig that multiplies its numbers by `scale`.
    #[must_use]
    pub fn scaled(self, scale: f64) -> Self {
        ReSkin { microtesla_per_unit: per_unit(mlx90393::MICROTESLA_PER_UNIT, 1.0, scale), ..self }
    }
}

impl BoardFirmware for ReSkin {
    fn device(&self) -> SceneDevice {
        SceneDevice::Array
    }

    fn port(&self) -> Port {
        Port::native_usb(mlx90393::SETUP_S)
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        Some(1.0 / self.rate_hz)
    }

    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let chips =
            mlx90393::read(scene, now_s, self.microtesla_per_unit).into_iter().map(|chip| chip.0.map(f64::from));
        let in_order = |mut chip: [f64; 4]| {
            // the text has the temperature last
            chip.rotate_left(usize::from(self.is_text));
            chip
        };
        chips.flat_map(in_order).collect()
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        let mut line = Vec::new();
        for &value in reading {
            if self.is_text {
                print_float(value, DECIMALS, &mut line);
                line.push(b'\t');
            } else {
                line.extend((value as f32).to_le_bytes());
            }
        }
        line.extend_from_slice(LINE_END);
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::{pressed, scene};

    #[test]
    fn a_frame_is_the_floats_of_each_chip_and_the_end_of_println() {
        let frame = ReSkin::new(400.0).line(&[25.0, 500.0, -0.5, 1.0, 26.0, 0.0, 0.0, 0.0]);
        let golden = "0000c841 0000fa43 000000bf 0000803f 0000d041 00000000 00000000 00000000 0d0a";
        let hex: String = frame.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hex, golden.replace(' ', ""));
    }

    #[test]
    fn five_chips_make_82_bytes_as_the_python_packages_expect() {
        let outputs = vec![0.0; 5 * 4];
        assert_eq!(ReSkin::new(400.0).line(&outputs).len(), 82);
    }

    #[test]
    fn each_channel_follows_its_output_and_the_temperature_comes_first() {
        let mut firmware = ReSkin::new(400.0);
        let rest = firmware.read(&mut scene(), 0.0);
        assert_eq!(rest.len(), 3 * 4, "nine outputs");
        assert!((rest[0] - 27.345).abs() < 1e-3 && (rest[1] - 500.0).abs() < 0.1 && (rest[3] - 500.0).abs() < 0.2);
        let mut scene = pressed(1.0);
        let pressed = firmware.read(&mut scene, 1.0);
        let mut outputs = vec![0.0; 9];
        scene.outputs(1.0, &mut outputs);
        assert!(outputs[4] > 0.5, "{outputs:?}");
        for (output, units) in outputs.iter().enumerate() {
            let microtesla = pressed[output / 3 * 4 + 1 + output % 3];
            let expected = 500.0 + 100.0 * units;
            assert!((microtesla - expected).abs() < 0.17, "output {output}: {microtesla} {expected}");
        }
    }

    #[test]
    fn a_line_has_a_tab_after_each_number_and_the_temperature_last() {
        let mut firmware = ReSkin::text(400.0);
        let reading = firmware.read(&mut scene(), 0.0);
        let chip = "500.00\t500.00\t500.13\t27.35\t";
        assert_eq!(String::from_utf8(firmware.line(&reading)).expect("text"), chip.repeat(3) + "\r\n");
        assert_eq!(firmware.line(&[-12.345, 0.0]), b"-12.35\t0.00\t\r\n");
    }
}
