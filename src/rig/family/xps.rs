//! Newport XPS: a group of three positioners as a stage, and an analog input of the same controller as a load cell.

use super::{Beside, Family, Links, NEWTON_PER_VOLT, NEWTON_PER_VOLT_MEANS, Role, as_a, read_newton_per_volt};
use crate::device::DeviceError;
use crate::document::{Problem, Table, keys};
use crate::driver::xps::{Group, Guard, Xps, XpsAnalog};
use crate::driver::{AnyLoadCell, AnyStage};
use crate::emulator;
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, LoadCellDriver, Misfit, RigSpec, StageDriver, Wiring};
use crate::scene::{Device, Scene};
use std::sync::Arc;

pub const FAMILY: Family = Family {
    name: "xps",
    meaning: "Newport XPS: a group of three positioners, an analog input",
    simulated: "an XPS-Q8 with three VP-25XL axes, an input, a guard",
    stage: Some(Role { words: &[], keys: stage::KEYS.always, links: Links::Stream, read: read_stage }),
    load_cell: Some(Role { words: &[], keys: load_cell::KEYS.always, links: Links::Stream, read: read_load_cell }),
    array: None,
};

/// Position of the axes after their search for home (VP-25XL: its switch is in the middle), mm.
const HOME_MM: f64 = 0.0;

keys! {
    /// `driver = { xps = ... }` of a stage.
    stage {
        xps: Text, Refused, "the XPS' group of three positioners", "\"XYZ\"";
        positioners: Texts, or_texts(&["X", "Y", "Z"]), "its positioners of x, y and z, in this order", "[\"X\", \"Y\", \"Z\"]";
        home_search: Flag, or_flag(false), "whether palpate may home the group; its way must be clear of the specimen",
            "true";
        guard: Flag, or_flag(false), "whether the controller also stops a motion at the force limit", "true";
    }
}

keys! {
    /// `driver = { xps = ... }` of a load cell.
    load_cell {
        xps: Text, Refused, "the analog input", "\"GPIO2.ADC1\"";
        newton_per_volt: Number(NEWTON_PER_VOLT), Refused, NEWTON_PER_VOLT_MEANS, "1.0";
    }
}

#[derive(Debug)]
struct Stage {
    group: Group,
    /// Whether the controller itself must end a motion at the force limit.
    guard: bool,
}

#[derive(Debug)]
struct LoadCell(Guard);

fn read_stage(table: &Table, _: Beside) -> Option<Arc<dyn StageDriver>> {
    let name = table.text(&stage::xps).map(str::to_owned);
    let positioners = table.texts(&stage::positioners).and_then(|names| {
        let three = names.into_iter().map(str::to_owned).collect::<Vec<_>>().try_into().ok();
        if three.is_none() {
            let told = "`positioners` names its positioners of x, y and z, in this order";
            table.complain(Problem::new(table.span_of(&stage::positioners), told));
        }
        three
    });
    let (home_search, guard) = (table.flag(&stage::home_search), table.flag(&stage::guard));
    let group = Group { name: name?, positioners: positioners?, home_search: home_search? };
    Some(Arc::new(Stage { group, guard: guard? }))
}

fn read_load_cell(table: &Table, _: Beside) -> Option<Arc<dyn LoadCellDriver>> {
    let input = table.text(&load_cell::xps).map(str::to_owned);
    let newton_per_volt = read_newton_per_volt(table, &load_cell::newton_per_volt);
    Some(Arc::new(LoadCell(Guard { input: input?, newton_per_volt: newton_per_volt? })))
}

/// Returns the load cell if it is on an XPS.
fn cell_of(rig: &RigSpec) -> Option<&LoadCell> {
    as_a(&*rig.load_cell.driver)
}

impl Driver for Stage {
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        let misfit = |told: &str, help| Misfit { role: Device::Stage, told: told.to_owned(), help: Some(help) };
        let mut misfits = Vec::new();
        if self.group.home_search && rig.frame.z_from_stage(HOME_MM) > rig.clear_mm() {
            misfits.push(misfit(
                "`home_search` moves z to 0, the middle of its travel, which isn't clear of the specimen",
                "mount the specimen so that `surface_mm` is beyond 0, or home the group by hand, without the specimen",
            ));
        }
        if self.guard && cell_of(rig).is_none() {
            misfits.push(misfit(
                "`guard` requires a load cell on one of the XPS's inputs",
                "remove `guard`, or also wire the cell to GPIO2",
            ));
        }
        misfits
    }
}

impl StageDriver for Stage {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        let guard = cell_of(rig).filter(|_| self.guard).map(|cell| cell.0.clone());
        let sockets = [dial(), dial(), dial()];
        AnyStage::Xps(Box::new(Xps::new(sockets, rig.stage.link.to_string(), self.group.clone(), guard)))
    }

    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice {
        let volts_per_newton = cell_of(rig).map_or(1.0, |cell| 1.0 / cell.0.newton_per_volt);
        let positioners = self.group.positioners.each_ref().map(String::as_str);
        EmulatedDevice::network(emulator::Xps::new(scene, &self.group.name, positioners, volts_per_newton), "xps")
    }
}

impl Driver for LoadCell {
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        if as_a::<Stage>(&*rig.stage.driver).is_some() && rig.stage.link == rig.load_cell.link {
            return Vec::new();
        }
        let told = "the load cell is on another XPS than the stage".to_owned();
        vec![Misfit { role: Device::LoadCell, told, help: Some("use the same link and an xps driver for both") }]
    }
}

impl LoadCellDriver for LoadCell {
    fn open(&self, dial: Dial, wiring: &Wiring) -> Result<AnyLoadCell, DeviceError> {
        let Guard { input, newton_per_volt } = &self.0;
        let cell = &wiring.rig.load_cell;
        let (link, hz) = (cell.link.to_string(), cell.conversions_hz);
        Ok(AnyLoadCell::Xps(XpsAnalog::new(dial(), link, input, *newton_per_volt, hz, wiring.origin)))
    }

    /// Returns another socket of the stage's own controller.
    fn emulated(&self, _: &RigSpec, stage: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError> {
        Ok(stage.clone())
    }
}
