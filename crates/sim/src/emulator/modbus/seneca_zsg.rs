//! Seneca Z-SG (manual MI002636) and its successor Z-SG2 (manual MI-005370): a net weight as f32. The two differ in where the
//! status and the commands are.

use super::{Refusal, RegisterBytes, RegisterMap};
use crate::scene::{Scene, SceneDevice};

// As on the wire: the manual's number less 40001.
const MACHINE_ID: u16 = 0;
const FIRMWARE: u16 = 1;
const UNIT: u16 = 2;
const NET: u16 = 63;

/// Differences between the two devices: addresses on the wire.
struct RegisterAddresses {
    status: u16,
    command: u16,
    /// Last register. Registers below it without a name read as 0, so that the map can be read at once.
    last: u16,
}

/// Status 40066: by the code of a public rig. Command 40067 and the end of the map: from memory only.
const ZSG: RegisterAddresses = RegisterAddresses { status: 65, command: 66, last: 69 };
/// Status 40078: manual MI-005370, page 52. Command 40080: a public table of the next model, the Z-SG3. The end of the map is
/// from memory only.
const ZSG2: RegisterAddresses = RegisterAddresses { status: 77, command: 79, last: 99 };

/// Value of `MACHINE_ID` and `FIRMWARE`. Any number is possible.
const OWN_ID: u16 = 10;
const OWN_FIRMWARE: u16 = 1;
/// High byte: newtons. Low byte: the cell measures tension and compression (Z-SG2 manual, page 42, 40003).
const UNIT_NEWTON: u16 = 5 << 8;
/// Command that takes the present weight as the tare (a public table of the next model, the Z-SG3).
const TARE_NOW: u16 = 49_914;

// Status bits (Z-SG2 manual, page 52). No page with those of the Z-SG was found, so they are taken to be the same.
const FULL_SCALE: u16 = 1 << 1;
const NET_NEGATIVE: u16 = 1 << 2;
const STABLE: u16 = 1 << 4;
/// Largest change between two looks at which the weight counts as stable, in its unit (Z-SG manual, page 20: 1.00 as shipped).
const STABLE_N: f64 = 1.0;

/// A load cell and its Seneca converter. The weight is a force in N, pressing positive, minus the tare. A restart would lose the
/// tare.
///
/// On the word order the manual of the Z-SG contradicts itself (page 17): the first register is the high word in the text, and the
/// low word in a formula. Here it is the high word, as in the Z-SG2 as shipped (page 38). Thresholds, outputs and the setting that
/// swaps the words aren't supported.
pub struct SenecaZsg {
    model: RegisterAddresses,
    range_n: f64,
    tare_n: f64,
    last_n: Option<f64>,
}

impl SenecaZsg {
    /// Creates a Z-SG with a cell that measures up to `range_n` either way. Beyond, the weight stays at the range's end, and the
    /// status reports that.
    pub fn zsg(range_n: f64) -> Self {
        SenecaZsg { model: ZSG, range_n, tare_n: 0.0, last_n: None }
    }

    /// Creates a Z-SG2 with such a cell.
    pub fn zsg2(range_n: f64) -> Self {
        SenecaZsg { model: ZSG2, ..SenecaZsg::zsg(range_n) }
    }

    /// Returns the net weight, N, and the status.
    fn weigh(&mut self, scene: &mut Scene, now_s: f64) -> (f64, u16) {
        let force_n = scene.load_cell_n(now_s);
        let measured_n = force_n.clamp(-self.range_n, self.range_n);
        let net_n = measured_n - self.tare_n;
        let stable = self.last_n.replace(measured_n).is_none_or(|last_n| (measured_n - last_n).abs() < STABLE_N);
        let mut status = 0;
        for (bit, set) in [(FULL_SCALE, force_n.abs() >= self.range_n), (NET_NEGATIVE, net_n < 0.0), (STABLE, stable)] {
            if set {
                status |= bit;
            }
        }
        (net_n, status)
    }
}

impl RegisterMap for SenecaZsg {
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
        if usize::from(address) + words.len() > usize::from(self.model.last) + 1 {
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
                register if register == self.model.status => status.to_be_bytes(),
                _ => [0, 0],
            };
        }
        Ok(())
    }

    fn write(&mut self, address: u16, words: &[RegisterBytes], scene: &mut Scene, now_s: f64) -> Result<(), Refusal> {
        match words {
            _ if address != self.model.command => Err(Refusal::Address),
            [word] if u16::from_be_bytes(*word) == TARE_NOW => {
                let (net_n, _) = self.weigh(scene, now_s);
                self.tare_n += net_n;
                Ok(())
            }
            _ => Err(Refusal::Value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::pressed;

    const EACH: [fn(f64) -> SenecaZsg; 2] = [SenecaZsg::zsg, SenecaZsg::zsg2];

    fn net(cell: &mut SenecaZsg, force_n: f64) -> [u8; 4] {
        let mut words = [[0; 2]; 2];
        cell.read(NET, &mut words, &mut pressed(force_n), 1.0).expect("the weight");
        [words[0][0], words[0][1], words[1][0], words[1][1]]
    }

    fn status(cell: &mut SenecaZsg, force_n: f64) -> u16 {
        let mut words = [[0; 2]];
        cell.read(cell.model.status, &mut words, &mut pressed(force_n), 1.0).expect("the status");
        u16::from_be_bytes(words[0])
    }

    #[test]
    fn the_weight_is_in_newtons() {
        // 1.25 is 3FA00000
        assert_eq!(net(&mut SenecaZsg::zsg(5.0), 1.25), [0x3F, 0xA0, 0, 0]);
        assert_eq!(net(&mut SenecaZsg::zsg2(5.0), 7.0), 5f32.to_be_bytes());
    }

    #[test]
    fn status_shows_full_scale_sign_and_rest() {
        for new in EACH {
            let mut cell = new(5.0);
            assert_eq!(status(&mut cell, 2.0), 0b1_0000);
            assert_eq!(status(&mut cell, 5.1), 0b0_0010);
            assert_eq!(status(&mut cell, 5.2), 0b1_0010);
            let (command, tare) = (cell.model.command, TARE_NOW.to_be_bytes());
            cell.write(command, &[tare], &mut pressed(2.0), 1.0).expect("tared");
            assert_eq!(net(&mut cell, 2.5), 0.5f32.to_be_bytes());
            assert_eq!(net(&mut cell, 1.5), (-0.5f32).to_be_bytes());
            assert_eq!(status(&mut cell, 1.5), 0b1_0100);
        }
    }

    #[test]
    fn a_zsg_has_its_status_elsewhere_than_a_zsg2() {
        let at = |mut cell: SenecaZsg, address| {
            let mut words = [[0; 2]];
            cell.read(address, &mut words, &mut pressed(9.0), 1.0).map(|()| u16::from_be_bytes(words[0]))
        };
        assert_eq!((at(SenecaZsg::zsg(5.0), 65), at(SenecaZsg::zsg2(5.0), 65)), (Ok(0b1_0010), Ok(0)));
        assert_eq!((at(SenecaZsg::zsg(5.0), 77), at(SenecaZsg::zsg2(5.0), 77)), (Err(Refusal::Address), Ok(0b1_0010)));
    }

    #[test]
    fn the_map_can_be_read_at_once_and_only_commands_can_be_written() {
        for new in EACH {
            let mut cell = new(5.0);
            let scene = &mut pressed(0.5);
            let mut words = vec![[0xFF; 2]; usize::from(cell.model.last) + 1];
            cell.read(0, &mut words, scene, 1.0).expect("the map");
            assert_eq!((words[2], words[63], words[64], words[50]), ([5, 0], [0x3F, 0], [0, 0], [0, 0]));
            assert_eq!(cell.read(1, &mut words, scene, 1.0), Err(Refusal::Address));
            assert_eq!(cell.read(u16::MAX, &mut words, scene, 1.0), Err(Refusal::Address));
            let command = cell.model.command;
            assert_eq!(cell.write(command, &[[0, 1]], scene, 1.0), Err(Refusal::Value));
            assert_eq!(cell.write(NET, &[[0, 0]; 2], scene, 1.0), Err(Refusal::Address));
        }
    }
}
