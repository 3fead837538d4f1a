//! Reads a line of CSV.

use super::{LineContent, Reading, ReadingError};
use crate::dataset::dialect::Dialect;
use crate::dataset::header::Header;
use crate::dataset::mapping::Mapping;
use crate::dataset::press::output_name;
use crate::dataset::table_error::{TableError, quoted};
use csv::{ByteRecord, StringRecord};
use palpate_core::quantity::round;
use serde_json::Value;
use std::io::{self, Read};

const HELP: &str = "required: out_1, out_2, ... without a gap; a file of numbers only needs no header";
const HELP_TIMES: &str =
    "required: t_s, the time of each reading, s, and out_1, out_2, ...; `solve --columns t_s=NAME` names another";

/// Decimals of a time in other units than s.
const TIME_DECIMALS: i32 = 9;

/// Parser of CSV lines.
pub(super) struct CsvParser {
    reader: csv::Reader<Feed>,
    cells: ByteRecord,
    columns: Option<CellPositions>,
    mapping: Mapping,
    /// Whether each reading needs a time.
    pub needs_time: bool,
    /// Dialect; known once the first line shows the separator.
    dialect: Option<Dialect>,
}

/// Positions of the columns in a line.
struct CellPositions {
    /// Names of the columns; `None` if the first line was numbers.
    names: Option<StringRecord>,
    outputs: Vec<usize>,
    id: Option<usize>,
    t_s: Option<usize>,
}

impl CsvParser {
    pub(super) fn new(mapping: Mapping) -> Self {
        CsvParser {
            reader: reader(b','),
            cells: ByteRecord::new(),
            columns: None,
            mapping,
            needs_time: false,
            dialect: None,
        }
    }

    /// Whether no line has been read yet.
    pub(super) fn awaits_header(&self) -> bool {
        self.columns.is_none()
    }

    /// Reads the line into the reading. The reading already has its line number.
    ///
    /// # Errors
    /// Returns an error for an invalid header.
    pub(super) fn read(
        &mut self,
        file: &str,
        line: &[u8],
        units: usize,
        reading: &mut Reading,
    ) -> Result<LineContent, ReadingError> {
        let number = reading.line;
        let mut dialect = self.dialect.take().unwrap_or_else(|| {
            let dialect = Dialect::of_start(line, &self.mapping.first_output(), &self.mapping);
            self.reader = reader(dialect.separator());
            dialect
        });
        let is_open = self.split(line, dialect.separator());
        let points = self.write_points(file, number, &mut dialect);
        self.dialect = Some(dialect);
        let is_open =
            is_open.map_err(|error| ReadingError::Unreadable { file: file.to_owned(), source: error.into() })?;
        if let Err(error) = points {
            return Ok(LineContent::Bad(error.into()));
        }
        let open_quote = || ReadingError::OpenQuote { file: file.to_owned(), line: number };
        let columns = match &self.columns {
            Some(columns) => columns,
            None if !self.mapping.has_header => {
                let names: StringRecord = (1..=self.cells.len()).map(|number| number.to_string()).collect();
                self.columns.insert(CellPositions::find(file, number, names, units, &self.mapping, self.needs_time)?)
            }
            None if is_reading(&self.cells, &self.mapping) && self.needs_time => {
                return Err(ReadingError::NoTime { file: file.to_owned(), line: number });
            }
            None if is_reading(&self.cells, &self.mapping) => self.columns.insert(CellPositions::in_order(units)),
            None if is_open => return Err(open_quote()),
            None => {
                let not_text = |_| TableError::NotText { file: file.to_owned(), line: number };
                let names = StringRecord::from_byte_record(self.cells.clone()).map_err(not_text)?;
                self.columns = Some(CellPositions::find(file, number, names, units, &self.mapping, self.needs_time)?);
                return Ok(LineContent::Nothing);
            }
        };
        if is_open {
            return Ok(LineContent::Bad(open_quote()));
        }
        Ok(match columns.fill(file, &self.cells, &self.mapping, reading) {
            Ok(()) => LineContent::Reading,
            Err(error) => LineContent::Bad(error),
        })
    }

    /// Splits a line, and returns whether a quotation mark in it isn't closed.
    fn split(&mut self, line: &[u8], separator: u8) -> Result<bool, csv::Error> {
        self.reader.get_mut().set(line);
        self.reader.read_byte_record(&mut self.cells)?;
        let is_open = self.reader.get_ref().is_starved;
        if is_open {
            self.reader = reader(separator); // a reader reads no further after an end
        }
        Ok(is_open)
    }

    /// Replaces decimal commas with points, if commas don't separate the cells.
    fn write_points(&mut self, file: &str, line: u64, dialect: &mut Dialect) -> Result<(), TableError> {
        if dialect.separator() != b',' && self.cells.as_slice().contains(&b',') {
            let mut record = StringRecord::from_byte_record_lossy(self.cells.clone());
            dialect.with_points(file, line, &mut record)?;
            self.cells = record.into_byte_record();
        }
        Ok(())
    }
}

fn reader(separator: u8) -> csv::Reader<Feed> {
    csv::ReaderBuilder::new().delimiter(separator).has_headers(false).flexible(true).from_reader(Feed::default())
}

/// Whether a first line is a reading instead of a header. Either each cell is an output, or one cell is a number and no cell is
/// called `out_N`.
fn is_reading(cells: &ByteRecord, mapping: &Mapping) -> bool {
    let is_number = |cell: &[u8]| output_in(cell).is_some_and(f64::is_finite);
    let first = mapping.first_output();
    let is_named = |cell: &[u8]| cell.trim_ascii().starts_with(b"out_") || cell.trim_ascii() == first.as_bytes();
    cells.iter().all(|cell| output_in(cell).is_some()) || (cells.iter().any(is_number) && !cells.iter().any(is_named))
}

impl CellPositions {
    /// Returns the columns of a table without a header.
    fn in_order(units: usize) -> Self {
        CellPositions { names: None, outputs: (0..units).collect(), id: None, t_s: None }
    }

    fn find(
        file: &str,
        line: u64,
        mut names: StringRecord,
        units: usize,
        mapping: &Mapping,
        needs_time: bool,
    ) -> Result<Self, ReadingError> {
        names.trim();
        let header = Header { file, line, names: &names, help: if needs_time { HELP_TIMES } else { HELP } };
        header.check()?;
        let outputs = header.outputs(mapping.output_names())?;
        if outputs.len() != units {
            return Err(ReadingError::Units { file: file.to_owned(), line, found: outputs.len(), expected: units });
        }
        let time = mapping.name_of("t_s").unwrap_or("t_s");
        let t_s = if needs_time { Some(header.needed("t_s", time)?) } else { header.optional(time) };
        let id = header.optional("id");
        Ok(CellPositions { names: Some(names), outputs, id, t_s })
    }

    /// Reads a row into a reading. The labels are read first, so that a row with an invalid output keeps them.
    fn fill(
        &self,
        file: &str,
        cells: &ByteRecord,
        mapping: &Mapping,
        reading: &mut Reading,
    ) -> Result<(), ReadingError> {
        self.check_length(file, reading.line, cells)?;
        let label = |column: Option<usize>| column.and_then(|column| cells.get(column)).map(label);
        (reading.id, reading.t_s) = (label(self.id), label(self.t_s));
        if let Some(time) = reading.t_s.as_ref().and_then(Value::as_f64).filter(|_| mapping.scale.time != 1.0) {
            reading.t_s = Some(round(time * mapping.scale.time, TIME_DECIMALS).into());
        }
        reading.outputs.clear();
        for &column in &self.outputs {
            let is_missing = |cell: &&[u8]| std::str::from_utf8(cell).is_ok_and(|cell| mapping.is_missing(cell.trim()));
            let output = match cells.get(column) {
                Some(cell) if is_missing(&cell) => Some(f64::NAN),
                cell => cell.and_then(output_in),
            };
            reading.outputs.push(output.ok_or_else(|| self.wrong(file, reading.line, column, cells))?);
        }
        Ok(())
    }

    fn check_length(&self, file: &str, line: u64, cells: &ByteRecord) -> Result<(), ReadingError> {
        let file = || file.to_owned();
        let (found, expected) = (cells.len(), self.names.as_ref().map_or(self.outputs.len(), StringRecord::len));
        match &self.names {
            _ if found == expected => Ok(()),
            None if cells.get(0).is_some_and(|cell| output_in(cell).is_none()) => {
                let found: Vec<_> = cells.iter().map(String::from_utf8_lossy).collect();
                let found = found.join(",").trim().to_owned();
                Err(ReadingError::NoNumbers { file: file(), line, expected, found: quoted(&found) })
            }
            None => Err(ReadingError::Units { file: file(), line, found, expected }),
            Some(names) => {
                let column = quoted(names.get(found.min(expected).saturating_sub(1)).unwrap_or_default());
                Err(TableError::Ragged { file: file(), line, column, expected, found }.into())
            }
        }
    }

    fn wrong(&self, file: &str, line: u64, column: usize, cells: &ByteRecord) -> ReadingError {
        let name = self.names.as_ref().and_then(|names| names.get(column)).map(quoted);
        let found = String::from_utf8_lossy(cells.get(column).unwrap_or_default());
        let cell = TableError::Cell {
            file: file.to_owned(),
            line,
            column: name.unwrap_or_else(|| output_name(column + 1)),
            expected: "a number",
            found: quoted(found.trim()),
        };
        cell.into()
    }
}

/// Reads an output; NaN if the cell is empty.
fn output_in(cell: &[u8]) -> Option<f64> {
    match cell.trim_ascii() {
        b"" => Some(f64::NAN),
        cell => std::str::from_utf8(cell).ok()?.parse().ok(),
    }
}

/// Returns a cell as a JSON value: a number if possible, otherwise a string.
fn label(cell: &[u8]) -> Value {
    let text = String::from_utf8_lossy(cell.trim_ascii());
    match serde_json::from_str(&text) {
        _ if text.is_empty() => Value::Null,
        Ok(number) => Value::Number(number),
        Err(_) => Value::String(text.into_owned()),
    }
}

/// Source of one line at a time for the csv reader, so that the reader never holds more than one line.
#[derive(Default)]
struct Feed {
    line: Vec<u8>,
    given: usize,
    /// Whether more than the line was requested.
    is_starved: bool,
}

impl Feed {
    fn set(&mut self, line: &[u8]) {
        self.line.clear();
        self.line.extend_from_slice(line.trim_ascii_end());
        self.line.push(b'\n');
        (self.given, self.is_starved) = (0, false);
    }
}

impl Read for Feed {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = (&self.line[self.given..]).read(buffer)?;
        self.given += count;
        self.is_starved = count == 0;
        Ok(count)
    }
}
