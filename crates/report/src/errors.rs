//! The numbers of an evaluation, for text and pages alike: name, unit, value, and what the paper reports.

use crate::paper;
use palpate_core::quantity::round;
use palpate_solver::Evaluation;

/// A number of an evaluation.
pub struct ErrorNumber {
    /// Name.
    pub name: &'static str,
    /// Place in the JSON of an evaluation, as keys joined by points.
    pub key: &'static str,
    /// Unit in which it is printed: mm, N, ns, % or nothing.
    pub unit: &'static str,
    /// Decimals.
    pub digits: usize,
    /// The paper's number, in the unit of [`ErrorNumber::value`].
    pub paper: Option<f64>,
    /// How many readers need it.
    pub detail: Detail,
    value: EvaluationValue,
}

type EvaluationValue = fn(&Evaluation) -> Option<f64>;

/// Which tables have a number, from those that every table has to those that only the longest one has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Detail {
    /// Mean errors.
    Means,
    /// Fractions of the presses with small errors.
    Shares,
    /// Everything else.
    All,
}

impl ErrorNumber {
    /// Returns the number of an evaluation, fractions from 0 to 1; `None` if it isn't known.
    pub fn value(&self, evaluation: &Evaluation) -> Option<f64> {
        (self.value)(evaluation)
    }

    /// Returns the number for a person, without its unit.
    pub fn digits_of(&self, value: f64) -> String {
        format!("{:.*}", self.digits, self.scale() * value)
    }

    /// Returns the number for a person, with its unit; "-" if it isn't known.
    pub fn shown(&self, evaluation: &Evaluation) -> String {
        self.value(evaluation).map_or("-".to_owned(), |value| self.with_unit(&self.digits_of(value)))
    }

    /// Returns the paper's number with its unit; nothing if it has none.
    pub fn shown_of_paper(&self) -> String {
        self.paper.map_or_else(String::new, |value| self.with_unit(&round(self.scale() * value, 6).to_string()))
    }

    fn with_unit(&self, digits: &str) -> String {
        format!("{digits} {}", self.unit).trim_end().to_owned()
    }

    fn scale(&self) -> f64 {
        if self.unit == "%" { 100.0 } else { 1.0 }
    }
}

/// Returns the numbers that at least one of these evaluations has. Those of every table are there without a value too, unless depths
/// are solved: then no force is known.
pub fn known(evaluations: &[&Evaluation], most: Detail) -> impl Iterator<Item = &'static ErrorNumber> {
    let is_known = |number: &ErrorNumber| evaluations.iter().any(|evaluation| number.value(evaluation).is_some());
    let by_depth = evaluations.iter().any(|evaluation| evaluation.depth_error_mm.is_some());
    let is_always_shown = |number: &ErrorNumber| number.detail < Detail::All && !number.key.starts_with("depth");
    let is_shown = move |number: &&ErrorNumber| (is_always_shown(number) && !by_depth) || is_known(number);
    NUMBERS.iter().filter(move |number| number.detail <= most).filter(is_shown)
}

/// Every number, in the order of a table.
pub static NUMBERS: [ErrorNumber; 25] = {
    use Detail::{All, Means, Shares};
    [
        row(All, "test presses", "points", "", 0, Some(paper::POINTS as f64), |e| Some(e.points as f64)),
        row(Means, "location error, mean", "location_error_mm.mean", "mm", 3, Some(paper::LOCATION_ERROR_MM), |e| {
            Some(e.location_error_mm.mean)
        }),
        row(All, "location error, median", "location_error_mm.median", "mm", 3, None, |e| {
            Some(e.location_error_mm.median)
        }),
        row(All, "location error, 95th percentile", "location_error_mm.p95", "mm", 3, None, |e| {
            Some(e.location_error_mm.p95)
        }),
        row(All, "location error, largest", "location_error_mm.max", "mm", 3, None, |e| Some(e.location_error_mm.max)),
        row(Means, "force error, mean", "force_error_n.mean", "N", 4, Some(paper::FORCE_ERROR_N), |e| {
            Some(e.force_error_n?.mean)
        }),
        row(All, "force error, median", "force_error_n.median", "N", 4, None, |e| Some(e.force_error_n?.median)),
        row(All, "force error, 95th percentile", "force_error_n.p95", "N", 4, None, |e| Some(e.force_error_n?.p95)),
        row(All, "force error, largest", "force_error_n.max", "N", 4, None, |e| Some(e.force_error_n?.max)),
        row(All, "force error by the load cell, mean", "force_error_load_cell_n.mean", "N", 4, None, |e| {
            Some(e.force_error_load_cell_n?.mean)
        }),
        row(Means, "depth error, mean", "depth_error_mm.mean", "mm", 3, None, |e| Some(e.depth_error_mm?.mean)),
        row(All, "depth error, median", "depth_error_mm.median", "mm", 3, None, |e| Some(e.depth_error_mm?.median)),
        row(All, "depth error, 95th percentile", "depth_error_mm.p95", "mm", 3, None, |e| Some(e.depth_error_mm?.p95)),
        row(All, "depth error, largest", "depth_error_mm.max", "mm", 3, None, |e| Some(e.depth_error_mm?.max)),
        row(Shares, "location error under 1 mm", "within.location_1mm", "%", 1, Some(paper::WITHIN_1MM), |e| {
            Some(e.within.location_1mm)
        }),
        row(Shares, "force error under 0.1 N", "within.force_0_1n", "%", 1, Some(paper::WITHIN_0_1N), |e| {
            e.within.force_0_1n
        }),
        row(Shares, "both under", "within.both", "%", 1, Some(paper::WITHIN_BOTH), |e| e.within.both),
        row(All, "location inside stated 68 %", "coverage.location_68", "%", 1, None, |e| e.coverage?.location_68),
        row(All, "location inside stated 95 %", "coverage.location_95", "%", 1, None, |e| e.coverage?.location_95),
        row(All, "force inside stated 68 %", "coverage.force_68", "%", 1, None, |e| e.coverage?.force_68),
        row(All, "force inside stated 95 %", "coverage.force_95", "%", 1, None, |e| e.coverage?.force_95),
        row(All, "depth inside stated 68 %", "coverage.depth_68", "%", 1, None, |e| e.coverage?.depth_68),
        row(All, "depth inside stated 95 %", "coverage.depth_95", "%", 1, None, |e| e.coverage?.depth_95),
        row(All, "doubted by the method itself", "", "", 0, None, |e| {
            Some(e.verdicts.doubts().map(|(count, _)| count as f64).iter().sum())
        }),
        row(All, "time a solve", "ns_per_solve", "ns", 0, None, |e| e.ns_per_solve),
    ]
};

const fn row(
    detail: Detail,
    name: &'static str,
    key: &'static str,
    unit: &'static str,
    digits: usize,
    paper: Option<f64>,
    value: EvaluationValue,
) -> ErrorNumber {
    ErrorNumber { name, key, unit, digits, paper, detail, value }
}
