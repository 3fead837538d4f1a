//! A device whose registers are those of a register map.

use super::cell::ProfiledCell;
use super::response::ArrayResponse;
use palpate_core::quantity::Range;
use palpate_drivers::modbus::{Force, Profile};
use palpate_sim::emulator::{Refusal, RegisterBytes, RegisterMap};
use palpate_sim::scene::{Scene, SceneDevice};
use std::collections::BTreeMap;
use std::ops::Range as Span;

/// Most decimals of a whole number whose decimals are in a register: a step of 1 mN for a device in N.
const DECIMALS_MOST: u32 = 3;

/// A device that only its register map knows. Registers without a meaning are 0, and none can be written.
pub(in crate::rig) struct MappedRegisters {
    profile: Profile,
    role: MappedRole,
}

/// What is wired to the device.
pub(in crate::rig) enum MappedRole {
    Cell(ProfiledCell),
    Array(ArrayResponse),
}

impl MappedRegisters {
    /// Creates the registers of a load cell.
    pub(in crate::rig) fn of_cell(profile: Profile, cell: ProfiledCell) -> Self {
        MappedRegisters { profile, role: MappedRole::Cell(cell) }
    }

    /// Creates the registers of an array.
    pub(in crate::rig) fn of_array(profile: Profile, response: ArrayResponse) -> Self {
        MappedRegisters { profile, role: MappedRole::Array(response) }
    }

    /// Checks that its numbers can hold the forces of a run.
    ///
    /// # Errors
    /// What they can't hold, in words.
    pub(in crate::rig) fn check(&self) -> Result<(), String> {
        match (&self.role, &self.profile.force) {
            (MappedRole::Cell(cell), Some(force)) => {
                let decimals = decimals(force, cell);
                cell.check(|force_n| units(force, force_n, decimals), force_range(force))
            }
            _ => Ok(()),
        }
    }

    /// Returns the words of the registers that have a meaning and are among those asked for.
    fn image(&self, asked: &Span<u32>, scene: &mut Scene, now_s: f64) -> BTreeMap<u16, u16> {
        let mut image = BTreeMap::new();
        let mut set = |address: u16, words: &[u16]| {
            for (register, word) in (address..=u16::MAX).zip(words) {
                *image.entry(register).or_insert(0) |= word;
            }
        };
        for probe in &self.profile.probe {
            set(probe.register.address, &probe.register.encoding.encode(probe.value));
        }
        match (&self.role, &self.profile.force, &self.profile.outputs) {
            (MappedRole::Cell(cell), Some(force), _) => {
                let decimals = decimals(force, cell);
                if let Some(register) = &force.decimals {
                    set(register.address, &register.encoding.encode(f64::from(decimals)));
                }
                let (first, count) = force.block();
                let status = self.profile.status.as_ref();
                let is_asked = |address: u16, count: u16| {
                    u32::from(address) < asked.end && u32::from(address) + u32::from(count) > asked.start
                };
                // each reading of the cell draws noise
                if is_asked(first, count) || status.is_some_and(|status| is_asked(status.address, 1)) {
                    let (forces_n, is_beyond) = cell.read(scene, now_s);
                    let encoding = force.register.encoding;
                    for (nth, force_n) in (0..force.count()).zip(forces_n) {
                        let units = units(force, force_n, decimals);
                        let number = if force.sign.is_some() { units.abs() } else { units };
                        // one beyond the last register is none
                        let address = force.register.address.checked_add(nth * encoding.registers());
                        address.into_iter().for_each(|address| set(address, &encoding.encode(number)));
                        if let Some(sign) = force.sign.filter(|_| units < 0.0) {
                            set(sign.address, &[1 << sign.bit]);
                        }
                    }
                    if let Some(status) = status.filter(|_| is_beyond) {
                        set(status.address, &[status.saturated_bits.iter().fold(0, |word, bit| word | 1 << bit)]);
                    }
                }
            }
            (MappedRole::Array(response), _, Some(own)) => {
                let mut outputs = vec![0.0; scene.taxels()];
                scene.outputs(now_s, &mut outputs);
                let encoding = own.register.encoding;
                let words =
                    outputs.iter().flat_map(|output| encoding.encode(response.number(*output, scene.is_monitored())));
                set(own.register.address, &words.collect::<Vec<u16>>());
            }
            _ => {}
        }
        image
    }
}

/// Returns the number of a force, in units of the device.
fn units(force: &Force, force_n: f64, decimals: u32) -> f64 {
    force_n * 10f64.powi(decimals as i32) / force.newton_per_unit + force.offset
}

/// Returns how many decimals the device has: as many as its register and its numbers can hold.
fn decimals(force: &Force, cell: &ProfiledCell) -> u32 {
    let Some(most) = force.decimals.and_then(|register| register.encoding.range()) else { return 0 };
    let fits = |decimals: &u32| {
        let ends = [cell.range_n(), -cell.range_n()].map(|force_n| units(force, force_n, *decimals));
        let are_held = force_range(force).is_none_or(|range| ends.iter().all(|end| range.contains(*end)));
        f64::from(*decimals) <= most.max && are_held
    };
    (0..=DECIMALS_MOST).rev().find(fits).unwrap_or(0)
}

/// Returns the ends of a force's numbers; `None` for floats.
fn force_range(force: &Force) -> Option<Range> {
    let range = force.register.encoding.range()?;
    Some(if force.sign.is_some() { Range { min: -range.max, max: range.max } } else { range })
}

impl RegisterMap for MappedRegisters {
    fn device(&self) -> SceneDevice {
        match self.role {
            MappedRole::Cell(_) => SceneDevice::LoadCell,
            MappedRole::Array(_) => SceneDevice::Array,
        }
    }

    fn read(
        &mut self,
        address: u16,
        words: &mut [RegisterBytes],
        scene: &mut Scene,
        now_s: f64,
    ) -> Result<(), Refusal> {
        let asked = u32::from(address)..u32::from(address) + words.len() as u32;
        if asked.end > u32::from(u16::MAX) + 1 {
            return Err(Refusal::Address);
        }
        let image = self.image(&asked, scene, now_s);
        for (register, word) in (address..=u16::MAX).zip(words) {
            *word = image.get(&register).copied().unwrap_or(0).to_be_bytes();
        }
        Ok(())
    }

    fn write(&mut self, _: u16, _: &[RegisterBytes], _: &mut Scene, _: f64) -> Result<(), Refusal> {
        Err(Refusal::Address)
    }
}

#[cfg(test)]
mod tests {
    use super::super::most_n;
    use super::*;
    use crate::rig::{SIM_RIG, parse};
    use palpate_core::parallel::lock;

    const MAP: &str = "name = \"a\"\ntransport = \"rtu\"\nunit_id = 1\ndeadline_ms = 200\n[force]\naddress = 8\n\
        type = \"u16\"\nnewton_per_unit = 0.1\noffset = 2000.0\ndecimals = { address = 5, mask = 48, shift = 4 }\n\
        sign = { address = 7, bit = 3 }\n[status]\naddress = 7\nsaturated_bits = [1]\n\
        [[probe]]\nwhat = \"model\"\naddress = 2\ntype = \"u16\"\nvalue = 17\n";

    /// The words from 0 to 9, at rest, of a device whose numbers are those of `more`.
    fn words(from: &str, to: &str) -> [u16; 10] {
        let rig = parse("rig.toml", SIM_RIG, &|_| Err(std::io::ErrorKind::NotFound.into())).expect("the shipped rig");
        let profile = Profile::parse("a.toml", &MAP.replace(from, to)).expect("a map");
        let cell = ProfiledCell::new(&rig, false, None);
        assert_eq!(cell.range_n(), most_n(&rig));
        let mut map = MappedRegisters::of_cell(profile, cell);
        let scene = rig.emulators(1).expect("emulators").scene;
        let mut words = [[0; 2]; 10];
        map.read(0, &mut words, &mut lock(&scene), 0.0).expect("registers");
        words.map(u16::from_be_bytes)
    }

    #[test]
    fn registers_have_the_number_its_decimals_its_sign_and_what_proves_the_map() {
        let at_rest = words("", "");
        assert_eq!([at_rest[2], at_rest[5], at_rest[7]], [17, 3 << 4, 0]);
        // 0 N within the noise of the cell, of 0.1 mN each
        assert!((1800..2200).contains(&at_rest[8]), "{at_rest:?}");
        let below = words("offset = 2000.0", "offset = -2000.0");
        assert_eq!(below[7], 1 << 3);
        assert!((1800..2200).contains(&below[8]), "{below:?}");
    }

    #[test]
    fn a_device_has_no_more_decimals_than_its_numbers_hold() {
        assert_eq!(words("newton_per_unit = 0.1", "newton_per_unit = 0.001")[5], 1 << 4);
        assert_eq!(words("mask = 48", "mask = 16")[5], 1 << 4);
    }
}
