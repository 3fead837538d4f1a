//! Plain CSV tables of presses, as people keep them and as a run writes them.
//!
//! A table has the columns `x_mm`, `y_mm` and `out_1..out_n`, optionally `force_n`, and `flags` (a row is flagged
//! unless its cell is empty or 0). A run's `presses.csv` has more, see [`Record`]. Columns may stand in any order;
//! those that aren't known are ignored. A byte-order mark and either kind of line end are tolerated.

use crate::quantity::Place;
use csv::StringRecord;
use miette::Diagnostic;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// The largest table that is read, bytes: some 100 000 presses of 100 units, far beyond any run, and it fits in memory.
pub const MAX_TABLE_BYTES: u64 = 256 << 20;
/// The most columns a table may have: far beyond any array, and few enough to look names up one by one.
pub const MAX_COLUMNS: usize = 4096;

/// A table as read: at least one row, at least one unit, every number finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The file's name as given, for messages.
    pub file: String,
    /// How many outputs each row has.
    pub units: usize,
    /// The rows in file order.
    pub rows: Vec<Row>,
}

/// One press.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The line in the file, from 1.
    pub line: u64,
    /// Where, mm.
    pub place: Place,
    /// How hard, N, if the table has that column; in a run, by the load cell.
    pub force_n: Option<f64>,
    /// `out_1..out_n`.
    pub outputs: Vec<f64>,
    /// Whether something was wrong with the press.
    pub flagged: bool,
    /// What only a run's `presses.csv` has; none in a plain table.
    pub record: Option<Record>,
}

/// What a run's `presses.csv` tells of a row beyond a plain table.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// `phase`: characterisation, calibration, test, teach.
    pub phase: String,
    /// `press`: the entry of the plan; the levels of a staircase share it.
    pub press: u64,
    /// `level`: from 0 in the order held.
    pub level: u64,
    /// `force_set_n`: the commanded force, N.
    pub force_set_n: f64,
}

/// Why a table can't be used; `line` counts from 1.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[allow(missing_docs)] // the fields say what the messages say
pub enum TableError {
    /// Not there, not a file, not permitted.
    #[error("{file}: can't be read")]
    Unreadable { file: String, source: io::Error },
    /// More than [`MAX_TABLE_BYTES`] or [`MAX_COLUMNS`].
    #[error("{file}: more than {limit} {what}")]
    #[diagnostic(help("leave out columns that aren't needed, or average repeated presses first"))]
    TooLarge { file: String, limit: u64, what: &'static str },
    /// Not text.
    #[error("{file}, line {line}: not UTF-8 text")]
    #[diagnostic(help("save the table as CSV in UTF-8"))]
    NotText { file: String, line: u64 },
    /// No row below the header, or no header.
    #[error("{file}: the table has no rows")]
    #[diagnostic(help("expected a header (x_mm, y_mm, out_1, ...) and at least one row below it"))]
    NoRows { file: String },
    /// A needed column isn't there.
    #[error("{file}, line {line}: column `{column}` is missing")]
    MissingColumn {
        file: String,
        line: u64,
        column: String,
        #[help]
        help: String,
    },
    /// Two columns of one name.
    #[error("{file}, line {line}: column `{column}` stands in the header twice")]
    #[diagnostic(help("keep one of them, or rename the other"))]
    DuplicateColumn { file: String, line: u64, column: String },
    /// An output column with a number that doesn't count from 1.
    #[error("{file}, line {line}: column `{column}` doesn't count as an output")]
    #[diagnostic(help("outputs are numbered out_1, out_2, ... from 1, without leading zeros"))]
    OutputNumber { file: String, line: u64, column: String },
    /// A row of another length than the header.
    #[error("{file}, line {line}: {found} cells where the header has {expected} (up to column `{column}`)")]
    #[diagnostic(help("every row needs one cell a column; numbers are written with a point, not a comma"))]
    Ragged { file: String, line: u64, column: String, expected: usize, found: usize },
    /// A cell that isn't what its column holds.
    #[error("{file}, line {line}, column `{column}`: expected {expected}, found `{found}`")]
    #[diagnostic(help("write what the column holds, or remove the row"))]
    Cell { file: String, line: u64, column: String, expected: &'static str, found: String },
}

impl Table {
    /// Reads a plain table.
    pub fn read(path: &Path) -> Result<Self, TableError> {
        Self::from_bytes(&path.display().to_string(), &bytes_of(path)?, Kind::Plain)
    }

    /// Reads a run's `presses.csv`: `force_n` and the columns of [`Record`] must be there.
    pub fn read_run(path: &Path) -> Result<Self, TableError> {
        Self::from_bytes(&path.display().to_string(), &bytes_of(path)?, Kind::Run)
    }

    /// The same from a text; `file` is its name in messages.
    pub fn of_run(file: &str, text: &str) -> Result<Self, TableError> {
        Self::from_bytes(file, text.as_bytes(), Kind::Run)
    }

    fn from_bytes(file: &str, bytes: &[u8], kind: Kind) -> Result<Self, TableError> {
        let text = std::str::from_utf8(bytes).map_err(|error| TableError::NotText {
            file: file.to_owned(),
            line: Lines::new(bytes).at(error.valid_up_to()),
        })?;
        // Rows of the wrong length are found here rather than by the reader, which counts lines its own way.
        let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(text.as_bytes());
        let unreadable = |error: csv::Error| TableError::Unreadable { file: file.to_owned(), source: error.into() };
        let mut lines = Lines::new(bytes);
        let header = reader.headers().map_err(unreadable)?.clone();
        let columns = Columns::find(file, lines.of(&header), &header, kind)?;
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(unreadable)?;
            let cells = Cells { file, line: lines.of(&record), header: &header, record: &record };
            rows.push(columns.row(&cells)?);
        }
        if rows.is_empty() {
            return Err(TableError::NoRows { file: file.to_owned() });
        }
        Ok(Table { file: file.to_owned(), units: columns.outputs.len(), rows })
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Plain,
    Run,
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, TableError> {
    let file = || path.display().to_string();
    let unreadable = |source| TableError::Unreadable { file: file(), source };
    let mut bytes = Vec::new();
    // One byte more than allowed is asked for, so that a pipe without end is found out as well.
    File::open(path).and_then(|file| file.take(MAX_TABLE_BYTES + 1).read_to_end(&mut bytes)).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_TABLE_BYTES {
        return Err(TableError::TooLarge { file: file(), limit: MAX_TABLE_BYTES, what: "bytes" });
    }
    Ok(bytes)
}

/// Where each known column stands.
struct Columns {
    x: usize,
    y: usize,
    force: Option<usize>,
    flags: Option<usize>,
    outputs: Vec<usize>,
    record: Option<RecordColumns>,
}

struct RecordColumns {
    phase: usize,
    press: usize,
    level: usize,
    force_set: usize,
}

impl Columns {
    fn find(file: &str, line: u64, header: &StringRecord, kind: Kind) -> Result<Self, TableError> {
        let is_repeated =
            |(index, name): &(usize, &str)| !name.is_empty() && header.iter().take(*index).any(|n| n == *name);
        if header.iter().all(str::is_empty) {
            return Err(TableError::NoRows { file: file.to_owned() });
        }
        if header.len() > MAX_COLUMNS {
            return Err(TableError::TooLarge { file: file.to_owned(), limit: MAX_COLUMNS as u64, what: "columns" });
        }
        if let Some((_, name)) = header.iter().enumerate().find(is_repeated) {
            return Err(TableError::DuplicateColumn { file: file.to_owned(), line, column: name.to_owned() });
        }
        let optional = |column: &str| header.iter().position(|name| name == column);
        let missing = |column: &str| TableError::MissingColumn {
            file: file.to_owned(),
            line,
            column: column.to_owned(),
            help: hint(column, header),
        };
        let needed = |column: &str| optional(column).ok_or_else(|| missing(column));
        let record = match kind {
            Kind::Plain => None,
            Kind::Run => Some(RecordColumns {
                phase: needed("phase")?,
                press: needed("press")?,
                level: needed("level")?,
                force_set: needed("force_set_n")?,
            }),
        };
        let force = if kind == Kind::Run { Some(needed("force_n")?) } else { optional("force_n") };
        let (x, y) = (needed("x_mm")?, needed("y_mm")?);
        let count = count_outputs(file, line, header)?;
        let outputs = (1..=count.max(1)).map(|unit| needed(&format!("out_{unit}"))).collect::<Result<_, _>>()?;
        Ok(Columns { x, y, force, flags: optional("flags"), outputs, record })
    }

    fn row(&self, cells: &Cells<'_>) -> Result<Row, TableError> {
        cells.check_length()?;
        let record = match &self.record {
            None => None,
            Some(columns) => Some(Record {
                phase: cells.text(columns.phase).to_owned(),
                press: cells.count(columns.press)?,
                level: cells.count(columns.level)?,
                force_set_n: cells.number(columns.force_set)?,
            }),
        };
        Ok(Row {
            line: cells.line,
            place: Place::new(cells.number(self.x)?, cells.number(self.y)?),
            force_n: self.force.map(|column| cells.number(column)).transpose()?,
            outputs: self.outputs.iter().map(|&column| cells.number(column)).collect::<Result<_, _>>()?,
            flagged: self.flags.is_some_and(|column| !matches!(cells.text(column), "" | "0")),
            record,
        })
    }
}

/// One row on its way in, with all that a message about it needs.
struct Cells<'a> {
    file: &'a str,
    line: u64,
    header: &'a StringRecord,
    record: &'a StringRecord,
}

impl<'a> Cells<'a> {
    fn check_length(&self) -> Result<(), TableError> {
        let (expected, found) = (self.header.len(), self.record.len());
        if found == expected {
            return Ok(());
        }
        let last = found.min(expected).saturating_sub(1);
        let column = self.header.get(last).unwrap_or_default().to_owned();
        Err(TableError::Ragged { file: self.file.to_owned(), line: self.line, column, expected, found })
    }

    fn text(&self, column: usize) -> &'a str {
        self.record.get(column).unwrap_or_default()
    }

    fn number(&self, column: usize) -> Result<f64, TableError> {
        let number = self.text(column).parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.wrong(column, "a finite number"))
    }

    fn count(&self, column: usize) -> Result<u64, TableError> {
        self.text(column).parse().map_err(|_| self.wrong(column, "a whole number from 0"))
    }

    fn wrong(&self, column: usize, expected: &'static str) -> TableError {
        TableError::Cell {
            file: self.file.to_owned(),
            line: self.line,
            column: self.header.get(column).unwrap_or_default().to_owned(),
            expected,
            found: self.text(column).to_owned(),
        }
    }
}

/// The largest number of an `out_N` column that the number of columns allows; 0 without any.
fn count_outputs(file: &str, line: u64, header: &StringRecord) -> Result<usize, TableError> {
    let numbered =
        |name: &&str| name.strip_prefix("out_").is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
    let names: Vec<&str> = header.iter().filter(numbered).collect();
    match names.iter().find(|name| name.starts_with("out_0")) {
        // Numbered from 0 or padded: no gap, but no output either.
        Some(name) => Err(TableError::OutputNumber { file: file.to_owned(), line, column: (*name).to_owned() }),
        // Without a gap, as many numbers as columns: the first that isn't among 1..=count is then missed by name.
        None => Ok(names.len()),
    }
}

/// What to do about a missing column: the header's nearest unknown name, where one is near.
fn hint(column: &str, header: &StringRecord) -> String {
    /// Jaro-Winkler similarity from which a name is taken for a slip of another.
    const NEAR: f64 = 0.7;
    let only = header.get(0).unwrap_or_default();
    if header.len() == 1 && only.contains([';', '\t']) {
        return "columns are separated by commas".to_owned();
    }
    let is_known = |name: &str| matches!(name, "x_mm" | "y_mm" | "force_n" | "flags") || name.starts_with("out_");
    let unknown = header.iter().filter(|name| !name.is_empty() && !is_known(name));
    let scored = unknown.map(|name| (strsim::jaro_winkler(column, &name.to_lowercase()), name));
    match scored.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(similarity, _)| *similarity > NEAR) {
        Some((_, name)) => format!("`{name}` is there: rename it to `{column}` if that is what it holds"),
        None => {
            "needed are x_mm, y_mm and out_1, out_2, ... without a gap; in a run also what it wrote itself".to_owned()
        }
    }
}

/// Finds line numbers, going forward only: the csv reader's own are off after blank lines and Windows line ends.
struct Lines<'a> {
    bytes: &'a [u8],
    offset: usize,
    line: u64,
}

impl<'a> Lines<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Lines { bytes, offset: 0, line: 1 }
    }

    /// The line of a record, past the blank lines and the rest of a line end that may come before it.
    fn of(&mut self, record: &StringRecord) -> u64 {
        let start = record.position().map_or(0, |position| position.byte() as usize).min(self.bytes.len());
        let blank = self.bytes[start..].iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
        self.at(start + blank)
    }

    fn at(&mut self, offset: usize) -> u64 {
        self.line += self.bytes[self.offset..offset].iter().filter(|byte| **byte == b'\n').count() as u64;
        self.offset = offset;
        self.line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(text: &str) -> Result<Table, TableError> {
        Table::from_bytes("a.csv", text.as_bytes(), Kind::Plain)
    }

    /// Message and help of a table that is refused.
    fn refusal(text: &str) -> String {
        let error = plain(text).unwrap_err();
        format!("{error}; {}", error.help().map(|help| help.to_string()).unwrap_or_default())
    }

    #[test]
    fn a_plain_table_is_read_whatever_its_order_and_line_ends() {
        let text = "\u{feff}out_2, x_mm ,note,y_mm,out_1\r\n4,1,\"a, b\",2,3\r\n\r\n-1e-3,0.5,,.25,0\r\n";
        let table = plain(text).unwrap();
        assert_eq!((table.units, table.rows.len()), (2, 2));
        assert_eq!(table.rows[0].outputs, [3.0, 4.0]);
        assert_eq!(table.rows[1].place, Place::new(0.5, 0.25));
        assert_eq!(table.rows.iter().map(|row| row.line).collect::<Vec<_>>(), [2, 4]);
        assert!(table.rows.iter().all(|row| row.force_n.is_none() && !row.flagged && row.record.is_none()));
    }

    #[test]
    fn a_runs_columns_are_read_from_a_run_and_ignored_elsewhere() {
        let text = "press,level,phase,x_mm,y_mm,force_set_n,force_n,out_1,flags\n".to_owned()
            + "7,2,test,0,0,0.5,0.49,1,\n8,0,test,0,0,1,1,1,drift\n";
        let run = Table::from_bytes("presses.csv", text.as_bytes(), Kind::Run).unwrap();
        let record = Record { phase: "test".into(), press: 7, level: 2, force_set_n: 0.5 };
        assert_eq!(run.rows[0].record, Some(record));
        assert_eq!(run.rows.iter().map(|row| row.flagged).collect::<Vec<_>>(), [false, true]);
        assert_eq!(plain(&text.replace("7,2,test,0,0,0.5", "a,b,c,0,0,d")).unwrap().rows[0].record, None);
        let without = Table::from_bytes("presses.csv", text.replace("force_n", "f").as_bytes(), Kind::Run).unwrap_err();
        assert!(without.to_string().contains("`force_n` is missing"), "{without}");
        let wrong = Table::from_bytes("presses.csv", text.replace("8,0", "8,-1").as_bytes(), Kind::Run).unwrap_err();
        assert_eq!(
            wrong.to_string(),
            "presses.csv, line 3, column `level`: expected a whole number from 0, found `-1`"
        );
    }

    #[test]
    fn what_is_wrong_is_named_with_file_line_and_column() {
        for (text, expected) in [
            (
                "x_mm,y_mm,out_1\n1,2,3\n1,NaN,3\n",
                "a.csv, line 3, column `y_mm`: expected a finite number, found `NaN`",
            ),
            ("x_mm,y_mm,out_1\r\n1,2,3\r\n1,2,inf\r\n", "a.csv, line 3, column `out_1`: expected a finite number"),
            ("x_mm,y_mm,out_1\n\n1,2,1e999\n", "a.csv, line 3, column `out_1`: expected a finite number"),
            ("x_mm,y_mm,out_1\n1,two,3\n", "a.csv, line 2, column `y_mm`: expected a finite number, found `two`"),
            ("x_mm,y_mm,out_1\n,2,3\n", "a.csv, line 2, column `x_mm`: expected a finite number, found ``"),
            ("x_mm,y_mm,force_n,out_1\n1,2,NaN,3\n", "a.csv, line 2, column `force_n`: expected a finite number"),
            ("x_mm,y_mm,out_1\n1,2,3\n1,2\n", "a.csv, line 3: 2 cells where the header has 3 (up to column `y_mm`)"),
            ("x_mm,y_mm,out_1\r\n1,2,3,4\r\n", "a.csv, line 2: 4 cells where the header has 3 (up to column `out_1`)"),
            ("x_mm,y_mm,x_mm,out_1\n1,2,3,4\n", "a.csv, line 1: column `x_mm` stands in the header twice"),
            ("x_mm,y_mm,note,note,out_1\n1,2,3,4,5\n", "a.csv, line 1: column `note` stands in the header twice"),
            ("\nX,y_mm,out_1\n1,2,3\n", "a.csv, line 2: column `x_mm` is missing"),
            ("x_mm,y-mm,out_1\n1,2,3\n", "column `y_mm` is missing; `y-mm` is there"),
            ("X_MM,y_mm,out_1\n1,2,3\n", "column `x_mm` is missing; `X_MM` is there"),
            ("y_mm,out_1\n2,3\n", "column `x_mm` is missing; needed are"),
            ("x_mm;y_mm;out_1\n1;2;3\n", "column `x_mm` is missing; columns are separated by commas"),
            ("x_mm,y_mm\n1,2\n", "column `out_1` is missing"),
            ("x_mm,y_mm,out_1,out_3\n1,2,3,4\n", "column `out_2` is missing"),
            ("x_mm,y_mm,out_0,out_1\n1,2,3,4\n", "column `out_0` doesn't count as an output; outputs are numbered"),
            ("x_mm,y_mm,out_1\n", "a.csv: the table has no rows"),
            ("", "a.csv: the table has no rows"),
            ("\n\n", "a.csv: the table has no rows"),
        ] {
            let refusal = refusal(text);
            assert!(refusal.contains(expected), "{text:?} gives: {refusal}");
        }
    }

    #[test]
    fn bytes_that_are_no_text_and_files_that_are_not_there_are_told_apart() {
        let error = Table::from_bytes("a.csv", b"x_mm,y_mm,out_1\n1,2,\xff\n", Kind::Plain).unwrap_err();
        assert_eq!(error.to_string(), "a.csv, line 2: not UTF-8 text");
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(Table::read(&folder.path().join("none.csv")), Err(TableError::Unreadable { .. })));
        assert!(matches!(Table::read(folder.path()), Err(TableError::Unreadable { .. })));
    }

    proptest::proptest! {
        #[test]
        fn no_text_makes_the_reader_panic(text in "[xy_mout1234567890,.\"\r\n ;N-]{0,60}") {
            let _ = plain(&text);
            let _ = plain(&format!("x_mm,y_mm,out_1\n{text}"));
        }
    }
}
