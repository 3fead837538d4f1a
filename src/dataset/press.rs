//! One press, and the columns it has: the CSV header, the journal's fields, the JSON keys and both readers follow from one list.
//!
//! A new column is one line of the list below, and the place that measures it.

use super::Flag;
use super::cell::{Cell, Misread, Value};
use crate::quantity::Place;
use crate::recipe::Phase;
use serde::{Deserialize, Serialize, Serializer, ser::SerializeMap};

/// Which tables have a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// Every table.
    Needed,
    /// Any table may have it.
    Optional,
    /// Only a run's own table; a table from elsewhere may use the name for something else.
    Run,
    /// Only a run's own table, and there a cell may be empty.
    Sparse,
}

/// One column of a table of presses.
#[derive(Clone, Copy)]
pub struct Column {
    /// Its name in a header and in JSON. [`OUTPUTS`] stands for `out_1`, `out_2`, ...: one a channel.
    pub name: &'static str,
    /// Which tables have it.
    pub presence: Presence,
    pub(super) write: Write,
    pub(super) read: Read,
    round: fn(&mut Press),
}

/// Gives the values of a press in a column, one a cell.
type Write = fn(&Press, &mut dyn FnMut(Value<'_>));
/// Takes the cells of a row in a column, one or one a channel.
type Read = fn(&mut Press, &[&str]) -> Result<(), Misread>;

/// The name of the column that stands for one column a channel.
pub const OUTPUTS: &str = "outputs";

/// Declares the columns in the order of `presses.csv`: `name: type, presence, decimals` (the decimals an instrument resolves).
macro_rules! columns {
    ($($(#[$meta:meta])* $name:ident: $kind:ty, $presence:ident, $decimals:literal;)*) => {
        /// One held level of one press: a row of `presses.csv`. None: the table it comes from doesn't say.
        #[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
        pub struct Press { $($(#[$meta])* pub $name: $kind,)* }

        /// The columns in the order in which they are written.
        pub const COLUMNS: &[Column] = &[$(Column {
            name: stringify!($name),
            presence: Presence::$presence,
            write: |press, out| press.$name.write(out),
            read: |press, cells| Cell::read(cells).map(|value| press.$name = value),
            round: |press| press.$name.round_to($decimals),
        },)*];
    };
}

columns! {
    /// The entry of the plan, from 0; in a table from elsewhere the row, from 0. The levels of a staircase share it.
    press: u64, Run, 0;
    /// The level of a staircase in the order they are held, from 0; 0 in a plain press.
    level: u64, Run, 0;
    /// What the press was made for.
    phase: Option<Phase>, Run, 0;
    /// Where, specimen frame, mm.
    x_mm: f64, Needed, 6;
    /// Where, specimen frame, mm.
    y_mm: f64, Needed, 6;
    /// The commanded force, N.
    force_set_n: Option<f64>, Run, 6;
    /// The mean force in the window, N, from the air before and after the press.
    force_n: Option<f64>, Optional, 6;
    /// Standard uncertainty of that force, N; none where neither a certificate nor a check weight says what the load cell errs by.
    u_force_n: Option<f64>, Sparse, 6;
    /// The depth below the surface as touched in this press, mm; 0 in air.
    depth_mm: Option<f64>, Run, 5;
    /// When the window began, s since the run's start.
    t_s: Option<f64>, Run, 4;
    /// Each channel's mean output in the window, less its output in air, in the array's unit.
    outputs: Vec<f64>, Needed, 7;
    /// What was wrong with the press; empty: nothing.
    flags: Vec<Flag>, Optional, 0;
    /// The stage's z in the window, read back, stage frame, mm.
    z_mm: Option<f64>, Run, 5;
    /// What the load cell read in air before the press, N.
    air_before_n: Option<f64>, Sparse, 6;
    /// What it read in air after it, N: forces count from between the two, as time goes.
    air_after_n: Option<f64>, Sparse, 6;
}

impl Column {
    /// The names that the column has in a header, for an array of so many channels.
    pub fn names(&self, channels: usize) -> Vec<String> {
        match self.name {
            OUTPUTS => (1..=channels).map(output_name).collect(),
            name => vec![name.to_owned()],
        }
    }
}

/// The name of a channel's column, the channel counted from 1.
pub fn output_name(channel: usize) -> String {
    format!("out_{channel}")
}

impl Press {
    /// Where it was made, specimen frame.
    pub fn place(&self) -> Place {
        Place::new(self.x_mm, self.y_mm)
    }

    /// Whether it was made for that phase.
    pub fn is_of(&self, phase: Phase) -> bool {
        self.phase == Some(phase)
    }

    /// Whether something was wrong with it.
    pub fn is_flagged(&self) -> bool {
        !self.flags.is_empty()
    }

    /// Whether each of its numbers is one.
    pub fn is_finite(&self) -> bool {
        let mut is_finite = true;
        for column in COLUMNS {
            (column.write)(self, &mut |value| {
                is_finite &= !matches!(value, Value::Number(number) if !number.is_finite());
            });
        }
        is_finite
    }

    /// The press with its numbers rounded to what the instruments resolve, so that the journal and every table say the same.
    #[must_use]
    pub fn rounded(mut self) -> Press {
        COLUMNS.iter().for_each(|column| (column.round)(&mut self));
        self
    }

    /// The press as one JSON object with the columns of `presses.csv` as its keys.
    pub fn to_json(&self) -> String {
        serde_json::to_string(&Flat(self)).unwrap_or_default() // numbers and plain text can't fail
    }
}

/// The first line of `presses.csv`.
pub(super) fn csv_header(channels: usize) -> String {
    let names: Vec<String> = COLUMNS.iter().flat_map(|column| column.names(channels)).collect();
    names.join(",") + "\n"
}

/// One line of `presses.csv`. No cell needs quoting: numbers, and words of our own.
pub(super) fn csv_line(press: &Press) -> String {
    let mut line = String::new();
    for column in COLUMNS {
        (column.write)(press, &mut |value| {
            value.push_to(&mut line);
            line.push(',');
        });
    }
    line.pop();
    line + "\n"
}

/// A press as a person's JSON reader wants it: flat, `out_1` to `out_n`, flags as text.
struct Flat<'a>(&'a Press);

impl Serialize for Flat<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        let mut first_error = Ok(());
        for column in COLUMNS {
            let mut names = column.names(self.0.outputs.len()).into_iter();
            (column.write)(self.0, &mut |value| {
                if let (Ok(()), Some(name)) = (&first_error, names.next()) {
                    first_error = map.serialize_entry(&name, &value);
                }
            });
        }
        first_error?;
        map.end()
    }
}

#[cfg(test)]
pub(super) fn example(press: u64, level: u64) -> Press {
    Press {
        press,
        level,
        phase: Some(Phase::Calibration),
        x_mm: -5.5,
        y_mm: 6.0,
        force_set_n: Some(1.0),
        force_n: Some(0.996_234_567),
        u_force_n: Some(0.001_234_567),
        depth_mm: Some(0.812_345_6),
        t_s: Some(12.345_67),
        outputs: vec![0.1, -0.000_000_01],
        flags: vec![Flag::OutOfTolerance],
        z_mm: Some(-0.9),
        air_before_n: Some(0.001),
        air_after_n: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_line_and_json_follow_from_the_columns() {
        let press = example(3, 0).rounded();
        assert_eq!(
            csv_header(2),
            "press,level,phase,x_mm,y_mm,force_set_n,force_n,u_force_n,depth_mm,t_s,out_1,out_2,flags,z_mm,air_before_n,air_after_n\n"
        );
        assert_eq!(
            csv_line(&press),
            "3,0,calibration,-5.5,6,1,0.996235,0.001235,0.81235,12.3457,0.1,0,out-of-tolerance,-0.9,0.001,\n"
        );
        assert_eq!(
            press.to_json(),
            "{\"press\":3,\"level\":0,\"phase\":\"calibration\",\"x_mm\":-5.5,\"y_mm\":6.0,\"force_set_n\":1.0,\
             \"force_n\":0.996235,\"u_force_n\":0.001235,\"depth_mm\":0.81235,\"t_s\":12.3457,\"out_1\":0.1,\"out_2\":0.0,\
             \"flags\":\"out-of-tolerance\",\"z_mm\":-0.9,\"air_before_n\":0.001,\"air_after_n\":null}"
        );
    }

    #[test]
    fn the_journals_fields_are_the_columns() {
        let fields = serde_json::to_value(example(3, 0)).unwrap();
        let mut names: Vec<&String> = fields.as_object().unwrap().keys().collect();
        let mut columns: Vec<&str> = COLUMNS.iter().map(|column| column.name).collect();
        names.sort();
        columns.sort_unstable();
        assert_eq!(names, columns);
    }
}
