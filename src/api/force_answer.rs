//! Answers with forces, written as lines: a force vector with its place, or the force of a series.

use super::lines::{AnswerWriter, Lines};
use super::solutions::{DECIMALS, UNSOLVED};
use palpate_core::quantity::round;
use palpate_data::dataset::readings::Reading;
use palpate_solver::FaultyUnit;
use palpate_solver::vector::{VECTOR_NUMBERS, VectorSolution};
use serde::ser::{Serialize, SerializeStruct as _, Serializer};
use serde_json::Value;
use std::error::Error;
use std::io::{self, Write};

/// Writes answers with forces, a line each.
pub(crate) struct ForceSolutions<W: Write> {
    lines: Lines<W>,
    /// Invalid lines are answered too: each answer has its line number, and CSV has a column for the problem.
    keep_going: bool,
}

/// Names and values of one line.
struct ForceLine(Vec<(&'static str, Value)>);

/// Returns the numbers of an answer as they are printed, in the order of [`VECTOR_NUMBERS`]; NaN if a number is unknown.
pub fn vector_numbers(solution: &VectorSolution) -> [f64; VECTOR_NUMBERS.len()] {
    solution.numbers().map(|number| if number.is_finite() { round(number, DECIMALS) } else { f64::NAN })
}

impl<W: Write> ForceSolutions<W> {
    pub(crate) fn new(to: W, json: bool, keep_going: bool) -> Self {
        ForceSolutions { lines: Lines::new(to, json, keep_going), keep_going }
    }

    /// Writes a line: the labels of a reading, what answers it, and the reason if nothing does.
    fn write_line<T, const N: usize>(
        &mut self,
        reading: &Reading,
        solved: &Result<T, impl Error>,
        numbers: impl Iterator<Item = (&'static str, Value)>,
        verdict: [(&'static str, Value); N],
    ) -> io::Result<()> {
        let labels = ["id", "t_s"].into_iter().zip(self.lines.labels(reading));
        let labels = labels.filter_map(|(name, label)| Some((name, label?.clone())));
        let fields = (self.keep_going.then_some(("line", reading.line.into())).into_iter())
            .chain(labels)
            .chain(numbers)
            .chain(verdict)
            .chain(self.lines.error(solved, self.keep_going).map(|error| ("error", error.into())));
        self.lines.write(&ForceLine(fields.collect()))
    }
}

impl<W: Write> AnswerWriter<VectorSolution> for ForceSolutions<W> {
    fn write(
        &mut self,
        reading: &Reading,
        _: &[FaultyUnit],
        solved: &Result<VectorSolution, impl Error>,
    ) -> io::Result<()> {
        let found = solved.as_ref().ok();
        let numbers = found.map_or([f64::NAN; VECTOR_NUMBERS.len()], vector_numbers);
        let numbers = VECTOR_NUMBERS.into_iter().zip(numbers.map(Value::from)); // NaN is null
        let verdict = found.map_or(UNSOLVED.into(), |solution| solution.verdict.word());
        let unit = found.and_then(|solution| solution.verdict.unit());
        self.write_line(reading, solved, numbers, [("verdict", verdict.into()), ("unit", unit.into())])
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lines.flush()
    }
}

impl<W: Write> AnswerWriter<f64> for ForceSolutions<W> {
    fn write(&mut self, reading: &Reading, _: &[FaultyUnit], solved: &Result<f64, impl Error>) -> io::Result<()> {
        let force_n = solved.as_ref().ok().map(|force_n| round(*force_n, DECIMALS));
        let verdict = if solved.is_ok() { "ok" } else { UNSOLVED };
        self.write_line(reading, solved, [("force_n", force_n.into())].into_iter(), [("verdict", verdict.into())])
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lines.flush()
    }
}

impl Serialize for ForceLine {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut line = serializer.serialize_struct("ForceLine", self.0.len())?;
        for (name, value) in &self.0 {
            line.serialize_field(name, value)?;
        }
        line.end()
    }
}
