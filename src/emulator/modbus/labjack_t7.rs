//! The LabJack T7 (support.labjack.com: Protocol Details, Direct Modbus TCP): f32 and u32 over two registers, high word
//! first, and to be read and written whole.

use super::{READ_MOST, Refusal, RegisterMap, Word};
use crate::scene::{Device, Scene};
use std::ops::Range;

/// Analog inputs AIN0 to AIN13.
const CHANNELS: usize = 14;
/// Volts a reading unit of a taxel: what 1 N straight above one comes to.
const VOLTS_PER_UNIT: f64 = 1.0;
/// Gains that AINn_RANGE names by their range, V; 0 stands for the first.
const RANGES_V: [f32; 4] = [10.0, 1.0, 0.1, 0.01];
/// AINn_NEGATIVE_CH of an input measured against ground.
const GROUND: u16 = 199;
/// The highest resolution index of a T7 (a T7-Pro has more).
const RESOLUTION_LAST: u16 = 8;
/// CORE_TIMER's rate: half of the core's 80 MHz.
const CORE_TIMER_HZ: f64 = 40e6;
/// SERIAL_NUMBER.
const SERIAL_NUMBER: u32 = 470_010_001;

// LAST_ERR_DETAIL
const BAD_COUNT: u16 = 2313;
const READ_TOO_LARGE: u16 = 2314;
const COUNT_MUST_BE_EVEN: u16 = 2315;
const BAD_RANGE: u16 = 2370;
const BAD_NEGATIVE_CHANNEL: u16 = 2373;
const BAD_RESOLUTION: u16 = 2375;

/// The input that a load cell's amplifier is on, and what the amplifier makes of a newton, V.
const CELL_CHANNEL: usize = 13;
const VOLTS_PER_N: f64 = 1.0;
/// Steps of a load cell's input from 0 to the end of its range: 16 bit with both signs.
const CELL_STEPS: f64 = 32_768.0;

/// A LabJack T7. As the array its analog inputs AIN0, AIN1 ... are the taxels of the scene, in their order, 1 V a reading unit.
/// As the load cell its AIN13 is the scene's load cell, 1 V a newton, in steps of 16 bit of the range. Other inputs read 0 V.
/// Quantisation of taxels isn't modelled, nor is stream mode.
pub struct LabJackT7 {
    role: Device,
    inputs: [Input; CHANNELS],
    dac_v: [f32; 2],
    fio: [u16; 8],
    last_error: u16,
    /// What is on the inputs, V: a scratch place, filled once a request.
    wires_v: Vec<f64>,
}

#[derive(Clone, Copy)]
struct Input {
    range_v: f32,
    negative_channel: u16,
    resolution: u16,
    settling_us: f32,
}

/// What stands at an address.
enum Value {
    Word(u16),
    Pair([u8; 4]),
}

impl LabJackT7 {
    /// A T7 as it is switched on: all inputs against ground, at 10 V. `role` is what is wired to it: the array, or the load
    /// cell; to one that is to play the stage, nothing.
    pub fn new(role: Device) -> Self {
        let input = Input { range_v: RANGES_V[0], negative_channel: GROUND, resolution: 0, settling_us: 0.0 };
        LabJackT7 { role, inputs: [input; CHANNELS], dac_v: [0.0; 2], fio: [1; 8], last_error: 0, wires_v: Vec::new() }
    }

    fn fail<T>(&mut self, detail: u16) -> Result<T, Refusal> {
        self.last_error = detail;
        Err(Refusal::Value)
    }

    /// What an input reads: the difference of its two, as far as its range goes, V.
    fn volts(&self, channel: usize) -> f32 {
        let input = &self.inputs[channel];
        let against_ground = |channel: usize| self.wires_v.get(channel).copied().unwrap_or(0.0);
        let negative =
            if input.negative_channel == GROUND { 0.0 } else { against_ground(input.negative_channel.into()) };
        let volts = ((against_ground(channel) - negative) as f32).clamp(-input.range_v, input.range_v);
        if self.role != Device::LoadCell {
            return volts;
        }
        let step_v = f64::from(input.range_v) / CELL_STEPS;
        ((f64::from(volts) / step_v).round() * step_v) as f32
    }

    /// Looks at what is wired to the inputs. A load cell's conversion is looked at only if `channels` need it, which draws its
    /// noise.
    fn sense(&mut self, channels: Range<usize>, scene: &mut Scene, now_s: f64) {
        match self.role {
            Device::Array => {
                self.wires_v.resize(scene.taxels(), 0.0);
                scene.outputs(now_s, &mut self.wires_v);
                self.wires_v.iter_mut().for_each(|volts| *volts *= VOLTS_PER_UNIT);
            }
            Device::LoadCell => {
                let inputs = self.inputs.iter().enumerate().take(channels.end).skip(channels.start);
                let of_cell = |(n, input): (usize, &Input)| {
                    n == CELL_CHANNEL || usize::from(input.negative_channel) == CELL_CHANNEL
                };
                if inputs.into_iter().any(of_cell) {
                    self.wires_v.resize(CHANNELS, 0.0);
                    self.wires_v[CELL_CHANNEL] = scene.load_cell_n(now_s) * VOLTS_PER_N;
                }
            }
            Device::Stage => {}
        }
    }

    fn value(&self, address: u16, now_s: f64) -> Option<Value> {
        let at = |first: u16| usize::from(address - first);
        let float = |value: f32| Value::Pair(value.to_be_bytes());
        let long = |value: u32| Value::Pair(value.to_be_bytes());
        Some(match address {
            // an odd address is the middle of a value
            0..=27 if address.is_multiple_of(2) => float(self.volts(at(0) / 2)),
            1000 | 1002 => float(self.dac_v[at(1000) / 2]),
            2000..=2007 => Value::Word(self.fio[at(2000)]),
            40000..=40027 if address.is_multiple_of(2) => float(self.inputs[at(40000) / 2].range_v),
            41000..=41013 => Value::Word(self.inputs[at(41000)].negative_channel),
            41500..=41513 => Value::Word(self.inputs[at(41500)].resolution),
            42000..=42027 if address.is_multiple_of(2) => float(self.inputs[at(42000) / 2].settling_us),
            55000 => Value::Word(self.last_error),
            55100 | 55120 => long(0x0011_2233),
            55110 => Value::Word(0x0011),
            55122 => long(0x8899_AABB),
            55124 => float(-9999.0),
            60000 => float(7.0),
            60002 => float(1.3),
            60004 => float(1.0292),
            60028 => long(SERIAL_NUMBER),
            60052 => float(298.15),
            61520 => long((now_s * CORE_TIMER_HZ) as u64 as u32),
            _ => return None,
        })
    }

    /// Sets what stands at `address`, and tells how many words it took.
    fn set(&mut self, address: u16, words: &[Word]) -> Result<usize, Refusal> {
        let at = |first: u16| usize::from(address - first);
        match address {
            2000..=2007 | 41000..=41013 | 41500..=41513 | 43902 | 43903 => {
                let word = u16::from_be_bytes(words[0]);
                match address {
                    2000..=2007 => self.fio[at(2000)] = word & 1,
                    41000..=41013 => self.set_negative_channel(at(41000), word)?,
                    41500..=41513 => self.set_resolution(at(41500), word)?,
                    43902 => (0..CHANNELS).try_for_each(|channel| self.set_negative_channel(channel, word))?,
                    _ => (0..CHANNELS).try_for_each(|channel| self.set_resolution(channel, word))?,
                }
                Ok(1)
            }
            1000 | 1002 | 40000..=40027 | 42000..=42027 | 43900 | 43904 if address.is_multiple_of(2) => {
                let &[[a, b], [c, d], ..] = words else { return self.fail(COUNT_MUST_BE_EVEN) };
                let value = f32::from_be_bytes([a, b, c, d]);
                match address {
                    1000 | 1002 => self.dac_v[at(1000) / 2] = value.clamp(0.0, 5.0),
                    40000..=40027 => self.set_range(at(40000) / 2, value)?,
                    42000..=42027 => self.inputs[at(42000) / 2].settling_us = value,
                    43900 => (0..CHANNELS).try_for_each(|channel| self.set_range(channel, value))?,
                    _ => self.inputs.iter_mut().for_each(|input| input.settling_us = value),
                }
                Ok(2)
            }
            _ => Err(Refusal::Address),
        }
    }

    fn set_range(&mut self, channel: usize, range_v: f32) -> Result<(), Refusal> {
        let range_v = if range_v == 0.0 { RANGES_V[0] } else { range_v };
        if !RANGES_V.contains(&range_v) {
            return self.fail(BAD_RANGE);
        }
        self.inputs[channel].range_v = range_v;
        Ok(())
    }

    /// Ground, or the next input for an even one.
    fn set_negative_channel(&mut self, channel: usize, negative: u16) -> Result<(), Refusal> {
        let paired = channel.is_multiple_of(2) && usize::from(negative) == channel + 1;
        if negative != GROUND && !paired {
            return self.fail(BAD_NEGATIVE_CHANNEL);
        }
        self.inputs[channel].negative_channel = negative;
        Ok(())
    }

    fn set_resolution(&mut self, channel: usize, resolution: u16) -> Result<(), Refusal> {
        if resolution > RESOLUTION_LAST {
            return self.fail(BAD_RESOLUTION);
        }
        self.inputs[channel].resolution = resolution;
        Ok(())
    }
}

impl RegisterMap for LabJackT7 {
    fn device(&self) -> Device {
        self.role
    }

    fn read(&mut self, address: u16, words: &mut [Word], scene: &mut Scene, now_s: f64) -> Result<(), Refusal> {
        let first = usize::from(address) / 2;
        if first < CHANNELS {
            let end = (usize::from(address) + words.len()).div_ceil(2).min(CHANNELS);
            self.sense(first..end, scene, now_s);
        }
        let mut address = address;
        let mut left = words;
        while !left.is_empty() {
            match (self.value(address, now_s).ok_or(Refusal::Address)?, left) {
                (Value::Word(value), [word, rest @ ..]) => {
                    *word = value.to_be_bytes();
                    left = rest;
                    address += 1;
                }
                (Value::Pair([a, b, c, d]), [high, low, rest @ ..]) => {
                    (*high, *low) = ([a, b], [c, d]);
                    left = rest;
                    address += 2;
                }
                _ => return self.fail(COUNT_MUST_BE_EVEN),
            }
        }
        Ok(())
    }

    fn write(&mut self, address: u16, words: &[Word], _: &mut Scene, _: f64) -> Result<(), Refusal> {
        let mut address = address;
        let mut left = words;
        while !left.is_empty() {
            let taken = self.set(address, left)?;
            left = &left[taken..];
            address += taken as u16;
        }
        Ok(())
    }

    fn refused_count(&mut self, count: u16) {
        self.last_error = if count > READ_MOST { READ_TOO_LARGE } else { BAD_COUNT };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::testbed::{noisy, pressed, scene};
    use crate::mechanics::lambda;

    fn floats<const N: usize>(daq: &mut LabJackT7, scene: &mut Scene, address: u16) -> [f32; N] {
        let mut words = vec![[0; 2]; 2 * N];
        daq.read(address, &mut words, scene, 1.5).expect("registers");
        std::array::from_fn(|n| {
            f32::from_be_bytes([words[2 * n][0], words[2 * n][1], words[2 * n + 1][0], words[2 * n + 1][1]])
        })
    }

    fn write(daq: &mut LabJackT7, address: u16, words: &[Word]) -> Result<(), Refusal> {
        daq.write(address, words, &mut scene(), 0.0)
    }

    fn float_words(value: f32) -> [Word; 2] {
        let [a, b, c, d] = value.to_be_bytes();
        [[a, b], [c, d]]
    }

    #[test]
    fn the_inputs_are_the_taxels_in_order_and_nothing_after_them() {
        let mut daq = LabJackT7::new(Device::Array);
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
    fn as_a_load_cell_it_has_the_force_on_ain13_in_steps_of_its_range_and_nothing_beyond() {
        let mut daq = LabJackT7::new(Device::LoadCell);
        let step_v = 10.0 / 32768.0;
        let [volts] = floats(&mut daq, &mut pressed(0.9), 26);
        assert!((volts - 0.9).abs() < step_v / 2.0 + 1e-6, "{volts}");
        assert!((volts / step_v - (volts / step_v).round()).abs() < 1e-3, "{volts} is no step");
        let volts: [f32; CHANNELS] = floats(&mut daq, &mut pressed(0.9), 0);
        assert_eq!(volts[..13], [0.0; 13], "the taxels are not on this one");
        assert_eq!(floats::<1>(&mut daq, &mut pressed(12.0), 26), [10.0]);
        assert_eq!(daq.device(), Device::LoadCell);
    }

    #[test]
    fn a_load_cells_conversion_is_spent_only_by_those_who_read_it() {
        let read_after = |others: &[u16]| {
            let mut scene = noisy();
            let mut daq = LabJackT7::new(Device::LoadCell);
            for (address, at_s) in others.iter().zip([0.1, 0.2, 0.3]) {
                daq.read(*address, &mut [[0; 2]; 2], &mut scene, at_s).expect("registers");
            }
            floats::<1>(&mut daq, &mut scene, 26)
        };
        assert_eq!(read_after(&[0, 24, 60000]), read_after(&[]));
        assert_ne!(read_after(&[26]), read_after(&[]));
        let mut daq = LabJackT7::new(Device::LoadCell);
        write(&mut daq, 41012, &[[0, 13]]).expect("a channel");
        let [volts] = floats(&mut daq, &mut pressed(0.5), 24);
        assert!((volts + 0.5).abs() < 1e-3, "AIN12 against AIN13: {volts}");
    }

    #[test]
    fn a_range_a_negative_channel_and_what_they_do() {
        let mut daq = LabJackT7::new(Device::Array);
        write(&mut daq, 40008, &float_words(0.1)).expect("a range");
        let volts: [f32; 10] = floats(&mut daq, &mut pressed(0.5), 0);
        assert_eq!(volts[4], 0.1);
        write(&mut daq, 43900, &float_words(10.0)).expect("a range");
        write(&mut daq, 41004, &[[0, 5]]).expect("a channel");
        let differential: [f32; 10] = floats(&mut daq, &mut pressed(0.5), 0);
        assert!((differential[4] - (0.5 - volts[5])).abs() < 1e-6);
    }

    #[test]
    fn what_a_host_probes_is_what_a_t7_says() {
        let mut daq = LabJackT7::new(Device::Array);
        let mut words = [[0; 2]; 2];
        for (address, bytes) in [
            (55100, [[0x00, 0x11], [0x22, 0x33]]),
            (60000, float_words(7.0)),
            (40000, float_words(10.0)),
            // half the core's clock, after 1.5 s
            (61520, [[0x03, 0x93], [0x87, 0x00]]),
        ] {
            daq.read(address, &mut words, &mut scene(), 1.5).expect("a register");
            assert_eq!(words, bytes, "{address}");
        }
    }

    #[test]
    fn what_it_refuses_stands_in_detail_at_55000() {
        let mut daq = LabJackT7::new(Device::Array);
        let mut odd = [[0; 2]; 3];
        assert_eq!(daq.read(0, &mut odd, &mut scene(), 0.0), Err(Refusal::Value));
        let mut detail = [[0; 2]];
        daq.read(55000, &mut detail, &mut scene(), 0.0).expect("the detail");
        assert_eq!(u16::from_be_bytes(detail[0]), COUNT_MUST_BE_EVEN);
        assert_eq!(write(&mut daq, 40000, &[[0, 0]]), Err(Refusal::Value));
        for (address, words, expected) in [
            (40000, float_words(3.0).to_vec(), BAD_RANGE),
            (41001, vec![[0, 2]], BAD_NEGATIVE_CHANNEL),
            (41500, vec![[0, 9]], BAD_RESOLUTION),
        ] {
            assert_eq!(write(&mut daq, address, &words), Err(Refusal::Value));
            assert_eq!(daq.last_error, expected);
        }
        daq.refused_count(126);
        assert_eq!(daq.last_error, READ_TOO_LARGE);
        daq.refused_count(0);
        assert_eq!(daq.last_error, BAD_COUNT);
        for address in [1, 28, 55101, 65535] {
            assert_eq!(daq.read(address, &mut odd, &mut scene(), 0.0), Err(Refusal::Address), "{address}");
        }
        assert_eq!(write(&mut daq, 0, &float_words(1.0)), Err(Refusal::Address));
    }
}
