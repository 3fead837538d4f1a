//! Answers with force vectors, written as lines.

use super::lines::{AnswerWriter, Lines};
use super::solutions::{DECIMALS, UNSOLVED};
use palpate_core::quantity::round;
use palpate_data::dataset::readings::Reading;
use palpate_solver::vector::{VECTOR_NUMBERS, VectorSolution};
use serde::ser::{Serialize, SerializeStruct as _, Serializer};
use serde_json::Value;
use std::error::Error;
use std::io::{self, Write};

/// Writes force vectors, a line each.
pub(crate) struct VectorSolutions<W: Write> {
    lines: Lines<W>,
    /// Invalid lines are answered too: each answer has its line number, and CSV has a column for the problem.
    keep_going: bool,
}

/// Names and values of one line.
struct VectorLine(Vec<(&'static str, Value)>);

/// Returns the numbers of an answer as they are printed, in the order of [`VECTOR_NUMBERS`]; NaN if a number is unknown.
pub fn vector_numbers(solution: &VectorSolution) -> [f64; VECTOR_NUMBERS.len()] {
    solution.numbers().map(|number| if number.is_finite() { round(number, DECIMALS) } else { f64::NAN })
}

impl<W: Write> VectorSolutions<W> {
    pub(crate) fn new(to: W, json: bool, keep_going: bool) -> Self {
        VectorSolutions { lines: Lines::new(to, json, keep_going), keep_going }
    }
}

impl<W: Write> AnswerWriter<VectorSolution> for VectorSolutions<W> {
    fn write(&mut self, reading: &Reading, solved: &Result<VectorSolution, impl Error>) -> io::Result<()> {
        let found = solved.as_ref().ok();
        let labels = ["id", "t_s"].into_iter().zip(self.lines.labels(reading));
        let labels = labels.filter_map(|(name, label)| Some((name, label?.clone())));
        let numbers = found.map_or([f64::NAN; VECTOR_NUMBERS.len()], vector_numbers);
        let verdict = found.map_or(UNSOLVED.into(), |solution| solution.verdict.word());
        let unit = found.and_then(|solution| solution.verdict.unit());
        let fields = (self.keep_going.then_some(("line", reading.line.into())).into_iter())
            .chain(labels)
            .chain(VECTOR_NUMBERS.into_iter().zip(numbers.map(Value::from))) // NaN is null
            .chain([("verdict", verdict.into()), ("unit", unit.into())])
            .chain(self.lines.error(solved, self.keep_going).map(|error| ("error", error.into())));
        self.lines.write(&VectorLine(fields.collect()))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lines.flush()
    }
}

impl Serialize for VectorLine {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut line = serializer.serialize_struct("VectorLine", self.0.len())?;
        for (name, value) in &self.0 {
            line.serialize_field(name, value)?;
        }
        line.end()
    }
}
