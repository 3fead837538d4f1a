//! One module per instrument family: a role of [`crate::device`] over a link of [`crate::wire`].

mod any;
pub mod daqmx;
mod esp301;
pub mod grbl;
pub mod modbus;
pub mod process;
#[cfg(test)]
mod script;
pub mod xps;

pub use any::{AnyArray, AnyLoadCell, AnyStage};
pub use esp301::Esp301;

use std::time::Duration;

/// How much longer than expected a motion may take.
const MOTION_MARGIN: Duration = Duration::from_secs(10);
