//! Events of a batch: the records of its journal, the lines of `--json`, and what a program of the user's is notified of.

use palpate_data::acceptance::{Judgement, LimitCheck, SensorVerdict};
use palpate_data::dataset::{Fingerprint, Logged, RecordedText, Status};
use palpate_solver::UnitChange;
use serde::{Deserialize, Serialize};

/// One event. `at` is the time of the event with its time zone, as in a run's manifest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BatchEvent {
    /// Description of the batch: the first record.
    Batch(Facts),
    /// A text that the batch uses, unchanged.
    Text(RecordedText),
    /// A program begins to work on the batch, or continues.
    Session(BatchSession),
    /// More serial numbers were added.
    Added {
        /// Time of the event.
        at: String,
        /// The serial numbers.
        serials: Vec<String>,
    },
    /// A sensor is on the bench, and its run begins.
    Began(Began),
    /// The runs of a sensor ended. A program that was killed leaves no such record: the sensor is interrupted.
    Ended(Ended),
    /// A person postponed the reference sensor, which was due, until after the next sensor.
    Postponed {
        /// Time of the event.
        at: String,
    },
    /// A person skipped a sensor.
    Skipped {
        /// Time of the event.
        at: String,
        /// Serial number.
        serial: String,
    },
    /// A person allowed a sensor to be calibrated again.
    Retry {
        /// Time of the event.
        at: String,
        /// Serial number.
        serial: String,
    },
    /// A person's note about a sensor.
    Noted {
        /// Time of the event.
        at: String,
        /// Serial number.
        serial: String,
        /// The note.
        note: String,
    },
    /// A typed serial number was refused.
    Refused {
        /// Time of the event.
        at: String,
        /// The typed text.
        typed: String,
        /// Reason for the person.
        reason: String,
    },
    /// A control chart shows a change.
    Alarm(Alarm),
    /// A person paused the run of a sensor: the stage is parked between two presses. It is published, but not recorded, because nothing
    /// about the sensor follows from it.
    Paused {
        /// Time of the event.
        at: String,
        /// Serial number.
        serial: String,
    },
    /// The program ended its work on the batch. A program that was killed leaves no such record.
    Closed {
        /// Time of the event.
        at: String,
    },
}

/// Format of the batch journals that this program writes and reads.
pub const BATCH_FORMAT: u32 = 1;

impl Logged for BatchEvent {
    const FIRST: &'static str = "batch";
    const FORMAT: u32 = BATCH_FORMAT;
}

/// Description of a batch.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Facts {
    /// Version of the journal's format.
    pub format: u32,
    /// Name of the batch.
    pub name: String,
    /// Time of its creation.
    pub at: String,
    /// Name of the design.
    pub design: String,
    /// Journals of the full calibrations that make the design's prior; empty if every sensor is calibrated alone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub prior: Vec<Fingerprint>,
    /// Normal values of the charted quantities.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub charted: Vec<Charted>,
    /// The reference sensor; `None` if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference: Option<ReferenceSensor>,
    /// Random seed of a simulated batch: specimens, noise and places.
    #[serde(default)]
    pub seed: u64,
    /// Whether this program's emulators are at the other ends of the links.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub simulated: bool,
}

/// Normal values of a quantity that is charted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Charted {
    /// Name of the quantity.
    pub quantity: String,
    /// Mean of the design.
    pub mean: f64,
    /// Standard deviation of the sensors of the design.
    pub sd: f64,
    /// Standard deviation of repeated measurements of one sensor.
    pub reference_sd: f64,
    /// Number of sensors that gave mean and standard deviation.
    pub sensors: usize,
}

/// The reference sensor, which shows whether the bench has changed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReferenceSensor {
    /// Serial number.
    pub serial: String,
    /// Number of sensors after which it is measured again.
    pub every: u64,
}

/// A program that works on the batch.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BatchSession {
    /// Time of the event.
    pub at: String,
    /// Version of the program.
    pub version: String,
    /// Name of the bench: that of the rig file, or the one that the batch file states.
    pub bench: String,
    /// Name of the operator.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
}

/// A sensor on the bench.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Began {
    /// Time of the event.
    pub at: String,
    /// Serial number.
    pub serial: String,
    /// Whether it is the reference sensor.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub reference: bool,
    /// Nest on the tray.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nest: Option<String>,
    /// Folder of the sensor's first run, relative to the batch folder.
    pub run: String,
}

/// The result of a sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ended {
    /// Time of the event.
    pub at: String,
    /// Serial number.
    pub serial: String,
    /// Whether it is the reference sensor.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub reference: bool,
    /// Folders of its runs, relative to the batch folder.
    pub runs: Vec<String>,
    /// Status of its last run.
    pub status: Status,
    /// The verdict; `None` for a reference sensor, and if the runs are incomplete.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<SensorVerdict>,
    /// Reasons for a verdict other than accepted, and what a person should know.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<String>,
    /// Figures that the acceptance rule limits.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub found: Vec<SensorFigure>,
    /// Number of calibration presses that count.
    pub calibration_presses: usize,
    /// Number of test presses that count.
    pub test_presses: usize,
    /// Time from the beginning of the first run to the end of the last, minutes.
    pub minutes: f64,
    /// Difference between the sensor and its design, one value for each unit; empty without a prior.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub change: Vec<UnitChange>,
    /// Whether the sensor was refused, because it isn't one of the design.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub refused: bool,
    /// File of the calibrated sensor, relative to the batch folder; `None` if none was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
}

impl Ended {
    /// Returns the same with a verdict.
    #[must_use]
    pub fn judged(self, judgement: &Judgement) -> Self {
        Ended {
            verdict: Some(judgement.verdict),
            reasons: self.reasons.into_iter().chain(judgement.all_reasons()).collect(),
            found: judgement.checks.iter().map(SensorFigure::of).collect(),
            calibration_presses: judgement.calibration_presses,
            test_presses: judgement.test_presses,
            ..self
        }
    }
}

impl SensorFigure {
    /// Returns what a check found.
    pub fn of(check: &LimitCheck) -> Self {
        let LimitCheck { figure, value, bound, limit, verdict, .. } = check;
        SensorFigure { figure: (*figure).to_owned(), value: *value, bound: *bound, limit: *limit, verdict: *verdict }
    }
}

/// A figure of a sensor and its limit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorFigure {
    /// Key of the figure in the acceptance rule.
    pub figure: String,
    /// Measured value, in the figure's unit; `None` if it wasn't measured.
    pub value: Option<f64>,
    /// One-sided 95 % bound, for a guarded rule.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bound: Option<f64>,
    /// The limit.
    pub limit: f64,
    /// Result of this limit alone.
    pub verdict: SensorVerdict,
}

/// Alarm of a control chart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Alarm {
    /// Time of the event.
    pub at: String,
    /// Serial number of the sensor that showed it.
    pub serial: String,
    /// What changed.
    pub cause: Cause,
    /// Quantity that changed.
    pub quantity: String,
    /// Value of the chart's statistic, in standard deviations.
    pub sigmas: f64,
    /// Its limit, in standard deviations.
    pub limit: f64,
}

/// What an alarm is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cause {
    /// The bench changed: the reference sensor shows it.
    Bench,
    /// The sensors of the batch changed, and the bench didn't.
    Batch,
}
