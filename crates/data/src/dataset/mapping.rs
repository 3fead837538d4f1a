//! Columns file: content and unit of each column of an external table, and the positions of the array's units.

use super::press::{Press, output_name};
use palpate_core::quantity::ArrayLayout;
use palpate_document::layout::{CHANNELS_MAX, GRID, LayoutKeys, read_unit};
use palpate_document::{self as document, Bounds, Key, Keys, Problem, Problems, Table, keys, words};

/// All keys of a columns file.
pub const COLUMN_KEYS: Keys = columns::KEYS;

const FACTOR: Bounds = Bounds::within(-1e9, 1e9, "");
const SHIFT_MM: Bounds = Bounds::within(-10_000.0, 10_000.0, "mm");
const SHIFT_N: Bounds = Bounds::within(-10_000.0, 10_000.0, "N");
const COORDINATE: Bounds = Bounds::within(-10_000.0, 10_000.0, "mm");

const SEPARATORS: [(&str, u8); 4] = [(",", b','), (";", b';'), ("tab", b'\t'), ("space", b' ')];
const DECIMALS: [(&str, Decimal); 2] = [(".", Decimal::Point), (",", Decimal::Comma)];

keys! {
    /// The complete file.
    columns {
        x_mm: Text, or_word("x_mm"), "the column with the place along x", "\"X [mm]\"";
        y_mm: Text, or_word("y_mm"), "the column with the place along y", "\"Y [mm]\"";
        force_n: Text, Allowed, "the column with the force into the skin; without it, `force_n` if the table has it", "\"Fz [N]\"";
        force_x_n: Text, Allowed, "the column with the force of the tip along x, where the force has three components", "\"Fx [N]\"";
        force_y_n: Text, Allowed, "the column with the force of the tip along y", "\"Fy [N]\"";
        group: Text, Allowed, "the column whose values name groups of presses, which `evaluate --folds-by` leaves out", "\"trial\"";
        t_s: Text, Allowed, "the column with the time of a series, for `--history`; a series may have no places", "\"time\"";
        depth_mm: Text, Allowed, "the column with the depth below the surface; without it, `depth_mm` if the table has it", "\"depth\"";
        outputs: Either(&[Text, Texts]), Allowed,
            "the columns with the outputs, in order: the first and the last of numbered ones, or a list; without it, out_1, out_2, ...",
            "\"ch0..ch15\"";
        flags: Text, Allowed, "the column that marks presses to exclude: a press is excluded unless its cell is empty or 0", "\"bad\"";
        scale: Table(&scale::KEYS), Allowed, "factors, for other units or signs";
        offset: Table(&offset::KEYS), Allowed, "what is added after the factor, for another origin or a zero";
        missing: Texts, or_texts(&[]), "cells that mean a missing value, besides blank cells and NaN", "[\"-999\"]";
        separator: Word(&words(&SEPARATORS)), Allowed,
            "what separates the columns; without it, detected from the header", "\";\"";
        decimal: Word(&words(&DECIMALS)), Allowed,
            "the decimal mark; without it, a comma is accepted where it doesn't separate the columns", "\",\"";
        header: Flag, or_flag(true), "whether the table has a header; without one, columns are named 1, 2, ...", "true";
        measured: Text, Allowed, "the day of the measurement, as year-month-day; a certificate requires it", "\"2026-05-04\"";
        array: Table(&array::KEYS), Allowed, "where the array's units are, and the unit of its outputs";
    }
}

keys! {
    /// `[scale]`
    scale {
        x_mm: Number(FACTOR), or(1.0), "factor of x and of y: 0.001 where they are in um", "0.001";
        force_n: Number(FACTOR), or(1.0), "factor of the force: -1 where pressing is negative", "-1.0";
        force_x_n: Number(FACTOR), or(1.0), "factor of the forces along x and y", "0.001";
        t_s: Number(FACTOR), or(1.0), "factor of the time: 0.001 where it is in ms", "0.001";
        depth_mm: Number(FACTOR), or(1.0), "factor of the depth: -1 where the column is a z that falls into the skin", "-1.0";
        outputs: Number(FACTOR), or(1.0), "factor of every output", "0.001";
    }
}

keys! {
    /// `[offset]`
    offset {
        x_mm: Number(SHIFT_MM), or(0.0), "added to x", "-9.0";
        y_mm: Number(SHIFT_MM), or(0.0), "added to y", "-9.0";
        force_n: Number(SHIFT_N), or(0.0), "added to the force", "0.0";
        depth_mm: Number(SHIFT_MM), or(0.0), "added to the depth: z of the surface where the factor is -1", "145.0";
    }
}

keys! {
    /// `[array]`
    array {
        unit: Text, or_word("a.u."), "unit of the outputs in tables and figures, 1 to 16 characters", "\"counts\"";
        channels_per_unit: Whole(1, CHANNELS_MAX), or_whole(1),
            "number of successive outputs of each unit: 3 for chips with three axes", "3";
    }
    one of {
        grid: Table(&GRID), Allowed, "its units are in rows and columns, centred on x = y = 0";
        places_mm: Places(COORDINATE), Allowed, "positions of its units, in the order of its outputs", "[[0.0, 0.0]]";
    }
}

const LAYOUT: LayoutKeys =
    LayoutKeys { grid: array::grid, places_mm: array::places_mm, channels_per_unit: array::channels_per_unit };

/// Columns of a table and their contents. The default is a table with the program's own names.
#[derive(Clone, Debug, PartialEq)]
pub struct Mapping {
    pub(super) x_mm: String,
    pub(super) y_mm: String,
    /// Name of the force column. `None`: `force_n`, if it exists.
    pub(super) force_n: Option<String>,
    /// Name of the depth column. `None`: `depth_mm`, if it exists.
    pub(super) depth_mm: Option<String>,
    /// Names of the columns with the forces along x and y.
    pub(super) force_sideways_n: [Option<String>; 2],
    /// Time of a series. `None`: `t_s`, if the table has it.
    pub(super) t_s: Option<String>,
    /// Name of the column whose values are groups.
    pub(super) group: Option<String>,
    pub(super) outputs: OutputSource,
    /// Name of the flags column. `None`: `flags`, if it exists.
    pub(super) flags: Option<String>,
    pub(super) scale: LinearScale,
    pub(super) missing: Vec<String>,
    /// Separator. `None`: detected.
    pub(super) separator: Option<u8>,
    pub(super) decimal: Option<Decimal>,
    pub(super) has_header: bool,
    /// Whether a person gave the mapping. Rows with missing values are then excluded, and a run's own columns aren't searched
    /// for.
    pub(super) is_given: bool,
    /// Sheet of a workbook. `None`: the first.
    pub sheet: Option<String>,
    /// Date of the measurement, as year-month-day.
    pub measured: Option<String>,
    /// Positions of the array's units, and the unit of the outputs.
    pub array: Option<(ArrayLayout, String)>,
}

/// Columns that contain the outputs.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum OutputSource {
    /// `out_1`, `out_2`, ..., any number of them.
    Own,
    /// The columns with these names.
    Named(Vec<String>),
}

/// Decimal mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Decimal {
    Point,
    Comma,
}

/// Factor of the values, and the offset that is added afterwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LinearScale {
    pub place: f64,
    pub force: f64,
    pub force_sideways: f64,
    pub time: f64,
    pub depth: f64,
    pub outputs: f64,
    pub x_mm: f64,
    pub y_mm: f64,
    pub force_n: f64,
    pub depth_mm: f64,
}

impl LinearScale {
    /// Converts the values of a table to millimetres and newtons.
    pub(super) fn apply(&self, press: &mut Press) {
        press.x_mm = press.x_mm * self.place + self.x_mm;
        press.y_mm = press.y_mm * self.place + self.y_mm;
        press.force_n = press.force_n.map(|force| force * self.force + self.force_n);
        for side_n in [&mut press.force_x_n, &mut press.force_y_n] {
            *side_n = side_n.map(|force| force * self.force_sideways);
        }
        press.depth_mm = press.depth_mm.map(|depth| depth * self.depth + self.depth_mm);
        press.t_s = press.t_s.map(|time| time * self.time);
        press.outputs.iter_mut().for_each(|output| *output *= self.outputs);
    }
}

impl Mapping {
    /// Returns the mapping for a sheet of a workbook; `None` for the first.
    #[must_use]
    pub fn of_sheet(self, sheet: Option<String>) -> Mapping {
        Mapping { sheet, ..self }
    }
}

impl Default for Mapping {
    fn default() -> Self {
        Mapping {
            x_mm: "x_mm".to_owned(),
            y_mm: "y_mm".to_owned(),
            force_n: None,
            depth_mm: None,
            force_sideways_n: [None, None],
            t_s: None,
            group: None,
            outputs: OutputSource::Own,
            flags: None,
            scale: LinearScale {
                place: 1.0,
                force: 1.0,
                force_sideways: 1.0,
                time: 1.0,
                depth: 1.0,
                outputs: 1.0,
                x_mm: 0.0,
                y_mm: 0.0,
                force_n: 0.0,
                depth_mm: 0.0,
            },
            missing: Vec::new(),
            separator: None,
            decimal: None,
            has_header: true,
            is_given: false,
            sheet: None,
            measured: None,
            array: None,
        }
    }
}

impl Mapping {
    /// Reads a columns file.
    ///
    /// # Errors
    /// Every problem of the text, each with its line.
    pub fn parse(file: &str, text: &str) -> Result<Mapping, Problems> {
        document::read(file, text, &columns::KEYS, read)
    }

    /// Returns the text of a columns file equivalent to `x_mm=X,y_mm=Y,outputs=ch0..ch15`.
    pub fn text_of(pairs: &str) -> String {
        let mut keys: Vec<(&str, Vec<&str>)> = Vec::new();
        for part in pairs.split(',') {
            match (part.split_once('='), keys.last_mut()) {
                (Some((key, name)), _) => keys.push((key.trim(), vec![name.trim()])),
                (None, Some((_, names))) => names.push(part.trim()),
                (None, None) => keys.push((part.trim(), Vec::new())),
            }
        }
        let line = |(key, names): &(&str, Vec<&str>)| match names.as_slice() {
            [name] => format!("{key} = {name:?}\n"),
            names => format!("{key} = {names:?}\n"),
        };
        keys.iter().map(line).collect()
    }

    /// Returns the positions of the units of a table with `outputs` outputs, if the mapping states them.
    pub fn layout_of(&self, outputs: usize) -> Option<ArrayLayout> {
        self.array.as_ref().map(|(layout, _)| layout).filter(|layout| layout.len() == outputs).cloned()
    }

    /// Returns the given name of one of the program's own columns, if there is one.
    pub(super) fn name_of(&self, column: &str) -> Option<&str> {
        match column {
            "x_mm" => Some(&self.x_mm),
            "y_mm" => Some(&self.y_mm),
            "force_n" => self.force_n.as_deref(),
            "depth_mm" => self.depth_mm.as_deref(),
            "force_x_n" => self.force_sideways_n[0].as_deref(),
            "force_y_n" => self.force_sideways_n[1].as_deref(),
            "t_s" => self.t_s.as_deref(),
            "flags" => self.flags.as_deref(),
            _ => None,
        }
    }

    /// Returns the mapping with another column of groups.
    #[must_use]
    pub fn grouped_by(self, column: &str) -> Mapping {
        Mapping { group: Some(column.to_owned()), ..self }
    }

    /// Name of the column of groups, if there is one.
    pub fn group(&self) -> Option<&str> {
        self.group.as_deref()
    }

    /// Returns the mapping with the program's own names for the forces along x and y, if none are named.
    #[must_use]
    pub fn with_force_vector(mut self) -> Mapping {
        for (side, name) in self.force_sideways_n.iter_mut().zip(["force_x_n", "force_y_n"]) {
            side.get_or_insert_with(|| name.to_owned());
        }
        self
    }

    /// Returns the mapping of a series, with the program's own name for the time if none is named.
    #[must_use]
    pub fn of_series(mut self) -> Mapping {
        self.t_s.get_or_insert_with(|| "t_s".to_owned());
        self
    }

    /// Whether the presses are a series: their time is named.
    pub fn is_series(&self) -> bool {
        self.t_s.is_some()
    }

    /// Whether the presses may have no places: they are a series, or the force has three components.
    pub(super) fn may_lack_places(&self) -> bool {
        self.is_series() || self.has_force_vector()
    }

    /// Returns the names of the columns with the forces along x and y, if they are named.
    pub(super) fn sideways_names(&self) -> Vec<&str> {
        self.force_sideways_n.iter().flatten().map(String::as_str).collect()
    }

    /// Whether the force has three components. Then the presses may have no places.
    pub fn has_force_vector(&self) -> bool {
        self.force_sideways_n.iter().all(Option::is_some)
    }

    /// Returns the names of the output columns, if they are known without the table.
    pub(super) fn output_names(&self) -> Option<&[String]> {
        match &self.outputs {
            OutputSource::Own => None,
            OutputSource::Named(names) => Some(names),
        }
    }

    /// Returns the name of the first output column.
    pub(super) fn first_output(&self) -> String {
        self.output_names().map_or_else(|| output_name(1), |names| names[0].clone())
    }

    /// Whether a cell has no value.
    pub(super) fn is_missing(&self, cell: &str) -> bool {
        cell.is_empty() || cell.eq_ignore_ascii_case("nan") || self.missing.iter().any(|missing| missing == cell)
    }
}

fn read(table: &Table) -> Option<Mapping> {
    let own = |table: &Table, key: &Key| table.text(key).map(str::to_owned);
    let names = [own(table, &columns::x_mm), own(table, &columns::y_mm)];
    let outputs = read_outputs(table);
    let scale = read_scale(table);
    let separator = optional(table, &columns::separator, |table, key| table.word(key, &SEPARATORS));
    let decimal = optional(table, &columns::decimal, |table, key| table.word(key, &DECIMALS));
    if let (Some(Some(b',')), Some(Some(Decimal::Comma))) = (separator, decimal) {
        let words = "a comma can't be the separator and the decimal mark";
        table.complain(Problem::new(table.span_of(&columns::decimal), words));
    }
    check_twice(table, &names, outputs.as_ref());
    let array = optional(table, &columns::array, |table, key| {
        let table = table.table(key)?;
        let (layout, unit) = (LAYOUT.read(&table), read_unit(&table, &array::unit));
        Some((layout?, unit?.to_owned()))
    });
    let measured = optional(table, &columns::measured, |table, key| table.day(key).map(str::to_owned));
    let single = |key: &Key| optional(table, key, own);
    let (force_n, depth_mm, flags) = (single(&columns::force_n), single(&columns::depth_mm), single(&columns::flags));
    let sideways = [single(&columns::force_x_n), single(&columns::force_y_n)];
    let (group, t_s) = (single(&columns::group), single(&columns::t_s));
    let missing = table.texts(&columns::missing);
    let (has_header, outputs, array) = (table.flag(&columns::header)?, outputs?, array?);
    if let (Some((layout, _)), OutputSource::Named(names)) = (&array, &outputs)
        && layout.len() != names.len()
    {
        let words = format!("`array` has {} outputs, but `outputs` names {} columns", layout.len(), names.len());
        table.complain(Problem::new(table.span_of(&columns::array), words));
    }
    let ([x_mm, y_mm], [x_n, y_n]) = (names, sideways);
    Some(Mapping {
        x_mm: x_mm?,
        y_mm: y_mm?,
        force_n: force_n?,
        depth_mm: depth_mm?,
        force_sideways_n: [x_n?, y_n?],
        t_s: t_s?,
        group: group?,
        outputs,
        flags: flags?,
        scale: scale?,
        missing: missing?.into_iter().map(str::to_owned).collect(),
        separator: separator?,
        decimal: decimal?,
        has_header,
        is_given: true,
        sheet: None,
        measured: measured?,
        array,
    })
}

/// Records a problem if two keys name one column.
fn check_twice(table: &Table, places: &[Option<String>; 2], outputs: Option<&OutputSource>) {
    let given = |key: &Key| table.is_text(key).then(|| table.text(key)).flatten();
    let mut named: Vec<(Key, &str)> = Vec::new();
    let singles = [columns::x_mm, columns::y_mm].into_iter().zip(places.iter().map(Option::as_deref));
    let others =
        [columns::force_n, columns::force_x_n, columns::force_y_n, columns::t_s, columns::depth_mm, columns::flags]
            .map(|key| (key, given(&key)));
    let several = match outputs {
        Some(OutputSource::Named(names)) => names.as_slice(),
        _ => &[],
    };
    let all = singles.chain(others).chain(several.iter().map(|name| (columns::outputs, Some(name.as_str()))));
    for (key, name) in all.filter_map(|(key, name)| Some((key, name?))) {
        if let Some((first, _)) = named.iter().find(|(first, other)| *other == name && *first != key) {
            let words = format!("`{}` and `{}` name the same column {name:?}", first.name, key.name);
            let at = if table.has(&key) { &key } else { first };
            table.complain(Problem::new(table.span_of(at), words).help("give each key a column of its own"));
            return;
        }
        named.push((key, name));
    }
}

/// Reads a key that may be missing. The outer value is `None` if the key is present and invalid.
fn optional<T>(table: &Table, key: &Key, read: impl Fn(&Table, &Key) -> Option<T>) -> Option<Option<T>> {
    if table.has(key) { read(table, key).map(Some) } else { Some(None) }
}

fn read_scale(table: &Table) -> Option<LinearScale> {
    let mut read = Mapping::default().scale;
    if let Some(table) = table.table(&columns::scale) {
        read.place = table.number(&scale::x_mm)?;
        read.force = table.number(&scale::force_n)?;
        read.force_sideways = table.number(&scale::force_x_n)?;
        read.time = table.number(&scale::t_s)?;
        read.depth = table.number(&scale::depth_mm)?;
        read.outputs = table.number(&scale::outputs)?;
        let factors = [
            (scale::x_mm, read.place),
            (scale::force_n, read.force),
            (scale::force_x_n, read.force_sideways),
            (scale::t_s, read.time),
            (scale::depth_mm, read.depth),
            (scale::outputs, read.outputs),
        ];
        for (key, factor) in factors {
            if factor == 0.0 {
                table.complain(Problem::new(table.span_of(&key), format!("`{}` of `scale` is 0", key.name)));
            }
        }
    }
    if let Some(table) = table.table(&columns::offset) {
        read.x_mm = table.number(&offset::x_mm)?;
        read.y_mm = table.number(&offset::y_mm)?;
        read.force_n = table.number(&offset::force_n)?;
        read.depth_mm = table.number(&offset::depth_mm)?;
    }
    Some(read)
}

/// Reads the columns named by `outputs`: a list, or numbered names from the first to the last.
fn read_outputs(table: &Table) -> Option<OutputSource> {
    let key = &columns::outputs;
    if !table.has(key) {
        return Some(OutputSource::Own);
    }
    let fail = |words: String| {
        let help = "write outputs = \"ch0..ch15\", or a list: [\"left\", \"right\"]";
        table.complain(Problem::new(table.span_of(key), words).help(help));
        None
    };
    let names = match table.is_text(key) {
        false => table.texts(key)?.into_iter().map(str::to_owned).collect(),
        true => {
            let text = table.text(key)?;
            match numbered(text) {
                Some(names) => names,
                None if text.contains("..") => {
                    return fail(format!(
                        "`outputs` is {text:?}: expected the same word with a smaller and a larger number"
                    ));
                }
                None if is_range(text) => {
                    return fail(format!("`outputs` is {text:?}, which names one column"));
                }
                None => vec![text.to_owned()],
            }
        }
    };
    let repeated = (1..names.len()).find(|index| names[..*index].contains(&names[*index]));
    match repeated {
        Some(index) => fail(format!("`outputs` names the column {:?} twice", names[index])),
        None if names.is_empty() => fail("`outputs` names no column".to_owned()),
        None => Some(OutputSource::Named(names)),
    }
}

/// Whether a name looks like a range of names with another mark than `..`: `ch0-ch8`, `ch0:ch8`.
fn is_range(text: &str) -> bool {
    ["-", ":", "...", " to "].iter().any(|mark| numbered(&text.replacen(mark, "..", 1)).is_some())
}

/// Returns the names `ch0` to `ch15` for `ch0..ch15`. Text after the number is part of each name too.
fn numbered(text: &str) -> Option<Vec<String>> {
    let (first, last) = text.split_once("..")?;
    let ((word, from, rest), (other, to, other_rest)) = (at_last_number(first.trim())?, at_last_number(last.trim())?);
    let is_series = word == other && rest == other_rest && from.len() <= to.len();
    let width = if from.starts_with('0') && from.len() > 1 { from.len() } else { 1 };
    let (from, to) = (from.parse::<usize>().ok()?, to.parse::<usize>().ok()?);
    let is_series = is_series && from <= to && to - from < super::MAX_COLUMNS;
    is_series.then(|| (from..=to).map(|number| format!("{word}{number:0width$}{rest}")).collect())
}

/// Splits a name at its last number: what is before, the digits, and what is behind.
pub(super) fn at_last_number(name: &str) -> Option<(&str, &str, &str)> {
    let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = name[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| at + name[at..].chars().next().map_or(1, char::len_utf8));
    Some((&name[..start], &name[start..end], &name[end..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        Mapping::parse("columns.toml", text).unwrap_err().lines().join("\n")
    }

    #[test]
    fn numbered_columns_are_named_by_the_first_and_the_last() {
        let names = |text: &str| numbered(text).map(|names| names.join(" "));
        for (text, expected) in [
            ("ch0..ch3", Some("ch0 ch1 ch2 ch3")),
            ("s01..s10", Some("s01 s02 s03 s04 s05 s06 s07 s08 s09 s10")),
            ("s9..s11", Some("s9 s10 s11")),
            ("4..6", Some("4 5 6")),
            ("B1 [mT]..B2 [mT]", Some("B1 [mT] B2 [mT]")),
            ("ß1..ß2", Some("ß1 ß2")),
            ("ch3..ch0", None),
            ("ch0..s3", None),
            ("ch0", None),
            ("a..b", None),
            ("ch0..ch99999", None),
        ] {
            assert_eq!(names(text).as_deref(), expected, "{text}");
        }
    }

    #[test]
    fn short_text_and_file_are_equivalent() {
        let file = "x_mm = \"X [mm]\"\noutputs = \"ch0..ch1\"\n";
        assert_eq!(Mapping::text_of("x_mm=X [mm], outputs=ch0..ch1"), file);
        assert_eq!(Mapping::text_of("x_mm=X,outputs=left, right"), "x_mm = \"X\"\noutputs = [\"left\", \"right\"]\n");
        let mapping = Mapping::parse("columns.toml", file).unwrap();
        assert_eq!((mapping.x_mm.as_str(), mapping.y_mm.as_str()), ("X [mm]", "y_mm"));
        assert_eq!(mapping.outputs, OutputSource::Named(vec!["ch0".to_owned(), "ch1".to_owned()]));
        assert_eq!(Mapping::parse("columns.toml", "").unwrap(), Mapping { is_given: true, ..Mapping::default() });
    }

    #[test]
    fn columns_file_error_names_its_place() {
        for (text, expected) in [
            ("outputs = \"ch3..ch0\"", "expected the same word with a smaller and a larger number"),
            ("outputs = []", "`outputs` names no column"),
            ("outputs = \"ch0-ch8\"", "`outputs` is \"ch0-ch8\", which names one column"),
            ("outputs = [\"a\", \"a\"]", "`outputs` names the column \"a\" twice"),
            ("separator = \",\"\ndecimal = \",\"", "a comma can't be the separator and the decimal mark"),
            ("scale = { force_n = 0.0 }", "`force_n` of `scale` is 0"),
            ("measured = \"4.5.2026\"", "expected a day as year-month-day"),
            ("output = \"ch0..ch3\"", "unknown key `output`"),
            ("y_mm = \"X\"\nx_mm = \"X\"", "`x_mm` and `y_mm` name the same column \"X\""),
            ("y_mm = \"x_mm\"", "`x_mm` and `y_mm` name the same column \"x_mm\""),
            ("force_n = \"ch1\"\noutputs = \"ch0..ch3\"", "`force_n` and `outputs` name the same column \"ch1\""),
            ("array = { unit = \"V\" }", "`array` has no positions of its units"),
            (
                "outputs = \"ch0..ch3\"\narray = { places_mm = [[0.0, 0.0]] }",
                "`array` has 1 outputs, but `outputs` names 4 columns",
            ),
        ] {
            let words = refused(text);
            assert!(words.contains(expected), "{text}: {words}");
        }
    }
}
