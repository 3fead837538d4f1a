//! Reads external tables: plain CSV.
//!
//! A table has the columns `x_mm`, `y_mm` and `out_1..out_n`, optionally `force_n`, `depth_mm`, `t_s`, and `flags` (a row is flagged unless its cell
//! is empty or 0). Columns may be in any order; unknown columns are ignored. A byte-order mark, either kind of line end, and
//! comments (`#`) above the header are accepted. A table that has every column of a run's own `presses.csv` gives the same
//! presses as the run's journal. A [`Mapping`] reads tables with other names and units. The use of a table without `force_n` is
//! decided by [`calibration`](super::calibration).

use super::dialect::{Dialect, is_comment};
use super::formats;
use super::header::Header;
use super::lookalike::lookalikes;
use super::mapping::Mapping;
use super::press::{COLUMNS, OUTPUTS, Presence, PressColumn};
use super::sensor_file::is_sensor_file;
use super::table_error::{MAX_ROW_BYTES, MAX_ROWS, MAX_TABLE_BYTES, TableError, quoted};
use super::{Flag, Press, Presses};
use csv::StringRecord;
use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

/// Help text about the requirements of a table.
const HELP: &str =
    "required: x_mm, y_mm and out_1, out_2, ... without a gap; --columns names the columns of another table";

/// Name of the column that marks presses to exclude. A blank cell is a value there.
const FLAGS: &str = "flags";

/// Reads a table with at least one press and at least one channel; every number must be finite. The extensions .xlsx, .npz, .mat
/// and .parquet are read as such; any other file is text.
///
/// # Errors
/// The problem, with file, line and column.
pub fn read_table(path: &Path, mapping: &Mapping) -> Result<Presses, TableError> {
    if let Some(kind) = formats::BinaryFormat::of(path).filter(|_| path.exists()) {
        let (file, text) = formats::text(path, kind, mapping)?;
        return parse_table(&file, text.as_bytes(), &formats::mapping(kind, mapping));
    }
    let file = path.display().to_string();
    let is_toml = path.extension().is_some_and(|extension| extension == "toml");
    if is_toml || is_sensor_file(path) {
        let kind = if is_toml { "a TOML file" } else { "a sensor file" };
        return Err(TableError::OtherKind { file, kind });
    }
    match File::open(path) {
        Ok(input) => parse_table(&file, input, mapping).map_err(|error| match (error, formats::unread(path)) {
            (TableError::NotText { file, .. }, Some(problem)) => {
                TableError::Malformed { file, problem: problem.to_owned() }
            }
            (error, _) => error,
        }),
        Err(source) => Err(TableError::Unreadable { file, source }),
    }
}

/// Reads a table from any input; `file` is its name in messages.
///
/// # Errors
/// The same as for [`read_table`].
pub fn parse_table(file: &str, input: impl Read, mapping: &Mapping) -> Result<Presses, TableError> {
    parse_bounded(file, input, mapping, MAX_TABLE_BYTES)
}

/// Reads a table of at most `most_bytes`. If the input is longer, one byte more than this is read.
fn parse_bounded(file: &str, input: impl Read, mapping: &Mapping, most_bytes: u64) -> Result<Presses, TableError> {
    let mut records = TableRecords::new(file, input.take(most_bytes + 1), mapping, most_bytes)?;
    let (mut header, mut record) = (StringRecord::new(), StringRecord::new());
    let mut is_there = records.next(&mut header)?;
    while is_there && header.get(0).is_some_and(is_comment) {
        is_there = records.next(&mut header)?;
    }
    header.trim();
    let header_line = records.line;
    if !mapping.has_header {
        record = header.clone();
        header = (1..=record.len()).map(|number| number.to_string()).collect();
        records.dialect.with_points(file, header_line, &mut record)?;
    }
    if mapping.has_header && looks_like_a_row(&header, mapping) {
        return Err(TableError::NoHeader { file: file.to_owned(), line: header_line });
    }
    let columns = KnownColumns::find(&Header { file, line: header_line, names: &header, help: HELP }, mapping)?;
    let (mut presses, mut lines, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
    let mut groups: HashMap<String, f64> = HashMap::new();
    is_there = if mapping.has_header { records.next_row(&mut record)? } else { is_there };
    while is_there {
        let line = records.line;
        if presses.len() == MAX_ROWS {
            let (file, line) = (file.to_owned(), Some(line));
            return Err(TableError::TooLarge { file, line, limit: MAX_ROWS as u64, what: "rows" });
        }
        let cells = RowReader { file, line, header: &header, record: &record };
        match columns.press(&cells, mapping)? {
            Ok(mut press) => {
                if !columns.is_of_run {
                    press.press = presses.len() as u64;
                }
                if let Some(at) = columns.group {
                    let next = groups.len() as f64;
                    press.group = Some(*groups.entry(cells.text(at).to_owned()).or_insert(next));
                }
                presses.push(press);
                lines.push(line);
            }
            Err(column) => left_out.push((line, quoted(header.get(column).unwrap_or_default()))),
        }
        is_there = records.next_row(&mut record)?;
    }
    if let (true, Some((line, column))) = (presses.is_empty(), left_out.first()) {
        return Err(TableError::NothingComplete {
            file: file.to_owned(),
            rows: left_out.len(),
            line: *line,
            column: column.clone(),
        });
    }
    if presses.is_empty() {
        return Err(TableError::NoRows { file: file.to_owned() });
    }
    let unused =
        if columns.is_of_run || mapping.is_given { Vec::new() } else { lookalikes(&header, &mapping.sideways_names()) };
    let mut presses = Presses::new(file, presses, lines);
    presses.unused = unused;
    presses.detected.extend(records.dialect.detected());
    if let Some((line, column)) = left_out.first() {
        let rows = if left_out.len() == 1 { "1 row".to_owned() } else { format!("{} rows", left_out.len()) };
        presses
            .detected
            .push(format!("{rows} excluded: a cell is blank or has no value (first: line {line}, column `{column}`)"));
    }
    Ok(presses)
}

/// Whether most cells of a header are numbers, and none is the name of a place. Numbers may be the names of outputs.
fn looks_like_a_row(header: &StringRecord, mapping: &Mapping) -> bool {
    let is_number = |cell: &&str| cell.replace(',', ".").parse::<f64>().is_ok();
    let is_place = |cell: &str| cell == mapping.x_mm || cell == mapping.y_mm;
    2 * header.iter().filter(is_number).count() > header.len() && !header.iter().any(is_place)
}

/// Known columns of a table, each with the positions of its cells.
struct KnownColumns {
    found: Vec<(&'static PressColumn, Vec<usize>)>,
    /// Position of the column of groups.
    group: Option<usize>,
    /// Whether the table has every column of a run's own table.
    is_of_run: bool,
}

impl KnownColumns {
    fn find(header: &Header<'_>, mapping: &Mapping) -> Result<Self, TableError> {
        header.check()?;
        let is_there = |column: &PressColumn| header.optional(column.name).is_some();
        let is_of_run = !mapping.is_given
            && COLUMNS.iter().filter(|column| matches!(column.presence, Presence::Run | Presence::OfRun)).all(is_there);
        let mut found = Vec::new();
        // a series, or a force with three components, can be solved without a place; a place that was named must be there
        let has_no = |column: &str| mapping.name_of(column) == Some(column) && header.optional(column).is_none();
        let lacks_places = mapping.may_lack_places() && has_no("x_mm") && has_no("y_mm");
        for column in COLUMNS {
            let given = mapping.name_of(column.name);
            let name = given.unwrap_or(column.name);
            let at = match column.presence {
                _ if column.name == OUTPUTS => Some(header.outputs(mapping.output_names())?),
                Presence::Needed if lacks_places => None,
                Presence::Needed => Some(vec![header.needed(column.name, name)?]),
                Presence::Optional | Presence::OfRun | Presence::ThreeAxes if given.is_some() => {
                    Some(vec![header.needed(column.name, name)?])
                }
                Presence::Optional | Presence::OfRun => header.optional(name).map(|at| vec![at]),
                Presence::Run | Presence::Sparse | Presence::ByDepth | Presence::ThreeAxes | Presence::Grouped => {
                    header.optional(name).filter(|_| is_of_run).map(|at| vec![at])
                }
            };
            found.extend(at.map(|at| (column, at)));
        }
        let group = mapping.group().map(|name| header.needed("group", name)).transpose()?;
        Ok(KnownColumns { found, group, is_of_run })
    }

    /// Returns the press of a row; or the index of its first column without a value.
    fn press(&self, cells: &RowReader<'_>, mapping: &Mapping) -> Result<Result<Press, usize>, TableError> {
        cells.check_length()?;
        let mut press = Press::default();
        let mut texts = Vec::new();
        let is_missed = self.is_of_run && self.is_missed(cells);
        for (column, places) in &self.found {
            texts.clear();
            texts.extend(places.iter().map(|place| cells.text(*place)));
            let may_be_empty = matches!(
                column.presence,
                Presence::Sparse | Presence::ByDepth | Presence::ThreeAxes | Presence::Grouped
            ) && self.is_of_run;
            if (may_be_empty || is_missed) && texts.iter().all(|text| text.is_empty()) {
                if column.name == OUTPUTS {
                    press.outputs = vec![f64::NAN; texts.len()];
                }
                continue;
            }
            let missing = texts.iter().position(|text| mapping.is_missing(text));
            if let Some(missing) = missing.filter(|_| mapping.is_given && column.name != FLAGS) {
                return Ok(Err(places[missing]));
            }
            let read = (column.read)(&mut press, &texts);
            read.map_err(|(index, expected)| cells.wrong(places[index], expected))?;
        }
        mapping.scale.apply(&mut press);
        Ok(Ok(press))
    }
}

impl KnownColumns {
    /// Whether readings of a row's press were missed, so that it has blanks.
    fn is_missed(&self, cells: &RowReader<'_>) -> bool {
        let flags = self.found.iter().find(|(column, _)| column.name == FLAGS).and_then(|(_, places)| places.first());
        flags.is_some_and(|place| cells.text(*place).split_whitespace().any(|flag| flag == Flag::Missed.name()))
    }
}

/// Row that is being read, with all data for messages about it.
struct RowReader<'a> {
    file: &'a str,
    line: u64,
    header: &'a StringRecord,
    record: &'a StringRecord,
}

impl<'a> RowReader<'a> {
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

/// Records of a table, one at a time, each with its line.
struct TableRecords<'a, R> {
    file: &'a str,
    reader: csv::Reader<LineCounter<BufReader<R>>>,
    dialect: Dialect,
    /// First line of the most recently read record.
    line: u64,
    most_bytes: u64,
}

impl<'a, R: Read> TableRecords<'a, R> {
    fn new(file: &'a str, input: R, mapping: &Mapping, most_bytes: u64) -> Result<Self, TableError> {
        let mut input = BufReader::new(input);
        let start = input.fill_buf().map_err(|source| TableError::Unreadable { file: file.to_owned(), source })?;
        let dialect = Dialect::of_start(start, &mapping.x_mm, mapping);
        // Rows of the wrong length are found later, with their line: the reader counts lines its own way.
        let mut reader = csv::ReaderBuilder::new();
        reader.has_headers(false).flexible(true).delimiter(dialect.separator());
        Ok(TableRecords { file, reader: reader.from_reader(LineCounter::new(input)), dialect, line: 1, most_bytes })
    }

    /// Reads the next row, with points as decimal marks. Returns whether there was one.
    fn next_row(&mut self, record: &mut StringRecord) -> Result<bool, TableError> {
        let is_there = self.next(record)?;
        self.dialect.with_points(self.file, self.line, record)?;
        Ok(is_there)
    }

    /// Reads the next record. Returns whether there was one.
    fn next(&mut self, record: &mut StringRecord) -> Result<bool, TableError> {
        let begin = self.reader.position().byte();
        self.reader.get_mut().most = begin + MAX_ROW_BYTES;
        let read = self.reader.read_record(record);
        let end = self.reader.position().byte();
        let lines = self.reader.get_mut();
        self.line = lines.of_record(end, record);
        let is_open = read.is_ok() && lines.is_open(end, record);
        let (taken, is_long) = (lines.taken, lines.is_stopped);
        let file = || self.file.to_owned();
        if taken > self.most_bytes {
            return Err(TableError::TooLarge { file: file(), line: None, limit: self.most_bytes, what: "bytes" });
        }
        if is_long {
            let line = Some(self.line);
            return Err(TableError::TooLarge { file: file(), line, limit: MAX_ROW_BYTES, what: "bytes in a row" });
        }
        if is_open {
            return Err(TableError::OpenQuote { file: file(), line: self.line });
        }
        read.map_err(|error| match error.into_kind() {
            csv::ErrorKind::Utf8 { .. } => TableError::NotText { file: file(), line: self.line },
            csv::ErrorKind::Io(source) => TableError::Unreadable { file: file(), source },
            other => TableError::Unreadable { file: file(), source: io::Error::other(format!("{other:?}")) },
        })
    }
}

/// Reader that passes a table's text on and records its line ends, so that a record's line is known. The csv reader's own count
/// is wrong after blank lines and Windows line ends.
struct LineCounter<R> {
    input: R,
    /// Number of bytes read.
    taken: u64,
    /// Number of bytes at which the present record is too long. The input then ends.
    most: u64,
    is_stopped: bool,
    /// Positions of the line ends in the reader's present buffer that no record has reached yet.
    ends: VecDeque<u64>,
    passed: u64,
    /// Most recent byte that isn't part of a line end.
    last: u8,
}

impl<R> LineCounter<R> {
    fn new(input: R) -> Self {
        LineCounter {
            input,
            taken: 0,
            most: MAX_ROW_BYTES,
            is_stopped: false,
            ends: VecDeque::new(),
            passed: 0,
            last: 0,
        }
    }

    /// Returns the first line of a record that ends before the byte `end`, including the record's own line end.
    fn of_record(&mut self, end: u64, record: &StringRecord) -> u64 {
        while self.ends.front().is_some_and(|at| at + 1 < end) {
            self.ends.pop_front();
            self.passed += 1;
        }
        let within = record.as_slice().bytes().filter(|byte| *byte == b'\n').count() as u64;
        // the last line end of a cell that is never closed is at the end of the input
        let is_last = u64::from(self.is_open(end, record) && record.as_slice().ends_with('\n'));
        1 + self.passed.saturating_sub(within - is_last)
    }

    /// Whether the last cell of a record ends with the input, because its quotation mark isn't closed.
    fn is_open(&self, end: u64, record: &StringRecord) -> bool {
        let last = record.get(record.len().wrapping_sub(1)).unwrap_or_default();
        end == self.taken && last.contains('\n') && self.last != b'"'
    }
}

impl<R: Read> Read for LineCounter<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.taken > self.most {
            self.is_stopped = true;
            return Ok(0);
        }
        let count = self.input.read(buffer)?;
        let is_line_end = |byte: &&u8| matches!(byte, b'\n' | b'\r');
        self.last = buffer[..count].iter().rfind(|byte| !is_line_end(byte)).copied().unwrap_or(self.last);
        let ends = buffer[..count].iter().enumerate().filter(|(_, byte)| **byte == b'\n');
        self.ends.extend(ends.map(|(at, _)| self.taken + at as u64));
        self.taken += count as u64;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Flag;
    use crate::dataset::press::{BY_FORCE, csv_header, csv_line, example};
    use crate::dataset::table_error::MAX_COLUMNS;
    use miette::Diagnostic as _;
    use palpate_core::quantity::Place;

    /// An input without an end, and how much of it was read.
    struct Endless<'a> {
        text: &'a [u8],
        read: u64,
    }

    impl Read for Endless<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            for byte in buffer.iter_mut() {
                *byte = self.text[self.read as usize % self.text.len()];
                self.read += 1;
            }
            Ok(buffer.len())
        }
    }

    #[test]
    fn a_table_is_read_up_to_its_limit_and_one_byte() {
        let header = "x_mm,y_mm,force_n,out_1\n";
        let table = header.to_owned() + &"1,2,0.5,3\n".repeat(10_000);
        let read = |text: &str, most_bytes| parse_bounded("a.csv", text.as_bytes(), &Mapping::default(), most_bytes);
        let bytes = table.len() as u64;
        assert_eq!(read(&table, bytes).unwrap().presses.len(), 10_000);
        let error = read(&table, bytes - 1).unwrap_err();
        assert!(matches!(error, TableError::TooLarge { line: None, limit, .. } if limit == bytes - 1), "{error}");
        let mut endless = Endless { text: table.as_bytes(), read: 0 };
        endless.text = &table.as_bytes()[..table.len() - header.len()];
        let error = parse_bounded("a.csv", &mut endless, &Mapping::default(), 50_000).unwrap_err();
        assert!(matches!(error, TableError::TooLarge { limit: 50_000, .. }), "{error}");
        assert_eq!(endless.read, 50_001, "and not a byte more");
    }

    #[test]
    fn a_row_without_an_end_is_refused_where_the_longest_row_ends() {
        for (start, text) in [("", b"\0".as_slice()), ("", b"1,"), ("\"", b"\n")] {
            let mut endless = Endless { text, read: 0 };
            let input = start.as_bytes().chain(&mut endless);
            let error = parse_table("a.csv", input, &Mapping::default()).unwrap_err();
            assert!(matches!(error, TableError::TooLarge { line: Some(1), limit: MAX_ROW_BYTES, .. }), "{error}");
            assert!(endless.read < MAX_ROW_BYTES + (64 << 10), "{} bytes", endless.read);
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_device_without_an_end_is_refused_as_a_table_and_has_no_fingerprint() {
        let path = Path::new("/dev/zero");
        let text = read_table(path, &Mapping::default()).unwrap_err().to_string();
        assert_eq!(text, format!("/dev/zero, line 1: more than {MAX_ROW_BYTES} bytes in a row"));
        let text = crate::dataset::source_fingerprint(path).unwrap_err().to_string();
        assert_eq!(text, format!("reading /dev/zero: more than {MAX_TABLE_BYTES} bytes"));
    }

    fn plain(text: &str) -> Result<Presses, TableError> {
        parse_table("a.csv", text.as_bytes(), &Mapping::default())
    }

    /// Message and help of a table that is refused.
    fn refusal(text: &str) -> String {
        let error = plain(text).unwrap_err();
        format!("{error}; {}", error.help().map(|help| help.to_string()).unwrap_or_default())
    }

    #[test]
    fn plain_table_is_read_in_any_order_and_with_any_line_ends() {
        let text =
            "\u{feff}out_2, x_mm ,note,y_mm,out_1\r\n4, 1 ,\"a, b\",2,3\r\n\r\n-1e-3,0.5,\"a\nb\",.25,0\r\n0,0,,0,0";
        let table = plain(text).unwrap();
        assert_eq!((table.channels, table.presses.len()), (2, 3));
        assert_eq!((table.presses[0].x_mm, table.presses[0].outputs.as_slice()), (1.0, [3.0, 4.0].as_slice()));
        assert_eq!(table.presses[1].place(), Place::new(0.5, 0.25));
        assert_eq!([0, 1, 2].map(|index| table.at(index)), [2, 4, 6].map(|line| format!("a.csv, line {line}")));
        let is_bare = |press: &Press| press.force_n.is_none() && !press.is_flagged() && press.phase.is_none();
        assert!(table.presses.iter().all(is_bare));
    }

    #[test]
    fn a_quotation_mark_that_isnt_closed_is_reported_at_its_line() {
        for end in ["", "\n", "\r\n", "\n\n"] {
            let text = refusal(&format!("x_mm,y_mm,out_1\n1,2,3\n1,\"2,3\n4,5,6{end}"));
            assert!(text.starts_with("a.csv, line 3: a quotation mark isn't closed"), "{end:?}: {text}");
        }
        let closed = plain("x_mm,y_mm,out_1,note\n1,2,3,\"a\nb\n\"\n").unwrap();
        assert_eq!(closed.at(0), "a.csv, line 2");
    }

    #[test]
    fn table_without_a_header_is_reported() {
        for text in ["-6,-6,0.5\n-6,-5,0.5\n", "1,5;2,5;3\n1;2;3\n", "0,calibration,1,2,3,\n1,calibration,1,2,3,\n"] {
            let words = refusal(text);
            assert!(words.contains("line 1: the table has no header") && words.contains("`header = false`"), "{words}");
        }
    }

    #[test]
    fn comments_above_the_header_are_skipped() {
        let text = "\u{feff}# made by hand, on Monday\n#again\n\nx_mm,y_mm,out_1\n1,2,3\n#4,5,6\n";
        let refused = plain(text).unwrap_err().to_string();
        assert!(refused.starts_with("a.csv, line 6, column `x_mm`: expected a finite number"), "{refused}");
        let table = plain(text.trim_end_matches("#4,5,6\n")).unwrap();
        assert_eq!((table.presses.len(), table.at(0)), (1, "a.csv, line 5".to_owned()));
        assert!(matches!(plain("# only this\n").unwrap_err(), TableError::Empty { .. }));
    }

    #[test]
    fn a_table_from_a_spreadsheet_is_read_with_its_separator_and_decimal_commas() {
        let text = "\u{feff}# exported\r\nx_mm;y_mm;force_n;out_1\r\n-1,5;2;0,25;1,5e-3\r\n";
        let table = plain(text).unwrap();
        let press = &table.presses[0];
        assert_eq!((press.place(), press.force_n, press.outputs[0]), (Place::new(-1.5, 2.0), Some(0.25), 0.0015));
        assert_eq!(table.detected, ["columns are separated by semicolons, decimal commas"]);
        assert!(plain("x_mm,y_mm,out_1\n1,2,3\n").unwrap().detected.is_empty());
        assert_eq!(table.at(0), "a.csv, line 3");
    }

    #[test]
    fn a_runs_own_table_gives_the_presses_it_was_written_from() {
        let presses: Vec<Press> = (0..3).map(|press| example(press, 0).rounded()).collect();
        let text = csv_header(2, BY_FORCE) + &presses.iter().map(|press| csv_line(press, BY_FORCE)).collect::<String>();
        assert_eq!(plain(&text).unwrap().presses, presses);
        let wrong = plain(&text.replace("1,0,calibration", "1,-1,calibration")).unwrap_err();
        assert_eq!(wrong.to_string(), "a.csv, line 3, column `level`: expected a whole number from 0, found `-1`");
        let wrong = plain(&text.replace("2,0,calibration", "2,0,calibratoin")).unwrap_err().to_string();
        assert!(wrong.starts_with("a.csv, line 4, column `phase`: expected characterisation, calibration"), "{wrong}");
    }

    #[test]
    fn a_runs_columns_are_ignored_in_a_table_from_elsewhere() {
        let text = "press,level,phase,x_mm,y_mm,force_set_n,force_n,out_1,flags\na,b,c,0,0,d,0.49,1,drift\n";
        let table = plain(text).unwrap();
        let expected = Press { force_n: Some(0.49), outputs: vec![1.0], flags: vec![Flag::Other], ..Press::default() };
        assert_eq!(table.presses, [expected]);
    }

    #[test]
    fn table_error_names_file_line_and_column() {
        for (text, expected) in [
            (
                "x_mm,y_mm,out_1\n1,2,3\n1,NaN,3\n",
                "a.csv, line 3, column `y_mm`: expected a finite number, found `NaN`",
            ),
            ("x_mm,y_mm,out_1\r\n1,2,3\r\n1,2,inf\r\n", "a.csv, line 3, column `out_1`: expected a finite number"),
            ("x_mm,y_mm,out_1\n\n1,2,1e999\n", "a.csv, line 3, column `out_1`: expected a finite number"),
            ("x_mm,y_mm,out_1\n1,two,3\n", "a.csv, line 2, column `y_mm`: expected a finite number, found `two`"),
            ("x_mm,y_mm,out_1\n,2,3\n", "a.csv, line 2, column `x_mm`: expected a finite number, found a blank cell"),
            ("x_mm,y_mm,force_n,out_1\n1,2,NaN,3\n", "a.csv, line 2, column `force_n`: expected a finite number"),
            ("x_mm,y_mm,out_1\n1,2,3\n1,2\n", "a.csv, line 3: 2 cells where the header has 3 (up to column `y_mm`)"),
            ("x_mm,y_mm,out_1\r\n1,2,3,4\r\n", "a.csv, line 2: 4 cells where the header has 3 (up to column `out_1`)"),
            ("x_mm,y_mm,x_mm,out_1\n1,2,3,4\n", "a.csv, line 1: column `x_mm` is in the header twice"),
            ("x_mm,y_mm,note,note,out_1\n1,2,3,4,5\n", "a.csv, line 1: column `note` is in the header twice"),
            ("\nX,y_mm,out_1\n1,2,3\n", "a.csv, line 2: column `x_mm` is missing"),
            ("x_mm,y-mm,out_1\n1,2,3\n", "column `y_mm` is missing; the header has `y-mm`"),
            ("X_MM,y_mm,out_1\n1,2,3\n", "column `x_mm` is missing; the header has `X_MM`"),
            ("y_mm,out_1\n2,3\n", "column `x_mm` is missing; required:"),
            ("x_mm,y,z_mm,out_1\n1,2,3,4\n", "column `y_mm` is missing; the header has `y`"),
            ("X;y_mm;out_1\n1;2;3\n", "column `x_mm` is missing; the header has `X`"),
            (
                "x_mm,y_mm,ch0,ch1\n1,2,3,4\n",
                "`out_1` is missing; the header has ch0 to ch1: if they are the outputs, add --columns outputs=ch0..ch1",
            ),
            ("x,y_mm,out_1\n1,2,3\n", "the header has `x`: if it holds that, rename it, or add --columns \"x_mm=x\""),
            (
                "x_mm;y_mm;out_1\n1;2,5;3\n1;2;3.5\n",
                "a.csv, line 3: a table can't have decimal commas (line 2) and decimal points (line 3)",
            ),
            ("x_mm,y_mm\n1,2\n", "column `out_1` is missing"),
            ("x_mm,y_mm,out_1,out_3\n1,2,3,4\n", "column `out_2` is missing; number the outputs without a gap"),
            ("x_mm,y_mm,out_0,out_1\n1,2,3,4\n", "invalid output column `out_0`; use out_1, out_2"),
            ("x_mm,y_mm,out_1\n", "a.csv: the table has no rows"),
            ("", "a.csv: there is no header and no row"),
            ("\n\n", "a.csv: there is no header and no row"),
        ] {
            let refusal = refusal(text);
            assert!(refusal.contains(expected), "{text:?} gives: {refusal}");
        }
    }

    #[test]
    fn quoted_text_is_cut_and_has_no_control_characters() {
        let long = "\u{1b}[2J".repeat(20);
        let shown = "\\u{1b}[2J".repeat(10) + "...";
        for (text, expected) in [
            (
                format!("x_mm,y_mm,out_1\n1,{long},3\n"),
                format!("line 2, column `y_mm`: expected a finite number, found `{shown}`;"),
            ),
            (format!("x_mm,y_mm,{long},out_1,{long}\n"), format!("line 1: column `{shown}` is in the header twice")),
            (
                format!("x_mm,y_mm,out_1,{long}\n1,2,3\n1,2,3,4,5\n"),
                "line 2: 3 cells where the header has 4".to_owned(),
            ),
            (format!("x_mm,y_mm,out_1,{long}\n1,2,3,4,5\n"), format!("(up to column `{shown}`)")),
            ("x_mm,y_mm,out_0\u{7}\n".to_owned(), "column `out_1` is missing".to_owned()),
            (
                format!("x_mm,y_mm,out_1,out_0{}\n", "1".repeat(40)),
                format!("invalid output column `out_0{}...`", "1".repeat(35)),
            ),
            ("x\u{9b}mm,y_mm,out_1\n".to_owned(), "column `x_mm` is missing; the header has `x\\u{9b}mm`".to_owned()),
            (format!("\n{}\n", ",x".repeat(MAX_COLUMNS)), "a.csv, line 2: more than 4096 columns".to_owned()),
        ] {
            let refusal = refusal(&text);
            assert!(refusal.contains(&expected) && !refusal.contains(char::is_control), "{text:?} gives: {refusal:?}");
        }
    }

    #[test]
    fn invalid_text_and_missing_files_are_distinguished() {
        let error = parse_table("a.csv", b"x_mm,y_mm,out_1\n1,2,\xff\n".as_slice(), &Mapping::default()).unwrap_err();
        assert_eq!(error.to_string(), "a.csv, line 2: not UTF-8 text");
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(
            read_table(&folder.path().join("none.csv"), &Mapping::default()),
            Err(TableError::Unreadable { .. })
        ));
        assert!(matches!(read_table(folder.path(), &Mapping::default()), Err(TableError::Unreadable { .. })));
    }

    proptest::proptest! {
        #[test]
        fn reader_survives_arbitrary_text(text in "[xy_mout1234567890,.\"\r\n ;N-]{0,60}") {
            let _ = plain(&text);
            let _ = plain(&format!("x_mm,y_mm,out_1\n{text}"));
        }
    }
}
