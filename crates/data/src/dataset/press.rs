//! One press and its columns. The CSV header, the journal's fields, the JSON keys and both readers follow from one list.
//!
//! A new column requires one line in the list below, and code that measures it.

use super::Flag;
use super::cell::{CellContent, CellType, CellValue, Misread};
use crate::recipe::Phase;
use palpate_control::SetPoint;
use palpate_core::quantity::Place;
use palpate_solver::vector::VectorRow;
use serde::{Deserialize, Serialize, Serializer, ser::SerializeMap};

/// Tables that have a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// Every table.
    Needed,
    /// Any table may have it.
    Optional,
    /// Any table may have it, and a run's own table must.
    OfRun,
    /// Only a run's own table. An external table may use the name for something else.
    Run,
    /// Only a run's own table, in which a cell may be empty.
    Sparse,
    /// The same, in a run with presses by depth.
    ByDepth,
    /// The same, in a run on a rig whose load cell has three axes.
    ThreeAxes,
    /// The same, in an import whose presses have groups.
    Grouped,
}

/// One column of a table of presses.
#[derive(Clone, Copy)]
pub struct PressColumn {
    /// Name in a header and in JSON. [`OUTPUTS`] means `out_1`, `out_2`, ...: one for each channel.
    pub name: &'static str,
    /// Tables that have the column.
    pub presence: Presence,
    /// What the column contains, in a sentence.
    pub definition: &'static str,
    /// Type of its values.
    pub kind: CellType,
    pub(super) write: Write,
    pub(super) read: ReadCells,
    round: fn(&mut Press),
}

/// Function that writes the values of a press in a column, one for each cell.
type Write = fn(&Press, &mut dyn FnMut(CellValue<'_>));
/// Function that reads the cells of a row in a column, one cell or one for each channel.
type ReadCells = fn(&mut Press, &[&str]) -> Result<(), Misread>;

/// Name of the column entry that represents one column for each channel.
pub const OUTPUTS: &str = "outputs";

/// Declares the columns in the order of `presses.csv`: `name: type, presence, decimals` (the number of decimals that an
/// instrument resolves). The comment of a column is its definition in exported files.
macro_rules! columns {
    ($($(#[doc = $doc:literal])* $(#[serde($($serde:tt)*)])? $name:ident: $kind:ty, $presence:ident, $decimals:literal;)*) => {
        /// One level of one press: a row of `presses.csv`. `None` means that the source table doesn't contain the value.
        #[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
        pub struct Press { $($(#[doc = $doc])* $(#[serde($($serde)*)])? pub $name: $kind,)* }

        /// Columns in the order in which they are written.
        pub const COLUMNS: &[PressColumn] = &[$(PressColumn {
            name: stringify!($name),
            presence: Presence::$presence,
            definition: concat!($($doc),*).trim_ascii(),
            kind: <$kind as CellContent>::KIND,
            write: |press, out| press.$name.write(out),
            read: |press, cells| CellContent::read(cells).map(|value| press.$name = value),
            round: |press| press.$name.round_to($decimals),
        },)*];
    };
}

columns! {
    /// Entry of the plan, from 0; in an external table the row, from 0. The levels of a staircase have the same entry.
    press: u64, Run, 0;
    /// Level of a staircase in the order of measurement, from 0; 0 in a plain press.
    level: u64, Run, 0;
    /// Purpose of the press.
    phase: Option<Phase>, Run, 0;
    /// x of the press, specimen frame, mm.
    x_mm: f64, Needed, 6;
    /// y of the press, specimen frame, mm.
    y_mm: f64, Needed, 6;
    /// Commanded force, N; `None` in a press by depth.
    force_set_n: Option<f64>, Sparse, 6;
    /// Commanded depth below the surface touched in this press, mm; `None` in a press by force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    depth_set_mm: Option<f64>, ByDepth, 6;
    /// Mean force in the window, N, relative to the readings without load before and after the press.
    force_n: Option<f64>, Optional, 6;
    /// Standard uncertainty of that force, N; `None` if neither a certificate nor a check weight gives the load cell's error.
    u_force_n: Option<f64>, Sparse, 6;
    /// Mean force of the tip on the specimen along x in the window, N; only of a load cell with three axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    force_x_n: Option<f64>, ThreeAxes, 6;
    /// Mean force of the tip on the specimen along y in the window, N; only of a load cell with three axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    force_y_n: Option<f64>, ThreeAxes, 6;
    /// Standard uncertainty of the force along x, N; empty if neither a certificate nor a check along the axes gives the cell's error.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    u_force_x_n: Option<f64>, ThreeAxes, 6;
    /// Standard uncertainty of the force along y, N.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    u_force_y_n: Option<f64>, ThreeAxes, 6;
    /// Way in contact from the place of the press to that of the window, mm; only of a load cell with three axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    drag_mm: Option<f64>, ThreeAxes, 6;
    /// Number of slips on that way.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    slips: Option<f64>, ThreeAxes, 0;
    /// Depth below the surface touched in this press, mm; 0 without load.
    depth_mm: Option<f64>, OfRun, 5;
    /// Standard uncertainty of that depth, mm; `None` if the stage has no certificate or the load cell's stiffness isn't stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    u_depth_mm: Option<f64>, ByDepth, 5;
    /// Start of the window, s since the run's start.
    t_s: Option<f64>, Optional, 4;
    /// Group of the press in the imported table, from 0 in the order of first appearance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    group: Option<f64>, Grouped, 0;
    /// Mean output of each channel in the window minus its output without load, in the array's unit; empty if it was missed.
    #[serde(with = "missable")]
    outputs: Vec<f64>, Needed, 7;
    /// Faults of the press; empty if there are none.
    flags: Vec<Flag>, Optional, 0;
    /// z of the stage in the window, read back, stage frame, mm.
    z_mm: Option<f64>, Run, 5;
    /// Reading of the load cell without load before the press, N.
    air_before_n: Option<f64>, Sparse, 6;
    /// Reading of the load cell without load after the press, N. The zero of the force is interpolated in time between the two air
    /// readings.
    air_after_n: Option<f64>, Sparse, 6;
}

impl PressColumn {
    /// Passes the values of a press in the column on, one for each cell.
    pub fn write(&self, press: &Press, out: &mut dyn FnMut(CellValue<'_>)) {
        (self.write)(press, out);
    }

    /// Returns the column's names in a header for an array with `channels` channels.
    pub fn names(&self, channels: usize) -> Vec<String> {
        match self.name {
            OUTPUTS => (1..=channels).map(output_name).collect(),
            name => vec![name.to_owned()],
        }
    }
}

/// Returns the name of a channel's column; the channel is counted from 1.
pub fn output_name(channel: usize) -> String {
    format!("out_{channel}")
}

/// Whether a column of the table of presses has this name, or the column of a channel would have it.
pub fn is_press_column(name: &str) -> bool {
    name.starts_with("out_") || COLUMNS.iter().any(|column| column.name == name)
}

impl Press {
    /// Returns the place of the press, specimen frame.
    pub fn place(&self) -> Place {
        Place::new(self.x_mm, self.y_mm)
    }

    /// Whether the press was made for that phase. The window after a drag belongs to no phase: only the table of presses has it.
    pub fn is_of(&self, phase: Phase) -> bool {
        self.phase == Some(phase) && !self.is_dragged()
    }

    /// What the press was set to; `None` if the table doesn't contain it.
    pub fn set_point(&self) -> Option<SetPoint> {
        self.depth_set_mm.map(SetPoint::Depth).or(self.force_set_n.map(SetPoint::Force))
    }

    /// Whether the tip was dragged in contact. Solvers of pressing forces leave such a press out.
    pub fn is_dragged(&self) -> bool {
        self.drag_mm.is_some_and(|mm| mm > 0.0)
    }

    /// Returns the force along x, y and the press, N; `None` if a component is unknown.
    pub fn force_vector_n(&self) -> Option<[f64; 3]> {
        Some([self.force_x_n?, self.force_y_n?, self.force_n?])
    }

    /// Returns what a vector calibration uses; `None` if a component of the force is unknown or the press has a fault.
    pub fn vector_row(&self) -> Option<VectorRow<'_>> {
        let force_n = self.force_vector_n()?;
        (!self.is_flagged()).then(|| VectorRow { place: self.place(), force_n, outputs: &self.outputs })
    }

    /// Whether the press has a fault.
    pub fn is_flagged(&self) -> bool {
        !self.flags.is_empty()
    }

    /// Whether all of its numbers are finite. Only a press with missed readings may lack outputs.
    pub fn is_finite(&self) -> bool {
        let may_lack = self.flags.contains(&Flag::Missed);
        let mut is_finite = may_lack || self.outputs.iter().all(|output| !output.is_nan());
        for column in COLUMNS {
            (column.write)(self, &mut |value| {
                is_finite &= !matches!(value, CellValue::Number(number) if !number.is_finite());
            });
        }
        is_finite
    }

    /// Returns the press with its numbers rounded to the resolution of the instruments, so that the journal and every table
    /// agree.
    #[must_use]
    pub fn rounded(mut self) -> Press {
        COLUMNS.iter().for_each(|column| (column.round)(&mut self));
        self
    }

    /// Returns the columns of the press outside a table. Only a press by depth has a set depth, and only three axes have
    /// forces sideways.
    pub fn columns(&self) -> impl Iterator<Item = &'static PressColumn> {
        let three_axes = self.force_x_n.is_some();
        let by_depth = self.depth_set_mm.is_some();
        RunColumns { by_depth, has_load_cell: true, three_axes, grouped: self.group.is_some() }.all()
    }

    /// Returns the press as one JSON object with the columns of `presses.csv` as its keys.
    pub fn to_json(&self) -> String {
        serde_json::to_string(&Flat(self)).unwrap_or_default() // numbers and plain text can't fail
    }
}

/// Which columns the table of a run has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunColumns {
    /// Whether presses are by depth.
    pub by_depth: bool,
    /// Whether the rig has a load cell.
    pub has_load_cell: bool,
    /// Whether the load cell has three axes.
    pub three_axes: bool,
    /// Whether the presses have groups.
    pub grouped: bool,
}

/// Columns that only a rig with a load cell has.
const OF_LOAD_CELL: [&str; 5] = ["force_set_n", "force_n", "u_force_n", "air_before_n", "air_after_n"];

impl RunColumns {
    /// Returns the columns in order.
    pub fn all(self) -> impl Iterator<Item = &'static PressColumn> {
        let is_there = move |column: &&PressColumn| match column.presence {
            Presence::ByDepth => self.by_depth,
            Presence::ThreeAxes => self.three_axes,
            Presence::Grouped => self.grouped,
            _ => self.has_load_cell || !OF_LOAD_CELL.contains(&column.name),
        };
        COLUMNS.iter().filter(is_there)
    }
}

/// Returns the first line of `presses.csv`.
pub(super) fn csv_header(channels: usize, columns: RunColumns) -> String {
    let names: Vec<String> = columns.all().flat_map(|column| column.names(channels)).collect();
    names.join(",") + "\n"
}

/// Returns one line of `presses.csv`. No cell needs quotation marks: the cells are numbers and this program's own words.
pub(super) fn csv_line(press: &Press, columns: RunColumns) -> String {
    let mut line = String::new();
    for column in columns.all() {
        (column.write)(press, &mut |value| {
            value.push_to(&mut line);
            line.push(',');
        });
    }
    line.pop();
    line + "\n"
}

/// Numbers of which some may have been missed: NaN here, `null` in JSON.
mod missable {
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(numbers: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(numbers.iter().map(|number| (!number.is_nan()).then_some(number)))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
        let numbers = Vec::<Option<f64>>::deserialize(from)?;
        Ok(numbers.into_iter().map(|number| number.unwrap_or(f64::NAN)).collect())
    }
}

/// Press in a flat form for other programs that read JSON: `out_1` to `out_n`, flags as text.
struct Flat<'a>(&'a Press);

impl Serialize for Flat<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        let mut first_error = Ok(());
        for column in self.0.columns() {
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
pub(super) const BY_FORCE: RunColumns =
    RunColumns { by_depth: false, has_load_cell: true, three_axes: false, grouped: false };

#[cfg(test)]
pub(super) fn example(press: u64, level: u64) -> Press {
    Press {
        press,
        level,
        phase: Some(Phase::Calibration),
        x_mm: -5.5,
        y_mm: 6.0,
        force_set_n: Some(1.0),
        depth_set_mm: None,
        force_n: Some(0.996_234_567),
        u_force_n: Some(0.001_234_567),
        force_x_n: None,
        force_y_n: None,
        group: None,
        u_force_x_n: None,
        u_force_y_n: None,
        drag_mm: None,
        slips: None,
        depth_mm: Some(0.812_345_6),
        u_depth_mm: None,
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

    const BY_DEPTH: RunColumns = RunColumns { by_depth: true, ..BY_FORCE };
    const THREE_AXES: RunColumns = RunColumns { three_axes: true, ..BY_FORCE };

    #[test]
    fn header_line_and_json_follow_from_the_columns() {
        let press = example(3, 0).rounded();
        assert_eq!(
            csv_header(2, BY_FORCE),
            "press,level,phase,x_mm,y_mm,force_set_n,force_n,u_force_n,depth_mm,t_s,out_1,out_2,flags,z_mm,air_before_n,air_after_n\n"
        );
        assert_eq!(
            csv_line(&press, BY_FORCE),
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
    fn press_by_depth_has_its_column_and_its_key() {
        let press = Press { force_set_n: None, depth_set_mm: Some(0.5), ..example(3, 0) }.rounded();
        assert!(csv_header(2, BY_DEPTH).starts_with("press,level,phase,x_mm,y_mm,force_set_n,depth_set_mm,force_n,"));
        assert!(csv_line(&press, BY_DEPTH).starts_with("3,0,calibration,-5.5,6,,0.5,0.996235,"));
        assert!(press.to_json().contains("\"force_set_n\":null,\"depth_set_mm\":0.5,"));
        assert!(csv_line(&example(3, 0).rounded(), BY_DEPTH).starts_with("3,0,calibration,-5.5,6,1,,0.996235,"));
    }

    #[test]
    fn press_on_three_axes_has_its_forces_sideways() {
        let sideways = Press { force_x_n: Some(0.1), force_y_n: Some(-0.05), ..example(3, 0) };
        let press = Press { u_force_x_n: Some(0.01), drag_mm: Some(0.5), slips: Some(1.0), ..sideways }.rounded();
        assert!(
            csv_header(2, THREE_AXES)
                .contains(",force_n,u_force_n,force_x_n,force_y_n,u_force_x_n,u_force_y_n,drag_mm,slips,depth_mm,")
        );
        assert!(csv_line(&press, THREE_AXES).contains(",0.996235,0.001235,0.1,-0.05,0.01,,0.5,1,0.81235,"));
        assert!(press.to_json().contains(
            "\"force_y_n\":-0.05,\"u_force_x_n\":0.01,\"u_force_y_n\":null,\"drag_mm\":0.5,\"slips\":1.0,\"depth_mm\""
        ));
    }

    #[test]
    fn missed_outputs_are_blank_in_every_text_and_only_under_their_flag() {
        let missed = Press { outputs: vec![f64::NAN; 2], flags: vec![Flag::Missed], force_n: None, ..example(3, 0) };
        assert!(csv_line(&missed, BY_FORCE).contains(",12.34567,,,missed,"), "{}", csv_line(&missed, BY_FORCE));
        assert!(missed.to_json().contains("\"out_1\":null,\"out_2\":null,\"flags\":\"missed\""));
        let read: Press = serde_json::from_str(&serde_json::to_string(&missed).unwrap()).unwrap();
        assert!(read.outputs.len() == 2 && read.outputs.iter().all(|output| output.is_nan()));
        assert!(missed.is_finite() && !Press { flags: vec![Flag::Stale], ..missed }.is_finite());
    }

    #[test]
    fn the_journals_fields_are_the_columns() {
        let by_depth = Press { depth_set_mm: Some(0.5), u_depth_mm: Some(0.01), ..example(3, 0) };
        let three = Press { force_x_n: Some(0.1), force_y_n: Some(0.2), group: Some(1.0), ..by_depth };
        let u_n = Some(0.01);
        let all = Press { u_force_x_n: u_n, u_force_y_n: u_n, drag_mm: Some(0.0), slips: Some(0.0), ..three };
        let fields = serde_json::to_value(all).unwrap();
        let mut names: Vec<&String> = fields.as_object().unwrap().keys().collect();
        let mut columns: Vec<&str> = COLUMNS.iter().map(|column| column.name).collect();
        names.sort();
        columns.sort_unstable();
        assert_eq!(names, columns);
    }
}
