use super::{End, RunFacts, Session};
use crate::control::{Air, Lesson, Trip};
use crate::device::Identity;
use crate::quantity::{Place, any_number};
use crate::recipe::Phase;
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

/// One record of the journal. What isn't measured but told by the clock and the machine stands in [`Session`] and [`End`]
/// alone: all others are the same to the last bit where a simulated run is made again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Record {
    /// What the run is: the first record.
    Run(RunFacts),
    /// A program begins to measure, or to go on.
    Session(Session),
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
        /// The outputs in air, V.
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
    },
    /// A program came to its end by itself. One that was killed leaves none.
    End(End),
}

impl Record {
    /// When it was made, s since the run's start; none where it says no time.
    pub fn t_s(&self) -> Option<f64> {
        match self {
            Record::Run(_) | Record::Session(_) | Record::Devices(_) => None,
            Record::Contact(contact) => contact.rows.iter().map(|row| row.t_s).reduce(f64::max),
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// The entry's number in the plan.
    pub press: u64,
    /// Its levels in the order they were held.
    pub rows: Vec<Row>,
    /// What really happened at each level, in a simulated run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub truth: Vec<RowTruth>,
    /// What the force loop learned from it for those to come; none if the entry never left the air.
    pub lesson: Option<Lesson>,
    /// What the next press begins from; none after the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left: Option<Left>,
}

/// How a contact was left.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Left {
    /// Where the indenter stood, in the clear above the next place, specimen frame, mm.
    pub z_mm: f64,
    /// What the load cell said on the way there, from the zero; none where a rest came after it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub air: Option<Air>,
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

/// One row of `presses.csv`: one held level of one press.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Row {
    /// The entry of the plan, from 0.
    pub press: u64,
    /// The level of a staircase in the order they are held, from 0; 0 in a plain press.
    pub level: u64,
    /// What the press was made for.
    pub phase: Phase,
    /// Where, specimen frame, mm.
    pub x_mm: f64,
    /// Where, specimen frame, mm.
    pub y_mm: f64,
    /// The commanded force, N.
    pub force_set_n: f64,
    /// The load cell's mean force in the window, N.
    pub force_n: f64,
    /// The depth below the surface as touched in this press, mm; 0 in air.
    pub depth_mm: f64,
    /// When the window began, s since the run's start.
    pub t_s: f64,
    /// Each unit's mean output in the window, less its output in air, V.
    pub outputs: Vec<f64>,
    /// What was wrong with the press; empty: nothing.
    pub flags: Vec<Flag>,
    /// The stage's z in the window, read back, stage frame, mm.
    pub z_mm: f64,
}

/// What can be wrong with a row that is kept all the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Flag {
    /// The force in the window missed the set force by more than the tolerance.
    OutOfTolerance,
    /// An output stood at the end of its range at some time in the window: the load may have been larger.
    Saturated,
    /// The outputs weren't read through the window, or no unit has moved where the load was another.
    Stale,
}

/// One row of `scene.csv`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RowTruth {
    /// Mean true force in the window, N.
    pub force_true_n: f64,
    /// Largest true force since the last row of the press, or since it began, N.
    pub force_peak_n: f64,
    /// Deepest indentation since then, mm.
    pub depth_peak_mm: f64,
}

impl Flag {
    /// The flag as it stands in files.
    pub fn name(self) -> &'static str {
        match self {
            Flag::OutOfTolerance => "out-of-tolerance",
            Flag::Saturated => "saturated",
            Flag::Stale => "stale",
        }
    }
}

impl Row {
    /// The row with its numbers rounded to what the instruments resolve, so that the journal and every table say the same.
    #[must_use]
    pub fn rounded(mut self) -> Row {
        for (value, digits) in [
            (&mut self.x_mm, 6),
            (&mut self.y_mm, 6),
            (&mut self.force_set_n, 6),
            (&mut self.force_n, 6),
            (&mut self.depth_mm, 5),
            (&mut self.t_s, 4),
            (&mut self.z_mm, 5),
        ] {
            *value = round(*value, digits);
        }
        for output in &mut self.outputs {
            *output = round(*output, 7);
        }
        self
    }

    /// The flags as one cell, separated by blanks.
    pub fn flags_text(&self) -> String {
        self.flags.iter().map(|flag| flag.name()).collect::<Vec<_>>().join(" ")
    }

    /// The row as one JSON object with the columns of `presses.csv` as its keys.
    pub fn to_json(&self) -> String {
        serde_json::to_string(&Flat(self)).unwrap_or_default() // numbers and plain text can't fail
    }
}

impl RowTruth {
    /// Rounded to 0.1 uN and 10 nm.
    #[must_use]
    pub fn rounded(self) -> RowTruth {
        RowTruth {
            force_true_n: round(self.force_true_n, 7),
            force_peak_n: round(self.force_peak_n, 7),
            depth_peak_mm: round(self.depth_peak_mm, 5),
        }
    }
}

/// To so many decimals.
pub(crate) fn round(value: f64, digits: i32) -> f64 {
    let scale = 10f64.powi(digits);
    let rounded = (value * scale).round() / scale;
    if !rounded.is_finite() {
        return value; // too large to have decimals
    }
    if rounded == 0.0 { 0.0 } else { rounded } // no "-0"
}

/// A row as a person's JSON reader wants it: flat, `out_1` to `out_n`, flags as text.
struct Flat<'a>(&'a Row);

impl Serialize for Flat<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let row = self.0;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("press", &row.press)?;
        map.serialize_entry("level", &row.level)?;
        map.serialize_entry("phase", row.phase.name())?;
        map.serialize_entry("x_mm", &row.x_mm)?;
        map.serialize_entry("y_mm", &row.y_mm)?;
        map.serialize_entry("force_set_n", &row.force_set_n)?;
        map.serialize_entry("force_n", &row.force_n)?;
        map.serialize_entry("depth_mm", &row.depth_mm)?;
        map.serialize_entry("t_s", &row.t_s)?;
        for (unit, output) in row.outputs.iter().enumerate() {
            map.serialize_entry(&format!("out_{}", unit + 1), output)?;
        }
        map.serialize_entry("flags", &row.flags_text())?;
        map.serialize_entry("z_mm", &row.z_mm)?;
        map.end()
    }
}

#[cfg(test)]
pub(super) fn example(press: u64, level: u64) -> Row {
    Row {
        press,
        level,
        phase: Phase::Calibration,
        x_mm: -5.5,
        y_mm: 6.0,
        force_set_n: 1.0,
        force_n: 0.996_234_567,
        depth_mm: 0.812_345_6,
        t_s: 12.345_67,
        outputs: vec![0.1, -0.000_000_01],
        flags: vec![Flag::OutOfTolerance],
        z_mm: -0.9,
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
        assert_eq!(round(1e305, 6), 1e305);
    }

    #[test]
    fn a_row_is_one_flat_object() {
        assert_eq!(
            example(3, 0).rounded().to_json(),
            "{\"press\":3,\"level\":0,\"phase\":\"calibration\",\"x_mm\":-5.5,\"y_mm\":6.0,\"force_set_n\":1.0,\
             \"force_n\":0.996235,\"depth_mm\":0.81235,\"t_s\":12.3457,\"out_1\":0.1,\"out_2\":0.0,\
             \"flags\":\"out-of-tolerance\",\"z_mm\":-0.9}"
        );
    }
}
