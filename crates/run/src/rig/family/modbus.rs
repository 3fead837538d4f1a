//! Modbus transmitters and converters. A register map defines the meaning of registers.

use super::{Beside, DeviceFamily, Links, Role, counted, own_file, unfit};
use crate::rig::axes::CellAxes;
use crate::rig::emulated::EmulatedDevice;
use crate::rig::profiled::{ArrayResponse, MappedRegisters, ProfiledCell, most_n};
use crate::rig::simulated::not_simulated;
use crate::rig::spec::{ArrayDriver, Dial, Driver, LoadCellDriver, Misfit, OwnFile, RigSpec, RigWiring};
use palpate_core::quantity::ArrayLayout;
use palpate_document::{Problem, Table, keys};
use palpate_drivers::modbus::{ModbusArray, ModbusFraming, ModbusLoadCell, Profile, SHIPPED, Transport};
use palpate_drivers::{AnyArray, AnyLoadCell};
use palpate_link::device::DeviceError;
use palpate_link::wire::Link;
use palpate_sim::emulator::lines::STRAIGHT;
use palpate_sim::emulator::{Instrument, LabJackT7, LaumasTlb, Modbus, RobotiqFt300, SenecaZsg, Transmitter};
use palpate_sim::scene::SceneDevice;
use std::sync::Arc;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "modbus",
    meaning: "any Modbus device with a register map",
    simulated: "generic-rs485, laumas-tlb, robotiq-ft300, seneca-zsg and seneca-zsg2 as load cells, labjack-t7 as load cell and array; what any other map describes",
    stage: None,
    load_cell: Some(Role { words: &[], keys: driver::KEYS.always, links: Links::Stream, read: read_load_cell }),
    array: Some(Role { words: &[], keys: driver::KEYS.always, links: Links::Stream, read: read_array }),
};

keys! {
    /// `driver = { modbus = ... }`
    driver {
        modbus: Text, Refused, "a register map shipped with the program, or a .toml file in the rig's folder",
            "\"labjack-t7\"";
    }
}

/// A device, its register map, and the map's origin.
#[derive(Debug)]
struct MappedDevice {
    file: OwnFile,
    profile: Profile,
}

#[derive(Debug)]
struct ModbusLoadCellSpec(MappedDevice);

#[derive(Debug)]
struct ModbusArraySpec(MappedDevice);

fn read_load_cell(table: &Table, beside: Beside) -> Option<Arc<dyn LoadCellDriver>> {
    Some(Arc::new(ModbusLoadCellSpec(read_map(table, "force", |profile| profile.force.is_some(), beside)?)))
}

fn read_array(table: &Table, beside: Beside) -> Option<Arc<dyn ArrayDriver>> {
    Some(Arc::new(ModbusArraySpec(read_map(table, "outputs", |profile| profile.outputs.is_some(), beside)?)))
}

/// Reads `modbus = "NAME"`: a map that is part of the program, or a file in the rig's folder.
fn read_map(table: &Table, part: &str, fits: impl Fn(&Profile) -> bool, beside: Beside) -> Option<MappedDevice> {
    let key = &driver::modbus;
    let shipped = SHIPPED.map(|(name, _)| name);
    let (file, profile) = own_file(table, key, "register map", &shipped, Profile::shipped, Profile::parse, beside)?;
    if !fits(&profile) {
        let help = format!("name another map, or add [{part}]: `palpate reference register-map` lists its keys");
        let text = format!("the register map \"{}\" has no [{part}], which this device needs", file.name);
        table.complain(Problem::new(table.span_of(key), text).help(help));
        return None;
    }
    Some(MappedDevice { file, profile })
}

impl Driver for ModbusLoadCellSpec {
    fn own_file(&self) -> Option<&OwnFile> {
        Some(&self.0.file)
    }

    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        self.0.misfits(SceneDevice::LoadCell, &rig.load_cell.link)
    }
}

impl Driver for ModbusArraySpec {
    /// A server of Modbus TCP answers each connection, and nothing is written to it.
    fn serves_several(&self, link: &Link) -> bool {
        matches!(link, Link::Tcp { .. })
    }

    fn own_file(&self) -> Option<&OwnFile> {
        Some(&self.0.file)
    }

    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        self.0.misfits(SceneDevice::Array, &rig.array.link)
    }
}

impl LoadCellDriver for ModbusLoadCellSpec {
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyLoadCell, DeviceError> {
        let cell = &wiring.rig.load_cell;
        let (link, hz, profile) = (cell.link.to_string(), cell.conversions_hz, self.0.profile.clone());
        let driver = ModbusLoadCell::new(dial.link(), self.0.framing(&cell.link), profile, &link, hz, wiring.origin);
        let driver = driver.ok_or_else(|| unfit("load cell", &self.0.file.name))?;
        Ok(AnyLoadCell::Modbus(match &cell.axes {
            Some(axes) => driver.mounted(axes.mounting()),
            None => driver,
        }))
    }

    fn has_axes(&self) -> bool {
        self.0.profile.force.as_ref().is_some_and(|force| force.axes)
    }

    fn emulated(&self, rig: &RigSpec, _: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError> {
        let (range_n, unit_id) = (most_n(rig), self.0.profile.unit_id);
        Ok(match self.0.file.name.as_str() {
            "generic-rs485" => rtu(Modbus::rtu(Transmitter::new(range_n), unit_id)),
            "laumas-tlb" => rtu(Modbus::rtu(LaumasTlb::new(range_n), unit_id)),
            "robotiq-ft300" => {
                let mounting = rig.load_cell.axes.as_ref().map_or(STRAIGHT, CellAxes::to_device);
                rtu(Modbus::rtu(RobotiqFt300::new(mounting), unit_id))
            }
            "seneca-zsg" => rtu(Modbus::rtu(SenecaZsg::zsg(range_n), unit_id)),
            "seneca-zsg2" => rtu(Modbus::rtu(SenecaZsg::zsg2(range_n), unit_id)),
            "labjack-t7" => tcp(Modbus::tcp(LabJackT7::new(SceneDevice::LoadCell))),
            _ => {
                let own_range_n = self.0.profile.force.as_ref().and_then(|force| force.range_n);
                let cell = ProfiledCell::new(rig, self.has_axes(), own_range_n);
                self.0.mapped(SceneDevice::LoadCell, MappedRegisters::of_cell(self.0.profile.clone(), cell))?
            }
        })
    }
}

impl ArrayDriver for ModbusArraySpec {
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyArray, DeviceError> {
        let array = &wiring.rig.array;
        let (link, units, profile) = (array.link.to_string(), array.layout.len(), self.0.profile.clone());
        let driver = ModbusArray::new(dial.link(), self.0.framing(&array.link), profile, &link, units);
        Ok(AnyArray::Modbus(driver.ok_or_else(|| unfit("array", &self.0.file.name))?))
    }

    fn emulated(&self, rig: &RigSpec) -> Result<EmulatedDevice, DeviceError> {
        if self.0.file.name == "labjack-t7" {
            return Ok(tcp(Modbus::tcp(LabJackT7::new(SceneDevice::Array))));
        }
        let range = self.0.profile.outputs.as_ref().and_then(|outputs| outputs.register.encoding.range());
        let response = ArrayResponse::new(1.0, 0.0, range, rig.full_scale_n.unwrap_or(rig.limits.force_n));
        self.0.mapped(SceneDevice::Array, MappedRegisters::of_array(self.0.profile.clone(), response))
    }

    fn misfit(&self, layout: &ArrayLayout) -> Option<(String, Option<&'static str>)> {
        let Profile { name, outputs: own, .. } = &self.0.profile;
        let most = own.as_ref().map_or(0, |own| own.count_max);
        let text = format!("{}, but {name} has {most} outputs", counted(layout));
        let help = "a register map of your own can have more, and so can { process = [...] }: `palpate init --from magnetic` writes such \
                    a rig";
        (layout.len() > most).then_some((text, Some(help)))
    }
}

impl MappedDevice {
    fn framing(&self, link: &Link) -> ModbusFraming {
        ModbusFraming::of(link, self.profile.transport)
    }

    /// Returns the reason why the device can't be on a link: one that speaks Modbus TCP only has no RTU on a serial port.
    fn misfits(&self, role: SceneDevice, link: &Link) -> Vec<Misfit> {
        if self.profile.transport == Transport::Rtu || !matches!(link, Link::Serial { .. }) {
            return Vec::new();
        }
        let text = format!("{} speaks Modbus over TCP only, but its link is the serial port {link}", self.profile.name);
        let help = "connect it through Ethernet or WiFi and use link = \"tcp://ADDRESS:502\". The USB port of a LabJack has a \
                    protocol of its own, which isn't Modbus. A device of your own that speaks RTU needs transport = \"rtu\" \
                    in its map";
        vec![Misfit { role, text, help: Some(help) }]
    }

    /// Returns a device with the registers of the map.
    fn mapped(&self, role: SceneDevice, map: MappedRegisters) -> Result<EmulatedDevice, DeviceError> {
        map.check().map_err(|why| not_simulated(role, self.file.not_simulated(&why)))?;
        Ok(match self.profile.transport {
            Transport::Rtu => rtu(Modbus::rtu(map, self.profile.unit_id)),
            Transport::Tcp => tcp(Modbus::tcp(map)),
        })
    }
}

fn rtu<I: Instrument + 'static>(instrument: I) -> EmulatedDevice {
    EmulatedDevice::serial(instrument, "modbus-rtu")
}

fn tcp<I: Instrument + 'static>(instrument: I) -> EmulatedDevice {
    EmulatedDevice::network(instrument, "modbus-tcp")
}
