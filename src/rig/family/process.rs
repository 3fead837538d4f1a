//! Programs written by the user that use the process protocol (docs/process.md), in any role.

use super::{Family, Links, Role};
use crate::device::DeviceError;
use crate::document::{Problem, Table, keys};
use crate::driver::process::{ProcessArray, ProcessLoadCell, ProcessStage};
use crate::driver::{AnyArray, AnyLoadCell, AnyStage};
use crate::emulator;
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{ArrayDriver, Dial, Driver, LoadCellDriver, RigSpec, StageDriver, Wiring};
use crate::scene::Scene;
use crate::wire::Link;
use std::sync::Arc;

pub const FAMILY: Family = Family {
    name: "process",
    meaning: "your own program that uses the process protocol",
    simulated: "programs in memory that use the protocol",
    stage: Some(Role {
        words: &[],
        keys: driver::KEYS.always,
        links: Links::Program,
        read: |table, _| Some(Arc::new(read(table)?)),
    }),
    load_cell: Some(Role {
        words: &[],
        keys: driver::KEYS.always,
        links: Links::Program,
        read: |table, _| Some(Arc::new(read(table)?)),
    }),
    array: Some(Role {
        words: &[],
        keys: driver::KEYS.always,
        links: Links::Program,
        read: |table, _| Some(Arc::new(read(table)?)),
    }),
};

keys! {
    /// `driver = { process = ... }`
    driver {
        process: Texts, Refused, "command of a program that uses the process protocol, and its arguments",
            "[\"python3\", \"my_daq.py\"]";
    }
}

/// Command and its arguments.
#[derive(Debug)]
struct Program(Vec<String>);

fn read(table: &Table) -> Option<Program> {
    let command: Vec<String> = table.texts(&driver::process)?.into_iter().map(str::to_owned).collect();
    if command.first().is_none_or(String::is_empty) {
        let told = "`process` is the command and its arguments: [\"python3\", \"my_daq.py\"]";
        table.complain(Problem::new(table.span_of(&driver::process), told));
        return None;
    }
    Some(Program(command))
}

impl Driver for Program {
    fn own_link(&self) -> Option<Link> {
        Some(Link::Process(self.0.clone()))
    }
}

impl StageDriver for Program {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        AnyStage::Process(ProcessStage::new(dial(), rig.stage.link.to_string()))
    }

    fn emulated(&self, scene: &Scene, _: &RigSpec) -> EmulatedDevice {
        EmulatedDevice::pipe(emulator::ProcessStage::new(scene), "process")
    }
}

impl LoadCellDriver for Program {
    fn open(&self, dial: Dial, wiring: &Wiring) -> Result<AnyLoadCell, DeviceError> {
        let cell = &wiring.rig.load_cell;
        let driver = ProcessLoadCell::new(dial(), cell.link.to_string(), cell.conversions_hz, wiring.origin);
        Ok(AnyLoadCell::Process(driver))
    }

    fn emulated(&self, _: &RigSpec, _: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError> {
        Ok(EmulatedDevice::pipe(emulator::ProcessLoadCell, "process"))
    }
}

impl ArrayDriver for Program {
    fn open(&self, dial: Dial, wiring: &Wiring) -> Result<AnyArray, DeviceError> {
        let array = &wiring.rig.array;
        Ok(AnyArray::Process(ProcessArray::new(dial(), array.link.to_string(), array.layout.len())))
    }

    fn emulated(&self, _: &RigSpec) -> Result<EmulatedDevice, DeviceError> {
        Ok(EmulatedDevice::pipe(emulator::ProcessArray, "process"))
    }
}
