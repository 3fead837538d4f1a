//! A batch: sensors of one design, calibrated one after another at one bench.
//!
//! A batch is a folder with a journal of its own and the run folders of its sensors. The run folders stay the record of what was
//! measured; the journal keeps what was done with which sensor, and the result. An [`BatchEvent`] is one record of it.
//! A [`BatchFile`] states what is to be done, and a [`BatchState`] follows from the events alone.

mod admit;
mod chance;
pub mod chart;
mod conclude;
mod design;
mod event;
mod file;
mod folder;
mod history;
mod keys;
mod monitor;
mod seed;
mod serial;
mod state;

pub use admit::Admitted;
pub use chance::{Chance, DRAWS, Test, chance};
pub use conclude::{Basis, Conclusion, conclude};
pub use design::ByDesign;
pub use event::{
    Alarm, BATCH_FORMAT, BatchEvent, BatchSession, Began, Cause, Charted, Ended, Facts, ReferenceSensor, SensorFigure,
};
pub use file::{BatchFile, Nest, PriorRuns, Typical, parse};
pub use folder::{BatchError, BatchFolder, RUNS, beginning, read_state};
pub use history::History;
pub use monitor::Monitor;
pub use monitor::Quantity;
pub use seed::{run_seed, specimen_seed};
pub use serial::check_serial;
pub use state::{BatchSensor, BatchState, RIG, SensorState};

use palpate_document::Keys;

/// All keys that a batch file may have.
pub const KEYS: Keys = keys::root::KEYS;

/// Largest number of serial numbers of a batch.
pub(crate) const SERIALS_MAX: usize = 100_000;
