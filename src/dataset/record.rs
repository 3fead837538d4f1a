//! The journal's records.

use super::{End, Loss, Press, Provenance, RunFacts, Text};
use crate::control::{AirReadings, Budget, Hum, Lesson, Trip};
use crate::device::Identity;
use crate::quantity::{Place, any_number, round};
use serde::{Deserialize, Serialize};

/// One record of the journal. What comes from the clock and the machine stands in [`Provenance`], [`Loss`] and [`End`] alone: all
/// others are the same to the last bit when a simulated run is repeated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Record {
    /// What the run is: the first record.
    Run(RunFacts),
    /// A program begins to measure, or to continue.
    Session(Provenance),
    /// A text that the run goes by, as given.
    Text(Text),
    /// What the devices said they are.
    Devices(Vec<Identity>),
    /// The zero was taken in air.
    Zero {
        /// When, s since the run's start.
        t_s: f64,
        /// The load cell's reading in air, N.
        offset_n: f64,
        /// Standard deviation of one reading, N.
        sigma_n: f64,
        /// The mains in it; none where there are none to be seen.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        hum: Option<Hum>,
        /// The outputs in air, in the array's unit.
        outputs: Vec<f64>,
    },
    /// An entry of the plan was measured whole.
    Contact(Contact),
    /// A place that was touched before was touched again, before a run went on.
    Retouch(Retouch),
    /// A safety rule was broken.
    Trip {
        /// When, s since the run's start.
        t_s: f64,
        /// The entry that was under way, if any.
        press: Option<u64>,
        /// The rule and its numbers.
        trip: Trip,
        /// What really happened since the row before, in a simulated run.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        peaks: Option<Peaks>,
    },
    /// A person accepted that presses were lost.
    Loss(Loss),
    /// A program came to its end by itself. One that was killed leaves none.
    End(End),
}

impl Record {
    /// When it was made, s since the run's start; none where it says no time.
    pub fn t_s(&self) -> Option<f64> {
        match self {
            Record::Run(_) | Record::Session(_) | Record::Text(_) | Record::Devices(_) | Record::Loss(_) => None,
            Record::Contact(contact) => contact.levels.iter().filter_map(|press| press.t_s).reduce(f64::max),
            Record::Retouch(Retouch { t_s, .. }) | Record::Zero { t_s, .. } | Record::Trip { t_s, .. } => Some(*t_s),
            Record::End(end) => Some(end.t_s),
        }
    }

    /// The contact, if it is one.
    pub fn contact(&self) -> Option<&Contact> {
        match self {
            Record::Contact(contact) => Some(contact),
            _ => None,
        }
    }
}

/// One contact: a plain press, or a staircase with all its levels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// The entry's number in the plan.
    pub press: u64,
    /// Its levels in the order they were held.
    pub levels: Vec<Press>,
    /// How well the force of each level is known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub budgets: Vec<Budget>,
    /// What really happened at each level, in a simulated run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub truth: Vec<PressTruth>,
    /// What the force loop learned from it for later ones; none if the entry never left the air.
    pub lesson: Option<Lesson>,
    /// The air before it: forces and outputs count from there.
    pub air_before: Air,
    /// The air after it: forces count from between the two, as time goes.
    pub air_after: Air,
    /// What the next press begins from; none after the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left: Option<Left>,
}

/// How a contact was left.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Left {
    /// Where the indenter stood, in the clear above the next place, specimen frame, mm.
    pub z_mm: f64,
}

/// What load cell and array read in air.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Air {
    /// The load cell.
    #[serde(flatten)]
    pub force: AirReadings,
    /// The mean of each output, in the array's unit.
    pub outputs: Vec<f64>,
}

/// A place that was touched again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Retouch {
    /// When, s since the run's start.
    pub t_s: f64,
    /// The place, specimen frame.
    #[serde(flatten)]
    pub place: Place,
    /// Where contact began before, mm into the specimen.
    pub before_mm: f64,
    /// Where it began now, mm into the specimen; NaN: nowhere.
    #[serde(with = "any_number")]
    pub touched_mm: f64,
}

/// One row of `scene.csv`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PressTruth {
    /// Mean true force in the window, N.
    pub force_true_n: f64,
    /// Largest true force since the last row of the press, or since it began, N.
    pub force_peak_n: f64,
    /// Deepest indentation since then, mm.
    pub depth_peak_mm: f64,
}

/// The worst that really happened in a press that tripped.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peaks {
    /// Largest true force, N.
    pub force_peak_n: f64,
    /// Deepest indentation, mm.
    pub depth_peak_mm: f64,
}

impl PressTruth {
    /// Rounded to 0.1 uN and 10 nm.
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
    fn what_is_no_number_is_written_and_read_again() {
        for touched_mm in [f64::INFINITY, f64::NEG_INFINITY, 0.1] {
            let retouch = Record::Retouch(Retouch { t_s: 1.0, place: Place::default(), before_mm: 0.0, touched_mm });
            let text = serde_json::to_string(&retouch).unwrap();
            assert_eq!(serde_json::from_str::<Record>(&text).unwrap(), retouch, "{text}");
        }
        let trip = Trip::new(crate::control::Rule::Noisy, f64::NAN, 1.0, "N");
        let read: Trip = serde_json::from_str(&serde_json::to_string(&trip).unwrap()).unwrap();
        assert!(read.measured.is_nan() && read.limit == 1.0);
    }
}
