//! A pressure matrix of Velostat at the converter of an Arduino (sketch: www.kobakant.at/DIY/?p=7443).

use super::scale::per_unit;
use super::{BoardFirmware, LINE_END, Port};
use crate::scene::{Scene, SceneDevice};

/// Largest count of the converter of an Uno: 10 bits.
const COUNTS_MOST: f64 = 1023.0;

/// `delay(10)` after each scan, s.
const REST_S: f64 = 0.010;

/// Time of one `analogRead` of an Uno, s: 13 cycles of 8 us, and some overhead.
const CONVERSION_S: f64 = 112e-6;

/// A matrix with one unit for each output of the scene.
///
/// Each scan is one line: the counts 0 to 1023 of all units, column by column, with a separator between them, then CR LF. Inputs
/// have pull-ups, so the count falls with the pressure. The board pushes lines without a command and listens to nothing. The time
/// of a scan follows from the sketch: 10 ms, and 0.112 ms for each unit. At 9600 baud the line itself takes longer.
///
/// Copies of the sketch: jaekim24/Smart_Sock (`8x8_pressure_sensor.ino`, its second version with 7 x 7 units: tab, 9600 baud) and
/// robinhermit/SillyCode (`Saved/matrix_sweater/matrix_sweater.ino`, 15 x 14 units: blank, 115200 baud). No public copy with a comma
/// was found; `b','` serves those that a rig may have.
pub struct Velostat {
    separator: u8,
    baud: f64,
    counts_per_unit: f64,
}

impl Velostat {
    /// Counts of a unit at rest.
    pub const REST_COUNTS: f64 = 900.0;
    /// Counts for one reading unit of a taxel. 1 N directly above a taxel gives one reading unit.
    pub const COUNTS_PER_UNIT: f64 = -150.0;

    /// Creates the firmware of an Uno with a byte between the numbers: `b'\t'` with 9600 baud in the original.
    pub fn new(separator: u8, baud: f64) -> Self {
        Velostat { separator, baud, counts_per_unit: Self::COUNTS_PER_UNIT }
    }

    /// Gives it the sheet of a rig that multiplies its counts by `scale`. They fall with the pressure for either sign,
    /// because the circuit is the same.
    #[must_use]
    pub fn scaled(self, scale: f64) -> Self {
        Velostat { counts_per_unit: per_unit(Self::COUNTS_PER_UNIT, 1.0, scale.abs()), ..self }
    }
}

impl BoardFirmware for Velostat {
    fn device(&self) -> SceneDevice {
        SceneDevice::Array
    }

    fn port(&self) -> Port {
        Port::uno(self.baud)
    }

    fn period_s(&self, scene: &Scene) -> Option<f64> {
        Some(REST_S + scene.taxels() as f64 * CONVERSION_S)
    }

    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let mut counts = vec![0.0; scene.taxels()];
        scene.outputs(now_s, &mut counts);
        for count in &mut counts {
            *count = (Self::REST_COUNTS + *count * self.counts_per_unit).round().clamp(0.0, COUNTS_MOST);
        }
        counts
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        let mut line = Vec::new();
        for (index, &count) in reading.iter().enumerate() {
            if index > 0 {
                line.push(self.separator);
            }
            line.extend_from_slice((count as i64).to_string().as_bytes());
        }
        line.extend_from_slice(LINE_END);
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::lines::SerialBoard;
    use crate::emulator::lines::tests::{listen, opened};
    use crate::emulator::tests::{pressed, scene};

    #[test]
    fn a_scan_is_one_line_with_separators_only_between_counts() {
        assert_eq!(Velostat::new(b'\t', 9600.0).line(&[900.0, 0.0, 1023.0]), b"900\t0\t1023\r\n");
        assert_eq!(Velostat::new(b',', 9600.0).line(&[7.0]), b"7\r\n");
    }

    #[test]
    fn counts_fall_with_the_pressure_and_end_with_the_converter() {
        let mut firmware = Velostat::new(b' ', 115_200.0);
        assert_eq!(firmware.read(&mut scene(), 0.0), [900.0; 9]);
        let middle = firmware.read(&mut pressed(1.0), 1.0)[4];
        assert!((740.0..780.0).contains(&middle), "{middle}");
        assert_eq!(firmware.read(&mut pressed(20.0), 1.0)[4], 0.0);
    }

    #[test]
    fn the_line_limits_the_rate_at_9600_baud_and_the_sketch_at_115200() {
        let rate_hz = |baud: f64| {
            let mut board = opened(SerialBoard::new(Velostat::new(b'\t', baud)));
            listen(&mut board, &mut scene(), 0.0, 11.7);
            board.sent().len() as f64 / 10.0
        };
        // nine counts of three digits, eight tabs, CR LF: 37 bytes
        assert!((rate_hz(115_200.0) - 1.0 / (0.010 + 9.0 * 112e-6)).abs() < 0.5, "{}", rate_hz(115_200.0));
        assert!((rate_hz(9600.0) - 960.0 / 37.0).abs() < 1.0, "{}", rate_hz(9600.0));
    }
}
