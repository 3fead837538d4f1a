//! The generic RS485 load-cell transmitter (manual: aje/scale-docs): 32-bit weights, high word first, RTU at 9600 8N1.

use super::{Refusal, RegisterBytes, RegisterMap};
use crate::scene::{Scene, SceneDevice};

/// Counts per newton: three decimals, so one count is 1 mN.
const COUNTS_PER_N: f64 = 1000.0;
/// Value of register 8, bits 0 to 2.
const DECIMALS: u16 = 3;
/// Largest change between two looks at which the weight counts as stable, counts.
const STABLE_COUNTS: i32 = 20;
/// Last register. Registers below it without a name read as 0, so that the map can be read at once.
const LAST: u16 = 99;

const STATUS: u16 = 8;
const MEASURED: u16 = 30;
const GROSS: u16 = 80;
const NET: u16 = 82;
const TARE: u16 = 84;
const ZERO: u16 = 94;

const SIGN: u16 = 1 << 3;
const UNSTABLE: u16 = 1 << 5;
const OVERFLOW: u16 = 1 << 6;
const AT_ZERO: u16 = 1 << 7;
const OVERLOAD: u16 = 1 << 9;

/// A load cell and its transmitter. Weights are forces in mN, pressing positive.
///
/// `measured` is the cell's reading, `gross` is the reading minus the zero, and `net` also subtracts the tare. A restart would
/// lose both. Communication settings, the converter's raw counts and the momentary tare aren't supported.
pub struct Transmitter {
    range_n: f64,
    zero: i32,
    tare: i32,
    last_measured: Option<i32>,
}

/// Readings of the cell at one instant, in counts.
struct TransmitterCounts {
    status: u16,
    measured: i32,
    gross: i32,
    net: i32,
}

impl Transmitter {
    /// Creates a cell that measures up to `range_n` either way. Beyond, the weight stays at the range's end, and the status
    /// reports overload and overflow.
    pub fn new(range_n: f64) -> Self {
        Transmitter { range_n, zero: 0, tare: 0, last_measured: None }
    }

    fn weigh(&mut self, scene: &mut Scene, now_s: f64) -> TransmitterCounts {
        let force_n = scene.load_cell_n(now_s);
        let measured = (force_n.clamp(-self.range_n, self.range_n) * COUNTS_PER_N).round() as i32;
        let gross = measured.saturating_sub(self.zero);
        let net = gross.saturating_sub(self.tare);
        let unstable = self.last_measured.is_some_and(|last| last.abs_diff(measured) > STABLE_COUNTS.unsigned_abs());
        self.last_measured = Some(measured);
        let mut status = DECIMALS;
        for (bits, set) in [
            (SIGN, gross < 0),
            (UNSTABLE, unstable),
            (AT_ZERO, gross == 0),
            (OVERFLOW | OVERLOAD, force_n.abs() > self.range_n),
        ] {
            if set {
                status |= bits;
            }
        }
        TransmitterCounts { status, measured, gross, net }
    }
}

impl RegisterMap for Transmitter {
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
        if usize::from(address) + words.len() > usize::from(LAST) + 1 {
            return Err(Refusal::Address);
        }
        let weights = self.weigh(scene, now_s);
        for (register, word) in (address..).zip(words) {
            let half = |value: i32, first: u16| {
                let [a, b, c, d] = value.to_be_bytes();
                if register == first { [a, b] } else { [c, d] }
            };
            *word = match register {
                STATUS => weights.status.to_be_bytes(),
                MEASURED | 31 => half(weights.measured, MEASURED),
                GROSS | 81 => half(weights.gross, GROSS),
                NET | 83 => half(weights.net, NET),
                TARE | 85 => half(self.tare, TARE),
                _ => [0, 0],
            };
        }
        Ok(())
    }

    fn write(&mut self, address: u16, words: &[RegisterBytes], scene: &mut Scene, now_s: f64) -> Result<(), Refusal> {
        match (address, words) {
            (TARE, &[[a, b], [c, d]]) => {
                self.tare = i32::from_be_bytes([a, b, c, d]);
                Ok(())
            }
            (ZERO, [[0, 1]]) => {
                self.zero = self.weigh(scene, now_s).measured;
                Ok(())
            }
            (TARE | ZERO, _) => Err(Refusal::Value),
            _ => Err(Refusal::Address),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::pressed;

    fn read(cell: &mut Transmitter, force_n: f64, address: u16) -> i32 {
        let mut words = [[0; 2]; 2];
        cell.read(address, &mut words, &mut pressed(force_n), 1.0).expect("a register");
        i32::from_be_bytes([words[0][0], words[0][1], words[1][0], words[1][1]])
    }

    fn status(cell: &mut Transmitter, force_n: f64) -> u16 {
        (read(cell, force_n, STATUS) >> 16) as u16
    }

    fn write(cell: &mut Transmitter, force_n: f64, address: u16, words: &[RegisterBytes]) -> Result<(), Refusal> {
        cell.write(address, words, &mut pressed(force_n), 1.0)
    }

    #[test]
    fn weights_count_millinewtons() {
        let mut cell = Transmitter::new(5.0);
        assert_eq!([MEASURED, GROSS, NET, TARE].map(|address| read(&mut cell, 1.2344, address)), [1234, 1234, 1234, 0]);
    }

    #[test]
    fn status_shows_zero_instability_and_range_overflow() {
        let mut cell = Transmitter::new(5.0);
        assert_eq!(status(&mut cell, 0.0), 0b00_1000_0011);
        assert_eq!(status(&mut cell, 1.0), 0b00_0010_0011);
        assert_eq!(status(&mut cell, 1.0), 0b00_0000_0011);
        assert_eq!(status(&mut cell, 5.1), 0b10_0110_0011);
        assert_eq!(read(&mut cell, 5.1, GROSS), 5000);
        assert_eq!(write(&mut cell, 1.0, ZERO, &[[0, 1]]), Ok(()));
        assert_eq!(status(&mut cell, 0.99), 0b00_0000_1011);
    }

    #[test]
    fn zero_changes_gross_and_tare_changes_net() {
        let mut cell = Transmitter::new(5.0);
        write(&mut cell, 0.25, ZERO, &[[0, 1]]).expect("zeroed");
        write(&mut cell, 0.75, TARE, &[[0, 0], [0x01, 0xF4]]).expect("tared");
        assert_eq!([MEASURED, GROSS, NET, TARE].map(|address| read(&mut cell, 1.0, address)), [1000, 750, 250, 500]);
        assert_eq!(read(&mut cell, 0.0, NET), -750);
        write(&mut cell, 0.0, TARE, &[[0, 0], [0, 0]]).expect("cleared");
        assert_eq!(read(&mut cell, 1.0, NET), 750);
    }

    #[test]
    fn only_commands_can_be_written() {
        let mut cell = Transmitter::new(5.0);
        assert_eq!(write(&mut cell, 0.0, TARE, &[[0, 0]]), Err(Refusal::Value));
        assert_eq!(write(&mut cell, 0.0, GROSS, &[[0, 0]]), Err(Refusal::Address));
    }

    #[test]
    fn the_whole_map_can_be_read_at_once_and_nothing_beyond_it() {
        let mut cell = Transmitter::new(5.0);
        let mut words = [[0xFF; 2]; LAST as usize + 1];
        cell.read(0, &mut words, &mut pressed(0.132), 1.0).expect("the map");
        assert_eq!((words[81], words[83], words[50]), ([0, 132], [0, 132], [0, 0]));
        assert_eq!(cell.read(1, &mut words, &mut pressed(0.0), 1.0), Err(Refusal::Address));
        assert_eq!(cell.read(u16::MAX, &mut words, &mut pressed(0.0), 1.0), Err(Refusal::Address));
    }
}
