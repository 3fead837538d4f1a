//! `[[monitor]]`: slow devices with one value, such as a thermometer, that are read between presses.
//!
//! A monitor is an array with one output. Its driver sees a rig whose array it is, so every family of arrays can be one.

use super::driver::read_array_driver;
use super::emulated::EmulatedDevice;
use super::family::{Beside, with_help};
use super::keys::{monitor, root};
use super::spec::{ArraySpec, Dial, LoadCellSpec, RigSpec, RigWiring};
use palpate_core::quantity::{ArrayLayout, Place, Range};
use palpate_data::dataset::is_press_column;
use palpate_document::{self as document, Problem, Table};
use palpate_drivers::AnyArray;
use palpate_link::device::DeviceError;
use palpate_link::time::Instant;
use palpate_link::wire::Link;
use palpate_sim::emulator::Shared;
use palpate_sim::scene::{Monitored, Scene};
use std::sync::{Arc, Mutex};

/// Name of the monitor whose value is the temperature of the rig, degrees Celsius.
pub const TEMPERATURE: &str = "temperature_c";

/// Longest name of a monitor, characters.
const NAME_MAX: usize = 40;

/// A slow device whose value is kept with every press.
#[derive(Clone, Debug)]
pub struct MonitorSpec {
    /// Name of the value, which ends in its unit.
    pub name: String,
    /// The device: an array with one output.
    pub array: ArraySpec,
    /// Factor of the reading.
    pub scale: f64,
    /// Value at a reading of 0.
    pub offset: f64,
    /// Least time from one reading to the next, s.
    pub every_s: f64,
    /// Range outside which no press begins; `None`: any value will do.
    pub bounds: Option<Range>,
    /// Longest wait for a value within the bounds, s.
    pub wait_s: f64,
}

/// Emulator of a monitor, and the scene of its own that it acts on.
pub struct EmulatedMonitor {
    /// The emulator.
    pub device: EmulatedDevice,
    /// Its scene.
    pub scene: Shared<Scene>,
}

impl MonitorSpec {
    /// Whether a press may begin at this value.
    pub fn admits(&self, value: f64) -> bool {
        self.bounds.is_none_or(|bounds| bounds.contains(value))
    }

    /// Returns the driver on its link, which `dial` opens. Nothing is sent.
    pub(super) fn open(
        &self,
        rig: &RigSpec,
        dial: Dial,
        scene: Option<Shared<Scene>>,
        origin: Instant,
    ) -> Result<AnyArray, DeviceError> {
        let opened = self.array.driver.open(dial, &RigWiring::new(&self.seen_in(rig), scene, origin));
        opened.map_err(|error| self.named(error))
    }

    /// Returns the emulator that answers the driver. Its readings depend on the time and the temperature of the rig's scene.
    pub(super) fn emulated(&self, rig: &RigSpec, scene: &Scene) -> Result<EmulatedMonitor, DeviceError> {
        let device = self.array.driver.emulated(&self.seen_in(rig)).map_err(|error| self.named(error))?;
        let device = device.on(&self.array.link);
        let middle = self.bounds.map_or(0.0, |bounds| f64::midpoint(bounds.min, bounds.max));
        let value = (self.name != TEMPERATURE).then_some(middle);
        let scene = scene.clone().monitored(Monitored { value, scale: self.scale, offset: self.offset });
        Ok(EmulatedMonitor { device, scene: Arc::new(Mutex::new(scene)) })
    }

    /// Returns an error of the driver with the name of the monitor: the driver takes itself for the array.
    pub fn named(&self, error: DeviceError) -> DeviceError {
        DeviceError { device: error.device.replacen("array", &self.role(), 1), ..error }
    }

    /// Role of the monitor in messages and among the devices of a run.
    pub fn role(&self) -> String {
        format!("monitor {}", self.name)
    }

    /// Returns the rig as the driver sees it: nothing else is wired to the device.
    fn seen_in(&self, rig: &RigSpec) -> RigSpec {
        RigSpec { load_cell: LoadCellSpec::none(), array: self.array.clone(), monitors: Vec::new(), ..rig.clone() }
    }
}

/// Reads every `[[monitor]]`.
pub(super) fn read_monitors(rig: &Table, beside: Beside) -> Option<Vec<MonitorSpec>> {
    let tables = rig.tables(&root::monitor);
    let monitors = document::all(tables.iter().map(|table| read_monitor(table, beside)))?;
    for (nth, (monitor, table)) in monitors.iter().zip(&tables).enumerate() {
        if monitors[..nth].iter().any(|before| before.name == monitor.name) {
            let text = format!("two monitors have the name `{}`", monitor.name);
            table.complain(Problem::new(table.span_of(&monitor::name), text));
        }
    }
    Some(monitors)
}

fn read_monitor(table: &Table, beside: Beside) -> Option<MonitorSpec> {
    let name = read_name(table);
    let driver = read_array_driver(table, beside);
    let numbers = table.numbers([monitor::scale, monitor::offset, monitor::every_s, monitor::wait_s]);
    let bounds = if table.has(&monitor::bounds) { table.range(&monitor::bounds).map(Some) } else { Some(None) };
    let layout = ArrayLayout::from_places(vec![Place::default()]);
    if let Some((text, help)) = driver.as_ref().and_then(|(driver, _)| driver.misfit(&layout)) {
        table.complain(with_help(table.span_of(&monitor::driver), format!("a monitor has one output: {text}"), help));
    }
    let ([scale, offset, every_s, wait_s], (driver, link)) = (numbers?, driver?);
    if scale == 0.0 {
        let text = "`scale` is 0, so the value would never change";
        table.complain(Problem::new(table.span_of(&monitor::scale), text));
    }
    let array = ArraySpec { range_v: driver.range_v(), driver, link, layout, unit: String::new() };
    Some(MonitorSpec { name: name?, array, scale, offset, every_s, bounds: bounds?, wait_s })
}

fn read_name(table: &Table) -> Option<String> {
    let name = table.text(&monitor::name)?;
    let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let text = if !(1..=NAME_MAX).contains(&name.chars().count()) || !name.chars().all(is_plain) {
        format!("`name` is {name:?}, expected 1 to {NAME_MAX} lower-case letters, digits and underscores")
    } else if is_press_column(name) {
        format!("`name` is \"{name}\", which is a column of presses.csv")
    } else {
        return Some(name.to_owned());
    };
    table.complain(Problem::new(table.span_of(&monitor::name), text));
    None
}

/// Checks the monitors against each other and the rest of the rig.
pub(super) fn check_monitors(spec: &RigSpec, rig: &Table) {
    let mut taken = vec![&spec.stage.link, &spec.load_cell.link, &spec.array.link];
    for (monitor, table) in spec.monitors.iter().zip(rig.tables(&root::monitor)) {
        for misfit in monitor.array.driver.misfits(&monitor.seen_in(spec)) {
            table.complain(with_help(table.span(), misfit.text, misfit.help));
        }
        let link = &monitor.array.link;
        let is_same = |other: &&Link| match (link, other) {
            (Link::Serial { port, .. }, Link::Serial { port: other, .. }) => port == other,
            (link, other) => matches!((link, other), (Link::Daqmx(_), Link::Daqmx(_))), // NI's library runs one task on a device
        };
        if taken.iter().any(is_same) {
            let text = format!("the monitor {} and another device have the same link {link}", monitor.name);
            let help = "a monitor is read while nothing else is, through a port or an NI device of its own";
            table.complain(Problem::new(table.span_of(&monitor::link), text).help(help));
        }
        taken.push(link);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{SIM_RIG, parse};
    use super::*;

    /// Reads the rig of the paper with these monitors; every problem with its line in the first monitor, which is at line 1.
    fn read(monitors: &str) -> Result<Vec<MonitorSpec>, Vec<String>> {
        let (before, after) = SIM_RIG.split_once("[scene]").unwrap();
        let above = before.lines().count();
        let at = |line: String| {
            let (line, text) = line.strip_prefix("rig.toml:").unwrap().split_once(':').unwrap();
            format!("{}:{text}", line.parse::<usize>().unwrap() - above)
        };
        let text = format!("{before}{monitors}\n[scene]{after}");
        let read = parse("rig.toml", &text, &|_| Err(std::io::ErrorKind::NotFound.into()));
        read.map(|rig| rig.monitors).map_err(|problems| problems.lines().into_iter().map(at).collect())
    }

    fn monitor(name: &str, more: &str) -> String {
        format!("[[monitor]]\nname = \"{name}\"\ndriver = {{ lines = \"one-number\" }}\nlink = \"sim\"\n{more}\n")
    }

    #[test]
    fn monitors_are_read_with_their_defaults() {
        let both = monitor("temperature_c", "") + &monitor("supply_v", "scale = 2\noffset = -1\nbounds = [11, 13]\n");
        let monitors = read(&both).unwrap();
        let [first, second] = &monitors[..] else { panic!("{monitors:?}") };
        assert_eq!((first.name.as_str(), first.scale, first.offset), ("temperature_c", 1.0, 0.0));
        assert_eq!((first.every_s, first.bounds, first.wait_s), (10.0, None, 600.0));
        assert!(first.admits(-300.0) && second.admits(13.0) && !second.admits(13.01) && !second.admits(f64::NAN));
        assert_eq!((second.scale, second.offset, second.array.layout.len()), (2.0, -1.0, 1));
        assert_eq!(read("").unwrap().len(), 0);
    }

    #[test]
    fn wrong_monitors_are_refused_at_their_lines() {
        let twice = monitor("humidity_percent", "") + &monitor("humidity_percent", "");
        assert_eq!(read(&twice).unwrap_err(), ["7:8: two monitors have the name `humidity_percent`"]);
        let words =
            |name: &str| format!("`name` is {name}, expected 1 to 40 lower-case letters, digits and underscores");
        for (name, more, problem) in [
            (
                "t_c",
                "bounds = [28.0, 18.0]",
                "5:10: `bounds` has its first number above the second: 28 to 18".to_owned(),
            ),
            ("t_c", "every_s = 0", "5:11: `every_s` is 0, must be 0.1 to 86400 s".to_owned()),
            ("t_c", "every_s = -1.0", "5:11: `every_s` is -1, must be 0.1 to 86400 s".to_owned()),
            ("t_c", "wait_s = inf", "5:10: `wait_s` is not a finite number".to_owned()),
            ("t_c", "scale = 0.0", "5:9: `scale` is 0, so the value would never change".to_owned()),
            ("force_n", "", "2:8: `name` is \"force_n\", which is a column of presses.csv".to_owned()),
            ("out_3", "", "2:8: `name` is \"out_3\", which is a column of presses.csv".to_owned()),
            ("Temp_c", "", format!("2:8: {}", words("\"Temp_c\""))),
            ("t c", "", format!("2:8: {}", words("\"t c\""))),
            ("", "", format!("2:8: {}", words("\"\""))),
        ] {
            assert_eq!(read(&monitor(name, more)).unwrap_err(), [problem], "{name} {more}");
        }
    }

    #[test]
    fn a_device_with_more_outputs_or_of_another_role_is_no_monitor() {
        let skin = monitor("t_c", "").replace("one-number", "velostat-16");
        let text = "3:10: a monitor has one output: 1 unit, but the line profile \"velostat-16\" has 16 outputs";
        assert_eq!(read(&skin).unwrap_err(), [text]);
        let cell = monitor("t_c", "").replace("one-number", "hx711");
        let text = "3:20: the line profile \"hx711\" has no [outputs], which an array needs";
        assert_eq!(read(&cell).unwrap_err(), [text]);
    }

    #[test]
    fn a_monitor_shares_neither_a_port_nor_ni_inputs() {
        let real = include_str!("../../../../rigs/esp301.toml");
        let none = |_: &str| Err(std::io::ErrorKind::NotFound.into());
        let read = |monitors: &str| {
            let problems = parse("rig.toml", &format!("{real}\n{monitors}"), &none);
            problems.map(|_| ()).map_err(|problems| {
                problems.lines().iter().map(|line| line.splitn(4, ':').last().unwrap().trim().to_owned()).collect()
            })
        };
        let at = |name: &str, port: &str| {
            monitor(name, "").replace("link = \"sim\"", &format!("link = \"serial:///dev/{port}?baud=9600\""))
        };
        assert_eq!(read(&at("t_c", "ttyUSB7")), Ok(()));
        let refused: Result<(), Vec<String>> = read(&at("t_c", "ttyUSB0"));
        let link = "the same link serial:///dev/ttyUSB0?baud=9600";
        assert_eq!(refused.unwrap_err(), [format!("the monitor t_c and another device have {link}")]);
        let two = at("t_c", "ttyUSB7") + &at("h_percent", "ttyUSB7");
        let link = "the same link serial:///dev/ttyUSB7?baud=9600";
        assert_eq!(read(&two).unwrap_err(), [format!("the monitor h_percent and another device have {link}")]);
        let text = "some links are simulated and others are real: they can't use the same clock";
        assert_eq!(read(&monitor("t_c", "")).unwrap_err(), [text]);
    }
}
