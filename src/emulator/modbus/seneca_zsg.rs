//! Seneca Z-SG and Z-SG2 (manuals MI002636, MI-005370): a net weight as f32.

use super::{Refusal, RegisterMap, Word};
use crate::scene::{Device, Scene};

/// Last register. Registers below it without a name read as 0, so that the map can be read at once.
const LAST: u16 = 99;

// As on the wire: the manual's number less 40001.
const MACHINE_ID: u16 = 0;
const FIRMWARE: u16 = 1;
const UNIT: u16 = 2;
const NET: u16 = 63;
const STATUS: u16 = 77;
const COMMAND: u16 = 79;

/// Value of `MACHINE_ID` and `FIRMWARE`. Any number is possible.
const OWN_ID: u16 = 10;
const OWN_FIRMWARE: u16 = 1;
/// High byte: newtons. Low byte: the cell measures tension and compression (manual, 40003).
const UNIT_NEWTON: u16 = 5 << 8;
/// Command that takes the present weight as the tare. It is known from memory only: no manual page with it was found.
const TARE_NOW: u16 = 49_914;

const FULL_SCALE: u16 = 1 << 1;
const NET_NEGATIVE: u16 = 1 << 2;

/// A load cell and its Seneca converter. The weight is a force in N, pressing positive, minus the tare. A restart would lose the
/// tare.
///
/// On the word order the manual contradicts itself: the first register is the high word in the text, and the low word in a
/// formula. Here it is the high word. Thresholds, outputs and the setting that swaps the words aren't supported.
pub struct SenecaZsg {
    range_n: f64,
    tare_n: f64,
}

impl SenecaZsg {
    /// Creates a cell that measures up to `range_n` either way, high word first. Beyond, the weight stays at the range's end, and
    /// the status reports that.
    pub fn new(range_n: f64) -> Self {
        SenecaZsg { range_n, tare_n: 0.0 }
    }

    /// Returns the net weight, N, and the status.
    fn weigh(&self, scene: &mut Scene, now_s: f64) -> (f64, u16) {
        let force_n = scene.load_cell_n(now_s);
        let measured_n = force_n.clamp(-self.range_n, self.range_n);
        let net_n = measured_n - self.tare_n;
        let full_scale = if force_n.abs() >= self.range_n { FULL_SCALE } else { 0 };
        let negative = if net_n < 0.0 { NET_NEGATIVE } else { 0 };
        (net_n, full_scale | negative)
    }
}

impl RegisterMap for SenecaZsg {
    fn device(&self) -> Device {
        Device::LoadCell
    }

    fn read(&mut self, address: u16, words: &mut [Word], scene: &mut Scene, now_s: f64) -> Result<(), Refusal> {
        if usize::from(address) + words.len() > usize::from(LAST) + 1 {
            return Err(Refusal::Address);
        }
        let (net_n, status) = self.weigh(scene, now_s);
        let [a, b, c, d] = (net_n as f32).to_be_bytes();
        for (register, word) in (address..).zip(words) {
            *word = match register {
                MACHINE_ID => OWN_ID.to_be_bytes(),
                FIRMWARE => OWN_FIRMWARE.to_be_bytes(),
                UNIT => UNIT_NEWTON.to_be_bytes(),
                NET => [a, b],
                64 => [c, d],
                STATUS => status.to_be_bytes(),
                _ => [0, 0],
            };
        }
        Ok(())
    }

    fn write(&mut self, address: u16, words: &[Word], scene: &mut Scene, now_s: f64) -> Result<(), Refusal> {
        match (address, words) {
            (COMMAND, [word]) if u16::from_be_bytes(*word) == TARE_NOW => {
                let (net_n, _) = self.weigh(scene, now_s);
                self.tare_n += net_n;
                Ok(())
            }
            (COMMAND, _) => Err(Refusal::Value),
            _ => Err(Refusal::Address),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::pressed;

    fn net(cell: &mut SenecaZsg, force_n: f64) -> [u8; 4] {
        let mut words = [[0; 2]; 2];
        cell.read(NET, &mut words, &mut pressed(force_n), 1.0).expect("the weight");
        [words[0][0], words[0][1], words[1][0], words[1][1]]
    }

    fn status(cell: &mut SenecaZsg, force_n: f64) -> u16 {
        let mut words = [[0; 2]];
        cell.read(STATUS, &mut words, &mut pressed(force_n), 1.0).expect("the status");
        u16::from_be_bytes(words[0])
    }

    #[test]
    fn the_weight_is_in_newtons() {
        // 1.25 is 3FA00000
        assert_eq!(net(&mut SenecaZsg::new(5.0), 1.25), [0x3F, 0xA0, 0, 0]);
        assert_eq!(net(&mut SenecaZsg::new(5.0), 7.0), 5f32.to_be_bytes());
    }

    #[test]
    fn the_status_tells_full_scale_and_sign() {
        let mut cell = SenecaZsg::new(5.0);
        assert_eq!(status(&mut cell, 2.0), 0);
        assert_eq!(status(&mut cell, 5.1), 0b10);
        let tare = TARE_NOW.to_be_bytes();
        cell.write(COMMAND, &[tare], &mut pressed(2.0), 1.0).expect("tared");
        assert_eq!(net(&mut cell, 2.5), 0.5f32.to_be_bytes());
        assert_eq!(net(&mut cell, 1.5), (-0.5f32).to_be_bytes());
        assert_eq!(status(&mut cell, 1.5), 0b100);
    }

    #[test]
    fn the_map_can_be_read_at_once_and_only_commands_can_be_written() {
        let mut cell = SenecaZsg::new(5.0);
        let scene = &mut pressed(0.5);
        let mut words = [[0xFF; 2]; LAST as usize + 1];
        cell.read(0, &mut words, scene, 1.0).expect("the map");
        assert_eq!((words[2], words[63], words[64], words[50]), ([5, 0], [0x3F, 0], [0, 0], [0, 0]));
        assert_eq!(cell.read(1, &mut words, scene, 1.0), Err(Refusal::Address));
        assert_eq!(cell.read(u16::MAX, &mut words, scene, 1.0), Err(Refusal::Address));
        assert_eq!(cell.write(COMMAND, &[[0, 1]], scene, 1.0), Err(Refusal::Value));
        assert_eq!(cell.write(NET, &[[0, 0]; 2], scene, 1.0), Err(Refusal::Address));
    }
}
