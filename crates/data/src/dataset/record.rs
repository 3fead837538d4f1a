//! Records of the journal.

use super::journal::Logged;
use super::{
    FORMAT, Loss, MissedReading, Press, Provenance, RecordedCheck, RecordedText, RunFacts, SeriesMark, SessionEnd,
};
use palpate_control::{LearnedContact, MainsInterference, NoLoadReadings, Trip, UncertaintyBudget};
use palpate_core::quantity::Identity;
use palpate_core::quantity::{Place, any_number, round};
use serde::{Deserialize, Serialize};

/// One record of the journal. Only [`Provenance`], [`Loss`] and [`SessionEnd`] depend on the clock and the machine. All others are the
/// same to the last bit when a simulated run is repeated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Record {
    /// Description of the run: the first record.
    Run(RunFacts),
    /// A program begins to measure, or continues.
    Session(Provenance),
    /// A text that the run uses, unchanged.
    Text(RecordedText),
    /// Identities reported by the devices.
    Devices(Vec<Identity>),
    /// The zero was measured without load.
    Zero {
        /// Time, s since the run's start.
        t_s: f64,
        /// The load cell's reading without load, N.
        offset_n: f64,
        /// Standard deviation of one reading, N.
        sigma_n: f64,
        /// Mains interference in the reading; `None` if no mains interference can be seen.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[serde(rename = "hum")]
        mains: Option<MainsInterference>,
        /// Outputs without load, in the array's unit.
        outputs: Vec<f64>,
    },
    /// An entry of the plan was measured completely.
    Contact(RecordedContact),
    /// A place was pressed again, to check that load cell and sensor haven't changed.
    Check(RecordedCheck),
    /// A place was touched again before a run continued.
    Retouch(Retouch),
    /// The surface from which depths count, in a run without a load cell.
    Surface(RecordedSurface),
    /// A reading of the array or of a monitor was missed. The press is made again.
    Missed(MissedReading),
    /// A safety rule was broken.
    Trip {
        /// Time, s since the run's start.
        t_s: f64,
        /// Entry that was being executed, if any.
        press: Option<u64>,
        /// The rule and its numbers.
        trip: Trip,
        /// True peaks since the previous row, in a simulated run.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        peaks: Option<Peaks>,
    },
    /// A person accepted that presses were lost, or that it is another journal.
    Loss(Loss),
    /// A program ended in a controlled way. A program that was killed leaves no such record.
    End(SessionEnd),
}

impl Record {
    /// Returns the time of the record, s since the run's start; `None` if it has no time.
    pub fn t_s(&self) -> Option<f64> {
        match self {
            Record::Run(_) | Record::Session(_) | Record::Text(_) | Record::Devices(_) | Record::Loss(_) => None,
            Record::Contact(contact) | Record::Check(RecordedCheck { contact, .. }) => contact.t_s(),
            Record::Surface(surface) => Some(surface.t_s),
            Record::Missed(missed) => Some(missed.t_s),
            Record::Retouch(Retouch { t_s, .. }) | Record::Zero { t_s, .. } | Record::Trip { t_s, .. } => Some(*t_s),
            Record::End(end) => Some(end.t_s),
        }
    }

    /// Returns the contact, if the record is a contact of the plan.
    pub fn contact(&self) -> Option<&RecordedContact> {
        match self {
            Record::Contact(contact) => Some(contact),
            _ => None,
        }
    }
}

impl Logged for Record {
    const FIRST: &'static str = "run";
    const FORMAT: u32 = FORMAT;

    fn check(&self) -> Result<(), String> {
        // JSON has no NaN: it would be read as a missing number
        let contact = match self {
            Record::Check(check) => Some(&check.contact),
            record => record.contact(),
        };
        let is_finite = |contact: &RecordedContact| {
            let monitors = contact.monitors.iter().all(|monitor| monitor.value.is_finite());
            monitors && contact.levels.iter().all(Press::is_finite)
        };
        match contact.is_none_or(is_finite) {
            true => Ok(()),
            false => Err("not a finite number".to_owned()),
        }
    }
}

/// One contact: a plain press, or a staircase with all its levels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RecordedContact {
    /// Number of the entry in the plan.
    pub press: u64,
    /// Levels of the contact in the order of measurement.
    pub levels: Vec<Press>,
    /// Uncertainty budget of each level's force.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub budgets: Vec<UncertaintyBudget>,
    /// True values at each level, in a simulated run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub truth: Vec<PressTruth>,
    /// Data that the force loop learned from the contact for later contacts; `None` if the entry never came into contact.
    #[serde(rename = "lesson")]
    pub learned_contact: Option<LearnedContact>,
    /// No-load readings before the contact: the zero of the outputs, and the first zero of the forces.
    #[serde(rename = "air_before")]
    pub no_load_before: NoLoad,
    /// No-load readings after the contact. The zero of the forces is interpolated in time between the two no-load readings.
    #[serde(rename = "air_after")]
    pub no_load_after: NoLoad,
    /// State from which the next press begins; `None` after the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left: Option<Left>,
    /// Values of the rig's monitors at the contact, in the order of the rig.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub monitors: Vec<MonitorValue>,
    /// Times in which all devices were read after the last level.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub followed: Vec<FollowedTime>,
    /// File of readings with those of this contact; `None` if none are kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub series: Option<SeriesMark>,
}

impl RecordedContact {
    /// Returns the time of the last level, s since the run's start.
    pub fn t_s(&self) -> Option<f64> {
        self.levels.iter().filter_map(|press| press.t_s).reduce(f64::max)
    }
}

/// Value of a monitor, which was read without load before a contact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MonitorValue {
    /// Name of the monitor, which ends in its unit.
    pub name: String,
    /// The value, rounded to 6 decimals.
    pub value: f64,
    /// Time of the reading, s since the run's start. Several contacts may have one reading.
    pub t_s: f64,
}

/// Time in which all devices were read, at rest or in a motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FollowedTime {
    /// Begin, s since the run's start.
    pub from_s: f64,
    /// End, s since the run's start.
    pub to_s: f64,
    /// Speed of the motion, mm/s, positive into the specimen; `None` at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_mm_s: Option<f64>,
    /// Whether the force was restored; otherwise z rested.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub holds_force: bool,
}

/// State at the end of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Left {
    /// z of the indenter in the clear above the next place, specimen frame, mm.
    pub z_mm: f64,
}

/// Readings of load cell and array without load.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NoLoad {
    /// Readings of the load cell.
    #[serde(flatten)]
    pub force: NoLoadReadings,
    /// Mean of each output, in the array's unit.
    pub outputs: Vec<f64>,
}

/// A place that was touched again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Retouch {
    /// Time, s since the run's start.
    pub t_s: f64,
    /// The place, specimen frame.
    #[serde(flatten)]
    pub place: Place,
    /// Depth at which contact began earlier, mm into the specimen.
    pub before_mm: f64,
    /// Depth at which contact began this time, mm into the specimen; NaN if there was no contact.
    #[serde(with = "any_number")]
    pub touched_mm: f64,
}

/// The surface at a place, found without a load cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RecordedSurface {
    /// Time, s since the run's start.
    pub t_s: f64,
    /// The place, specimen frame.
    #[serde(flatten)]
    pub place: Place,
    /// z of the surface, mm into the specimen from where the frame states it.
    pub z_mm: f64,
    /// Who found it.
    pub by: SurfaceFinder,
}

/// What found a surface without a load cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SurfaceFinder {
    /// The outputs of the array left their noise.
    Array,
    /// A person touched it in steps, and confirms that it is where the frame states.
    Person,
}

/// One row of `scene.csv`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PressTruth {
    /// Mean true force in the window, N.
    pub force_true_n: f64,
    /// Largest true force since the previous row of the press, or since its beginning, N.
    pub force_peak_n: f64,
    /// Largest indentation since then, mm.
    pub depth_peak_mm: f64,
}

/// Largest true values in a press that tripped.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peaks {
    /// Largest true force, N.
    pub force_peak_n: f64,
    /// Largest indentation, mm.
    pub depth_peak_mm: f64,
}

impl PressTruth {
    /// Returns its peaks, rounded.
    pub fn peaks(self) -> Peaks {
        let PressTruth { force_peak_n, depth_peak_mm, .. } = self.rounded();
        Peaks { force_peak_n, depth_peak_mm }
    }

    /// Returns the values rounded to 0.1 uN and 10 nm.
    #[must_use]
    pub fn rounded(self) -> PressTruth {
        PressTruth {
            force_true_n: round(self.force_true_n, 7),
            force_peak_n: round(self.force_peak_n, 7),
            depth_peak_mm: round(self.depth_peak_mm, 5),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_and_infinity_survive_a_round_trip() {
        for touched_mm in [f64::INFINITY, f64::NEG_INFINITY, 0.1] {
            let retouch = Record::Retouch(Retouch { t_s: 1.0, place: Place::default(), before_mm: 0.0, touched_mm });
            let text = serde_json::to_string(&retouch).unwrap();
            assert_eq!(serde_json::from_str::<Record>(&text).unwrap(), retouch, "{text}");
        }
        let trip = Trip::new(palpate_control::SafetyRule::Noisy, f64::NAN, 1.0, "N");
        let read: Trip = serde_json::from_str(&serde_json::to_string(&trip).unwrap()).unwrap();
        assert!(read.measured.is_nan() && read.limit == 1.0);
    }
}
