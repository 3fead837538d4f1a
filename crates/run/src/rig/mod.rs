//! The rig: driver and link of each role, position of the specimen, and its limits.
//!
//! A [`RigSpec`] is a parsed rig file. [`RigSpec::open`] is the only place that chooses between a real link and an emulator in
//! memory. After this choice, the driver, the framing and the time-outs are the same.

mod axes;
mod bench;
mod cell;
mod certificate;
mod compare;
mod driver;
mod emulated;
mod family;
mod keys;
mod monitor;
mod no_load_cell;
mod open;
mod over_time;
mod parse;
mod profiled;
mod scene;
mod scene_keys;
mod simulated;
mod skin;
mod spec;
mod which_way;

pub use axes::{CellAxes, CellMatrix, DeviceAxis};
pub use bench::Bench;
pub use cell::AdjustedCell;
pub use cell::GAIN_UNKNOWN;
pub use compare::{Consequence, Difference, differences};
pub use emulated::{EmulatedDevice, FarEnd};
pub use family::{DeviceFamily, FAMILIES, Links, Role};
pub use monitor::{EmulatedMonitor, MonitorSpec, TEMPERATURE};
pub use open::OpenRig;
pub use parse::parse;
pub use simulated::GroundTruth;
pub use simulated::SimulatedRig;
pub use spec::ArrayDriver;
pub use spec::ArraySpec;
pub use spec::HomeSide;
pub use spec::LoadCellDriver;
pub use spec::StageDriver;
pub use spec::StageSpec;
pub use spec::{Dial, Driver, Home, LastResort, LoadCellSpec, Misfit, OwnFile, RigSpec, RigWiring};
pub use which_way::WhichWay;

use palpate_document::Keys;

/// Every key that a rig may have.
pub const KEYS: Keys = keys::root::KEYS;

/// The paper's rig, simulated, as supplied.
pub const SIM_RIG: &str = include_str!("../../../../rigs/sim.toml");
