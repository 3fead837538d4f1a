//! Solved contacts: one, or a batch as a frame.

use super::frame::{ColumnValues, PyColumn, PyFrame};
use palpate::api::{Measure, NUMBERS, UNSOLVED, numbers};
use palpate_solver::{ContactVerdict, Solution, Unanswered};
use pyo3::prelude::*;
use std::collections::HashMap;

/// Unit and definition of each number, in the order of [`NUMBERS`].
const ABOUT: [(&str, &str); NUMBERS.len()] = [
    ("mm", "x of the contact, specimen frame."),
    ("mm", "y of the contact, specimen frame."),
    ("N", "Force of the contact."),
    ("mm", "Standard deviation of x."),
    ("mm", "Standard deviation of y."),
    ("N", "Standard deviation of the force."),
    ("mm", "Half-width that contains 68 % of the location errors."),
    ("mm", "Half-width that contains 95 % of the location errors."),
    ("N", "Half-width that contains 68 % of the force errors."),
    ("N", "Half-width that contains 95 % of the force errors."),
    ("mm", "x of another place that fits nearly as well."),
    ("mm", "y of another place that fits nearly as well."),
    ("", "Misfit between the reading and one contact; above 1: not a single contact."),
    ("", "Force relative to the typical press of a calibration without forces."),
    ("", "Half-width that contains 68 % of the errors of the relative force."),
    ("", "Half-width that contains 95 % of the errors of the relative force."),
    ("mm", "Depth of the contact, of a calibration by depth."),
    ("mm", "Standard deviation of the depth."),
    ("mm", "Half-width that contains 68 % of the depth errors."),
    ("mm", "Half-width that contains 95 % of the depth errors."),
];

/// The contact behind one reading. An unknown number is NaN.
#[pyclass(name = "Contact", frozen, get_all, module = "palpate")]
pub struct PyContact {
    /// x of the contact, specimen frame, mm.
    x_mm: f64,
    /// y of the contact, specimen frame, mm.
    y_mm: f64,
    /// Force of the contact, N; NaN if the calibration has no forces.
    force_n: f64,
    /// Standard deviation of x, mm.
    sd_x_mm: f64,
    /// Standard deviation of y, mm.
    sd_y_mm: f64,
    /// Standard deviation of the force, N.
    sd_force_n: f64,
    /// Half-width that contains 68 % of the location errors, mm.
    half68_mm: f64,
    /// Half-width that contains 95 % of the location errors, mm.
    half95_mm: f64,
    /// Half-width that contains 68 % of the force errors, N.
    half68_n: f64,
    /// Half-width that contains 95 % of the force errors, N.
    half95_n: f64,
    /// x of another place that fits nearly as well, mm.
    other_x_mm: f64,
    /// y of another place that fits nearly as well, mm.
    other_y_mm: f64,
    /// Misfit between the reading and one contact; above 1: not a single contact.
    misfit: f64,
    /// Force relative to the typical press of a calibration without forces.
    relative_force: f64,
    /// Half-width that contains 68 % of the errors of the relative force.
    half68_relative_force: f64,
    /// Half-width that contains 95 % of the errors of the relative force.
    half95_relative_force: f64,
    /// Depth of the contact, mm; NaN unless the calibration is by depth.
    depth_mm: f64,
    /// Standard deviation of the depth, mm.
    sd_depth_mm: f64,
    /// Half-width that contains 68 % of the depth errors, mm.
    half68_depth_mm: f64,
    /// Half-width that contains 95 % of the depth errors, mm.
    half95_depth_mm: f64,
    /// Whether the answer assumes the load of the calibration, which the reading has; only if a second method is fitted for it.
    is_calibrated_load: bool,
    /// `ok`, `weak-signal`, `outside-area`, `not-one-contact`, `channel-fault`, or `unsolved`.
    verdict: &'static str,
    /// The output that contradicts the others, counted from 1, if the verdict is `channel-fault`.
    unit: Option<usize>,
    /// Why there is no contact, if the verdict is `unsolved`.
    error: Option<String>,
}

impl PyContact {
    /// Takes the answer to a reading.
    pub fn of(solved: &Result<Solution, Unanswered>, measure: Measure) -> PyContact {
        let [x_mm, y_mm, force_n, sd_x_mm, sd_y_mm, sd_force_n, rest @ ..] = shown(solved, measure);
        let [half68_mm, half95_mm, half68_n, half95_n, other_x_mm, other_y_mm, misfit, relative @ ..] = rest;
        let [relative_force, half68_relative_force, half95_relative_force, depth @ ..] = relative;
        let [depth_mm, sd_depth_mm, half68_depth_mm, half95_depth_mm] = depth;
        PyContact {
            x_mm,
            y_mm,
            force_n,
            sd_x_mm,
            sd_y_mm,
            sd_force_n,
            half68_mm,
            half95_mm,
            half68_n,
            half95_n,
            other_x_mm,
            other_y_mm,
            misfit,
            relative_force,
            half68_relative_force,
            half95_relative_force,
            depth_mm,
            sd_depth_mm,
            half68_depth_mm,
            half95_depth_mm,
            is_calibrated_load: solved.as_ref().is_ok_and(|solution| solution.is_calibrated_load),
            verdict: verdict(solved),
            unit: unit(solved),
            error: solved.as_ref().err().map(ToString::to_string),
        }
    }
}

#[pymethods]
impl PyContact {
    fn __repr__(&self) -> String {
        let PyContact { x_mm, y_mm, force_n, relative_force, depth_mm, verdict, .. } = self;
        let force = match () {
            () if !depth_mm.is_nan() => format!("depth {depth_mm:.3} mm"),
            () if !relative_force.is_nan() => format!("relative force {relative_force:.3}"),
            () => format!("{force_n:.3} N"),
        };
        format!("<palpate.Contact x {x_mm:.3} mm, y {y_mm:.3} mm, {force}, {verdict}>")
    }
}

/// Answers to a batch of readings, column by column.
pub struct PyContacts {
    numbers: [Vec<f64>; NUMBERS.len()],
    /// Positions in [`VERDICTS`].
    verdicts: Vec<i32>,
    units: Vec<i64>,
    /// Different reasons for rows without an answer, after `None`, and which of them each row has.
    errors: Vec<Option<String>>,
    error: Vec<i32>,
    /// Positions in [`LOADS`].
    loads: Vec<i32>,
}

/// Names of the loads that two methods assume, as `palpate solve` prints them. A reading without an answer has none.
const LOADS: [Option<&str>; 3] = [Some("any"), Some("calibrated"), None];

/// All verdicts of a solution, in the order of their positions, and that of a reading without a solution.
const VERDICTS: [ContactVerdict; 5] = [
    ContactVerdict::Ok,
    ContactVerdict::WeakSignal,
    ContactVerdict::OutsideArea,
    ContactVerdict::NotOneContact,
    ContactVerdict::ChannelFault(0),
];

impl PyContacts {
    /// Creates room for the answers to so many readings.
    pub fn new(rows: usize) -> PyContacts {
        PyContacts {
            numbers: std::array::from_fn(|_| Vec::with_capacity(rows)),
            verdicts: Vec::with_capacity(rows),
            units: Vec::with_capacity(rows),
            errors: vec![None],
            error: Vec::with_capacity(rows),
            loads: Vec::with_capacity(rows),
        }
    }

    /// Adds the answer to the next reading.
    pub fn add(&mut self, solved: &Result<Solution, Unanswered>, measure: Measure) {
        self.numbers.iter_mut().zip(shown(solved, measure)).for_each(|(column, number)| column.push(number));
        let (verdict, unit) = match solved.as_ref().map(|solution| solution.verdict) {
            Ok(ContactVerdict::Ok) => (0, 0),
            Ok(ContactVerdict::WeakSignal) => (1, 0),
            Ok(ContactVerdict::OutsideArea) => (2, 0),
            Ok(ContactVerdict::NotOneContact) => (3, 0),
            Ok(ContactVerdict::ChannelFault(unit)) => (4, unit as i64 + 1),
            Err(_) => (5, 0),
        };
        self.verdicts.push(verdict);
        self.units.push(unit);
        let error = solved.as_ref().err().map_or(0, |error| self.position(error.to_string()));
        self.error.push(error);
        self.loads.push(solved.as_ref().map_or(2, |solution| i32::from(solution.is_calibrated_load)));
    }

    /// Returns the position of a reason, which is added if it is new.
    fn position(&mut self, error: String) -> i32 {
        let error = Some(error);
        let known = self.errors.iter().position(|known| *known == error);
        known.unwrap_or_else(|| {
            self.errors.push(error);
            self.errors.len() - 1
        }) as i32
    }

    /// Returns a frame with the columns of `palpate solve`. `has_two_methods` states whether a second method answers readings with the
    /// load of the calibration. Without depths the frame has all columns of forces, and none of depths.
    pub fn frame(self, has_two_methods: bool, measure: Measure) -> PyFrame {
        let rows = self.verdicts.len();
        let numbers = NUMBERS.into_iter().zip(ABOUT).zip(self.numbers);
        let is_column =
            |name: &str| if measure == Measure::Depth { measure.has(name) } else { !name.contains("depth") };
        let mut columns: Vec<PyColumn> = numbers
            .filter(|((name, _), _)| is_column(name))
            .map(|((name, (unit, about)), values)| PyColumn::new(name, unit, about, ColumnValues::F64(values.into())))
            .collect();
        if has_two_methods {
            let loads = ColumnValues::Text(LOADS.map(|load| load.map(str::to_owned)).to_vec(), self.loads);
            columns.push(PyColumn::new("load", "", "Load that the answer assumes: of the calibration, or any.", loads));
        }
        let words = VERDICTS.into_iter().map(ContactVerdict::word).chain([UNSOLVED]);
        let verdicts = ColumnValues::Text(words.map(|word| Some(word.to_owned())).collect(), self.verdicts);
        columns.push(PyColumn::new("verdict", "", "Whether the contact is credible.", verdicts));
        let about = "The output that contradicts the others, counted from 1.";
        columns.push(PyColumn::new("unit", "", about, ColumnValues::Ordinal(self.units.into())));
        columns.push(PyColumn::new(
            "error",
            "",
            "Why there is no contact.",
            ColumnValues::Text(self.errors, self.error),
        ));
        PyFrame::new("contacts", rows, columns, HashMap::new())
    }
}

fn shown(solved: &Result<Solution, Unanswered>, measure: Measure) -> [f64; NUMBERS.len()] {
    solved.as_ref().map_or([f64::NAN; NUMBERS.len()], |solution| numbers(solution, measure))
}

fn verdict(solved: &Result<Solution, Unanswered>) -> &'static str {
    solved.as_ref().map_or(UNSOLVED, |solution| solution.verdict.word())
}

fn unit(solved: &Result<Solution, Unanswered>) -> Option<usize> {
    match solved.as_ref().map(|solution| solution.verdict) {
        Ok(ContactVerdict::ChannelFault(unit)) => Some(unit + 1),
        _ => None,
    }
}
