//! Raw series: every reading of a press with its own time, in a file of Arrow beside the journal.
//!
//! The file is a stream of Arrow (IPC): its schema, then a batch for each press, or several for a long one. Batches reach the disk before
//! the press is recorded, and the record states the length of the file and the SHA-256 of what was added. So the journal vouches for every
//! batch, and what comes after the last recorded press is cut off when a run continues.

mod check;
#[cfg(feature = "files")]
mod encode;
mod queue;
#[cfg(feature = "files")]
mod read;
#[cfg(feature = "files")]
mod writer;

pub(super) use check::{cut, problems};
pub use queue::{SeriesQueue, SeriesRequest, SeriesWriteError, series_queue};
#[cfg(feature = "files")]
pub use read::{RecordedSeries, SeriesBatch};
#[cfg(feature = "files")]
pub(super) use writer::SeriesWriter;

use super::press::output_name;
use super::{MonitorValue, NoLoad};
use serde::{Deserialize, Serialize};

/// Name of the file of readings in a run folder.
pub const SERIES: &str = "series.arrows";

/// Readings of one press, in the order in which they arrived.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeriesReadings {
    /// Number of the entry in the plan.
    pub press: u64,
    /// The readings.
    pub rows: Vec<SeriesReading>,
}

/// One reading of one device.
#[derive(Clone, Debug, PartialEq)]
pub struct SeriesReading {
    /// Time at which the answer arrived, s since the run's start.
    pub t_s: f64,
    /// Time at which the device took the reading, s since the run's start; `None` if the device reports no time.
    pub taken_s: Option<f64>,
    /// What was read.
    pub value: ReadValue,
}

/// Value of a reading.
#[derive(Clone, Debug, PartialEq)]
pub enum ReadValue {
    /// Forces, N, relative to the reading without load before the press. `side_n` has those along x and y, on a cell with three axes.
    Force {
        /// Force along z, pressing positive.
        force_n: f64,
        /// Forces along x and y of the specimen frame, as the tip exerts them on the specimen.
        side_n: Option<[f64; 2]>,
    },
    /// Outputs in the array's unit, relative to the outputs without load before the press.
    Outputs(Vec<f64>),
    /// z of the indenter, read back, mm into the specimen in the specimen frame.
    Height(f64),
    /// Value of a monitor.
    Monitor(MonitorValue),
}

/// What the journal states about the file of readings after a press.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SeriesMark {
    /// Length of the file, bytes.
    pub bytes: u64,
    /// SHA-256 of the bytes since the mark before, in hexadecimal.
    pub sha256: String,
}

/// Column of the file of readings. A reading fills the columns of its device; the others are missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeriesColumn {
    /// Name.
    pub name: String,
    /// Unit of the outputs; empty for a column whose name ends in its unit.
    pub unit: String,
    /// What it contains, in a sentence.
    pub definition: String,
}

/// Number of columns before the forces sideways and the outputs: press, t_s, taken_s, z_mm and force_n.
const COMMON: usize = 5;

/// Returns the columns of an array with `channels` outputs in `unit`, and of monitors with these names.
pub fn series_columns(channels: usize, three_axes: bool, unit: &str, monitors: &[&str]) -> Vec<SeriesColumn> {
    const COLUMNS: [(&str, &str); COMMON + 2] = [
        ("press", "Number of the press in the plan, from 0."),
        ("t_s", "Time at which the answer arrived, s since the run's start."),
        (
            "taken_s",
            "Time at which the load cell took the reading, s since the run's start, if it reports it; otherwise t_s.",
        ),
        ("z_mm", "Indenter read back along the specimen's normal, mm; positive into the specimen."),
        ("force_n", "Force, N, relative to the reading without load before the press; pressing positive."),
        ("force_x_n", "Force of the tip along x, N, relative to the reading without load before the press."),
        ("force_y_n", "Force of the tip along y, N, relative to the reading without load before the press."),
    ];
    const OUTPUT: &str = "Output of the channel minus its output without load before the press, in the array's unit.";
    let column = |(name, definition): (&str, &str)| SeriesColumn {
        name: name.to_owned(),
        unit: String::new(),
        definition: definition.to_owned(),
    };
    let common = if three_axes { COMMON + 2 } else { COMMON };
    let outputs = (1..=channels).map(|channel| SeriesColumn {
        name: output_name(channel),
        unit: unit.to_owned(),
        definition: OUTPUT.to_owned(),
    });
    let monitors = monitors.iter().map(|name| column((name, "Value of the monitor, when it was read.")));
    COLUMNS[..common].iter().copied().map(column).chain(outputs).chain(monitors).collect()
}

impl SeriesReadings {
    /// Number of values, which bounds their memory.
    pub fn values(&self) -> usize {
        self.rows.iter().map(SeriesReading::values).sum()
    }
}

impl SeriesReading {
    /// Number of values of 8 bytes that it takes in memory.
    pub fn values(&self) -> usize {
        let outputs = if let ReadValue::Outputs(outputs) = &self.value { outputs.len() } else { 0 };
        size_of::<SeriesReading>() / size_of::<f64>() + outputs
    }
}

impl SeriesReading {
    /// Makes a value as the device returned it relative to a reading without load, which was taken at `zero_s`, and to its drift since.
    pub fn count_from(&mut self, no_load: &NoLoad, zero_s: f64) {
        let drift_n =
            no_load.force.drift.map_or(0.0, |drift| drift.rate_n_s * (self.taken_s.unwrap_or(self.t_s) - zero_s));
        match &mut self.value {
            ReadValue::Force { force_n, side_n } => {
                *force_n -= no_load.force.mean_n + drift_n;
                *side_n = side_n.zip(no_load.force.side_mean_n).map(|(now, from)| [now[0] - from[0], now[1] - from[1]]);
            }
            ReadValue::Outputs(outputs) => {
                outputs.iter_mut().zip(&no_load.outputs).for_each(|(output, no_load)| *output -= no_load);
            }
            ReadValue::Height(_) | ReadValue::Monitor(_) => {}
        }
    }
}
