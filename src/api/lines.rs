//! Lines of answers: CSV with a header, or a JSON object each.

use super::solutions::io_error;
use palpate_data::dataset::readings::Reading;
use palpate_solver::FaultyUnit;
use serde::Serialize;
use serde_json::Value;
use std::error::Error;
use std::io::{self, BufWriter, Write};

/// Number of bytes that are written at once.
const BUFFER_BYTES: usize = 64 << 10;

/// Writes the answer to each reading as a line.
pub(crate) trait AnswerWriter<T> {
    /// Writes one answer, which was solved without the units at fault.
    fn write(&mut self, reading: &Reading, at_fault: &[FaultyUnit], solved: &Result<T, impl Error>) -> io::Result<()>;

    /// Flushes the lines written so far.
    fn flush(&mut self) -> io::Result<()>;
}

/// Destination of the lines.
pub(crate) enum Lines<W: Write> {
    /// `labels` states whether the columns id and t_s exist. The first reading decides it. Both exist if an invalid line may
    /// come first.
    Csv {
        writer: Box<csv::Writer<W>>,
        labels: Option<[bool; 2]>,
    },
    Ndjson(BufWriter<W>),
}

impl<W: Write> Lines<W> {
    pub(crate) fn new(to: W, json: bool, keep_going: bool) -> Self {
        if json {
            return Lines::Ndjson(BufWriter::with_capacity(BUFFER_BYTES, to));
        }
        let writer = csv::WriterBuilder::new().buffer_capacity(BUFFER_BYTES).from_writer(to);
        Lines::Csv { writer: Box::new(writer), labels: keep_going.then_some([true, true]) }
    }

    /// Returns id and t_s of a reading, each if it is in the line. A column without a value has a null.
    pub(crate) fn labels<'r>(&mut self, reading: &'r Reading) -> [Option<&'r Value>; 2] {
        let of = [reading.id.as_ref(), reading.t_s.as_ref()];
        let Lines::Csv { labels, .. } = self else { return of };
        let [id, t_s] = *labels.get_or_insert(of.map(|label| label.is_some()));
        [(id, of[0]), (t_s, of[1])].map(|(is_column, label)| is_column.then_some(label.unwrap_or(&Value::Null)))
    }

    /// Returns the text of the column `error`, if the line has one.
    pub(crate) fn error<T>(&self, solved: &Result<T, impl Error>, keep_going: bool) -> Option<String> {
        let error = solved.as_ref().err().map(ToString::to_string);
        match self {
            Lines::Csv { .. } => keep_going.then(|| error.unwrap_or_default()),
            Lines::Ndjson(_) => error,
        }
    }

    pub(crate) fn write(&mut self, line: &impl Serialize) -> io::Result<()> {
        match self {
            Lines::Csv { writer, .. } => writer.serialize(line).map_err(io_error),
            Lines::Ndjson(writer) => {
                serde_json::to_writer(&mut *writer, line)?;
                writer.write_all(b"\n")
            }
        }
    }

    pub(crate) fn flush(&mut self) -> io::Result<()> {
        match self {
            Lines::Csv { writer, .. } => writer.flush(),
            Lines::Ndjson(writer) => writer.flush(),
        }
    }
}
