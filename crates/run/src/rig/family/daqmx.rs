//! Inputs of NI devices, by NI's DAQmx library: one as a load cell, several as an array.

use super::{
    Beside, DeviceFamily, Links, NEWTON_PER_VOLT, NEWTON_PER_VOLT_MEANS, Role, as_a, counted, read_newton_per_volt,
};
use crate::rig::emulated::{EmulatedDevice, FarEnd};
use crate::rig::spec::{ArrayDriver, Dial, Driver, LoadCellDriver, Misfit, RigSpec, RigWiring};
use palpate_core::quantity::ArrayLayout;
use palpate_document::{Problem, Table, keys, words};
use palpate_drivers::daqmx::{Acquisition, DaqmxArray, DaqmxLoadCell, Inputs, SharedAcquisition, Terminal};
use palpate_drivers::{AnyArray, AnyLoadCell};
use palpate_link::device::{self, DeviceError, Identity};
use palpate_link::time::Instant;
use palpate_link::wire::daqmx::{DaqmxLibrary, Functions, NiDaqmx};
use palpate_link::wire::{ClaimError, Claims, Link};
use palpate_sim::emulator::{DaqmxEmulator, Shared};
use palpate_sim::scene::{Scene, SceneDevice};
use std::sync::Arc;
use tokio::sync::Mutex;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "daqmx",
    meaning: "inputs of an NI device, read through NI's library",
    simulated: "a USB-6343, within a simulated run",
    stage: None,
    load_cell: Some(Role { words: &[], keys: load_cell::KEYS.always, links: Links::Daqmx, read: read_load_cell }),
    array: Some(Role { words: &[], keys: array::KEYS.always, links: Links::Daqmx, read: read_array }),
};

const TERMINALS: [(&str, Terminal); 4] =
    [("diff", Terminal::Diff), ("rse", Terminal::Rse), ("nrse", Terminal::Nrse), ("pseudo-diff", Terminal::PseudoDiff)];

/// Largest number of inputs of one device that a rig may name.
const INPUTS_MAX: usize = 512;

keys! {
    /// `driver = { daqmx = ... }` of an array.
    array {
        daqmx: Text, Refused, "inputs of an NI device, in the order of the units", "\"Dev1/ai1:9\"";
        terminal: Word(&words(&TERMINALS)), or_word("rse"), "how they are wired", "\"diff\"";
        range_v: Number(above(0.0, 10.0, "V")), or(10.0), "their measuring range, + and -", "10.0";
    }
}

keys! {
    /// `driver = { daqmx = ... }` of a load cell: one input.
    load_cell {
        newton_per_volt: Number(NEWTON_PER_VOLT), Refused, NEWTON_PER_VOLT_MEANS, "1.0";
    }
    as array { daqmx, terminal, range_v }
}

#[derive(Debug)]
struct DaqmxLoadCellSpec {
    inputs: Inputs,
    newton_per_volt: f64,
}

#[derive(Debug)]
struct DaqmxArraySpec(Inputs);

fn read_load_cell(table: &Table, _: Beside) -> Option<Arc<dyn LoadCellDriver>> {
    let inputs = read_inputs(table);
    let newton_per_volt = read_newton_per_volt(table, &load_cell::newton_per_volt);
    if inputs.as_ref().is_some_and(|inputs| inputs.count != 1) {
        table.complain(Problem::new(table.span_of(&load_cell::daqmx), "a load cell is on one input"));
    }
    Some(Arc::new(DaqmxLoadCellSpec { inputs: inputs?, newton_per_volt: newton_per_volt? }))
}

fn read_array(table: &Table, _: Beside) -> Option<Arc<dyn ArrayDriver>> {
    Some(Arc::new(DaqmxArraySpec(read_inputs(table)?)))
}

impl Driver for DaqmxLoadCellSpec {
    fn claim(&self, link: &Link, claims: &mut Claims) -> Result<(), ClaimError> {
        claim(&self.inputs, link, claims)
    }
}

impl LoadCellDriver for DaqmxLoadCellSpec {
    fn open(&self, _: Dial, wiring: &RigWiring) -> Result<AnyLoadCell, DeviceError> {
        let cell = &wiring.rig.load_cell;
        let identity = identity("load_cell", &self.inputs, wiring.rig, &cell.link);
        let (at, range_v, hz) = (0, self.inputs.range_v, cell.conversions_hz);
        let acquisition = acquisition(wiring)?;
        let driver = DaqmxLoadCell::new(acquisition, at, self.newton_per_volt, range_v, hz, wiring.origin, identity);
        Ok(AnyLoadCell::Daqmx(driver))
    }

    fn emulated(&self, _: &RigSpec, _: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError> {
        Ok(LIBRARY)
    }
}

impl Driver for DaqmxArraySpec {
    fn claim(&self, link: &Link, claims: &mut Claims) -> Result<(), ClaimError> {
        claim(&self.0, link, claims)
    }

    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        if cell_of(rig).is_none() || rig.load_cell.link == rig.array.link {
            return Vec::new();
        }
        let text = "load cell and array are on NI inputs, but over different links".to_owned();
        vec![Misfit { role: SceneDevice::Array, text, help: Some("one task samples both: use the same link for both") }]
    }
}

impl ArrayDriver for DaqmxArraySpec {
    fn open(&self, _: Dial, wiring: &RigWiring) -> Result<AnyArray, DeviceError> {
        let array = &wiring.rig.array;
        let identity = identity("array", &self.0, wiring.rig, &array.link);
        // behind the load cell, where that is in the same task
        let at = usize::from(cell_of(wiring.rig).is_some());
        Ok(AnyArray::Daqmx(DaqmxArray::new(acquisition(wiring)?, at, array.layout.len(), identity)))
    }

    fn emulated(&self, _: &RigSpec) -> Result<EmulatedDevice, DeviceError> {
        Ok(LIBRARY)
    }

    fn misfit(&self, layout: &ArrayLayout) -> Option<(String, Option<&'static str>)> {
        let Inputs { physical, count, .. } = &self.0;
        let text = || format!("{}, but \"{physical}\" is {count} inputs", counted(layout));
        (layout.len() != *count).then(|| (text(), None))
    }

    fn range_v(&self) -> Option<f64> {
        Some(self.0.range_v)
    }
}

const LIBRARY: EmulatedDevice = EmulatedDevice { far_end: FarEnd::Library, protocol: "daqmx" };

/// Returns the load cell if it is on an NI device.
fn cell_of(rig: &RigSpec) -> Option<&DaqmxLoadCellSpec> {
    as_a(&*rig.load_cell.driver)
}

fn array_of(rig: &RigSpec) -> Option<&DaqmxArraySpec> {
    as_a(&*rig.array.driver)
}

fn claim(inputs: &Inputs, link: &Link, claims: &mut Claims) -> Result<(), ClaimError> {
    match link {
        Link::Daqmx(_) => claims.take_ni(&inputs.physical),
        _ => claims.take(link),
    }
}

fn identity(role: &str, inputs: &Inputs, rig: &RigSpec, link: &Link) -> Identity {
    let identity = format!("NI-DAQmx {} at {} Hz", inputs.physical, rig.load_cell.conversions_hz);
    Identity { role: role.to_owned(), identity, link: link.to_string(), warnings: Vec::new() }
}

/// Returns the task for all NI inputs of the rig, the load cell's first. The first role that needs the task creates it.
fn acquisition(wiring: &RigWiring) -> Result<SharedAcquisition, DeviceError> {
    if let Some(made) = wiring.acquisition.get() {
        return Ok(made.clone());
    }
    let rig = wiring.rig;
    let functions = match &wiring.scene {
        Some(scene) => Functions::Here(emulated_library(rig, scene, wiring.origin)),
        None => library(rig)?,
    };
    let (cell, array) = (cell_of(rig).map(|cell| &cell.inputs), array_of(rig).map(|array| &array.0));
    let link = if cell.is_some() { &rig.load_cell.link } else { &rig.array.link };
    let inputs = cell.into_iter().chain(array).cloned().collect();
    let acquisition = Acquisition::new(functions, inputs, rig.load_cell.conversions_hz, link.to_string());
    Ok(wiring.acquisition.get_or_init(|| Arc::new(Mutex::new(acquisition))).clone())
}

/// Loads NI's library.
fn library(rig: &RigSpec) -> Result<Functions, DeviceError> {
    let path = match (&rig.load_cell.link, &rig.array.link) {
        (Link::Daqmx(path), _) | (_, Link::Daqmx(path)) => path.as_deref(),
        _ => None,
    };
    let failed = |text: String| DeviceError {
        device: "NI device".to_owned(),
        doing: "loading NI's library".to_owned(),
        problem: device::DeviceProblem::Link(text),
    };
    let library = DaqmxLibrary::load(path).map_err(|error| failed(error.to_string()))?;
    let functions = Functions::on_a_thread(Arc::new(library));
    functions.map_err(|error| failed(format!("can't start a thread: {error}")))
}

/// Returns NI's functions for a scene. The channels that the rig's drivers name carry the expected signals.
fn emulated_library(rig: &RigSpec, scene: &Shared<Scene>, origin: Instant) -> Arc<dyn NiDaqmx> {
    let (mut device, mut cell, mut first, mut volts_per_newton) = ("Dev1", None, 0, 1.0);
    if let Some(array) = array_of(rig) {
        (device, first) = first_input(&array.0.physical);
    }
    if let Some(DaqmxLoadCellSpec { inputs, newton_per_volt }) = cell_of(rig) {
        let (name, channel) = first_input(&inputs.physical);
        (device, cell, volts_per_newton) = (name, Some(channel), 1.0 / newton_per_volt);
    }
    Arc::new(DaqmxEmulator::new(scene.clone(), origin, device, cell, first, volts_per_newton))
}

/// Returns the device and the number of the first input of `Dev1/ai1:9`.
fn first_input(physical: &str) -> (&str, u32) {
    let (device, inputs) = physical.split_once('/').unwrap_or((physical, ""));
    let digits: String = inputs.chars().skip_while(|c| !c.is_ascii_digit()).take_while(char::is_ascii_digit).collect();
    (device, digits.parse().unwrap_or(0))
}

/// Reads `daqmx = "Dev1/ai0:8"` with the inputs' wiring and measurement.
fn read_inputs(table: &Table) -> Option<Inputs> {
    let physical = table.text(&array::daqmx)?;
    let terminal = table.word(&array::terminal, &TERMINALS);
    let range_v = table.number(&array::range_v);
    let count =
        physical.split(',').map(inputs_in).sum::<Option<usize>>().filter(|count| (1..=INPUTS_MAX).contains(count));
    let Some(count) = count else {
        let words = format!("`daqmx` is \"{physical}\", expected inputs such as \"Dev1/ai0\" or \"Dev1/ai1:9\"");
        table.complain(Problem::new(table.span_of(&array::daqmx), words));
        return None;
    };
    Some(Inputs { physical: physical.to_owned(), count, terminal: terminal?, range_v: range_v? })
}

/// Returns the number of inputs in `Dev1/ai1:9`.
fn inputs_in(physical: &str) -> Option<usize> {
    let (device, inputs) = physical.trim().split_once('/')?;
    let (first, last) = inputs.strip_prefix("ai").map(|range| range.split_once(':').unwrap_or((range, range)))?;
    let (first, last): (usize, usize) = (first.parse().ok()?, last.trim_start_matches("ai").parse().ok()?);
    if device.is_empty() || first.max(last) >= INPUTS_MAX { None } else { Some(first.abs_diff(last) + 1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_counted_as_daqmx_writes_them() {
        for (physical, count) in [
            ("Dev1/ai0", Some(1)),
            ("Dev1/ai1:9", Some(9)),
            ("Dev1/ai9:ai1", Some(9)),
            ("ai0", None),
            ("Dev1/ao0", None),
            ("Dev1/ai0:", None),
            ("Dev1/ai4000000000", None),
        ] {
            assert_eq!(inputs_in(physical), count, "{physical}");
        }
    }
}
