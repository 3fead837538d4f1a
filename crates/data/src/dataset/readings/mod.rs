//! Readings of an array as sent by another program: one per line, as CSV or as NDJSON.
//!
//! CSV has a header with `out_1..out_n`. Without a header, the first line contains only numbers: `out_1..out_n` in order. NDJSON
//! has one object per line, `{"outputs": [0.1, 0.2]}`, or the array alone. `id` and `t_s` are kept with the reading. Everything
//! else is ignored, and so are blank lines. A missing channel is NaN: `nan` or an empty cell in CSV, `null` or `NaN` in NDJSON.
//!
//! [`StreamLines`] takes lines from a stream. [`Readings`] interprets one line from any source.

mod cells;
mod lines;
mod object;

pub use lines::StreamLines;

use super::dialect::is_comment;
use super::mapping::Mapping;
use super::table_error::TableError;
use cells::CsvParser;
use miette::Diagnostic;
use serde_json::Value;
use std::io;

/// Length of the longest line that is read, bytes: 4096 outputs of 60 characters each.
pub(crate) const MAX_LINE_BYTES: usize = 256 << 10;

/// Format of readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadingFormat {
    /// Cells separated by commas.
    Csv,
    /// One JSON object or array per line.
    Ndjson,
}

/// One reading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Line of the reading, from 1.
    pub line: u64,
    /// Label of the reading, a number or a text.
    pub id: Option<Value>,
    /// Time of the reading.
    pub t_s: Option<Value>,
    /// Outputs, one for each unit. A missing output is NaN; an infinite output is unchanged.
    pub outputs: Vec<f64>,
}

/// Content of a line.
#[derive(Debug)]
pub enum LineContent {
    /// A reading.
    Reading,
    /// An invalid line that should be a reading. The next line may be a reading again.
    Bad(ReadingError),
    /// Blanks, or the header.
    Nothing,
}

/// Reason why a line is invalid, or why the rest can't be read; `line` counts from 1.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[allow(missing_docs, reason = "the fields say what the messages say")]
pub enum ReadingError {
    /// Reading the input failed.
    #[error("{file}: can't be read")]
    Unreadable { file: String, source: io::Error },
    /// The line is longer than [`MAX_LINE_BYTES`].
    #[error("{file}, line {line}: longer than {MAX_LINE_BYTES} bytes")]
    #[diagnostic(help("expected one reading per line"))]
    TooLong { file: String, line: u64 },
    /// The header or a cell of a CSV line is invalid.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Cells(#[from] TableError),
    /// A cell continues in the next line.
    #[error("{file}, line {line}: a quotation mark isn't closed")]
    #[diagnostic(help("expected one reading per line"))]
    OpenQuote { file: String, line: u64 },
    /// The reading is from another array.
    #[error("{file}, line {line}: {} where the calibration has {expected}", outputs(*found))]
    #[diagnostic(help(
        "a reading has one number for each output of the calibrated array, separated by commas. A run's `test_matrix.csv` has a \
         row for each output: use its `presses.csv`"
    ))]
    Units { file: String, line: u64, found: usize, expected: usize },
    /// The line contains words although the other lines contain numbers.
    #[error("{file}, line {line}: expected {expected} numbers, found `{found}`")]
    #[diagnostic(help(
        "correct the program that sends it, or add --keep-going: such a line is then answered `unsolved`"
    ))]
    NoNumbers { file: String, line: u64, expected: usize, found: String },
    /// The sensor has a history, and the reading has no time.
    #[error("{file}, line {line}: t_s, the time of the reading, is missing or isn't a number")]
    #[diagnostic(help(
        "a sensor with a history needs the time of each reading, s: a header with t_s in CSV, \
         {{\"t_s\": 0.1, \"outputs\": [0.1, 0.2]}} in JSON"
    ))]
    NoTime { file: String, line: u64 },
    /// The line isn't JSON, or is JSON of another form.
    #[error("{file}, line {line}, column {column}: {reason}")]
    #[diagnostic(help("expected a reading, as {{\"outputs\": [0.1, 0.2]}} or [0.1, 0.2]"))]
    Json { file: String, line: u64, column: usize, reason: String },
}

fn outputs(count: usize) -> String {
    if count == 1 { "1 output".to_owned() } else { format!("{count} outputs") }
}

/// Interprets one line after another; stores one line at a time.
pub struct Readings {
    file: String,
    units: usize,
    format: Option<ReadingFormat>,
    scale: f64,
    cells: CsvParser,
    reading: Reading,
}

impl Readings {
    /// Interprets readings of `units` units; `file` is the name of the input in messages. Without a format, the format is
    /// detected from the first character. The mapping names the columns of the outputs and of the time. It scales outputs in either
    /// format, and the time in CSV; in JSON `t_s` is in s.
    pub fn new(file: &str, units: usize, format: Option<ReadingFormat>, mapping: Mapping) -> Self {
        let scale = mapping.scale.outputs;
        Readings {
            file: file.to_owned(),
            units,
            format,
            scale,
            cells: CsvParser::new(mapping),
            reading: Reading::default(),
        }
    }

    /// Refuses readings without a time, if each needs one.
    #[must_use]
    pub(super) fn with_times(mut self, needs_time: bool) -> Self {
        self.cells.needs_time = needs_time;
        self
    }

    /// Returns the content of the next line, given with or without its line end.
    ///
    /// # Errors
    /// The header is invalid, so the content of the lines below it is unknown.
    pub fn read(&mut self, line: &[u8]) -> Result<LineContent, ReadingError> {
        self.reading.line += 1;
        (self.reading.id, self.reading.t_s) = (None, None);
        if line.len() > MAX_LINE_BYTES {
            return Ok(LineContent::Bad(ReadingError::TooLong { file: self.file.clone(), line: self.reading.line }));
        }
        let is_first = self.reading.line == 1;
        let line = line.strip_prefix(b"\xef\xbb\xbf").filter(|_| is_first).unwrap_or(line); // a byte-order mark
        let Some(first) = line.trim_ascii_start().first() else { return Ok(LineContent::Nothing) };
        let may_be_comment = self.cells.awaits_header() && self.format != Some(ReadingFormat::Ndjson);
        if may_be_comment && is_comment(String::from_utf8_lossy(line).trim_start()) {
            return Ok(LineContent::Nothing); // a comment above the header
        }
        let found = if matches!(first, b'{' | b'[') { ReadingFormat::Ndjson } else { ReadingFormat::Csv };
        let held = match *self.format.get_or_insert(found) {
            ReadingFormat::Csv => self.cells.read(&self.file, line, self.units, &mut self.reading)?,
            ReadingFormat::Ndjson => match object::read(&self.file, line, self.units, &mut self.reading) {
                Ok(()) => LineContent::Reading,
                Err(error) => LineContent::Bad(error),
            },
        };
        if self.scale != 1.0 {
            self.reading.outputs.iter_mut().for_each(|output| *output *= self.scale);
        }
        let has_time = self.reading.t_s.as_ref().is_some_and(Value::is_number);
        if self.cells.needs_time && !has_time && matches!(held, LineContent::Reading) {
            return Ok(LineContent::Bad(ReadingError::NoTime { file: self.file.clone(), line: self.reading.line }));
        }
        Ok(held)
    }

    /// Returns the reading of the last line. For an invalid line: its line number, and its labels if they could be read.
    pub fn reading(&self) -> &Reading {
        &self.reading
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each line of a text that isn't blank or the header: a reading, or what is wrong with it and the help. An error that no
    /// line comes after is the last one.
    fn held(text: &str, format: Option<ReadingFormat>) -> Vec<Result<Reading, String>> {
        let words =
            |error: ReadingError| format!("{error}; {}", error.help().map_or(String::new(), |help| help.to_string()));
        let (mut lines, mut readings) =
            (StreamLines::new("stdin", text.as_bytes()), Readings::new("stdin", 2, format, Mapping::default()));
        let mut found = Vec::new();
        while let Some(line) = lines.read_next().expect("a text doesn't break off") {
            match readings.read(line) {
                Ok(LineContent::Reading) => found.push(Ok(readings.reading().clone())),
                Ok(LineContent::Bad(error)) => found.push(Err(words(error))),
                Ok(LineContent::Nothing) => {}
                Err(error) => {
                    found.push(Err(words(error)));
                    break;
                }
            }
        }
        found
    }

    /// All readings of a text before the first error, and that error.
    fn readings(text: &str, format: Option<ReadingFormat>) -> (Vec<Reading>, Option<String>) {
        let mut found = Vec::new();
        for held in held(text, format) {
            match held {
                Ok(reading) => found.push(reading),
                Err(words) => return (found, Some(words)),
            }
        }
        (found, None)
    }

    #[test]
    fn comments_above_the_header_are_skipped() {
        let text = "\u{feff}# of Monday, 9:00\n # and \"more\nout_2,out_1\n2,1\n";
        assert_eq!(readings(text, None), (vec![reading(4, [1.0, 2.0])], None));
        assert_eq!(readings("# of Monday\n[1,2]\n", None), (vec![reading(2, [1.0, 2.0])], None));
        assert!(readings("1,2\n# of Monday\n", None).1.is_some(), "below the first reading");
    }

    fn reading(line: u64, outputs: [f64; 2]) -> Reading {
        Reading { line, outputs: outputs.to_vec(), ..Reading::default() }
    }

    #[test]
    fn format_is_detected_from_the_first_character() {
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
        let words = readings("[1,2]\n", Some(ReadingFormat::Csv)).1.unwrap();
        assert!(words.contains("stdin, line 1: column `out_1` is missing; required: out_1"), "{words}");
        assert!(readings("1,2\n", Some(ReadingFormat::Ndjson)).1.is_some());
    }

    #[test]
    fn id_of_a_reading_is_kept() {
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
    fn missing_number_of_a_reading_is_passed_on() {
        for text in ["nan,inf\n", "out_1,out_2\nNaN,1e999\n"] {
            let (found, words) = readings(text, None);
            assert!(words.is_none() && found[0].outputs[0].is_nan() && found[0].outputs[1].is_infinite(), "{found:?}");
        }
    }

    #[test]
    fn missing_channel_is_nan_in_every_notation() {
        for text in
            ["nan,1", ",1", "NaN,1.0", " ,1", "out_2,x,out_1\n1,,\n", "out_1,out_2\n,1", "[null,1]", "[NaN,1.0]"]
        {
            let (found, words) = readings(text, None);
            assert!(words.is_none() && found.len() == 1, "{text:?}: {found:?} {words:?}");
            assert!(found[0].outputs[0].is_nan() && found[0].outputs[1] == 1.0, "{text:?}: {found:?}");
        }
    }

    #[test]
    fn a_cell_that_the_columns_file_calls_missing_is_nan() {
        let mapping = Mapping::parse("columns.toml", "outputs = [\"a\", \"b\"]\nmissing = [\"-999\"]\n").unwrap();
        let mut readings = Readings::new("stdin", 2, None, mapping);
        let mut found = Vec::new();
        for line in ["a,b", "-999,1", "-998, -999 "] {
            if matches!(readings.read(line.as_bytes()), Ok(LineContent::Reading)) {
                found.push(readings.reading().outputs.clone());
            }
        }
        assert!(found[0][0].is_nan() && found[0][1] == 1.0, "{found:?}");
        assert!(found[1][0] == -998.0 && found[1][1].is_nan(), "{found:?}");
    }

    #[test]
    fn after_a_bad_line_the_next_one_is_read() {
        let long = format!("1,2\n{}\n3,4\n", "1".repeat(2 * MAX_LINE_BYTES));
        for text in [
            "1,2\n1,x\n3,4\n",
            "1,2\n1\n3,4\n",
            "1,2\n\"1,2\n3,4\n",
            "1,2\nhello\n3,4\n",
            "out_1,out_2\n1,2\n1,\"2\n3,4\n",
            "[1,2]\n[1,2\n[3,4]\n",
            "[1,2]\n{\"outputs\":[1]}\n[3,4]\n",
            "[1,2]\nhello\n[3,4]\n",
            "[1,2]\n[1,\"2\"]\n[3,4]\n",
            long.as_str(),
        ] {
            let found = held(text, None);
            let outputs = |held: &Result<Reading, String>| held.as_ref().ok().map(|reading| reading.outputs.clone());
            let outputs: Vec<Option<Vec<f64>>> = found.iter().map(outputs).collect();
            assert_eq!(outputs, [Some(vec![1.0, 2.0]), None, Some(vec![3.0, 4.0])], "{:.60}", text);
        }
    }

    #[test]
    fn a_bad_first_line_is_a_reading_where_it_has_a_number_and_no_name() {
        for first in ["1,x", "1", "1,2,3", "1,\"2"] {
            let found = held(&format!("{first}\n3,4\n"), None);
            assert!(found.len() == 2 && found[0].is_err(), "{first}: {found:?}");
            assert_eq!(found[1].as_ref().unwrap().outputs, [3.0, 4.0], "{first}");
        }
        for first in ["a,b", "out_1,2", "out_1,out_3", "out_2,\"out_1"] {
            let found = held(&format!("{first}\n3,4\n"), None);
            assert!(found.len() == 1 && found[0].is_err(), "{first} is a header, no line below it is read: {found:?}");
        }
    }

    #[test]
    fn invalid_reading_keeps_a_readable_id() {
        for text in ["id,t_s,out_1,out_2\na,0.5,1,x\n", "{\"id\":\"a\",\"t_s\":0.5,\"outputs\":[1]}\n"] {
            let mut readings = Readings::new("stdin", 2, None, Mapping::default());
            let held: Vec<LineContent> = text.lines().map(|line| readings.read(line.as_bytes()).unwrap()).collect();
            assert!(matches!(held.last(), Some(LineContent::Bad(_))), "{text}");
            let Reading { id, t_s, .. } = readings.reading();
            assert_eq!((id, t_s), (&Some(Value::from("a")), &Some(Value::from(0.5))), "{text}");
        }
    }

    #[test]
    fn bad_line_is_named_with_line_and_column_after_earlier_answers() {
        let long = format!("1,2\n{}\n", "1".repeat(MAX_LINE_BYTES));
        for (text, before, expected) in [
            ("1,2\n1,x\n", 1, "stdin, line 2, column `out_2`: expected a number, found `x`"),
            ("1,2\n\n1,2,3\n", 1, "stdin, line 3: 3 outputs where the calibration has 2"),
            ("1,2,3\n", 0, "stdin, line 1: 3 outputs where the calibration has 2"),
            ("note,out_2,out_1\n,1,2\n,1,2,3\n", 1, "stdin, line 3: 4 cells where the header has 3"),
            ("note,out_2,out_1\n,1,2\n,-,2\n", 1, "stdin, line 3, column `out_2`: expected a number, found `-`"),
            ("out_1\n1\n", 0, "stdin, line 1: 1 output where the calibration has 2"),
            ("out_1,out-2\n1,2\n", 0, "stdin, line 1: 1 output where the calibration has 2"),
            ("out_1,out_3\n1,2\n", 0, "stdin, line 1: column `out_2` is missing; required: out_1"),
            ("a;b\n1;2\n", 0, "stdin, line 1: column `out_1` is missing; required: out_1"),
            ("out_1,out_1\n1,2\n", 0, "stdin, line 1: column `out_1` is in the header twice"),
            ("out_1,out_2,note\n1,2,\"a\n1,2,b\"\n", 0, "stdin, line 2: a quotation mark isn't closed"),
            ("[1,2]\n[1,2,3]\n", 1, "stdin, line 2: 3 outputs where the calibration has 2"),
            ("[1,2]\n[1,\"2\"]\n", 1, "stdin, line 2, column 6: invalid type: string \"2\", expected f64; expected a"),
            ("[1,2]\n{\"output\":[1,2]}\n", 1, "stdin, line 2, column 16: missing field `outputs`; expected a reading"),
            ("[1,2]\n[1,2\n", 1, "stdin, line 2, column 4: EOF while parsing a list; expected a reading, as {\"out"),
            ("[1,2] [1,2]\n", 0, "stdin, line 1, column 7: trailing characters"),
            ("{\"id\":[1],\"outputs\":[1,2]}\n", 0, "stdin, line 1, column 1: `id` must be a number or a text"),
            (long.as_str(), 1, "stdin, line 2: longer than 262144 bytes; expected one reading per line"),
        ] {
            let (found, words) = readings(text, None);
            let words = words.unwrap_or_default();
            let text = &text[..text.len().min(60)];
            assert!(found.len() == before && words.starts_with(expected), "{text:?} gives {found:?} {words}");
        }
    }

    #[test]
    fn quoted_text_is_cut_and_has_no_control_characters() {
        let long = "\u{1b}[2J".repeat(100);
        for (text, expected) in [
            (format!("a,{long}\n"), "`out_1` is missing".to_owned()),
            (format!("1,2\n1,{long}\n"), format!("found `{}...`", "\\u{1b}[2J".repeat(10))),
            (format!("[1,2]\n[1,\"{}\"]\n", "\\u001b[2J".repeat(100)), "line 2, column ".to_owned()),
        ] {
            let words = readings(&text, None).1.unwrap_or_default();
            let is_plain = words.len() < 300 && !words.contains(char::is_control);
            assert!(words.contains(&expected) && is_plain, "{text:?} gives {words:?}");
        }
    }

    proptest::proptest! {
        #[test]
        fn reader_survives_arbitrary_text(text in "[out_12,.\"\\[\\]{}: \r\n-]{0,60}") {
            held(&text, None);
            held(&format!("out_1,out_2\n{text}"), None);
            held(&format!("[1,2]\n{text}"), None);
        }
    }
}
