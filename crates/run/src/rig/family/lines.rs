//! Devices that send lines or frames. A line profile states how a reading looks.

use super::{Beside, DeviceFamily, Links, Role, counted, own_file};
use crate::rig::axes::CellAxes;
use crate::rig::emulated::EmulatedDevice;
use crate::rig::profiled::{ArrayResponse, ProfiledBoard, ProfiledCell, most_n};
use crate::rig::simulated::not_simulated;
use crate::rig::spec::{ArrayDriver, Dial, Driver, LoadCellDriver, Misfit, OwnFile, RigSpec, RigWiring};
use palpate_core::quantity::{ArrayLayout, Range};
use palpate_document::{Bounds, Problem, Table, keys};
use palpate_drivers::lines::{ForceColumns, LineArray, LineLoadCell, LineProfile, SHIPPED};
use palpate_drivers::{AnyArray, AnyLoadCell};
use palpate_link::device::DeviceError;
use palpate_link::wire::Link;
use palpate_sim::emulator::lines::{
    BoardFirmware, Bota, CellScale, Gsv8, Hx711, Hx711Sketch, Mark10, NetFt, OneNumber, ReSkin, STRAIGHT, SerialBoard,
    Velostat,
};
use palpate_sim::scene::SceneDevice;
use std::sync::Arc;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "lines",
    meaning: "any device that sends lines of numbers or frames of bytes, with a line profile",
    simulated: "hx711, mark-10, ati-netft, bota-serial and me-gsv8 as load cells, reskin, mlx90393-text, velostat-16 and one-number as arrays; what any other profile describes",
    stage: None,
    load_cell: Some(Role {
        words: &[],
        keys: load_cell::KEYS.always,
        links: Links::StreamOrDatagrams,
        read: read_load_cell,
    }),
    array: Some(Role { words: &[], keys: array::KEYS.always, links: Links::StreamOrDatagrams, read: read_array }),
};

/// Rate of the emulated magnetometers, 1/s (paper of ReSkin).
const MAGNETOMETERS_HZ: f64 = 400.0;

/// Baud rate of the emulated pressure matrix.
const MATRIX_BAUD: f64 = 115_200.0;

/// Rate of an emulated array that only its profile knows, 1/s: that of many boards.
const OWN_ARRAY_HZ: f64 = 100.0;

const FACTOR: Bounds = Bounds::within(-1e12, 1e12, "");

keys! {
    /// `driver = { lines = ... }` of a load cell.
    load_cell {
        lines: Text, Refused, "a line profile shipped with the program, or a .toml file in the rig's folder", "\"hx711\"";
        newton_per_unit: Number(FACTOR), Allowed, "N per unit of the device; without it, that of the profile", "0.0000025";
        offset: Number(FACTOR), Allowed, "its number without force; without it, that of the profile", "84000.0";
    }
}

keys! {
    /// `driver = { lines = ... }` of an array.
    array {
        lines: Text, Refused, "a line profile shipped with the program, or a .toml file in the rig's folder", "\"reskin\"";
        scale: Number(FACTOR), Allowed, "factor of each output, after the offset; without it, that of the profile", "-1.0";
        offset: Number(FACTOR), Allowed, "what is subtracted from each number; without it, that of the profile", "1023.0";
    }
}

/// A device, its profile, and the profile's origin.
#[derive(Clone, Debug)]
struct Sender {
    file: OwnFile,
    profile: LineProfile,
}

#[derive(Debug)]
struct LineLoadCellSpec(Sender);

#[derive(Debug)]
struct LineArraySpec(Sender);

fn read_load_cell(table: &Table, beside: Beside) -> Option<Arc<dyn LoadCellDriver>> {
    let mut sender = read_profile(table, &load_cell::lines, beside)?;
    let name = sender.file.name.clone();
    let Some(force) = &mut sender.profile.force else {
        let text = format!("the line profile \"{name}\" has no [force], which a load cell needs");
        table.complain(Problem::new(table.span_of(&load_cell::lines), text));
        return None;
    };
    force.newton_per_unit = table.number(&load_cell::newton_per_unit).or(force.newton_per_unit);
    force.offset = table.number(&load_cell::offset).unwrap_or(force.offset);
    if force.newton_per_unit.is_none_or(|factor| factor == 0.0) {
        let problem =
            Problem::new(table.span(), format!("the line profile \"{name}\" doesn't state N per unit of its numbers"));
        let help = "add newton_per_unit to `driver`: weigh a known mass, and divide its weight in N by the change of the number";
        table.complain(problem.help(help));
        return None;
    }
    Some(Arc::new(LineLoadCellSpec(sender)))
}

fn read_array(table: &Table, beside: Beside) -> Option<Arc<dyn ArrayDriver>> {
    let mut sender = read_profile(table, &array::lines, beside)?;
    let Some(outputs) = &mut sender.profile.outputs else {
        let text = format!("the line profile \"{}\" has no [outputs], which an array needs", sender.file.name);
        table.complain(Problem::new(table.span_of(&array::lines), text));
        return None;
    };
    outputs.scale = table.number(&array::scale).unwrap_or(outputs.scale);
    outputs.offset = table.number(&array::offset).unwrap_or(outputs.offset);
    if outputs.scale == 0.0 {
        table.complain(Problem::new(table.span_of(&array::scale), "`scale` is 0, so every output would read 0"));
        return None;
    }
    Some(Arc::new(LineArraySpec(sender)))
}

fn read_profile(table: &Table, key: &palpate_document::Key, beside: Beside) -> Option<Sender> {
    let shipped = SHIPPED.map(|(name, _)| name);
    let (file, profile) =
        own_file(table, key, "line profile", &shipped, LineProfile::shipped, LineProfile::parse, beside)?;
    Some(Sender { file, profile })
}

impl Driver for LineLoadCellSpec {
    fn shares_port(&self) -> bool {
        true
    }

    fn own_file(&self) -> Option<&OwnFile> {
        Some(&self.0.file)
    }

    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        let unpacked = self.0.unpacked(&rig.load_cell.link, SceneDevice::LoadCell);
        unpacked.into_iter().chain(self.differs(rig)).collect()
    }
}

impl LineLoadCellSpec {
    /// Two roles on one link are one device.
    fn differs(&self, rig: &RigSpec) -> Option<Misfit> {
        let LineArraySpec(array) = super::as_a::<LineArraySpec>(&*rig.array.driver)?;
        let is_shared = rig.load_cell.link == rig.array.link && rig.array.link != Link::Sim;
        let differ = is_shared && array.file != self.0.file;
        let text = format!(
            "load cell and array have the same `link`, but the line profiles \"{}\" and \"{}\"",
            self.0.file.name, array.file.name
        );
        let help = Some("one port sends one kind of line: use one profile with [force] and [outputs] for both");
        differ.then_some(Misfit { role: SceneDevice::Array, text, help })
    }
}

impl Driver for LineArraySpec {
    fn shares_port(&self) -> bool {
        true
    }

    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        self.0.unpacked(&rig.array.link, SceneDevice::Array).into_iter().collect()
    }

    fn own_file(&self) -> Option<&OwnFile> {
        Some(&self.0.file)
    }
}

impl LoadCellDriver for LineLoadCellSpec {
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyLoadCell, DeviceError> {
        let cell = &wiring.rig.load_cell;
        let force = self.0.profile.force.clone().ok_or_else(|| super::unfit("load cell", &self.0.file.name))?;
        let port = wiring.line_port(&cell.link, &self.0.profile, dial);
        let (link, hz) = (cell.link.to_string(), cell.conversions_hz);
        let driver = LineLoadCell::new(port, force, link, hz, wiring.origin);
        Ok(AnyLoadCell::Lines(match &cell.axes {
            Some(axes) => driver.mounted(axes.mounting()),
            None => driver,
        }))
    }

    fn has_axes(&self) -> bool {
        self.0.profile.force.as_ref().is_some_and(|force| matches!(force.columns, ForceColumns::Axes(_)))
    }

    fn net_ft_counts(&self) -> Option<f64> {
        let newton_per_unit = self.0.profile.force.as_ref()?.newton_per_unit?;
        (self.0.file.name == "ati-netft").then(|| 1.0 / newton_per_unit)
    }

    fn emulated(&self, rig: &RigSpec, _: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError> {
        let hz = rig.load_cell.conversions_hz;
        let force = self.0.profile.force.as_ref().ok_or_else(|| super::unfit("load cell", &self.0.file.name))?;
        let cell = ProfiledCell::new(rig, self.has_axes(), force.range_n);
        let outputs = self.0.response(rig).filter(|_| rig.is_one_board());
        let own = self.0.profiled(SceneDevice::LoadCell, hz, Some(cell), outputs)?;
        let (range_n, scale) = (most_n(rig), self.0.cell_scale());
        let mounting = rig.load_cell.axes.as_ref().map_or(STRAIGHT, CellAxes::to_device);
        Ok(match self.0.file.name.as_str() {
            "hx711" => board(Hx711::new(Hx711Sketch::Bare, hz).scaled(scale)),
            "mark-10" => board(Mark10::new(range_n).scaled(scale)),
            "ati-netft" => {
                let device = SerialBoard::new(NetFt::new(hz, range_n, mounting).scaled(scale));
                EmulatedDevice::datagrams(device, "rdt")
            }
            "me-gsv8" => board(Gsv8::new(hz, range_n, mounting).scaled(scale)),
            "bota-serial" => board(Bota::new(hz, range_n, mounting).scaled(scale)),
            _ => self.0.offered(own, &rig.load_cell.link),
        })
    }
}

impl ArrayDriver for LineArraySpec {
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyArray, DeviceError> {
        let array = &wiring.rig.array;
        let outputs = self.0.profile.outputs.clone().ok_or_else(|| super::unfit("array", &self.0.file.name))?;
        let port = wiring.line_port(&array.link, &self.0.profile, dial);
        Ok(AnyArray::Lines(LineArray::new(port, outputs, array.link.to_string())))
    }

    fn emulated(&self, rig: &RigSpec) -> Result<EmulatedDevice, DeviceError> {
        let own = self.0.profile.outputs.as_ref();
        let (scale, offset) = own.map_or((1.0, 0.0), |outputs| (outputs.scale, outputs.offset));
        Ok(match self.0.file.name.as_str() {
            "reskin" => board(ReSkin::new(MAGNETOMETERS_HZ).scaled(scale)),
            "mlx90393-text" => board(ReSkin::text(MAGNETOMETERS_HZ).scaled(scale)),
            "velostat-16" => board(Velostat::new(b',', MATRIX_BAUD).scaled(scale)),
            "one-number" => board(OneNumber::new(scale, offset)),
            _ => {
                let own = self.0.profiled(SceneDevice::Array, OWN_ARRAY_HZ, None, self.0.response(rig))?;
                self.0.offered(own, &rig.array.link)
            }
        })
    }

    fn misfit(&self, layout: &ArrayLayout) -> Option<(String, Option<&'static str>)> {
        let columns = self.0.profile.outputs.as_ref().map_or(0, |own| own.columns.len());
        let text = format!("{}, but the line profile \"{}\" has {columns} outputs", counted(layout), self.0.file.name);
        let help = "change the layout, or `columns` of [outputs] in a profile of your own";
        (layout.len() != columns).then_some((text, Some(help)))
    }
}

impl Sender {
    /// Returns what is wrong with the link of a device that sends packets.
    fn unpacked(&self, link: &Link, role: SceneDevice) -> Option<Misfit> {
        let is_stream = matches!(link, Link::Serial { .. } | Link::Tcp { .. });
        let text = format!("the line profile \"{}\" is for packets, but {link} has none", self.file.name);
        let help = Some("use link = \"udp://ADDRESS:PORT\", or a profile without `packet`");
        (is_stream && self.profile.is_packets()).then_some(Misfit { role, text, help })
    }

    /// Returns how the numbers of an array follow its outputs; `None` if the profile has none.
    fn response(&self, rig: &RigSpec) -> Option<ArrayResponse> {
        let outputs = self.profile.outputs.as_ref()?;
        // the narrowest of its columns holds all
        let wholes = outputs.columns.iter().filter_map(|column| self.profile.whole_range(*column));
        let range = wholes
            .chain(outputs.possible)
            .reduce(|range, other| Range { min: range.min.max(other.min), max: range.max.min(other.max) });
        let full_scale_n = rig.full_scale_n.unwrap_or(rig.limits.force_n);
        Some(ArrayResponse::new(outputs.scale, outputs.offset, range, full_scale_n))
    }

    /// Returns the calibration of a load cell, as profile and rig state it.
    fn cell_scale(&self) -> CellScale {
        let own = self.profile.force.as_ref();
        own.map_or(CellScale::NEWTON, |force| CellScale {
            newton_per_unit: force.newton_per_unit.unwrap_or(1.0),
            offset: force.offset,
        })
    }

    /// Returns a board that sends what the profile reads.
    fn profiled(
        &self,
        role: SceneDevice,
        hz: f64,
        cell: Option<ProfiledCell>,
        outputs: Option<ArrayResponse>,
    ) -> Result<ProfiledBoard, DeviceError> {
        let board = ProfiledBoard::new(self.profile.clone(), hz, cell, outputs);
        let checked = board.check().map_err(|why| not_simulated(role, self.file.not_simulated(&why)));
        checked.map(|()| board)
    }

    /// Returns a board of the profile on the kind of link that the rig names.
    fn offered(&self, own: ProfiledBoard, link: &Link) -> EmulatedDevice {
        match link {
            _ if self.profile.is_packets() => EmulatedDevice::datagrams(SerialBoard::new(own), "lines"),
            Link::Tcp { .. } => EmulatedDevice::network(SerialBoard::new(own), "lines"),
            _ => board(own),
        }
    }
}

fn board<F: BoardFirmware + 'static>(firmware: F) -> EmulatedDevice {
    EmulatedDevice::serial(SerialBoard::new(firmware), "lines")
}
