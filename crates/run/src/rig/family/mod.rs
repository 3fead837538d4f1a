//! Families of devices that a rig may name, with one file and one line in [`FAMILIES`] for each.
//!
//! For each role that it supports, a family defines the keys of `driver = { ... }` and how they are read. It also defines the
//! supported links, how its driver is connected to a link, and the emulator for a simulated rig.

mod daqmx;
mod esp301;
mod grbl;
mod klipper;
mod lines;
mod list;
mod marlin;
mod modbus;
mod printer;
mod process;
mod ur;
mod xps;

pub use list::FAMILIES;
pub(super) use list::choices;

use super::spec::{ArrayDriver, Driver, LoadCellDriver, OwnFile, StageDriver};
use palpate_core::quantity::ArrayLayout;
use palpate_document::{Bounds, Key, Problem, Problems, Span, Table, with_nearest};
use palpate_link::device::{self, DeviceError};
use std::any::Any;
use std::sync::Arc;

/// Devices of one kind.
pub struct DeviceFamily {
    /// Name in a rig file.
    pub name: &'static str,
    /// Description, in one line.
    pub meaning: &'static str,
    /// Capabilities of its emulators, in one line.
    pub simulated: &'static str,
    /// Role as stage, if supported.
    pub stage: Option<Role<dyn StageDriver>>,
    /// Role as load cell, if supported.
    pub load_cell: Option<Role<dyn LoadCellDriver>>,
    /// Role as array, if supported.
    pub array: Option<Role<dyn ArrayDriver>>,
}

/// Implementation of a role by a family.
pub struct Role<D: ?Sized> {
    /// Words that are sufficient as a name, `driver = "esp301"`.
    pub words: &'static [&'static str],
    /// Keys of `driver = { ... }`. The first key names the family. Empty if a word is sufficient.
    pub keys: &'static [Key],
    /// Supported links in addition to `sim`.
    pub links: Links,
    /// Function that reads the keys. If a key is invalid, the function records the problems and returns no driver.
    pub(super) read: fn(&Table, Beside) -> Option<Arc<D>>,
}

/// Links that a driver supports in addition to `sim`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Links {
    /// A serial port or a TCP server.
    Stream,
    /// A serial port, a TCP server, or a device that sends datagrams.
    StreamOrDatagrams,
    /// NI's library.
    Daqmx,
    /// No link, because the driver names a program, which is the link.
    Program,
}

/// Function that returns the text of a file in the rig's folder.
pub(super) type Beside<'a> = &'a dyn Fn(&str) -> std::io::Result<String>;

/// Describes the outputs of an array for a user: as units, if each unit has one output.
fn counted(layout: &ArrayLayout) -> String {
    let units = layout.units().len();
    if layout.len() == 1 {
        "1 unit".to_owned()
    } else if layout.len() == units {
        format!("{units} units")
    } else {
        format!("{} outputs of {units} units", layout.len())
    }
}

/// Returns a driver as a specific type of its role; `None` if it has another type.
pub(super) fn as_a<D: Driver>(driver: &dyn Driver) -> Option<&D> {
    (driver as &dyn Any).downcast_ref()
}

/// Limits of an analog load cell's factor in N per volt.
const NEWTON_PER_VOLT: Bounds = Bounds::within(-1e6, 1e6, "N/V");
const NEWTON_PER_VOLT_MEANS: &str = "N per volt; negative if a push gives a negative voltage";

fn read_newton_per_volt(table: &Table, key: &Key) -> Option<f64> {
    let newton_per_volt = table.number(key)?;
    if newton_per_volt == 0.0 {
        table.complain(Problem::new(table.span_of(key), "`newton_per_volt` is 0, so every force would read 0 N"));
        return None;
    }
    Some(newton_per_volt)
}

/// Reads a key that names what describes a device: one of the texts that are part of the program, or a file in the rig's folder.
/// `what` it is called in messages.
fn own_file<T>(
    table: &Table,
    key: &Key,
    what: &str,
    names: &[&'static str],
    shipped: fn(&str) -> Option<T>,
    parse: fn(&str, &str) -> Result<T, Problems>,
    beside: Beside,
) -> Option<(OwnFile, T)> {
    let span = table.span_of(key);
    let name = table.text(key)?;
    if let Some(found) = shipped(name) {
        return Some((OwnFile { name: name.to_owned(), text: None }, found));
    }
    let known = names.join(", ");
    let plain = !name.contains(['/', '\\']) && name.ends_with(".toml");
    if !plain {
        let problem = Problem::new(span, format!("there is no {what} \"{name}\""));
        let problem = problem.help(format!("shipped {what}s: {known}; or give a .toml file in the rig's folder"));
        table.complain(with_nearest(problem, name, names));
        return None;
    }
    let text = match beside(name) {
        Ok(text) => text,
        Err(error) => {
            let help = format!("the file must be in the rig's folder; shipped {what}s: {known}");
            table.complain(Problem::new(span, format!("{name}: {error}")).help(help));
            return None;
        }
    };
    match parse(name, &text) {
        Ok(found) => Some((OwnFile { name: name.to_owned(), text: Some(text) }, found)),
        Err(problems) => {
            // each with the file's own line
            problems.text().for_each(|(line, help)| {
                let problem = Problem::new(span.clone(), line);
                table.complain(help.into_iter().fold(problem, Problem::help));
            });
            None
        }
    }
}

/// Returns a problem with the advice that a driver may give.
pub(super) fn with_help(span: Span, text: String, help: Option<&str>) -> Problem {
    help.into_iter().fold(Problem::new(span, text), Problem::help)
}

/// Returns the error of a driver that can't play a role.
pub(super) fn unfit(role: &str, driver: &str) -> DeviceError {
    let problem = device::DeviceProblem::Mismatch(format!("\"{driver}\" can't be used for this device"));
    DeviceError { device: role.to_owned(), doing: "opening it".to_owned(), problem }
}
