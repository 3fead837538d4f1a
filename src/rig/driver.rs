use super::map::{Beside, MappedDevice, read_map};
use crate::document::{Bounds, Problem, Table};
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
const RANGE_MOST_V: f64 = 10.0;
const RANGE_V: Bounds = Bounds::above(0.0, RANGE_MOST_V, "V");
const TERMINALS: [(&str, Terminal); 4] =
    [("diff", Terminal::Diff), ("rse", Terminal::Rse), ("nrse", Terminal::Nrse), ("pseudo-diff", Terminal::PseudoDiff)];

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
pub(super) fn read_stage_driver(table: &mut Table) -> Option<(StageDriver, Link)> {
    if !table.has("driver") || table.is_text("driver") {
        let driver = if table.text("driver") == Some("marlin") {
            let told = "Marlin can't press with a force: it tells where a motion will end, not where the axes are, and has no \
                        byte that stops one at once";
            let help = "GRBL 1.1 runs on most of the same boards: driver = \"grbl\"";
            table.complain(Problem::new(table.span_of("driver"), told).help(help));
            None
        } else {
            let known = [("esp301", StageDriver::Esp301), ("esp300", StageDriver::Esp301), ("grbl", StageDriver::Grbl)];
            let names = known.each_ref().map(|(name, _)| (*name, *name));
            let name = table.require_choice("driver", &names);
            known.into_iter().find(|(known, _)| Some(*known) == name).map(|(_, driver)| driver)
        };
        let link = read_link(table, None, &[Kind::Stream]);
        return Some((driver?, link?));
    }
    let mut driver = table.require_table("driver")?;
    let read = match driver.first_of(&["xps", "process"]) {
        Some("xps") => {
            let name = driver.text("xps").map(str::to_owned);
            let span = driver.span_of("positioners");
            let positioners = match driver.has("positioners") {
                false => Some(["X", "Y", "Z"].map(str::to_owned)),
                true => driver.texts("positioners").and_then(|names| {
                    let names: Vec<String> = names.into_iter().map(str::to_owned).collect();
                    let three = names.try_into().ok();
                    if three.is_none() {
                        let told = "`positioners` names those of x, y and z, in this order";
                        driver.complain(Problem::new(span, told));
                    }
                    three
                }),
            };
            let home_search = driver.flag("home_search").unwrap_or(false);
            let guard = driver.flag("guard").unwrap_or(false);
            let group = name.zip(positioners).map(|(name, positioners)| Group { name, positioners, home_search });
            let link = read_link(table, None, &[Kind::Stream]);
            group.zip(link).map(|(group, link)| (StageDriver::Xps { group, guard }, link))
        }
        Some(_) => read_process(table, &mut driver).map(|link| (StageDriver::Process, link)),
        None => unknown(&driver, "expected xps or process, or a name alone: esp301, esp300 or grbl"),
    };
    driver.finish();
    read
}

/// `driver = { modbus | xps | daqmx | process = ... }`, and its link.
pub(super) fn read_load_cell_driver(table: &mut Table, beside: Beside) -> Option<(LoadCellDriver, Link)> {
    let mut driver = table.require_table("driver")?;
    let read = match driver.first_of(&["modbus", "xps", "daqmx", "process"]) {
        Some("modbus") => {
            let map = read_map(&mut driver, "force", |profile| profile.force.is_some(), beside);
            let link = read_link(table, None, &[Kind::Stream]);
            map.zip(link).map(|(map, link)| (LoadCellDriver::Modbus(Box::new(map)), link))
        }
        Some("xps") => {
            let input = driver.text("xps").map(str::to_owned);
            let newton_per_volt = read_newton_per_volt(&mut driver);
            let link = read_link(table, None, &[Kind::Stream]);
            let guard = input.zip(newton_per_volt).map(|(input, newton_per_volt)| Guard { input, newton_per_volt });
            guard.zip(link).map(|(guard, link)| (LoadCellDriver::Xps(guard), link))
        }
        Some("daqmx") => {
            let span = driver.span_of("daqmx");
            let inputs = read_inputs(&mut driver);
            let newton_per_volt = read_newton_per_volt(&mut driver);
            if inputs.as_ref().is_some_and(|inputs| inputs.count != 1) {
                driver.complain(Problem::new(span, "a load cell is on one input"));
            }
            let link = read_link(table, None, &[Kind::Daqmx]);
            let read = inputs.zip(newton_per_volt);
            read.zip(link)
                .map(|((inputs, newton_per_volt), link)| (LoadCellDriver::Daqmx { inputs, newton_per_volt }, link))
        }
        Some(_) => read_process(table, &mut driver).map(|link| (LoadCellDriver::Process, link)),
        None => unknown(&driver, "expected one of modbus, xps, daqmx and process"),
    };
    driver.finish();
    read
}

/// `driver = { modbus | daqmx | process = ... }`, and its link.
pub(super) fn read_array_driver(table: &mut Table, beside: Beside) -> Option<(ArrayDriver, Link)> {
    let mut driver = table.require_table("driver")?;
    let read = match driver.first_of(&["modbus", "daqmx", "process"]) {
        Some("modbus") => {
            let map = read_map(&mut driver, "outputs", |profile| profile.outputs.is_some(), beside);
            let link = read_link(table, None, &[Kind::Stream]);
            map.zip(link).map(|(map, link)| (ArrayDriver::Modbus(Box::new(map)), link))
        }
        Some("daqmx") => {
            let inputs = read_inputs(&mut driver);
            let link = read_link(table, None, &[Kind::Daqmx]);
            inputs.zip(link).map(|(inputs, link)| (ArrayDriver::Daqmx(inputs), link))
        }
        Some(_) => read_process(table, &mut driver).map(|link| (ArrayDriver::Process, link)),
        None => unknown(&driver, "expected one of modbus, daqmx and process"),
    };
    driver.finish();
    read
}

fn unknown<T>(driver: &Table, expected: &str) -> Option<T> {
    driver.complain(Problem::new(driver.span(), format!("no driver that is known: {expected}")));
    None
}

/// What kinds of links there are besides `sim`.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Stream,
    Daqmx,
}

impl Kind {
    fn expected(self) -> &'static str {
        match self {
            Kind::Stream => "serial://PORT?baud=RATE or tcp://HOST:PORT",
            Kind::Daqmx => "daqmx, or daqmx:///PATH/OF/THE/LIBRARY",
        }
    }

    fn of(link: &Link) -> Option<Kind> {
        match link {
            Link::Serial { .. } | Link::Tcp { .. } => Some(Kind::Stream),
            Link::Daqmx(_) => Some(Kind::Daqmx),
            Link::Sim | Link::Process(_) => None,
        }
    }
}

/// `link = "..."` of some kinds, or `sim`.
fn read_link(table: &mut Table, otherwise: Option<Link>, kinds: &[Kind]) -> Option<Link> {
    let span = table.span_of("link");
    let expected = || {
        let kinds: Vec<&str> = kinds.iter().map(|kind| kind.expected()).collect();
        if kinds.is_empty() { "sim, or no link at all".to_owned() } else { format!("sim, {}", kinds.join(", ")) }
    };
    if otherwise.is_some() && !table.has("link") {
        return otherwise;
    }
    let text = table.require_text("link", &format!("where it is: {}", expected()))?;
    let parsed = Link::parse(text).map_err(|told| format!("`link` is \"{text}\", {told}"));
    let fitting = parsed.and_then(|link| match &link {
        Link::Sim => Ok(link),
        other if Kind::of(other).is_some_and(|kind| kinds.contains(&kind)) => Ok(link),
        _ => Err(format!("`link` is \"{text}\", this driver expects {}", expected())),
    });
    fitting.map_err(|told| table.complain(Problem::new(span, told))).ok()
}

/// `{ process = ["COMMAND", ...] }`: the program is the link, unless it is simulated.
fn read_process(table: &mut Table, driver: &mut Table) -> Option<Link> {
    let span = driver.span_of("process");
    let command: Vec<String> = driver.texts("process")?.into_iter().map(str::to_owned).collect();
    if command.first().is_none_or(String::is_empty) {
        driver.complain(Problem::new(span, "`process` is the command and its arguments: [\"python3\", \"my_daq.py\"]"));
        return None;
    }
    read_link(table, Some(Link::Process(command)), &[])
}

fn read_newton_per_volt(driver: &mut Table) -> Option<f64> {
    let span = driver.span_of("newton_per_volt");
    let newton_per_volt = driver.require_number("newton_per_volt", NEWTON_PER_VOLT)?;
    if newton_per_volt == 0.0 {
        driver.complain(Problem::new(span, "`newton_per_volt` is 0: no force would ever be seen"));
        return None;
    }
    Some(newton_per_volt)
}

/// `daqmx = "Dev1/ai0:8"` with how they are wired and measured.
fn read_inputs(driver: &mut Table) -> Option<Inputs> {
    let span = driver.span_of("daqmx");
    let physical = driver.text("daqmx")?;
    let terminal = driver.choice("terminal", &TERMINALS).unwrap_or(Terminal::Rse);
    let range_v = driver.number("range_v", RANGE_V).unwrap_or(RANGE_MOST_V);
    let count =
        physical.split(',').map(inputs_in).sum::<Option<usize>>().filter(|count| (1..=INPUTS_MAX).contains(count));
    let Some(count) = count else {
        let told = format!("`daqmx` is \"{physical}\", expected inputs such as \"Dev1/ai0\" or \"Dev1/ai1:9\"");
        driver.complain(Problem::new(span, told));
        return None;
    };
    Some(Inputs { physical: physical.to_owned(), count, terminal, range_v })
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
