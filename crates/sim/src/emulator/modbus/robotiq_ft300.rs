//! Robotiq FT 300: forces, torques and accelerations of a sensor with six axes, as integers (FT 300 manual, section 4.4.1).

use super::{Refusal, RegisterBytes, RegisterMap};
use crate::emulator::lines::axes;
use crate::scene::{Scene, SceneDevice};
use std::ops::RangeInclusive;

/// Registers of the measurements: forces, torques and, after a gap, accelerations. Registers in the gap read as 0, so that all can be
/// read at once.
const MEASURED: RangeInclusive<u16> = 180..=192;
/// Register of the acceleration along z, at rest.
const ACCELERATION_Z: u16 = 192;
/// Registers of the serial number and the year of production.
const IDENTITY: RangeInclusive<u16> = 510..=514;
const YEAR: u16 = 514;

/// Counts per newton.
const COUNTS_PER_N: f64 = 100.0;
/// Counts of 1 g.
const GRAVITY: i16 = 1000;
/// Value of the year. Any year is possible.
const OWN_YEAR: u16 = 2019;

/// A sensor whose torques are 0. The data stream isn't supported, and how a reading beyond 300 N looks isn't known: here it ends with
/// the integer.
pub struct RobotiqFt300 {
    mounting: [[f64; 3]; 3],
}

impl RobotiqFt300 {
    /// Creates a sensor. `mounting` is the matrix from the forces of the tip on the specimen along x, y and the press to those along its
    /// axes.
    pub fn new(mounting: [[f64; 3]; 3]) -> Self {
        RobotiqFt300 { mounting }
    }
}

impl RegisterMap for RobotiqFt300 {
    fn device(&self) -> SceneDevice {
        SceneDevice::LoadCell
    }

    fn read(
        &mut self,
        address: u16,
        words: &mut [RegisterBytes],
        scene: &mut Scene,
        now_s: f64,
    ) -> Result<(), Refusal> {
        let last = usize::from(address) + words.len() - 1;
        let is_within =
            |registers: &RangeInclusive<u16>| registers.contains(&address) && last <= usize::from(*registers.end());
        if !is_within(&MEASURED) && !is_within(&IDENTITY) {
            return Err(Refusal::Address);
        }
        let (forces_n, _) = axes::read(scene, now_s, &self.mounting, f64::INFINITY);
        for (register, word) in (address..).zip(words) {
            let force_n = forces_n.get(usize::from(register.wrapping_sub(*MEASURED.start())));
            *word = match (register, force_n) {
                // a cast ends with the integer
                (_, Some(force_n)) => ((force_n * COUNTS_PER_N).round() as i16).to_be_bytes(),
                (ACCELERATION_Z, _) => GRAVITY.to_be_bytes(),
                (YEAR, _) => OWN_YEAR.to_be_bytes(),
                _ => [0, 0],
            };
        }
        Ok(())
    }

    fn write(&mut self, _: u16, _: &[RegisterBytes], _: &mut Scene, _: f64) -> Result<(), Refusal> {
        Err(Refusal::Address)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::pressed;

    /// The sensor with its z along x, against it.
    const MOUNTING: [[f64; 3]; 3] = [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];

    fn read(force_n: f64, address: u16, words: &mut [RegisterBytes]) -> Result<(), Refusal> {
        RobotiqFt300::new(MOUNTING).read(address, words, &mut pressed(force_n), 1.0)
    }

    #[test]
    fn forces_are_hundredths_of_a_newton_along_the_axes_of_the_mounting() {
        for (force_n, x) in [(1.234, -123), (0.006, -1), (400.0, i16::MIN)] {
            let mut words = [[0xFF; 2]; 3];
            read(force_n, 180, &mut words).expect("the forces");
            assert_eq!(words.map(i16::from_be_bytes), [x, 0, 0], "{force_n} N");
        }
    }

    #[test]
    fn measurements_and_identity_can_each_be_read_at_once_and_nothing_else() {
        let mut words = [[0xFF; 2]; 13];
        read(1.0, 180, &mut words).expect("the measurements");
        assert_eq!((words[0], words[3], words[12]), ((-100i16).to_be_bytes(), [0, 0], GRAVITY.to_be_bytes()));
        read(1.0, 510, &mut words[..5]).expect("the identity");
        assert_eq!(words[4], OWN_YEAR.to_be_bytes());
        for (address, count) in [(179, 2), (181, 13), (193, 1), (509, 1), (514, 2), (u16::MAX, 2)] {
            assert_eq!(read(1.0, address, &mut words[..count]), Err(Refusal::Address), "{count} at {address}");
        }
        let mut sensor = RobotiqFt300::new(MOUNTING);
        assert_eq!(sensor.write(410, &[[2, 0]], &mut pressed(0.0), 1.0), Err(Refusal::Address));
    }
}
