//! One module per instrument family: a role of [`palpate_link::device`] over a link of [`palpate_link::wire`].

#![forbid(unsafe_code)]

mod any;
mod clear;
pub mod daqmx;
mod esp301;
pub mod grbl;
pub mod klipper;
pub mod lines;
pub mod marlin;
pub mod modbus;
mod mounting;
mod no_load_cell;
mod printer;
pub mod process;
#[cfg(test)]
pub(crate) mod script;
pub mod ur;
pub mod xps;

pub use any::{AnyArray, AnyLoadCell, AnyStage};
pub use esp301::Esp301;
pub use no_load_cell::MissingLoadCell;

use std::time::Duration;

/// Additional time that a motion may take beyond its expected time.
const MOTION_MARGIN: Duration = Duration::from_secs(10);
