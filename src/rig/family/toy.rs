//! A toy array on a serial line.

use super::{ArrayDriver, Driver, Family, Links, Role};
use crate::device::DeviceError;
use crate::driver::{AnyArray, Toy};
use crate::emulator;
use crate::rig::open::{Dial, Wiring};
use crate::rig::{EmulatedDevice, RigSpec};
use std::sync::Arc;

pub const FAMILY: Family = Family {
    name: "toy",
    meaning: "a toy array",
    simulated: "the toy itself",
    stage: None,
    load_cell: None,
    array: Some(Role { words: &["toy"], keys: &[], links: Links::Stream, read: |_, _| Some(Arc::new(Array)) }),
};

#[derive(Debug)]
struct Array;

impl Driver for Array {}

impl ArrayDriver for Array {
    fn open(&self, dial: Dial, wiring: &Wiring) -> Result<AnyArray, DeviceError> {
        let array = &wiring.rig.array;
        Ok(AnyArray::Toy(Toy::new(dial(), array.link.to_string(), array.layout.len())))
    }

    fn emulated(&self, _: &RigSpec) -> Result<EmulatedDevice, DeviceError> {
        Ok(EmulatedDevice::serial(emulator::Toy, "toy"))
    }
}
