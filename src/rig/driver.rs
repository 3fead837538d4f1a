//! The drivers that a rig may name for each role, and how they are read with their links.

use super::keys::{array, load_cell, stage};
use super::map::{Beside, MappedDevice, read_map};
use crate::document::{Bounds, Case, Key, Keys, Kind, Problem, Table, keys, words};
use crate::driver::daqmx::{Inputs, Terminal};
use crate::driver::xps::{Group, Guard};
use crate::wire::Link;

/// The stage drivers there are.
#[derive(Clone, Debug, PartialEq)]
pub enum StageDriver {
    /// Newport ESP301 or ESP300.
    Esp301,
    /// A group of a Newport XPS.
    Xps {
        /// The group.
        group: Group,
        /// Whether the controller itself is to end a motion at the force limit.
        guard: bool,
    },
    /// GRBL 1.1.
    Grbl,
    /// A program of the user's own.
    Process,
}

/// The load cell drivers there are.
#[derive(Clone, Debug)]
pub enum LoadCellDriver {
    /// A Modbus transmitter.
    Modbus(Box<MappedDevice>),
    /// An analog input of an XPS.
    Xps(Guard),
    /// An input of an NI device.
    Daqmx {
        /// The input.
        inputs: Inputs,
        /// N a volt.
        newton_per_volt: f64,
    },
    /// A program of the user's own.
    Process,
}

/// The array drivers there are.
#[derive(Clone, Debug)]
pub enum ArrayDriver {
    /// A Modbus converter.
    Modbus(Box<MappedDevice>),
    /// Inputs of an NI device.
    Daqmx(Inputs),
    /// A program of the user's own.
    Process,
}

const NEWTON_PER_VOLT: Bounds = Bounds::within(-1e6, 1e6, "N/V");
const STAGES: [(&str, StageDriver); 3] =
    [("esp301", StageDriver::Esp301), ("esp300", StageDriver::Esp301), ("grbl", StageDriver::Grbl)];
const TERMINALS: [(&str, Terminal); 4] =
    [("diff", Terminal::Diff), ("rse", Terminal::Rse), ("nrse", Terminal::Nrse), ("pseudo-diff", Terminal::PseudoDiff)];

keys! {
    /// `driver = { xps = ... }` of a stage.
    xps_stage {
        xps: Text, Refused, "the XPS' group of three positioners", "\"XYZ\"";
        positioners: Texts, or_texts(&["X", "Y", "Z"]), "those of x, y and z, in this order", "[\"X\", \"Y\", \"Z\"]";
        home_search: Flag, or_flag(false), "whether the group may search its home; only where that is clear of the specimen",
            "true";
        guard: Flag, or_flag(false), "whether the controller itself ends a motion at the force limit", "true";
    }
}

keys! {
    /// `driver = { xps = ... }` of a load cell.
    xps_input {
        xps: Text, Refused, "the analog input", "\"GPIO2.ADC1\"";
        newton_per_volt: Number(NEWTON_PER_VOLT), Refused, "N a volt; negative where a push gives a negative voltage", "1.0";
    }
}

keys! {
    /// `driver = { modbus = ... }`
    modbus_device {
        modbus: Text, Refused, "a register map that comes with the program, or a .toml file beside the rig's", "\"labjack-t7\"";
    }
}

keys! {
    /// `driver = { daqmx = ... }` of an array.
    daqmx_inputs {
        daqmx: Text, Refused, "the inputs of an NI device, in the order of the units", "\"Dev1/ai1:9\"";
        terminal: Word(&words(&TERMINALS)), or_word("rse"), "how they are wired", "\"diff\"";
        range_v: Number(above(0.0, 10.0, "V")), or(10.0), "the range that they measure in, either way", "10.0";
    }
}

keys! {
    /// `driver = { daqmx = ... }` of a load cell.
    daqmx_input {
        newton_per_volt: Number(NEWTON_PER_VOLT), Refused, "N a volt; negative where a push gives a negative voltage", "1.0";
    }
    as daqmx_inputs { daqmx, terminal, range_v }
}

keys! {
    /// `driver = { process = ... }`
    process_command {
        process: Texts, Refused, "a command that speaks the process protocol, and its arguments",
            "[\"python3\", \"my_daq.py\"]";
    }
}

/// What a stage's `driver` may be.
pub(super) mod stage_driver {
    use super::*;
    pub const KIND: Kind = Kind::Either(&[Kind::Word(&words(&STAGES)), Kind::Table(&KEYS)]);
    pub const KEYS: Keys = Keys::one_of(&[
        Case { name: "xps", keys: xps_stage::KEYS.always },
        Case { name: "process", keys: process_command::KEYS.always },
    ]);
}

/// What a load cell's `driver` may be.
pub(super) mod load_cell_driver {
    use super::*;
    pub const KIND: Kind = Kind::Table(&KEYS);
    pub const KEYS: Keys = Keys::one_of(&[
        Case { name: "modbus", keys: modbus_device::KEYS.always },
        Case { name: "xps", keys: xps_input::KEYS.always },
        Case { name: "daqmx", keys: daqmx_input::KEYS.always },
        Case { name: "process", keys: process_command::KEYS.always },
    ]);
}

/// What an array's `driver` may be.
pub(super) mod array_driver {
    use super::*;
    pub const KIND: Kind = Kind::Table(&KEYS);
    pub const KEYS: Keys = Keys::one_of(&[
        Case { name: "modbus", keys: modbus_device::KEYS.always },
        Case { name: "daqmx", keys: daqmx_inputs::KEYS.always },
        Case { name: "process", keys: process_command::KEYS.always },
    ]);
}

/// Most inputs of one device that a rig may name.
const INPUTS_MAX: usize = 512;

impl LoadCellDriver {
    /// The register map of a user's own, if it has one.
    pub fn map(&self) -> Option<&MappedDevice> {
        match self {
            LoadCellDriver::Modbus(map) => Some(map),
            _ => None,
        }
    }
}

impl ArrayDriver {
    /// The register map of a user's own, if it has one.
    pub fn map(&self) -> Option<&MappedDevice> {
        match self {
            ArrayDriver::Modbus(map) => Some(map),
            _ => None,
        }
    }
}

/// `driver = "esp301"`, `"grbl"`, `{ xps = "GROUP", ... }` or `{ process = [...] }`, and its link.
pub(super) fn read_stage_driver(table: &Table) -> Option<(StageDriver, Link)> {
    if !table.has(&stage::driver) || table.is_text(&stage::driver) {
        let link = read_link(table, &stage::link, None, &[LinkKind::Stream]);
        if table.text(&stage::driver) == Some("marlin") {
            let told = "Marlin can't press with a force: it tells where a motion will end, not where the axes are, and has no \
                        byte that stops one at once";
            let help = "GRBL 1.1 runs on most of the same boards: driver = \"grbl\"";
            table.complain(Problem::new(table.span_of(&stage::driver), told).help(help));
            return None;
        }
        let names = STAGES.each_ref().map(|(name, driver)| (*name, driver));
        return table.has(&stage::driver).then(|| table.word(&stage::driver, &names))?.cloned().zip(link);
    }
    let driver = table.table(&stage::driver)?;
    match driver.case() {
        Some("xps") => {
            let name = driver.text(&xps_stage::xps).map(str::to_owned);
            let positioners = driver.texts(&xps_stage::positioners).and_then(|names| {
                let names: Vec<String> = names.into_iter().map(str::to_owned).collect();
                let three = names.try_into().ok();
                if three.is_none() {
                    let told = "`positioners` names those of x, y and z, in this order";
                    driver.complain(Problem::new(driver.span_of(&xps_stage::positioners), told));
                }
                three
            });
            let (home_search, guard) = (driver.flag(&xps_stage::home_search), driver.flag(&xps_stage::guard));
            let link = read_link(table, &stage::link, None, &[LinkKind::Stream]);
            let group = Group { name: name?, positioners: positioners?, home_search: home_search? };
            Some((StageDriver::Xps { group, guard: guard? }, link?))
        }
        Some(_) => read_process(table, &stage::link, &driver).map(|link| (StageDriver::Process, link)),
        None => unknown(&driver, "expected xps or process, or a name alone: esp301, esp300 or grbl"),
    }
}

/// `driver = { modbus | xps | daqmx | process = ... }`, and its link.
pub(super) fn read_load_cell_driver(table: &Table, beside: Beside) -> Option<(LoadCellDriver, Link)> {
    let driver = table.table(&load_cell::driver)?;
    let link = |kind| read_link(table, &load_cell::link, None, &[kind]);
    match driver.case() {
        Some("modbus") => {
            let map = read_map(&driver, &modbus_device::modbus, "force", |profile| profile.force.is_some(), beside);
            let link = link(LinkKind::Stream);
            Some((LoadCellDriver::Modbus(Box::new(map?)), link?))
        }
        Some("xps") => {
            let input = driver.text(&xps_input::xps).map(str::to_owned);
            let newton_per_volt = read_newton_per_volt(&driver, &xps_input::newton_per_volt);
            let link = link(LinkKind::Stream);
            Some((LoadCellDriver::Xps(Guard { input: input?, newton_per_volt: newton_per_volt? }), link?))
        }
        Some("daqmx") => {
            let inputs = read_inputs(&driver);
            let newton_per_volt = read_newton_per_volt(&driver, &daqmx_input::newton_per_volt);
            if inputs.as_ref().is_some_and(|inputs| inputs.count != 1) {
                driver.complain(Problem::new(driver.span_of(&daqmx_input::daqmx), "a load cell is on one input"));
            }
            let link = link(LinkKind::Daqmx);
            Some((LoadCellDriver::Daqmx { inputs: inputs?, newton_per_volt: newton_per_volt? }, link?))
        }
        Some(_) => read_process(table, &load_cell::link, &driver).map(|link| (LoadCellDriver::Process, link)),
        None => unknown(&driver, "expected one of modbus, xps, daqmx and process"),
    }
}

/// `driver = { modbus | daqmx | process = ... }`, and its link.
pub(super) fn read_array_driver(table: &Table, beside: Beside) -> Option<(ArrayDriver, Link)> {
    let driver = table.table(&array::driver)?;
    let link = |kind| read_link(table, &array::link, None, &[kind]);
    match driver.case() {
        Some("modbus") => {
            let map = read_map(&driver, &modbus_device::modbus, "outputs", |profile| profile.outputs.is_some(), beside);
            let link = link(LinkKind::Stream);
            Some((ArrayDriver::Modbus(Box::new(map?)), link?))
        }
        Some("daqmx") => {
            let inputs = read_inputs(&driver);
            let link = link(LinkKind::Daqmx);
            Some((ArrayDriver::Daqmx(inputs?), link?))
        }
        Some(_) => read_process(table, &array::link, &driver).map(|link| (ArrayDriver::Process, link)),
        None => unknown(&driver, "expected one of modbus, daqmx and process"),
    }
}

fn unknown<T>(driver: &Table, expected: &str) -> Option<T> {
    driver.complain(Problem::new(driver.span(), format!("no driver that is known: {expected}")));
    None
}

/// What kinds of links there are besides `sim`.
#[derive(Clone, Copy, PartialEq)]
enum LinkKind {
    Stream,
    Daqmx,
}

impl LinkKind {
    fn expected(self) -> &'static str {
        match self {
            LinkKind::Stream => "serial://PORT?baud=RATE or tcp://HOST:PORT",
            LinkKind::Daqmx => "daqmx, or daqmx:///PATH/OF/THE/LIBRARY",
        }
    }

    fn of(link: &Link) -> Option<LinkKind> {
        match link {
            Link::Serial { .. } | Link::Tcp { .. } => Some(LinkKind::Stream),
            Link::Daqmx(_) => Some(LinkKind::Daqmx),
            Link::Sim | Link::Process(_) => None,
        }
    }
}

/// `link = "..."` of some kinds, or `sim`.
fn read_link(table: &Table, key: &Key, otherwise: Option<Link>, kinds: &[LinkKind]) -> Option<Link> {
    let span = table.span_of(key);
    let expected = || {
        let kinds: Vec<&str> = kinds.iter().map(|kind| kind.expected()).collect();
        if kinds.is_empty() { "sim, or no link at all".to_owned() } else { format!("sim, {}", kinds.join(", ")) }
    };
    if otherwise.is_some() && !table.has(key) {
        return otherwise;
    }
    table.require_as(key, &format!("where it is: {}", expected()));
    let text = table.text(key)?;
    let parsed = Link::parse(text).map_err(|told| format!("`link` is \"{text}\", {told}"));
    let fitting = parsed.and_then(|link| match &link {
        Link::Sim => Ok(link),
        other if LinkKind::of(other).is_some_and(|kind| kinds.contains(&kind)) => Ok(link),
        _ => Err(format!("`link` is \"{text}\", this driver expects {}", expected())),
    });
    fitting.map_err(|told| table.complain(Problem::new(span, told))).ok()
}

/// `{ process = ["COMMAND", ...] }`: the program is the link, unless it is simulated.
fn read_process(table: &Table, link: &Key, driver: &Table) -> Option<Link> {
    let process = &process_command::process;
    let command: Vec<String> = driver.texts(process)?.into_iter().map(str::to_owned).collect();
    if command.first().is_none_or(String::is_empty) {
        let told = "`process` is the command and its arguments: [\"python3\", \"my_daq.py\"]";
        driver.complain(Problem::new(driver.span_of(process), told));
        return None;
    }
    read_link(table, link, Some(Link::Process(command)), &[])
}

fn read_newton_per_volt(driver: &Table, key: &Key) -> Option<f64> {
    let newton_per_volt = driver.number(key)?;
    if newton_per_volt == 0.0 {
        driver.complain(Problem::new(driver.span_of(key), "`newton_per_volt` is 0: no force would ever be seen"));
        return None;
    }
    Some(newton_per_volt)
}

/// `daqmx = "Dev1/ai0:8"` with how they are wired and measured.
fn read_inputs(driver: &Table) -> Option<Inputs> {
    let physical = driver.text(&daqmx_inputs::daqmx)?;
    let terminal = driver.word(&daqmx_inputs::terminal, &TERMINALS);
    let range_v = driver.number(&daqmx_inputs::range_v);
    let count =
        physical.split(',').map(inputs_in).sum::<Option<usize>>().filter(|count| (1..=INPUTS_MAX).contains(count));
    let Some(count) = count else {
        let told = format!("`daqmx` is \"{physical}\", expected inputs such as \"Dev1/ai0\" or \"Dev1/ai1:9\"");
        driver.complain(Problem::new(driver.span_of(&daqmx_inputs::daqmx), told));
        return None;
    };
    Some(Inputs { physical: physical.to_owned(), count, terminal: terminal?, range_v: range_v? })
}

/// How many inputs `Dev1/ai1:9` is.
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
