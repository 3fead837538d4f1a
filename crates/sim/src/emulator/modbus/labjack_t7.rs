//! The LabJack T7 (support.labjack.com: Protocol Details, Direct Modbus TCP): f32 and u32 in two registers, high word first. Both
//! registers must be read and written together.

use super::{Refusal, RegisterBytes, RegisterMap};
use crate::scene::{Scene, SceneDevice};
use std::ops::Range;

/// Analog inputs AIN0 to AIN13.
const CHANNELS: usize = 14;
/// Volts for each reading unit of a taxel. 1 N directly above a taxel gives one reading unit.
const VOLTS_PER_UNIT: f64 = 1.0;
/// Range of an input, +- V.
const RANGE_V: f64 = 10.0;

/// Value of LAST_ERR_DETAIL.
const COUNT_MUST_BE_EVEN: u16 = 2315;

/// Input of the load cell's amplifier. The second constant is the amplifier's output for each newton, V.
const CELL_CHANNEL: usize = 13;
const VOLTS_PER_N: f64 = 1.0;
/// Number of steps of a load cell's input from 0 to the end of its range: 16 bits with both signs.
const CELL_STEPS: f64 = 32_768.0;

/// A LabJack T7 at power-on, with all inputs relative to ground at 10 V. As the array, its analog inputs AIN0, AIN1 ... are the
/// taxels of the scene, in their order, 1 V for one reading unit. As the load cell, its AIN13 is the scene's load cell, 1 V for
/// one newton, in steps of 16 bit of the range. Other inputs read 0 V. Quantisation of taxels isn't modelled. Stream mode,
/// digital lines and the settings of inputs aren't supported.
pub struct LabJackT7 {
    role: SceneDevice,
    dac_v: [f32; 2],
    last_error: u16,
    /// Voltages on the inputs, V: a buffer that is filled once for each request.
    wires_v: Vec<f64>,
}

/// Value at an address.
enum RegisterValue {
    Word(u16),
    Pair([u8; 4]),
}

impl LabJackT7 {
    /// Creates a T7. `role` is the device wired to it: the array, or the load cell. If `role` is the stage, nothing is wired.
    pub fn new(role: SceneDevice) -> Self {
        LabJackT7 { role, dac_v: [0.0; 2], last_error: 0, wires_v: Vec::new() }
    }

    /// Refuses an access to half of a value.
    fn fail<T>(&mut self) -> Result<T, Refusal> {
        self.last_error = COUNT_MUST_BE_EVEN;
        Err(Refusal::Value)
    }

    /// Reading of an input within its range, V.
    fn volts(&self, channel: usize) -> f32 {
        let volts = self.wires_v.get(channel).copied().unwrap_or(0.0).clamp(-RANGE_V, RANGE_V);
        if self.role != SceneDevice::LoadCell {
            return volts as f32;
        }
        let step_v = RANGE_V / CELL_STEPS;
        ((volts / step_v).round() * step_v) as f32
    }

    /// Reads the signals that are wired to the inputs. A load cell's conversion is read only if its input is among `channels`,
    /// because each reading draws noise.
    fn sense(&mut self, channels: Range<usize>, scene: &mut Scene, now_s: f64) {
        match self.role {
            SceneDevice::Array => {
                self.wires_v.resize(scene.taxels(), 0.0);
                scene.outputs(now_s, &mut self.wires_v);
                self.wires_v.iter_mut().for_each(|volts| *volts *= VOLTS_PER_UNIT);
            }
            SceneDevice::LoadCell if channels.contains(&CELL_CHANNEL) => {
                self.wires_v.resize(CHANNELS, 0.0);
                self.wires_v[CELL_CHANNEL] = scene.load_cell_n(now_s) * VOLTS_PER_N;
            }
            SceneDevice::LoadCell | SceneDevice::Stage => {}
        }
    }

    fn value(&self, address: u16) -> Option<RegisterValue> {
        let float = |value: f32| RegisterValue::Pair(value.to_be_bytes());
        Some(match address {
            // an odd address is the middle of a value
            0..=27 if address.is_multiple_of(2) => float(self.volts(usize::from(address) / 2)),
            1000 | 1002 => float(self.dac_v[usize::from(address - 1000) / 2]),
            55000 => RegisterValue::Word(self.last_error),
            55100 => RegisterValue::Pair([0x00, 0x11, 0x22, 0x33]),
            60000 => float(7.0),
            _ => return None,
        })
    }
}

impl RegisterMap for LabJackT7 {
    fn device(&self) -> SceneDevice {
        self.role
    }

    fn read(
        &mut self,
        address: u16,
        words: &mut [RegisterBytes],
        scene: &mut Scene,
        now_s: f64,
    ) -> Result<(), Refusal> {
        let first = usize::from(address) / 2;
        if first < CHANNELS {
            let end = (usize::from(address) + words.len()).div_ceil(2).min(CHANNELS);
            self.sense(first..end, scene, now_s);
        }
        let mut address = address;
        let mut left = words;
        while !left.is_empty() {
            match (self.value(address).ok_or(Refusal::Address)?, left) {
                (RegisterValue::Word(value), [word, rest @ ..]) => {
                    *word = value.to_be_bytes();
                    left = rest;
                    address += 1;
                }
                (RegisterValue::Pair([a, b, c, d]), [high, low, rest @ ..]) => {
                    (*high, *low) = ([a, b], [c, d]);
                    left = rest;
                    address += 2;
                }
                _ => return self.fail(),
            }
        }
        Ok(())
    }

    fn write(&mut self, address: u16, words: &[RegisterBytes], _: &mut Scene, _: f64) -> Result<(), Refusal> {
        let mut address = address;
        let mut left = words;
        while !left.is_empty() {
            if !matches!(address, 1000 | 1002) {
                return Err(Refusal::Address);
            }
            let &[[a, b], [c, d], ref rest @ ..] = left else { return self.fail() };
            self.dac_v[usize::from(address - 1000) / 2] = f32::from_be_bytes([a, b, c, d]).clamp(0.0, 5.0);
            left = rest;
            address += 2;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::{noisy, pressed, scene};
    use palpate_core::mechanics::lambda;

    fn floats<const N: usize>(daq: &mut LabJackT7, scene: &mut Scene, address: u16) -> [f32; N] {
        let mut words = vec![[0; 2]; 2 * N];
        daq.read(address, &mut words, scene, 1.5).expect("registers");
        std::array::from_fn(|n| {
            f32::from_be_bytes([words[2 * n][0], words[2 * n][1], words[2 * n + 1][0], words[2 * n + 1][1]])
        })
    }

    fn write(daq: &mut LabJackT7, address: u16, words: &[RegisterBytes]) -> Result<(), Refusal> {
        daq.write(address, words, &mut scene(), 0.0)
    }

    fn float_words(value: f32) -> [RegisterBytes; 2] {
        let [a, b, c, d] = value.to_be_bytes();
        [[a, b], [c, d]]
    }

    #[test]
    fn the_inputs_are_the_taxels_in_order_and_nothing_after_them() {
        let mut daq = LabJackT7::new(SceneDevice::Array);
        let volts: [f32; CHANNELS] = floats(&mut daq, &mut pressed(0.5), 0);
        let side = (0.5 * lambda(4.5 / 5.0)) as f32;
        let corner = (0.5 * lambda(4.5 * 2f64.sqrt() / 5.0)) as f32;
        let expected = [corner, side, corner, side, 0.5, side, corner, side, corner, 0.0, 0.0, 0.0, 0.0, 0.0];
        for (n, (volts, expected)) in volts.into_iter().zip(expected).enumerate() {
            assert!((volts - expected).abs() < 1e-6, "AIN{n}: {volts} V, not {expected} V");
        }
        assert_eq!(floats::<1>(&mut daq, &mut pressed(0.5), 8), [volts[4]]);
    }

    #[test]
    fn t7_as_load_cell_has_the_force_on_ain13_within_its_range() {
        let mut daq = LabJackT7::new(SceneDevice::LoadCell);
        let step_v = 10.0 / 32768.0;
        let [volts] = floats(&mut daq, &mut pressed(0.9), 26);
        assert!((volts - 0.9).abs() < step_v / 2.0 + 1e-6, "{volts}");
        assert!((volts / step_v - (volts / step_v).round()).abs() < 1e-3, "{volts} is no step");
        let volts: [f32; CHANNELS] = floats(&mut daq, &mut pressed(0.9), 0);
        assert_eq!(volts[..13], [0.0; 13], "the taxels are not on this one");
        assert_eq!(floats::<1>(&mut daq, &mut pressed(12.0), 26), [10.0]);
        assert_eq!(daq.device(), SceneDevice::LoadCell);
    }

    #[test]
    fn conversion_of_a_load_cell_is_used_only_by_its_reader() {
        let read_after = |others: &[u16]| {
            let mut scene = noisy();
            let mut daq = LabJackT7::new(SceneDevice::LoadCell);
            for (address, at_s) in others.iter().zip([0.1, 0.2, 0.3]) {
                daq.read(*address, &mut [[0; 2]; 2], &mut scene, at_s).expect("registers");
            }
            floats::<1>(&mut daq, &mut scene, 26)
        };
        assert_eq!(read_after(&[0, 24, 60000]), read_after(&[]));
        assert_ne!(read_after(&[26]), read_after(&[]));
    }

    #[test]
    fn probed_registers_have_the_values_of_a_t7() {
        let mut daq = LabJackT7::new(SceneDevice::Array);
        let mut words = [[0; 2]; 2];
        for (address, bytes) in
            [(55100, [[0x00, 0x11], [0x22, 0x33]]), (60000, float_words(7.0)), (1000, float_words(0.0))]
        {
            daq.read(address, &mut words, &mut scene(), 1.5).expect("a register");
            assert_eq!(words, bytes, "{address}");
        }
    }

    #[test]
    fn refusal_details_are_at_register_55000() {
        let mut daq = LabJackT7::new(SceneDevice::Array);
        let mut odd = [[0; 2]; 3];
        assert_eq!(daq.read(0, &mut odd, &mut scene(), 0.0), Err(Refusal::Value));
        let mut detail = [[0; 2]];
        daq.read(55000, &mut detail, &mut scene(), 0.0).expect("the detail");
        assert_eq!(u16::from_be_bytes(detail[0]), COUNT_MUST_BE_EVEN);
        assert_eq!(write(&mut daq, 1000, &[[0, 0]]), Err(Refusal::Value));
        for address in [1, 28, 55101, 65535] {
            assert_eq!(daq.read(address, &mut odd, &mut scene(), 0.0), Err(Refusal::Address), "{address}");
        }
        assert_eq!(write(&mut daq, 0, &float_words(1.0)), Err(Refusal::Address));
    }
}
