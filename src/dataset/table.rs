//! Plain CSV tables of presses, as people keep them and as a run writes them.
//!
//! A table has the columns `x_mm`, `y_mm` and `out_1..out_n`, optionally `force_n`, and `flags` (a row is flagged
//! unless its cell is empty or 0). A run's `presses.csv` has more, see [`Record`]. Columns may stand in any order;
//! those that aren't known are ignored. A byte-order mark and either kind of line end are tolerated. What a table without
//! `force_n` is worth is for [`calibration`](super::calibration) to say.

use super::Contact;
use super::header::{Header, quoted};
use crate::quantity::Place;
use csv::StringRecord;
use miette::Diagnostic;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// The largest table that is read, bytes: some 100 000 presses of 500 units, far beyond any run. What is held of it is numbers
/// alone, mostly less than the text.
pub const MAX_TABLE_BYTES: u64 = 512 << 20;
/// The most rows a table may have: a stage that presses every three seconds is a month over them.
pub const MAX_ROWS: usize = 1 << 20;
/// The most columns a table may have: far beyond any array, and few enough to look names up one by one.
pub const MAX_COLUMNS: usize = 4096;

/// What a table needs.
const HELP: &str = "needed are x_mm, y_mm and out_1, out_2, ... without a gap; in a run also what it wrote itself";

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

impl Row {
    /// Whether a run made the press for that phase.
    pub fn is_of(&self, phase: &str) -> bool {
        self.record.as_ref().is_some_and(|record| record.phase == phase)
    }
}

/// Why a table can't be used; `line` counts from 1.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[allow(missing_docs, reason = "the fields say what the messages say")]
pub enum TableError {
    /// Not there, not a file, not permitted.
    #[error("{file}: can't be read")]
    #[diagnostic(help("name a table that is there; that of a run is written anew by `palpate rebuild`"))]
    Unreadable { file: String, source: io::Error },
    /// More than [`MAX_TABLE_BYTES`], [`MAX_ROWS`] or [`MAX_COLUMNS`].
    #[error("{file}{}: more than {limit} {what}", line.map(|line| format!(", line {line}")).unwrap_or_default())]
    #[diagnostic(help("leave out columns that aren't needed, or average repeated presses first"))]
    TooLarge { file: String, line: Option<u64>, limit: u64, what: &'static str },
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
    /// What a run's contacts would be read as, were they written; none of none.
    pub fn of_contacts<'a>(contacts: impl IntoIterator<Item = &'a Contact>) -> Option<Table> {
        let recorded = contacts.into_iter().flat_map(|contact| &contact.rows);
        let row = |(index, row): (usize, &super::Row)| Row {
            line: index as u64 + 2, // below the header
            place: Place::new(row.x_mm, row.y_mm),
            force_n: Some(row.force_n),
            outputs: row.outputs.clone(),
            flagged: !row.flags.is_empty(),
            record: Some(Record {
                phase: row.phase.name().to_owned(),
                press: row.press,
                level: row.level,
                force_set_n: row.force_set_n,
            }),
        };
        let rows: Vec<Row> = recorded.enumerate().map(row).collect();
        let units = rows.first()?.outputs.len();
        Some(Table { file: "presses.csv".to_owned(), units, rows })
    }

    /// Reads a plain table.
    pub fn read(path: &Path) -> Result<Self, TableError> {
        Self::open(path, Kind::Plain)
    }

    /// Reads a run's `presses.csv`: `force_n` and the columns of [`Record`] must be there.
    pub fn read_run(path: &Path) -> Result<Self, TableError> {
        Self::open(path, Kind::Run)
    }

    /// The same from a text; `file` is its name in messages.
    pub fn of_run(file: &str, text: &str) -> Result<Self, TableError> {
        Self::parse(file, text.as_bytes(), Kind::Run)
    }

    fn open(path: &Path, kind: Kind) -> Result<Self, TableError> {
        let file = path.display().to_string();
        match File::open(path) {
            Ok(input) => Self::parse(&file, input, kind),
            Err(source) => Err(TableError::Unreadable { file, source }),
        }
    }

    fn parse(file: &str, input: impl Read, kind: Kind) -> Result<Self, TableError> {
        let mut records = Records::new(file, input);
        let mut header = StringRecord::new();
        records.next(&mut header)?;
        header.trim();
        let columns = Columns::find(&Header { file, line: records.line, names: &header, help: HELP }, kind)?;
        let (mut rows, mut record) = (Vec::new(), StringRecord::new());
        while records.next(&mut record)? {
            if rows.len() == MAX_ROWS {
                let (file, line) = (file.to_owned(), Some(records.line));
                return Err(TableError::TooLarge { file, line, limit: MAX_ROWS as u64, what: "rows" });
            }
            rows.push(columns.row(&Cells { file, line: records.line, header: &header, record: &record })?);
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
    fn find(header: &Header<'_>, kind: Kind) -> Result<Self, TableError> {
        header.check()?;
        let record = match kind {
            Kind::Plain => None,
            Kind::Run => Some(RecordColumns {
                phase: header.needed("phase")?,
                press: header.needed("press")?,
                level: header.needed("level")?,
                force_set: header.needed("force_set_n")?,
            }),
        };
        let force = if kind == Kind::Run { Some(header.needed("force_n")?) } else { header.optional("force_n") };
        let (x, y) = (header.needed("x_mm")?, header.needed("y_mm")?);
        Ok(Columns { x, y, force, flags: header.optional("flags"), outputs: header.outputs()?, record })
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
        let mut outputs = Vec::with_capacity(self.outputs.len());
        for &column in &self.outputs {
            outputs.push(cells.number(column)?);
        }
        Ok(Row {
            line: cells.line,
            place: Place::new(cells.number(self.x)?, cells.number(self.y)?),
            force_n: self.force.map(|column| cells.number(column)).transpose()?,
            outputs,
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
        let column = quoted(self.header.get(last).unwrap_or_default());
        Err(TableError::Ragged { file: self.file.to_owned(), line: self.line, column, expected, found })
    }

    fn text(&self, column: usize) -> &'a str {
        self.record.get(column).unwrap_or_default().trim()
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
            column: quoted(self.header.get(column).unwrap_or_default()),
            expected,
            found: quoted(self.text(column)),
        }
    }
}

/// The records of a table, one at a time, each with its line.
struct Records<'a, R> {
    file: &'a str,
    reader: csv::Reader<Lines<R>>,
    /// The first line of the record that was read last.
    line: u64,
}

impl<'a, R: Read> Records<'a, R> {
    fn new(file: &'a str, input: R) -> Self {
        // Rows of the wrong length are found later, with their line: the reader counts lines its own way.
        let reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(Lines::new(input));
        Records { file, reader, line: 1 }
    }

    /// Whether there was another one.
    fn next(&mut self, record: &mut StringRecord) -> Result<bool, TableError> {
        let read = self.reader.read_record(record);
        let end = self.reader.position().byte();
        let lines = self.reader.get_mut();
        self.line = lines.of_record(end, record);
        let file = || self.file.to_owned();
        if lines.taken > MAX_TABLE_BYTES {
            return Err(TableError::TooLarge { file: file(), line: None, limit: MAX_TABLE_BYTES, what: "bytes" });
        }
        read.map_err(|error| match error.into_kind() {
            csv::ErrorKind::Utf8 { .. } => TableError::NotText { file: file(), line: self.line },
            csv::ErrorKind::Io(source) => TableError::Unreadable { file: file(), source },
            other => TableError::Unreadable { file: file(), source: io::Error::other(format!("{other:?}")) },
        })
    }
}

/// What is read passes through here and leaves its line ends behind, so that a record's line can be told: the csv reader's own
/// count is off after blank lines and Windows line ends.
struct Lines<R> {
    input: R,
    /// Bytes so far; the input counts as ended a little beyond [`MAX_TABLE_BYTES`].
    taken: u64,
    /// Where the line ends are that no record has passed yet: those of one buffer of the reader.
    ends: VecDeque<u64>,
    passed: u64,
}

impl<R> Lines<R> {
    fn new(input: R) -> Self {
        Lines { input, taken: 0, ends: VecDeque::new(), passed: 0 }
    }

    /// The first line of a record that ends before that byte, its own line end included.
    fn of_record(&mut self, end: u64, record: &StringRecord) -> u64 {
        while self.ends.front().is_some_and(|at| at + 1 < end) {
            self.ends.pop_front();
            self.passed += 1;
        }
        let within = record.as_slice().bytes().filter(|byte| *byte == b'\n').count() as u64;
        1 + self.passed.saturating_sub(within)
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.taken > MAX_TABLE_BYTES {
            return Ok(0);
        }
        let count = self.input.read(buffer)?;
        let ends = buffer[..count].iter().enumerate().filter(|(_, byte)| **byte == b'\n');
        self.ends.extend(ends.map(|(at, _)| self.taken + at as u64));
        self.taken += count as u64;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(text: &str) -> Result<Table, TableError> {
        Table::parse("a.csv", text.as_bytes(), Kind::Plain)
    }

    /// Message and help of a table that is refused.
    fn refusal(text: &str) -> String {
        let error = plain(text).unwrap_err();
        format!("{error}; {}", error.help().map(|help| help.to_string()).unwrap_or_default())
    }

    #[test]
    fn a_plain_table_is_read_whatever_its_order_and_line_ends() {
        let text =
            "\u{feff}out_2, x_mm ,note,y_mm,out_1\r\n4, 1 ,\"a, b\",2,3\r\n\r\n-1e-3,0.5,\"a\nb\",.25,0\r\n0,0,,0,0";
        let table = plain(text).unwrap();
        assert_eq!((table.units, table.rows.len()), (2, 3));
        assert_eq!((table.rows[0].place.x_mm, table.rows[0].outputs.as_slice()), (1.0, [3.0, 4.0].as_slice()));
        assert_eq!(table.rows[1].place, Place::new(0.5, 0.25));
        assert_eq!(table.rows.iter().map(|row| row.line).collect::<Vec<_>>(), [2, 4, 6]);
        assert!(table.rows.iter().all(|row| row.force_n.is_none() && !row.flagged && row.record.is_none()));
    }

    #[test]
    fn a_runs_columns_are_read_from_a_run_and_ignored_elsewhere() {
        let text = "press,level,phase,x_mm,y_mm,force_set_n,force_n,out_1,flags\n".to_owned()
            + "7,2,test,0,0,0.5,0.49,1,\n8,0,test,0,0,1,1,1,drift\n";
        let run = Table::parse("presses.csv", text.as_bytes(), Kind::Run).unwrap();
        let record = Record { phase: "test".into(), press: 7, level: 2, force_set_n: 0.5 };
        assert_eq!(run.rows[0].record, Some(record));
        assert_eq!(run.rows.iter().map(|row| row.flagged).collect::<Vec<_>>(), [false, true]);
        assert_eq!(plain(&text.replace("7,2,test,0,0,0.5", "a,b,c,0,0,d")).unwrap().rows[0].record, None);
        let without = Table::parse("presses.csv", text.replace("force_n", "f").as_bytes(), Kind::Run).unwrap_err();
        assert!(without.to_string().contains("`force_n` is missing"), "{without}");
        let wrong = Table::parse("presses.csv", text.replace("8,0", "8,-1").as_bytes(), Kind::Run).unwrap_err();
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
    fn what_is_quoted_is_short_and_moves_no_cursor() {
        let long = "\u{1b}[2J".repeat(20);
        let shown = "\\u{1b}[2J".repeat(10) + "...";
        for (text, expected) in [
            (
                format!("x_mm,y_mm,out_1\n1,{long},3\n"),
                format!("line 2, column `y_mm`: expected a finite number, found `{shown}`;"),
            ),
            (
                format!("x_mm,y_mm,{long},out_1,{long}\n"),
                format!("line 1: column `{shown}` stands in the header twice"),
            ),
            (
                format!("x_mm,y_mm,out_1,{long}\n1,2,3\n1,2,3,4,5\n"),
                "line 2: 3 cells where the header has 4".to_owned(),
            ),
            (format!("x_mm,y_mm,out_1,{long}\n1,2,3,4,5\n"), format!("(up to column `{shown}`)")),
            ("x_mm,y_mm,out_0\u{7}\n".to_owned(), "column `out_1` is missing".to_owned()),
            (
                format!("x_mm,y_mm,out_1,out_0{}\n", "1".repeat(40)),
                format!("column `out_0{}...` doesn't", "1".repeat(35)),
            ),
            ("x\u{9b}mm,y_mm,out_1\n".to_owned(), "column `x_mm` is missing; `x\\u{9b}mm` is there".to_owned()),
            (format!("\n{}\n", ",x".repeat(MAX_COLUMNS)), "a.csv, line 2: more than 4096 columns".to_owned()),
        ] {
            let refusal = refusal(&text);
            assert!(refusal.contains(&expected) && !refusal.contains(char::is_control), "{text:?} gives: {refusal:?}");
        }
    }

    #[test]
    fn bytes_that_are_no_text_and_files_that_are_not_there_are_told_apart() {
        let error = Table::parse("a.csv", b"x_mm,y_mm,out_1\n1,2,\xff\n".as_slice(), Kind::Plain).unwrap_err();
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
