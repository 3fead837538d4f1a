//! An Arduino Uno with an HX711 amplifier and the library bogde/HX711.

use super::print::print_float;
use super::{BoardFirmware, CellScale, LINE_END, Port};
use crate::scene::{Scene, SceneDevice};

/// Ends of the 24-bit counts. The chip stays at an end beyond its range (data sheet of the HX711, from memory).
const COUNTS_LEAST: f64 = -8_388_608.0;
const COUNTS_MOST: f64 = 8_388_607.0;

/// Time between readings of the basic example, s: its `delay(1000)`.
const BASIC_PERIOD_S: f64 = 1.0;

const NEWTONS_PER_POUND: f64 = 4.448_221_615_260_5;

/// Sketch on the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hx711Sketch {
    /// `Serial.println(scale.read())` in the loop, 57600 baud: one line such as `84123` for each conversion. The most common
    /// example without its text and delay, as rigs have it (dregnerus/Bachelor-Project, Before_calibration.ino).
    Bare,
    /// The most common public example, bogde/HX711 `examples/HX711_basic_example/HX711_basic_example.ino`: 57600 baud, a line such
    /// as `HX711 reading: 84123` each second.
    Basic,
    /// SparkFun's example (copy: Najeeb-Aqel/PackageSorting, LoadCell.ino): 9600 baud. It greets with `HX711 scale demo`, takes its
    /// tare, prints `Readings:`, then lines such as `Reading: -0.2 lbs`.
    Demo,
}

/// An HX711 with a load cell, in raw counts.
///
/// The tare of [`Hx711Sketch::Demo`] is one conversion, where the library takes the mean of ten.
pub struct Hx711 {
    sketch: Hx711Sketch,
    rate_hz: f64,
    scale: CellScale,
    tare_counts: Option<f64>,
}

impl Hx711 {
    /// Usual counts: 400,000 for one newton, so the range of the chip ends at some 20 N. No bridge is balanced exactly.
    pub const USUAL: CellScale = CellScale { newton_per_unit: 0.000_002_5, offset: 84_000.0 };
    /// Conversions per second with the pin RATE low, as most boards have it.
    pub const SLOW_HZ: f64 = 10.0;
    /// Conversions per second with the pin RATE high.
    pub const FAST_HZ: f64 = 80.0;

    /// Creates the firmware. `rate_hz` is the number of conversions per second; the chip's own clock is off by some percent.
    pub fn new(sketch: Hx711Sketch, rate_hz: f64) -> Self {
        Hx711 { sketch, rate_hz, scale: Self::USUAL, tare_counts: None }
    }

    /// Puts a load cell with other counts on the amplifier.
    #[must_use]
    pub fn scaled(self, scale: CellScale) -> Self {
        Hx711 { scale, ..self }
    }
}

impl BoardFirmware for Hx711 {
    fn device(&self) -> SceneDevice {
        SceneDevice::LoadCell
    }

    fn port(&self) -> Port {
        Port::uno(match self.sketch {
            Hx711Sketch::Bare | Hx711Sketch::Basic => 57_600.0,
            Hx711Sketch::Demo => 9600.0,
        })
    }

    fn start(&mut self) -> Vec<u8> {
        self.tare_counts = None;
        match self.sketch {
            Hx711Sketch::Demo => b"HX711 scale demo\r\n".to_vec(),
            Hx711Sketch::Bare | Hx711Sketch::Basic => Vec::new(),
        }
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        Some(if self.sketch == Hx711Sketch::Basic { BASIC_PERIOD_S } else { 1.0 / self.rate_hz })
    }

    /// The reading of [`Hx711Sketch::Demo`] that becomes its tare is empty.
    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let sound = |force_n: f64| self.scale.number(force_n).round().clamp(COUNTS_LEAST, COUNTS_MOST);
        let counts = scene.load_cell_count(now_s, sound);
        match (self.sketch, self.tare_counts) {
            (Hx711Sketch::Bare | Hx711Sketch::Basic, _) => vec![counts],
            (Hx711Sketch::Demo, Some(tare)) => vec![(counts - tare) * self.scale.newton_per_unit / NEWTONS_PER_POUND],
            (Hx711Sketch::Demo, None) => {
                self.tare_counts = Some(counts);
                Vec::new()
            }
        }
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        let mut line = Vec::new();
        match (self.sketch, reading) {
            (Hx711Sketch::Demo, [pounds, ..]) => {
                line.extend_from_slice(b"Reading: ");
                print_float(*pounds, 1, &mut line);
                line.extend_from_slice(b" lbs");
            }
            (_, []) => line.extend_from_slice(b"Readings:"),
            (sketch, [counts, ..]) => {
                let text: &[u8] = if sketch == Hx711Sketch::Basic { b"HX711 reading: " } else { b"" };
                line.extend_from_slice(text);
                line.extend_from_slice((*counts as i64).to_string().as_bytes());
            }
        }
        line.extend_from_slice(LINE_END);
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::{pressed, scene, scene_with};
    use crate::scene::{CorruptSamples, GlitchKind, LoadCellScene};

    fn line(sketch: Hx711Sketch, force_n: f64) -> String {
        let mut firmware = Hx711::new(sketch, Hx711::FAST_HZ);
        let reading = firmware.read(&mut pressed(force_n), 1.0);
        String::from_utf8(firmware.line(&reading)).expect("text")
    }

    #[test]
    fn lines_are_those_of_the_sketches() {
        assert_eq!(line(Hx711Sketch::Bare, 0.25), "184000\r\n");
        assert_eq!(line(Hx711Sketch::Basic, 0.25), "HX711 reading: 184000\r\n");
        assert_eq!(Hx711::new(Hx711Sketch::Bare, 10.0).line(&[-42.0]), b"-42\r\n");
    }

    #[test]
    fn readings_stay_at_the_ends_of_24_bits() {
        assert_eq!(line(Hx711Sketch::Bare, 20.0), "8084000\r\n");
        assert_eq!(line(Hx711Sketch::Bare, 30.0), "8388607\r\n");
        assert_eq!(Hx711::new(Hx711Sketch::Bare, 10.0).line(&[COUNTS_LEAST]), b"-8388608\r\n");
    }

    #[test]
    fn counts_follow_the_cell_and_its_zero() {
        for (newton_per_unit, offset, expected) in
            [(0.000_005, 84_000.0, 134_000.0), (-0.000_002_5, 84_000.0, -16_000.0), (0.000_002_5, 0.0, 100_000.0)]
        {
            let mut firmware = Hx711::new(Hx711Sketch::Bare, 10.0).scaled(CellScale { newton_per_unit, offset });
            assert_eq!(firmware.read(&mut pressed(0.25), 1.0), [expected]);
        }
    }

    #[test]
    fn corrupt_samples_are_the_counts_of_the_chip() {
        for (kind, expected) in [
            (GlitchKind::MinusOne, "-1\r\n"),
            (GlitchKind::AllOnes, "16777215\r\n"),
            (GlitchKind::FullScale, "8388607\r\n"),
            (GlitchKind::SignTurned, "-8304608\r\n"),
        ] {
            let glitches = Some(CorruptSamples::of(kind, 1.0));
            let cell = LoadCellScene { glitches, ..LoadCellScene::IDEAL };
            let mut firmware = Hx711::new(Hx711Sketch::Bare, Hx711::FAST_HZ);
            let reading = firmware.read(&mut scene_with(|spec| spec.load_cell = Some(cell)), 1.0);
            assert_eq!(firmware.line(&reading), expected.as_bytes(), "{kind:?}");
        }
    }

    #[test]
    fn the_demo_takes_its_tare_first_and_again_after_a_reset() {
        let mut firmware = Hx711::new(Hx711Sketch::Demo, 10.0);
        assert_eq!(firmware.start(), b"HX711 scale demo\r\n");
        let next = |firmware: &mut Hx711, force_n: f64| {
            let mut scene = if force_n > 0.0 { pressed(force_n) } else { scene() };
            let reading = firmware.read(&mut scene, 1.0);
            String::from_utf8(firmware.line(&reading)).expect("text")
        };
        assert_eq!(next(&mut firmware, NEWTONS_PER_POUND), "Readings:\r\n");
        assert_eq!(next(&mut firmware, 3.0 * NEWTONS_PER_POUND), "Reading: 2.0 lbs\r\n");
        assert_eq!(next(&mut firmware, 0.0), "Reading: -1.0 lbs\r\n");
        firmware.start();
        assert_eq!(next(&mut firmware, 0.0), "Readings:\r\n");
        assert_eq!(next(&mut firmware, NEWTONS_PER_POUND), "Reading: 1.0 lbs\r\n");
    }

    #[test]
    fn rates_and_bauds_are_those_of_chip_and_sketch() {
        let of = |sketch| {
            let firmware = Hx711::new(sketch, Hx711::SLOW_HZ);
            (firmware.period_s(&scene()), firmware.port())
        };
        assert_eq!(of(Hx711Sketch::Bare), (Some(0.1), Port::uno(57_600.0)));
        assert_eq!(of(Hx711Sketch::Basic), (Some(1.0), Port::uno(57_600.0)));
        assert_eq!(of(Hx711Sketch::Demo), (Some(0.1), Port::uno(9600.0)));
    }
}
