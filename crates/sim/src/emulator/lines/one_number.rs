//! An Arduino that prints one number a line, such as that of a thermometer.

use super::print::print_float;
use super::{BoardFirmware, LINE_END, Port};
use crate::scene::{Scene, SceneDevice};

/// Decimals of `Serial.println(number, 3)`.
const DECIMALS: u32 = 3;

/// Time from line to line, s: the conversion of a DS18B20 with 12 bits takes 0.75 s (its data sheet, `tCONV`).
const PERIOD_S: f64 = 0.75;

/// Baud rate of the usual sketch.
const BAUD: f64 = 9600.0;

/// An Uno that prints the first output of the scene. It pushes lines without a command and listens to nothing.
pub struct OneNumber {
    scale: f64,
    offset: f64,
}

impl OneNumber {
    /// Creates the firmware of a board in a rig that subtracts `offset` from its number and multiplies the rest by `scale`.
    pub fn new(scale: f64, offset: f64) -> Self {
        OneNumber { scale, offset }
    }
}

impl BoardFirmware for OneNumber {
    fn device(&self) -> SceneDevice {
        SceneDevice::Array
    }

    fn port(&self) -> Port {
        Port::uno(BAUD)
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        Some(PERIOD_S)
    }

    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let mut outputs = vec![0.0; scene.taxels()];
        scene.outputs(now_s, &mut outputs);
        outputs.truncate(1);
        outputs.into_iter().map(|output| output / self.scale + self.offset).collect()
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        let mut line = Vec::new();
        reading.iter().for_each(|number| print_float(*number, DECIMALS, &mut line));
        line.extend_from_slice(LINE_END);
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::scene;
    use crate::scene::Monitored;

    #[test]
    fn a_line_is_the_reading_of_the_scene_before_scale_and_offset() {
        let monitored = |value, scale, offset| scene().monitored(Monitored { value, scale, offset });
        let line_of = |scale: f64, offset: f64, mut scene: Scene| {
            let mut board = OneNumber::new(scale, offset);
            let reading = board.read(&mut scene, 1.0);
            String::from_utf8(board.line(&reading)).unwrap()
        };
        let line = |scene: Scene| line_of(1.0, 0.0, scene);
        assert_eq!(line(monitored(None, 1.0, 0.0)), "23.000\r\n", "this scene names none");
        assert_eq!(line(monitored(Some(50.0), 100.0, 10.0)), "0.400\r\n");
        assert_eq!(line(scene()), "0.000\r\n");
        assert_eq!(line_of(-0.5, 100.0, monitored(None, 1.0, 0.0)), "54.000\r\n");
    }
}
