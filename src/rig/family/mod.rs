//! The families of devices that a rig may name: a file each, and a line each in [`FAMILIES`].
//!
//! A family says for each role that it plays which keys its `driver = { ... }` takes, how they are read, which links it takes,
//! how its driver is put on one, and which emulator answers in a simulated rig.

mod daqmx;
mod esp301;
mod grbl;
mod modbus;
mod process;
mod xps;

pub use modbus::MappedDevice;

use super::open::{Dial, Wiring};
use super::{EmulatedDevice, RigSpec};
use crate::device::DeviceError;
use crate::document::{Bounds, Case, Key, Keys, Kind, Problem, Table};
use crate::driver::{AnyArray, AnyLoadCell, AnyStage};
use crate::quantity::ArrayLayout;
use crate::scene::{Device, Scene};
use crate::wire::{ClaimError, Claims, Link};
use std::any::Any;
use std::fmt::Debug;
use std::sync::Arc;

/// Every family, in the order in which messages name them.
pub const FAMILIES: [&Family; 6] =
    [&esp301::FAMILY, &grbl::FAMILY, &modbus::FAMILY, &xps::FAMILY, &daqmx::FAMILY, &process::FAMILY];

/// Devices of one kind.
pub struct Family {
    /// Its name in a rig file.
    pub name: &'static str,
    /// What it is, in one line.
    pub meaning: &'static str,
    /// What its emulators can do, in one line.
    pub simulated: &'static str,
    /// How it plays the stage, if it does.
    pub stage: Option<Role<dyn StageDriver>>,
    /// How it plays the load cell, if it does.
    pub load_cell: Option<Role<dyn LoadCellDriver>>,
    /// How it plays the array, if it does.
    pub array: Option<Role<dyn ArrayDriver>>,
}

/// How a family plays a role.
pub struct Role<D: ?Sized> {
    /// The words that name it alone, `driver = "esp301"`.
    pub words: &'static [&'static str],
    /// The keys of `driver = { ... }`; the first of them names the family. None: a word is enough.
    pub keys: &'static [Key],
    /// The links that it takes besides `sim`.
    pub links: Links,
    /// Reads the keys. The problems of a wrong one are recorded, and there is no driver.
    pub(super) read: fn(&Table, Beside) -> Option<Arc<D>>,
}

/// Which links a driver takes besides `sim`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Links {
    /// A serial port or a TCP server.
    Stream,
    /// NI's library.
    Daqmx,
    /// None: the driver names a program, which is the link.
    Program,
}

/// Gives the text of a file that lies beside the rig's.
pub(super) type Beside<'a> = &'a dyn Fn(&str) -> std::io::Result<String>;

/// A driver as a rig describes it, whichever role it plays.
pub trait Driver: Any + Debug + Send + Sync {
    /// The link that it has by itself; none: the rig names it.
    fn own_link(&self) -> Option<Link> {
        None
    }

    /// The register map that it goes by, if it has one.
    fn map(&self) -> Option<&MappedDevice> {
        None
    }

    /// Takes its real link for this program alone.
    ///
    /// # Errors
    /// Another program has it.
    fn claim(&self, link: &Link, claims: &mut Claims) -> Result<(), ClaimError> {
        claims.take(link)
    }

    /// What keeps it from working with the rest of the rig.
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        let _ = rig;
        Vec::new()
    }
}

/// A driver that doesn't fit the rest of its rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Misfit {
    /// The role that has to be changed.
    pub role: Device,
    /// What is wrong.
    pub told: String,
    /// What to do.
    pub help: Option<&'static str>,
}

/// A stage.
pub trait StageDriver: Driver {
    /// The driver on its link, which `dial` opens; nothing is sent.
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage;

    /// The emulator that answers it in a simulated rig.
    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice;
}

/// A load cell.
pub trait LoadCellDriver: Driver {
    /// The driver on its link, which `dial` opens; nothing is sent.
    ///
    /// # Errors
    /// It can't play this role, or needs a library that isn't there.
    fn open(&self, dial: Dial, wiring: &Wiring) -> Result<AnyLoadCell, DeviceError>;

    /// The emulator that answers it in a simulated rig, whose stage is `stage`.
    ///
    /// # Errors
    /// There is none.
    fn emulated(&self, rig: &RigSpec, stage: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError>;
}

/// An array.
pub trait ArrayDriver: Driver {
    /// The driver on its link, which `dial` opens; nothing is sent.
    ///
    /// # Errors
    /// It can't play this role, or needs a library that isn't there.
    fn open(&self, dial: Dial, wiring: &Wiring) -> Result<AnyArray, DeviceError>;

    /// The emulator that answers it in a simulated rig.
    ///
    /// # Errors
    /// There is none.
    fn emulated(&self, rig: &RigSpec) -> Result<EmulatedDevice, DeviceError>;

    /// What keeps it from reading all outputs of a layout, and what to do about it.
    fn misfit(&self, layout: &ArrayLayout) -> Option<(String, Option<&'static str>)> {
        let _ = layout;
        None
    }

    /// The largest output that it can give, where it knows, V.
    fn range_v(&self) -> Option<f64> {
        None
    }
}

/// The outputs of an array as a person counts them: units, where each has one.
fn counted(layout: &ArrayLayout) -> String {
    let units = layout.units().len();
    if layout.len() == units { format!("{units} units") } else { format!("{} outputs of {units} units", layout.len()) }
}

/// A driver of a role as one of the types that there are; none where it is another.
pub(super) fn as_a<D: Driver>(driver: &dyn Driver) -> Option<&D> {
    (driver as &dyn Any).downcast_ref()
}

/// N a volt of an analog load cell.
const NEWTON_PER_VOLT: Bounds = Bounds::within(-1e6, 1e6, "N/V");
const NEWTON_PER_VOLT_MEANS: &str = "N a volt; negative where a push gives a negative voltage";

fn read_newton_per_volt(table: &Table, key: &Key) -> Option<f64> {
    let newton_per_volt = table.number(key)?;
    if newton_per_volt == 0.0 {
        table.complain(Problem::new(table.span_of(key), "`newton_per_volt` is 0: no force would ever be seen"));
        return None;
    }
    Some(newton_per_volt)
}

/// What the `driver` of a role may be, from the families that play it.
macro_rules! choice {
    ($role:ident) => {
        pub mod $role {
            use super::*;

            const fn counts() -> (usize, usize) {
                let (mut words, mut cases, mut i) = (0, 0, 0);
                while i < FAMILIES.len() {
                    if let Some(role) = &FAMILIES[i].$role {
                        words += role.words.len();
                        cases += !role.keys.is_empty() as usize;
                    }
                    i += 1;
                }
                (words, cases)
            }

            const WORDS: [&str; counts().0] = {
                let (mut words, mut next, mut i) = ([""; counts().0], 0, 0);
                while i < FAMILIES.len() {
                    if let Some(role) = &FAMILIES[i].$role {
                        let mut word = 0;
                        while word < role.words.len() {
                            words[next] = role.words[word];
                            (next, word) = (next + 1, word + 1);
                        }
                    }
                    i += 1;
                }
                words
            };

            const CASES: [Case; counts().1] = {
                let (mut cases, mut next, mut i) = ([Case { name: "", keys: &[] }; counts().1], 0, 0);
                while i < FAMILIES.len() {
                    if let Some(role) = &FAMILIES[i].$role
                        && !role.keys.is_empty()
                    {
                        cases[next] = Case { name: role.keys[0].name, keys: role.keys };
                        next += 1;
                    }
                    i += 1;
                }
                cases
            };

            const KEYS: Keys = Keys::one_of(&CASES);

            /// A word, a table, or either of them.
            pub const KIND: Kind = match WORDS.len() {
                0 => Kind::Table(&KEYS),
                _ => Kind::Either(&[Kind::Word(&WORDS), Kind::Table(&KEYS)]),
            };
        }
    };
}

/// What `driver` may be, role by role.
pub(super) mod choices {
    use super::{Case, FAMILIES, Keys, Kind};

    choice!(stage);
    choice!(load_cell);
    choice!(array);
}
