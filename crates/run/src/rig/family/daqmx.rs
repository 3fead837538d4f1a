//! Inputs of NI devices, by NI's DAQmx library: one as a load cell, several as an array.

use super::{Beside, DeviceFamily, Links, NEWTON_PER_VOLT, Role, as_a, counted, read_newton_per_volt};
use crate::rig::axes::{CellAxes, check_directions, products, read_serial};
use crate::rig::emulated::{EmulatedDevice, FarEnd};
use crate::rig::spec::{ArrayDriver, Dial, Driver, LoadCellDriver, Misfit, RigSpec, RigWiring};
use palpate_core::algebra::Matrix;
use palpate_core::quantity::ArrayLayout;
use palpate_document::{Problem, Table, keys, words};
use palpate_drivers::daqmx::{
    Acquisition, DaqmxArray, DaqmxLoadCell, Inputs, Sensitivity, SharedAcquisition, Terminal,
};
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
    /// `driver = { daqmx = ... }` of a load cell: one input, or the inputs of a cell with three axes.
    load_cell {
        newton_per_volt: Either(&[Number(NEWTON_PER_VOLT), Rows(NEWTON_PER_VOLT)]), Refused,
            "N per volt; negative if a push gives a negative voltage. Of a cell with three axes, the matrix from its calibration: one row \
             each for its forces along its x, y and z, one number per input; in a .cal file of ATI the `UserAxis` Fx, Fy and Fz; requires \
             `serial`", "1.0";
        serial: Text, Allowed, "serial number of the cell that a matrix belongs to, 1 to 64 characters", "\"FT12345\"";
    }
    as array { daqmx, terminal, range_v }
}

#[derive(Debug)]
struct DaqmxLoadCellSpec {
    inputs: Inputs,
    newton_per_volt: NewtonPerVolt,
}

/// `newton_per_volt` of a load cell.
#[derive(Debug)]
enum NewtonPerVolt {
    Number(f64),
    Matrix(BridgeMatrix),
}

/// Matrix of a cell with three axes.
#[derive(Debug)]
struct BridgeMatrix {
    /// Rows for the forces along its x, y and z, N per volt of each input.
    rows: [Vec<f64>; 3],
    /// Serial number of the cell that it belongs to.
    serial: String,
}

#[derive(Debug)]
struct DaqmxArraySpec(Inputs);

fn read_load_cell(table: &Table, _: Beside) -> Option<Arc<dyn LoadCellDriver>> {
    let inputs = read_inputs(table);
    let newton_per_volt = read_sensitivity(table, inputs.as_ref());
    Some(Arc::new(DaqmxLoadCellSpec { inputs: inputs?, newton_per_volt: newton_per_volt? }))
}

fn read_sensitivity(table: &Table, inputs: Option<&Inputs>) -> Option<NewtonPerVolt> {
    let (key, what) = (&load_cell::newton_per_volt, "a matrix in `newton_per_volt`");
    let is_matrix = table.is_list(key);
    let serial = read_serial(table, what, key, is_matrix, &load_cell::serial);
    if !is_matrix {
        let newton_per_volt = read_newton_per_volt(table, key);
        if inputs.is_some_and(|inputs| inputs.count != 1) {
            let problem = Problem::new(table.span_of(&load_cell::daqmx), "a load cell is on one input");
            table.complain(problem.help("a cell on more inputs has three axes: give its matrix as `newton_per_volt`"));
        }
        serial?;
        return Some(NewtonPerVolt::Number(newton_per_volt?));
    }
    let rows = table.rows(key)?;
    if let Some(Inputs { physical, count, .. }) = inputs.filter(|inputs| inputs.count != rows[0].len()) {
        let text = format!("{what} has rows of {}, but \"{physical}\" is {count} inputs", rows[0].len());
        table.complain(Problem::new(table.span_of(key), text));
        return None;
    }
    check_directions(table, what, key, &rows)?;
    Some(NewtonPerVolt::Matrix(BridgeMatrix { rows, serial: serial?? }))
}

impl BridgeMatrix {
    /// Returns the matrix from the voltages to the forces of the tip on the specimen along x, y and the press.
    fn mounted(&self, axes: &CellAxes) -> [Vec<f64>; 3] {
        let mounting = axes.mounting();
        let mounted = |along: [f64; 3], input: usize| (0..3).map(|axis| along[axis] * self.rows[axis][input]).sum();
        mounting.map(|along| (0..self.rows[0].len()).map(|input| mounted(along, input)).collect())
    }

    /// Returns the voltages of the inputs for those forces, per newton: the smallest from which the matrix returns them.
    fn volts_per_newton(&self, axes: &CellAxes) -> Option<Vec<[f64; 3]>> {
        let inverse = products(&self.rows).inverse()? * Matrix::of(axes.to_device());
        let column = |input: usize| Matrix::of([self.rows.each_ref().map(|row| row[input])]);
        Some((0..self.rows[0].len()).map(|input| (column(input) * inverse).rows()[0]).collect())
    }
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
        let mut identity = identity("load_cell", &self.inputs, wiring.rig, &cell.link);
        let (at, range_v, hz) = (0, self.inputs.range_v, cell.conversions_hz);
        let acquisition = acquisition(wiring)?;
        let sensitivity = match (&self.newton_per_volt, &cell.axes) {
            (NewtonPerVolt::Number(newton_per_volt), _) => Sensitivity::OneAxis(*newton_per_volt),
            (NewtonPerVolt::Matrix(matrix), Some(axes)) => {
                identity.identity += &format!(", matrix of {}", matrix.serial);
                Sensitivity::Axes(matrix.mounted(axes))
            }
            (NewtonPerVolt::Matrix(_), None) => return Err(super::unfit("load cell", &self.inputs.physical)),
        };
        let driver = DaqmxLoadCell::new(acquisition, at, sensitivity, range_v, hz, wiring.origin, identity);
        Ok(AnyLoadCell::Daqmx(driver))
    }

    fn has_axes(&self) -> bool {
        matches!(self.newton_per_volt, NewtonPerVolt::Matrix(_))
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
        let at = cell_of(wiring.rig).map_or(0, |cell| cell.inputs.count);
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

const LIBRARY: EmulatedDevice = EmulatedDevice { far_end: FarEnd::Library, protocol: "daqmx", ports: &[], line: None };

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
    let (device, first) = array_of(rig).map_or(("Dev1", 0), |array| first_input(&array.0.physical));
    let Some(DaqmxLoadCellSpec { inputs, newton_per_volt }) = cell_of(rig) else {
        return Arc::new(DaqmxEmulator::new(scene.clone(), origin, device, None, first, 1.0));
    };
    let (device, channel) = first_input(&inputs.physical);
    let emulator =
        |cell, volts_per_newton| DaqmxEmulator::new(scene.clone(), origin, device, cell, first, volts_per_newton);
    Arc::new(match newton_per_volt {
        NewtonPerVolt::Number(newton_per_volt) => emulator(Some(channel), 1.0 / newton_per_volt),
        NewtonPerVolt::Matrix(matrix) => {
            let volts = rig.load_cell.axes.as_ref().and_then(|axes| matrix.volts_per_newton(axes));
            emulator(None, 1.0).with_axes(&inputs.physical, volts.unwrap_or_default()) // both were checked
        }
    })
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
    use crate::rig::{RigSpec, SIM_RIG, parse};

    /// The simulated rig with this load cell.
    fn read(driver: &str) -> Result<RigSpec, Vec<String>> {
        let none = |_: &str| Err(std::io::Error::from(std::io::ErrorKind::NotFound));
        let text = SIM_RIG.replacen("{ modbus = \"generic-rs485\" }", driver, 1);
        let wrong = |problem: &String| problem.split_once(": ").unwrap().1.to_owned();
        parse("rig.toml", &text, &none).map_err(|problems| problems.lines().iter().map(wrong).collect())
    }

    const ROWS: &str =
        "[[0.3, -5.0, 0.2, 5.1, -0.1, 0.4], [-0.2, 2.9, 0.1, 2.8, 0.3, -5.8], [3.9, 0.2, 4.1, -0.1, 4.0, 0.3]]";
    const AXES: &str = "axes = { x = \"y\", y = \"-x\", press = \"-z\" }";

    #[test]
    fn matrix_returns_the_forces_from_the_voltages_of_the_emulator_in_any_mounting() {
        let text = format!("{{ daqmx = \"Dev1/ai0:5\", newton_per_volt = {ROWS}, serial = \"FT1\" }}\n{AXES}");
        let spec = read(&text).unwrap();
        let axes = spec.load_cell.axes.as_ref().unwrap();
        let Some(DaqmxLoadCellSpec { newton_per_volt: NewtonPerVolt::Matrix(matrix), .. }) = cell_of(&spec) else {
            panic!("no matrix")
        };
        let (mounted, volts) = (matrix.mounted(axes), matrix.volts_per_newton(axes).unwrap());
        assert_eq!(mounted[0], [-0.2, 2.9, 0.1, 2.8, 0.3, -5.8], "x of the specimen is y of the cell");
        for (row, along) in mounted.iter().enumerate() {
            for column in 0..3 {
                let product: f64 = along.iter().zip(&volts).map(|(newton, volts)| newton * volts[column]).sum();
                assert!((product - f64::from(u8::from(row == column))).abs() < 1e-12, "{row} {column}: {product}");
            }
        }
    }

    #[test]
    fn wrong_matrices_are_refused() {
        let six = |rows: &str| format!("daqmx = \"Dev1/ai0:5\", newton_per_volt = {rows}");
        let flat = "[[1, 2, 3, 4, 5, 6], [2, 4, 6, 8, 10, 12], [0, 0, 1, 0, 0, 0]]";
        for (driver, axes, text) in [
            (six(ROWS), AXES, "a matrix in `newton_per_volt` requires `serial`"),
            (format!("{}, serial = \"\"", six(ROWS)), AXES, "`serial` is \"\", expected 1 to 64 printable characters"),
            (
                format!("{}, serial = \"FT1\"", six(ROWS)),
                "",
                "`axes` is missing: the cell has three axes, and which way it is mounted isn't guessed",
            ),
            (
                format!("{}, serial = \"FT1\"", six(flat)),
                AXES,
                "a matrix in `newton_per_volt` is singular: it loses a direction of the force",
            ),
            (
                format!("{}, serial = \"FT1\"", six("[[1, 0, 0], [0, 1, 0], [0, 0, 1]]")),
                AXES,
                "a matrix in `newton_per_volt` has rows of 3, but \"Dev1/ai0:5\" is 6 inputs",
            ),
            (
                format!("{}, serial = \"FT1\"", six("[[1, 0, 0], [0, 1], [0, 0, 1]]")),
                AXES,
                "`newton_per_volt` must have three lists with as many numbers each",
            ),
            (
                format!("{}, serial = \"FT1\"", six("[[inf, 0, 0], [0, 1, 0], [0, 0, 1]]")),
                AXES,
                "`newton_per_volt` is not a finite number",
            ),
            (six("1.0"), "", "a load cell is on one input"),
            (
                "daqmx = \"Dev1/ai0\", newton_per_volt = 1.0, serial = \"FT1\"".to_owned(),
                "",
                "`serial` requires a matrix in `newton_per_volt`",
            ),
            (
                "daqmx = \"Dev1/ai0\", newton_per_volt = 1.0".to_owned(),
                AXES,
                "`axes` is for a cell with three axes, but this one has one",
            ),
        ] {
            assert_eq!(read(&format!("{{ {driver} }}\n{axes}")).map(|_| ()).unwrap_err(), [text], "{driver}");
        }
        let [three, serial] = ["[[1, 0, 0], [0, 2, 0], [0, 0, 3]]", "serial = \"FT1\""];
        read(&format!("{{ daqmx = \"Dev1/ai7:5\", newton_per_volt = {three}, {serial} }}\n{AXES}")).unwrap();
    }

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
