//! The load cell of a rig that has none: every reading is an error.

use palpate_core::quantity::ForceReading;
use palpate_link::device::{DeviceError, DeviceProblem, Identity, LoadCell};
use std::time::Duration;

/// Absence of a load cell. Code that asks for a force fails with an error that states why.
#[derive(Debug)]
pub struct MissingLoadCell;

/// Interval at which code asks again that waits for a force.
const ASKED_EVERY: Duration = Duration::from_millis(10);

impl LoadCell for MissingLoadCell {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        Err(missing("preparing it"))
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        Err(missing("reading it"))
    }

    fn conversion(&self) -> Duration {
        ASKED_EVERY
    }
}

fn missing(doing: &str) -> DeviceError {
    let problem = DeviceProblem::Mismatch("this rig has none (`load_cell = \"none\"`)".to_owned());
    DeviceError { device: "load cell".to_owned(), doing: doing.to_owned(), problem }
}
