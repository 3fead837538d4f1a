//! Laumas TLB, TLU and W100 (manual: Modbus protocol of the TLB4): weights as magnitudes of 32 bits, high word first, their
//! signs in the status register.

use super::{Refusal, RegisterBytes, RegisterMap};
use crate::scene::{Scene, SceneDevice};

/// Counts per newton: three decimals, so one count is 1 mN.
const COUNTS_PER_N: f64 = 1000.0;
/// Value of "divisions and units of measure" in the manual, 40014. The manual's table of divisions isn't known here. This value
/// uses the simplest interpretation: number of decimals in the low byte, no unit in the high byte.
const DECIMALS: u16 = 3;
/// Largest number of registers in one query (manual).
const QUERY_MOST: usize = 32;
/// Largest weight that is reported, counts.
const DISPLAYED_MOST: i32 = 999_999;
/// Number of divisions beyond the range that are accepted. The second constant is the end of the converter's range, as a multiple
/// of the range.
const DIVISIONS_BEYOND: f64 = 9.0;
const CONVERTER_PART: f64 = 1.1;
/// Last register. Registers below it without a name read as 0, so that the map can be read in a few queries.
const LAST: u16 = 79;

// As on the wire: the manual's number less 40001.
const FIRMWARE: u16 = 0;
const MODEL: u16 = 1;
const COMMAND: u16 = 5;
const STATUS: u16 = 6;
const GROSS: u16 = 7;
const NET: u16 = 9;
const DIVISION: u16 = 13;

const NO_COMMAND: u16 = 0;
const TARE: u16 = 7;
const SEMI_AUTO_ZERO: u16 = 8;

const CONVERTER_FAULT: u16 = 1 << 1;
const BEYOND_RANGE: u16 = 1 << 2;
const BEYOND_CONVERTER: u16 = 1 << 3;
const GROSS_BEYOND_DISPLAY: u16 = 1 << 4;
const NET_BEYOND_DISPLAY: u16 = 1 << 5;
const GROSS_NEGATIVE: u16 = 1 << 7;
const NET_NEGATIVE: u16 = 1 << 8;
const NET_SHOWN: u16 = 1 << 10;

/// A load cell and its Laumas transmitter. Weights are forces in mN, pressing positive. The gross weight is the weight minus the
/// zero; the net weight also subtracts the tare. A restart would lose both.
///
/// The command register reads 0, because a command is done when it is answered. Peaks, calibration, filters and set points aren't
/// supported.
pub struct LaumasTlb {
    range_n: f64,
    zero: i32,
    tare: Option<i32>,
}

/// Readings of the cell at one instant, in counts.
struct TlbCounts {
    status: u16,
    gross: i32,
    net: i32,
}

impl LaumasTlb {
    /// Creates a cell that measures up to `range_n` either way. Slightly beyond, the status reports that; at 110 % the weight
    /// stays constant.
    pub fn new(range_n: f64) -> Self {
        LaumasTlb { range_n, zero: 0, tare: None }
    }

    fn weigh(&self, scene: &mut Scene, now_s: f64) -> TlbCounts {
        let force_n = scene.load_cell_n(now_s);
        let most_n = self.range_n * CONVERTER_PART;
        let measured = (force_n.clamp(-most_n, most_n) * COUNTS_PER_N).round() as i32;
        let gross = measured.saturating_sub(self.zero);
        let net = gross.saturating_sub(self.tare.unwrap_or(0));
        let mut status = 0;
        for (bit, set) in [
            (CONVERTER_FAULT, !force_n.is_finite()),
            (BEYOND_RANGE, force_n.abs() > self.range_n + DIVISIONS_BEYOND / COUNTS_PER_N),
            (BEYOND_CONVERTER, force_n.abs() > most_n),
            (GROSS_BEYOND_DISPLAY, gross.abs() > DISPLAYED_MOST),
            (NET_BEYOND_DISPLAY, net.abs() > DISPLAYED_MOST),
            (GROSS_NEGATIVE, gross < 0),
            (NET_NEGATIVE, net < 0),
            (NET_SHOWN, self.tare.is_some()),
        ] {
            if set {
                status |= bit;
            }
        }
        TlbCounts { status, gross, net }
    }

    fn command(&mut self, command: u16, scene: &mut Scene, now_s: f64) -> Result<(), Refusal> {
        match command {
            NO_COMMAND => {}
            TARE => self.tare = Some(self.weigh(scene, now_s).gross),
            SEMI_AUTO_ZERO => {
                self.zero += self.weigh(scene, now_s).gross;
            }
            _ => return Err(Refusal::Value),
        }
        Ok(())
    }
}

impl RegisterMap for LaumasTlb {
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
        if words.len() > QUERY_MOST {
            return Err(Refusal::Value);
        }
        if usize::from(address) + words.len() > usize::from(LAST) + 1 {
            return Err(Refusal::Address);
        }
        let weights = self.weigh(scene, now_s);
        for (register, word) in (address..).zip(words) {
            let half = |value: i32, first: u16| {
                let [a, b, c, d] = value.unsigned_abs().to_be_bytes();
                if register == first { [a, b] } else { [c, d] }
            };
            *word = match register {
                FIRMWARE | MODEL => [0, 1],
                STATUS => weights.status.to_be_bytes(),
                GROSS | 8 => half(weights.gross, GROSS),
                NET | 10 => half(weights.net, NET),
                DIVISION => DECIMALS.to_be_bytes(),
                _ => [0, 0],
            };
        }
        Ok(())
    }

    fn write(&mut self, address: u16, words: &[RegisterBytes], scene: &mut Scene, now_s: f64) -> Result<(), Refusal> {
        match (address, words) {
            (COMMAND, [word]) => self.command(u16::from_be_bytes(*word), scene, now_s),
            (COMMAND, _) => Err(Refusal::Value),
            _ => Err(Refusal::Address),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::{noisy, pressed};

    fn read(cell: &mut LaumasTlb, force_n: f64, address: u16) -> u32 {
        let mut words = [[0; 2]; 2];
        cell.read(address, &mut words, &mut pressed(force_n), 1.0).expect("a register");
        u32::from_be_bytes([words[0][0], words[0][1], words[1][0], words[1][1]])
    }

    fn status(cell: &mut LaumasTlb, force_n: f64) -> u16 {
        (read(cell, force_n, STATUS) >> 16) as u16
    }

    fn command(cell: &mut LaumasTlb, force_n: f64, command: u8) -> Result<(), Refusal> {
        cell.write(COMMAND, &[[0, command]], &mut pressed(force_n), 1.0)
    }

    #[test]
    fn weights_count_millinewtons_as_the_division_states() {
        let mut cell = LaumasTlb::new(5.0);
        assert_eq!([GROSS, NET].map(|address| read(&mut cell, 1.2344, address)), [1234; 2]);
        assert_eq!(read(&mut cell, 0.0, DIVISION) >> 16, 3);
    }

    #[test]
    fn sign_is_in_the_status_register() {
        let mut cell = LaumasTlb::new(5.0);
        command(&mut cell, 0.5, 8).expect("zeroed");
        command(&mut cell, 0.75, 7).expect("tared");
        assert_eq!([GROSS, NET].map(|address| read(&mut cell, 1.0, address)), [500, 250]);
        assert_eq!([GROSS, NET].map(|address| read(&mut cell, 0.6, address)), [100, 150]);
        assert_eq!(status(&mut cell, 0.6), NET_NEGATIVE | NET_SHOWN);
        assert_eq!([GROSS, NET].map(|address| read(&mut cell, 0.25, address)), [250, 500]);
        assert_eq!(status(&mut cell, 0.25), GROSS_NEGATIVE | NET_NEGATIVE | NET_SHOWN);
    }

    #[test]
    fn status_shows_range_overflow() {
        let mut cell = LaumasTlb::new(5.0);
        assert_eq!(status(&mut cell, 1.0), 0);
        assert_eq!(status(&mut cell, 5.005), 0);
        assert_eq!(status(&mut cell, 5.1), BEYOND_RANGE);
        assert_eq!(status(&mut cell, 5.6), BEYOND_RANGE | BEYOND_CONVERTER);
        assert_eq!(read(&mut cell, 5.6, GROSS), 5500);
        assert_eq!(status(&mut LaumasTlb::new(2000.0), 1000.0), GROSS_BEYOND_DISPLAY | NET_BEYOND_DISPLAY);
    }

    #[test]
    fn a_query_has_32_registers_at_most_and_only_commands_can_be_written() {
        let mut cell = LaumasTlb::new(5.0);
        let scene = &mut noisy();
        assert_eq!(cell.read(0, &mut [[0; 2]; 32], scene, 1.0), Ok(()));
        assert_eq!(cell.read(0, &mut [[0; 2]; 33], scene, 1.0), Err(Refusal::Value));
        assert_eq!(cell.read(79, &mut [[0; 2]; 2], scene, 1.0), Err(Refusal::Address));
        assert_eq!(cell.read(u16::MAX, &mut [[0; 2]; 2], scene, 1.0), Err(Refusal::Address));
        assert_eq!(command(&mut cell, 0.0, 0), Ok(()));
        assert_eq!(command(&mut cell, 0.0, 100), Err(Refusal::Value));
        assert_eq!(cell.write(COMMAND, &[[0, 8]; 2], scene, 1.0), Err(Refusal::Value));
        assert_eq!(cell.write(GROSS, &[[0, 0]], scene, 1.0), Err(Refusal::Address));
    }
}
