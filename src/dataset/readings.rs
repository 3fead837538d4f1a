//! Readings of an array as another program pipes them in: one a line, as CSV or as NDJSON.
//!
//! CSV has a header with `out_1..out_n`, or none where its first line is numbers alone: `out_1..out_n` in order. NDJSON has an
//! object a line, `{"outputs": [0.1, 0.2]}`, or the bare array. `id` and `t_s` are kept with the reading; all else is passed
//! over, and so are blank lines.

use super::header::Header;
use super::press::output_name;
use super::table_error::{TableError, quoted, start_of};
use csv::{ByteRecord, StringRecord};
use miette::Diagnostic;
use serde::Deserialize;
use serde_json::Value;
use std::io::{self, BufRead, BufReader, Read};

/// The longest line that is read, bytes: 4096 outputs of 60 characters each.
pub const MAX_LINE_BYTES: usize = 256 << 10;
/// How much is read at once, bytes.
const BUFFER_BYTES: usize = 64 << 10;
/// As much of what is said of a JSON line as a message repeats, characters: it quotes the line.
const REASON: usize = 120;

const HELP: &str = "needed are out_1, out_2, ... without a gap; a first line of numbers alone needs no header";

/// How readings are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Cells separated by commas.
    Csv,
    /// A JSON object or array a line.
    Ndjson,
}

/// One reading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Its line, from 1.
    pub line: u64,
    /// What it is called, a number or a text.
    pub id: Option<Value>,
    /// When it was taken.
    pub t_s: Option<Value>,
    /// One output a unit; NaN and infinity come as they are, and so does a JSON null, as NaN.
    pub outputs: Vec<f64>,
}

/// Why the rest can't be read; `line` counts from 1.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[allow(missing_docs, reason = "the fields say what the messages say")]
pub enum ReadingError {
    /// The input broke off.
    #[error("{file}: can't be read")]
    Unreadable { file: String, source: io::Error },
    /// Beyond [`MAX_LINE_BYTES`].
    #[error("{file}, line {line}: longer than {MAX_LINE_BYTES} bytes")]
    #[diagnostic(help("expected one reading a line"))]
    TooLong { file: String, line: u64 },
    /// The header or a cell of a CSV line.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Cells(#[from] TableError),
    /// A cell goes on in the next line.
    #[error("{file}, line {line}: a quotation mark isn't closed")]
    #[diagnostic(help("expected one reading a line"))]
    OpenQuote { file: String, line: u64 },
    /// Another array.
    #[error("{file}, line {line}: {found} outputs where the calibration has {expected}")]
    #[diagnostic(help("a reading has one output a unit of the array that was calibrated"))]
    Units { file: String, line: u64, found: usize, expected: usize },
    /// No JSON, or other JSON.
    #[error("{file}, line {line}, column {column}: {reason}")]
    #[diagnostic(help("expected a reading, as {{\"outputs\": [0.1, 0.2]}} or [0.1, 0.2]"))]
    Json { file: String, line: u64, column: usize, reason: String },
}

/// Reads one reading after another; holds one line at a time.
pub struct Readings<R> {
    file: String,
    units: usize,
    input: BufReader<R>,
    line: Vec<u8>,
    format: Option<Format>,
    csv: Csv,
    reading: Reading,
}

impl<R: Read> Readings<R> {
    /// Readings of so many units; `file` is what messages call the input. Without a format the first character tells it.
    pub fn new(file: &str, input: R, units: usize, format: Option<Format>) -> Self {
        Readings {
            file: file.to_owned(),
            units,
            input: BufReader::with_capacity(BUFFER_BYTES, input),
            line: Vec::new(),
            format,
            csv: Csv::new(),
            reading: Reading::default(),
        }
    }

    /// The next one; none at the end.
    pub fn read_next(&mut self) -> Result<Option<&Reading>, ReadingError> {
        while self.next_line()? {
            let Some(first) = self.line.trim_ascii_start().first() else { continue };
            let found = if matches!(first, b'{' | b'[') { Format::Ndjson } else { Format::Csv };
            let is_reading = match *self.format.get_or_insert(found) {
                Format::Csv => self.csv.read(&self.file, &self.line, self.units, &mut self.reading)?,
                Format::Ndjson => self.read_json()?,
            };
            if is_reading {
                return Ok(Some(&self.reading));
            }
        }
        Ok(None)
    }

    /// Whether the next one may have to be waited for: no whole line has come in yet.
    pub fn is_drained(&self) -> bool {
        !self.input.buffer().contains(&b'\n')
    }

    /// Takes the next line without its end; there may be none.
    fn next_line(&mut self) -> Result<bool, ReadingError> {
        self.line.clear();
        let taken = (&mut self.input).take(MAX_LINE_BYTES as u64 + 1).read_until(b'\n', &mut self.line);
        if taken.map_err(|source| ReadingError::Unreadable { file: self.file.clone(), source })? == 0 {
            return Ok(false);
        }
        self.reading.line += 1;
        if self.line.len() > MAX_LINE_BYTES {
            return Err(ReadingError::TooLong { file: self.file.clone(), line: self.reading.line });
        }
        if self.reading.line == 1 && self.line.starts_with(b"\xef\xbb\xbf") {
            self.line.drain(..3); // a byte-order mark
        }
        Ok(true)
    }

    fn read_json(&mut self) -> Result<bool, ReadingError> {
        #[derive(Deserialize)]
        struct Object {
            outputs: Vec<Option<f64>>,
            id: Option<Value>,
            t_s: Option<Value>,
        }
        let text = self.line.trim_ascii_end();
        let read = match text.trim_ascii_start().starts_with(b"[") {
            true => serde_json::from_slice(text).map(|outputs| Object { outputs, id: None, t_s: None }),
            false => serde_json::from_slice::<Object>(text),
        };
        let line = self.reading.line;
        let wrong = |column, reason| ReadingError::Json { file: self.file.clone(), line, column, reason };
        let object = read.map_err(|error| {
            let told = error.to_string();
            let reason = told.rsplit_once(" at line ").map_or(told.as_str(), |(reason, _)| reason);
            wrong(error.column(), start_of(reason, REASON))
        })?;
        for (key, value) in [("id", &object.id), ("t_s", &object.t_s)] {
            if !matches!(value, None | Some(Value::Number(_) | Value::String(_))) {
                return Err(wrong(1, format!("`{key}` is neither a number nor a text")));
            }
        }
        let (found, expected) = (object.outputs.len(), self.units);
        if found != expected {
            return Err(ReadingError::Units { file: self.file.clone(), line, found, expected });
        }
        self.reading.id = object.id;
        self.reading.t_s = object.t_s;
        self.reading.outputs.clear();
        self.reading.outputs.extend(object.outputs.iter().map(|output| output.unwrap_or(f64::NAN)));
        Ok(true)
    }
}

/// Takes CSV lines apart.
struct Csv {
    reader: csv::Reader<Feed>,
    cells: ByteRecord,
    columns: Option<Columns>,
}

/// Where a line has what.
struct Columns {
    /// None where the first line was numbers.
    names: Option<StringRecord>,
    outputs: Vec<usize>,
    id: Option<usize>,
    t_s: Option<usize>,
}

impl Csv {
    fn new() -> Self {
        let reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(Feed::default());
        Csv { reader, cells: ByteRecord::new(), columns: None }
    }

    /// Whether the line was a reading; else it was the header.
    fn read(&mut self, file: &str, line: &[u8], units: usize, reading: &mut Reading) -> Result<bool, ReadingError> {
        let number = reading.line;
        self.reader.get_mut().set(line);
        let read = self.reader.read_byte_record(&mut self.cells);
        read.map_err(|error| ReadingError::Unreadable { file: file.to_owned(), source: error.into() })?;
        if self.reader.get_ref().is_starved {
            return Err(ReadingError::OpenQuote { file: file.to_owned(), line: number });
        }
        let columns = match &self.columns {
            Some(columns) => columns,
            None => {
                let columns = self.columns.insert(Columns::find(file, number, &self.cells, units)?);
                if columns.names.is_some() {
                    return Ok(false);
                }
                columns
            }
        };
        columns.check_length(file, number, &self.cells)?;
        reading.outputs.clear();
        for &column in &columns.outputs {
            let output = self.cells.get(column).and_then(number_in);
            let wrong = || columns.wrong(file, number, column, &self.cells);
            reading.outputs.push(output.ok_or_else(wrong)?);
        }
        let label = |column: Option<usize>| column.and_then(|column| self.cells.get(column)).map(label);
        (reading.id, reading.t_s) = (label(columns.id), label(columns.t_s));
        Ok(true)
    }
}

impl Columns {
    fn find(file: &str, line: u64, cells: &ByteRecord, units: usize) -> Result<Self, ReadingError> {
        if cells.iter().all(|cell| number_in(cell).is_some()) {
            return Ok(Columns { names: None, outputs: (0..units).collect(), id: None, t_s: None });
        }
        let not_text = |_| TableError::NotText { file: file.to_owned(), line };
        let mut names = StringRecord::from_byte_record(cells.clone()).map_err(not_text)?;
        names.trim();
        let header = Header { file, line, names: &names, help: HELP };
        header.check()?;
        let outputs = header.outputs()?;
        if outputs.len() != units {
            return Err(ReadingError::Units { file: file.to_owned(), line, found: outputs.len(), expected: units });
        }
        let (id, t_s) = (header.optional("id"), header.optional("t_s"));
        Ok(Columns { names: Some(names), outputs, id, t_s })
    }

    fn check_length(&self, file: &str, line: u64, cells: &ByteRecord) -> Result<(), ReadingError> {
        let file = || file.to_owned();
        let (found, expected) = (cells.len(), self.names.as_ref().map_or(self.outputs.len(), StringRecord::len));
        match &self.names {
            _ if found == expected => Ok(()),
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

fn number_in(cell: &[u8]) -> Option<f64> {
    std::str::from_utf8(cell.trim_ascii()).ok()?.parse().ok()
}

/// A cell as JSON has it: a number if it is one, else a text.
fn label(cell: &[u8]) -> Value {
    let text = String::from_utf8_lossy(cell.trim_ascii());
    match serde_json::from_str(&text) {
        _ if text.is_empty() => Value::Null,
        Ok(number) => Value::Number(number),
        Err(_) => Value::String(text.into_owned()),
    }
}

/// One line at a time for the csv reader, which so never holds more than that.
#[derive(Default)]
struct Feed {
    line: Vec<u8>,
    given: usize,
    /// It was asked for more than the line.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// All readings of a text, or what ends them: message and help.
    fn readings(text: &str, format: Option<Format>) -> (Vec<Reading>, Option<String>) {
        let (mut readings, mut found) = (Readings::new("stdin", text.as_bytes(), 2, format), Vec::new());
        loop {
            match readings.read_next() {
                Ok(Some(reading)) => found.push(reading.clone()),
                Ok(None) => return (found, None),
                Err(error) => {
                    let help = error.help().map(|help| help.to_string()).unwrap_or_default();
                    return (found, Some(format!("{error}; {help}")));
                }
            }
        }
    }

    fn reading(line: u64, outputs: [f64; 2]) -> Reading {
        Reading { line, outputs: outputs.to_vec(), ..Reading::default() }
    }

    #[test]
    fn the_first_character_tells_the_format() {
        let expected = (vec![reading(2, [1.0, -0.5]), reading(4, [2.0, 3.0])], None);
        for text in [
            "out_1,out_2\n1,-.5\n\n2,3",
            "\u{feff}x_mm, out_2 ,out_1\r\n9,-0.5,1\r\n \r\n\"a, \"\"b\"\"\", 3 ,2e0\r\n",
            "\n1,-0.5\n\n2,3\n",
            "\n{\"outputs\":[1,-0.5]}\n\n {\"more\":{},\"outputs\":[2.0,3]}\n",
            "\r\n[1,-0.5]\r\n\r\n[2,3]\r\n",
        ] {
            assert_eq!(readings(text, None), expected, "{text:?}");
        }
        assert_eq!(readings("", None), (Vec::new(), None));
        assert_eq!(readings("\n \n", None), (Vec::new(), None));
        let told = readings("[1,2]\n", Some(Format::Csv)).1.unwrap();
        assert!(told.contains("stdin, line 1: column `out_1` is missing; needed are out_1"), "{told}");
        assert!(readings("1,2\n", Some(Format::Ndjson)).1.is_some());
    }

    #[test]
    fn a_label_stays_with_its_reading() {
        let labels = |text| {
            let labels = |reading: Reading| [reading.id, reading.t_s];
            readings(text, None).0.into_iter().map(labels).collect::<Vec<_>>()
        };
        let number = |number: f64| Some(Value::from(number));
        let text = |text: &str| Some(Value::from(text));
        assert_eq!(
            labels("id,t_s,out_1,out_2\na b,0.5,1,2\n,,1,2\n"),
            [[text("a b"), number(0.5)], [Some(Value::Null), Some(Value::Null)]]
        );
        let [first, second] = ["{\"id\":\"a\",\"outputs\":[1,2]}\n", "{\"outputs\":[1,2],\"t_s\":0.5}\n"];
        assert_eq!(labels(&[first, second].concat()), [[text("a"), None], [None, number(0.5)]]);
    }

    #[test]
    fn what_is_no_number_for_a_sensor_either_is_passed_on() {
        for text in ["nan,inf\n", "out_1,out_2\nNaN,1e999\n"] {
            let (found, told) = readings(text, None);
            assert!(told.is_none() && found[0].outputs[0].is_nan() && found[0].outputs[1].is_infinite(), "{found:?}");
        }
        assert!(readings("[null,1]\n", None).0[0].outputs[0].is_nan());
    }

    #[test]
    fn what_is_wrong_is_named_with_line_and_column_and_what_came_before_is_answered() {
        let long = format!("1,2\n{}\n", "1".repeat(MAX_LINE_BYTES));
        for (text, before, expected) in [
            ("1,2\n1,x\n", 1, "stdin, line 2, column `out_2`: expected a number, found `x`"),
            ("1,2\n1,\n", 1, "stdin, line 2, column `out_2`: expected a number, found ``"),
            ("1,2\n\n1,2,3\n", 1, "stdin, line 3: 3 outputs where the calibration has 2"),
            ("1,2,3\n", 0, "stdin, line 1: 3 outputs where the calibration has 2"),
            ("note,out_2,out_1\n,1,2\n,1,2,3\n", 1, "stdin, line 3: 4 cells where the header has 3"),
            ("note,out_2,out_1\n,1,2\n,-,2\n", 1, "stdin, line 3, column `out_2`: expected a number, found `-`"),
            ("out_1\n1\n", 0, "stdin, line 1: 1 outputs where the calibration has 2"),
            ("out_1,out-2\n1,2\n", 0, "stdin, line 1: 1 outputs where the calibration has 2"),
            ("out_1,out_3\n1,2\n", 0, "stdin, line 1: column `out_2` is missing; needed are out_1"),
            ("a;b\n1;2\n", 0, "stdin, line 1: column `out_1` is missing; columns are separated by commas"),
            ("out_1,out_1\n1,2\n", 0, "stdin, line 1: column `out_1` stands in the header twice"),
            ("out_1,out_2,note\n1,2,\"a\n1,2,b\"\n", 0, "stdin, line 2: a quotation mark isn't closed"),
            ("[1,2]\n[1,2,3]\n", 1, "stdin, line 2: 3 outputs where the calibration has 2"),
            ("[1,2]\n[1,\"2\"]\n", 1, "stdin, line 2, column 6: invalid type: string \"2\", expected f64; expected a"),
            ("[1,2]\n{\"output\":[1,2]}\n", 1, "stdin, line 2, column 16: missing field `outputs`; expected a reading"),
            ("[1,2]\n[1,2\n", 1, "stdin, line 2, column 4: EOF while parsing a list; expected a reading, as {\"out"),
            ("[1,2] [1,2]\n", 0, "stdin, line 1, column 7: trailing characters"),
            ("{\"id\":[1],\"outputs\":[1,2]}\n", 0, "stdin, line 1, column 1: `id` is neither a number nor a text"),
            (long.as_str(), 1, "stdin, line 2: longer than 262144 bytes; expected one reading a line"),
        ] {
            let (found, told) = readings(text, None);
            let told = told.unwrap_or_default();
            let text = &text[..text.len().min(60)];
            assert!(found.len() == before && told.starts_with(expected), "{text:?} gives {found:?} {told}");
        }
    }

    #[test]
    fn what_is_quoted_is_short_and_moves_no_cursor() {
        let long = "\u{1b}[2J".repeat(100);
        for (text, expected) in [
            (format!("1,{long}\n"), "`out_1` is missing".to_owned()),
            (format!("1,2\n1,{long}\n"), format!("found `{}...`", "\\u{1b}[2J".repeat(10))),
            (format!("[1,2]\n[1,\"{}\"]\n", "\\u001b[2J".repeat(100)), "line 2, column ".to_owned()),
        ] {
            let told = readings(&text, None).1.unwrap_or_default();
            let is_plain = told.len() < 300 && !told.contains(char::is_control);
            assert!(told.contains(&expected) && is_plain, "{text:?} gives {told:?}");
        }
    }

    #[test]
    fn a_reading_is_to_be_waited_for_where_no_whole_line_is_there() {
        let mut readings = Readings::new("stdin", "1,2\n3,4\n5,".as_bytes(), 2, None);
        let mut drained = Vec::new();
        while let Ok(Some(_)) = readings.read_next() {
            drained.push(readings.is_drained());
        }
        assert_eq!(drained, [false, true]);
    }

    proptest::proptest! {
        #[test]
        fn no_text_makes_the_reader_panic(text in "[out_12,.\"\\[\\]{}: \r\n-]{0,60}") {
            readings(&text, None);
            readings(&format!("out_1,out_2\n{text}"), None);
            readings(&format!("[1,2]\n{text}"), None);
        }
    }
}
