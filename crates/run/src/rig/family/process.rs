//! Programs written by the user that use the process protocol (docs/reference/process.md), in any role.

use super::{DeviceFamily, Links, Role};
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{
    ArrayDriver, Dial, Driver, HomeSide, LoadCellDriver, RigSpec, RigWiring, StageDriver, StageSpec, outside_stock,
};
use palpate_core::quantity::{StageAbilities, seconds};
use palpate_document::{Bounds, Problem, Table, keys};
use palpate_drivers::process::{ProcessArray, ProcessLoadCell, ProcessStage};
use palpate_drivers::{AnyArray, AnyLoadCell, AnyStage};
use palpate_link::device::DeviceError;
use palpate_link::wire::{ClaimError, Claims, Link};
use palpate_sim::emulator;
use palpate_sim::scene::Scene;
use std::sync::Arc;
use std::time::Duration;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "process",
    meaning: "your own program that uses the process protocol",
    simulated: "programs in memory that use the protocol",
    stage: Some(Role {
        words: &[],
        keys: stage::KEYS.always,
        links: Links::Program,
        read: |table, _| {
            let (program, finishes, late_ms) =
                (read(table), table.flag(&stage::finishes), table.number(&stage::late_ms));
            let (program, late_s) = (program?, late_ms? / 1000.0);
            Some(Arc::new(UserStage { program, abilities: abilities(finishes?, late_s) }))
        },
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
    /// `driver = { process = ... }` of a stage
    stage {
        process: Texts, Refused, "command of a program that uses the process protocol, and its arguments",
            "[\"python3\", \"my_daq.py\"]";
        start_s: Number(START), or(START_S), "longest time until the started program answers `identify`", "30.0";
        finishes: Flag, or_flag(false),
            "whether the stage finishes each motion that it was sent, as an arm does; no motion then needs a stop", "true";
        late_ms: Number(LATE), or(0.0), "how late a motion begins", "100.0";
    }
}

keys! {
    /// `driver = { process = ... }` of a load cell or an array
    driver {}
    as stage { process, start_s }
}

/// Default of `start_s`, s: an interpreter that loads a large library needs several seconds.
const START_S: f64 = 10.0;
const START: Bounds = Bounds::above(0.0, 600.0, "s");
const LATE: Bounds = Bounds::within(0.0, 2000.0, "ms");

/// A program of the user.
#[derive(Debug)]
struct UserProgram {
    /// Command and its arguments.
    command: Vec<String>,
    /// Longest time until it answers `identify`.
    start: Duration,
}

fn read(table: &Table) -> Option<UserProgram> {
    let command: Vec<String> = table.texts(&driver::process)?.into_iter().map(str::to_owned).collect();
    if command.first().is_none_or(String::is_empty) {
        let text = "`process` is the command and its arguments: [\"python3\", \"my_daq.py\"]";
        table.complain(Problem::new(table.span_of(&driver::process), text));
        return None;
    }
    Some(UserProgram { command, start: seconds(table.number(&driver::start_s)?) })
}

impl Driver for UserProgram {
    fn own_link(&self) -> Option<Link> {
        Some(Link::Process(self.command.clone()))
    }
}

/// A stage behind a program of the user.
#[derive(Debug)]
struct UserStage {
    program: UserProgram,
    abilities: StageAbilities,
}

fn abilities(finishes: bool, late_s: f64) -> StageAbilities {
    let abilities = if finishes { StageAbilities::FINISHES } else { StageAbilities::FULL };
    StageAbilities { late_s, ..abilities }
}

impl Driver for UserStage {
    fn own_link(&self) -> Option<Link> {
        self.program.own_link()
    }

    fn claim(&self, link: &Link, claims: &mut Claims) -> Result<(), ClaimError> {
        match link {
            // two palpates with this command would move one stage; a cell or an array is only read
            Link::Process(command) => claims.take_program(command),
            _ => claims.take(link),
        }
    }
}

impl StageDriver for UserStage {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        AnyStage::Process(ProcessStage::new(dial.link(), rig.stage.link.to_string(), self.program.start))
    }

    fn abilities(&self) -> StageAbilities {
        self.abilities
    }

    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice {
        let StageSpec { steps, travel, .. } = rig.stage;
        // nobody takes a simulated specimen away for a search toward it
        let homed = rig.stage.home_side == HomeSide::Toward;
        let stage = match steps.is_fine() && !homed {
            true => emulator::ProcessStageEmulator::new(scene),
            false => {
                let printer = emulator::Printer { ends_mm: travel.axes, steps, homed };
                emulator::ProcessStageEmulator::printer(scene, printer)
            }
        };
        EmulatedDevice::pipe(stage, "process")
    }

    fn homes_toward(&self) -> bool {
        true
    }

    fn simulated_misfit(&self, rig: &RigSpec) -> Option<String> {
        // the emulator of a printer has the travel of its rig
        let is_printer = !rig.stage.steps.is_fine() || rig.stage.home_side == HomeSide::Toward;
        if is_printer { None } else { outside_stock(rig) }
    }
}

impl LoadCellDriver for UserProgram {
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyLoadCell, DeviceError> {
        let cell = &wiring.rig.load_cell;
        let driver =
            ProcessLoadCell::new(dial.link(), cell.link.to_string(), self.start, cell.conversions_hz, wiring.origin);
        Ok(AnyLoadCell::Process(driver))
    }

    fn emulated(&self, _: &RigSpec, _: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError> {
        Ok(EmulatedDevice::pipe(emulator::ProcessLoadCellEmulator, "process"))
    }
}

impl ArrayDriver for UserProgram {
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyArray, DeviceError> {
        let array = &wiring.rig.array;
        Ok(AnyArray::Process(ProcessArray::new(dial.link(), array.link.to_string(), self.start, array.layout.len())))
    }

    fn emulated(&self, _: &RigSpec) -> Result<EmulatedDevice, DeviceError> {
        Ok(EmulatedDevice::pipe(emulator::ProcessArrayEmulator, "process"))
    }
}
