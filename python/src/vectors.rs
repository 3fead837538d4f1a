//! `palpate.fit_vector`: place and force vector of unknown contacts, from presses and drags.

use super::frame::{ColumnValues, PyColumn, PyFrame};
use super::given::{RunPath, noted};
use super::model::SERIES;
use super::readings::PyReadings;
use super::refused::{UsageError, raised, warn};
use palpate::api::{self, ColumnsOptions, MethodOptions, Sensor, SensorModel, UNSOLVED, vector_numbers};
use palpate_data::dataset::Fingerprint;
use palpate_solver::Unanswered;
use palpate_solver::vector::{VECTOR_NUMBERS, VectorFits, VectorSession, VectorSolution};
use pyo3::prelude::*;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Unit and definition of each number, in the order of [`VECTOR_NUMBERS`].
const ABOUT: [(&str, &str); VECTOR_NUMBERS.len()] = [
    ("mm", "x of the contact, specimen frame."),
    ("mm", "y of the contact, specimen frame."),
    ("N", "Force along x."),
    ("N", "Force along y."),
    ("N", "Force into the specimen."),
    ("mm", "Standard deviation of x."),
    ("mm", "Standard deviation of y."),
    ("N", "Standard deviation of the force along x."),
    ("N", "Standard deviation of the force along y."),
    ("N", "Standard deviation of the force into the specimen."),
    ("N", "Expected error of a force along the surface that the outputs can't show."),
    ("mm", "x of a second contact."),
    ("mm", "y of a second contact."),
    ("N", "Force of a second contact."),
    ("", "Misfit between the reading and one contact; above 1: not a single contact."),
];

/// A calibrated sensor that solves places and force vectors.
#[pyclass(name = "VectorModel", frozen, module = "palpate")]
pub struct PyVectorModel {
    fits: Arc<VectorFits>,
    sensor: Option<String>,
    made_from: Vec<Fingerprint>,
}

/// The contact behind one reading, with its force vector. An unknown number is NaN.
#[pyclass(name = "VectorContact", frozen, get_all, module = "palpate")]
pub struct PyVectorContact {
    /// x of the contact, specimen frame, mm.
    x_mm: f64,
    /// y of the contact, specimen frame, mm.
    y_mm: f64,
    /// Force along x, N; NaN if the outputs can't show it.
    force_x_n: f64,
    /// Force along y, N; NaN if the outputs can't show it.
    force_y_n: f64,
    /// Force into the specimen, N.
    force_n: f64,
    /// Standard deviation of x, mm.
    sd_x_mm: f64,
    /// Standard deviation of y, mm.
    sd_y_mm: f64,
    /// Standard deviation of the force along x, N.
    sd_force_x_n: f64,
    /// Standard deviation of the force along y, N.
    sd_force_y_n: f64,
    /// Standard deviation of the force into the specimen, N.
    sd_force_n: f64,
    /// Expected error of a force along the surface that the outputs can't show, N.
    shear_bound_n: f64,
    /// x of a second contact, specimen frame, mm.
    second_x_mm: f64,
    /// y of a second contact, specimen frame, mm.
    second_y_mm: f64,
    /// Force of a second contact, N.
    second_force_n: f64,
    /// Misfit between the reading and one contact; above 1: not a single contact.
    misfit: f64,
    /// `ok`, `weak-signal`, `outside-area`, `shear-unknown`, `two-contacts`, `two-not-separable`, `unit-fault`, `not-one-contact`, two
    /// causes with "or", or `unsolved`.
    verdict: String,
    /// The taxel that contradicts the others, counted from 1, if the verdict is `unit-fault`.
    unit: Option<usize>,
    /// Why there is no contact, if the verdict is `unsolved`.
    error: Option<String>,
}

/// Fits a run or a table of presses and drags, like `palpate fit --vector`.
///
/// `run` is a run folder, a table, or a `Run`. `columns`: what the columns of a table contain. Raises `UsageError` for bad input, or if
/// no press has three components of the force. Other threads continue meanwhile.
#[pyfunction]
#[pyo3(signature = (run, *, columns=None))]
pub fn fit_vector(py: Python<'_>, run: &Bound<'_, PyAny>, columns: Option<String>) -> PyResult<PyVectorModel> {
    let run = RunPath::of(run)?;
    let columns = columns.or_else(|| run.columns().map(str::to_owned));
    let columns = ColumnsOptions { columns, sheet: None };
    let options = MethodOptions { vector: true, columns, ..MethodOptions::default() };
    let path = run.path().to_owned();
    PyVectorModel::of(py, py.detach(|| noted(|note| api::fit(&path, &options, note))))
}

impl PyVectorModel {
    fn of(py: Python<'_>, sensor: Result<(Sensor, Vec<String>), api::Failure>) -> PyResult<Self> {
        let (Sensor { model, sensor, made_from }, notes) = sensor.map_err(raised)?;
        warn(py, &notes)?;
        match model {
            SensorModel::Vector(model) => {
                Ok(PyVectorModel { fits: Arc::new(VectorFits::new(*model)), sensor, made_from })
            }
            SensorModel::Contact(_) => {
                Err(UsageError::new_err("the sensor file solves no force vectors: load it with palpate.Model.load"))
            }
            SensorModel::History(_) => Err(UsageError::new_err(SERIES)),
        }
    }
}

#[pymethods]
impl PyVectorModel {
    /// Loads a sensor file, which `save` or `palpate fit --vector` wrote.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<PyVectorModel> {
        PyVectorModel::of(py, py.detach(|| noted(|note| api::read_sensor(&path, note))))
    }

    /// Writes the model to a sensor file. Replaces a sensor file, but nothing else.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let model = SensorModel::Vector(Box::new(self.fits.model().clone()));
        let (sensor, made_from) = (self.sensor.clone(), self.made_from.clone());
        py.detach(|| api::write_sensor(model, sensor, made_from, &path)).map_err(raised)
    }

    /// Solves one reading, shape (outputs,), or a batch, shape (rows, outputs). A missing output is NaN.
    ///
    /// One reading gives a `VectorContact`, a batch a `Frame` with a row for each reading. The numbers are those of `palpate solve`, to
    /// the last bit. Other threads continue meanwhile.
    fn solve<'py>(&self, py: Python<'py>, readings: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let outputs = self.outputs();
        let readings = PyReadings::of(readings, outputs)?;
        let numbers = readings.numbers()?;
        let solved: Vec<Result<VectorSolution, Unanswered>> = py.detach(|| {
            let mut session = VectorSession::new(self.fits.clone());
            numbers.chunks_exact(outputs).map(|reading| session.solve(reading)).collect()
        });
        match (readings.rows, solved.as_slice()) {
            (None, [solved]) => Ok(PyVectorContact::of(solved).into_pyobject(py)?.into_any()),
            (_, solved) => Ok(frame(solved).into_pyobject(py)?.into_any()),
        }
    }

    /// ID of the sensor; None if its run has none.
    #[getter]
    fn sensor(&self) -> Option<&str> {
        self.sensor.as_deref()
    }

    /// Number of outputs of a reading.
    #[getter]
    fn outputs(&self) -> usize {
        self.fits.model().validity().units
    }

    /// Smallest and largest x of the calibration, mm.
    #[getter]
    fn x_mm(&self) -> (f64, f64) {
        self.fits.model().validity().x_mm.into()
    }

    /// Smallest and largest y of the calibration, mm.
    #[getter]
    fn y_mm(&self) -> (f64, f64) {
        self.fits.model().validity().y_mm.into()
    }

    /// Whether the calibration shows the effect of a force along the surface.
    #[getter]
    fn knows_shear(&self) -> bool {
        self.fits.model().map().knows_shear()
    }

    fn __repr__(&self) -> String {
        let validity = self.fits.model().validity();
        format!("<palpate.VectorModel: {} presses of {} outputs>", validity.presses, validity.units)
    }
}

impl PyVectorContact {
    fn of(solved: &Result<VectorSolution, Unanswered>) -> PyVectorContact {
        let [x_mm, y_mm, force_x_n, force_y_n, force_n, sd_x_mm, sd_y_mm, rest @ ..] = shown(solved);
        let [sd_force_x_n, sd_force_y_n, sd_force_n, shear_bound_n, rest @ ..] = rest;
        let [second_x_mm, second_y_mm, second_force_n, misfit] = rest;
        PyVectorContact {
            x_mm,
            y_mm,
            force_x_n,
            force_y_n,
            force_n,
            sd_x_mm,
            sd_y_mm,
            sd_force_x_n,
            sd_force_y_n,
            sd_force_n,
            shear_bound_n,
            second_x_mm,
            second_y_mm,
            second_force_n,
            misfit,
            verdict: word(solved),
            unit: unit(solved),
            error: solved.as_ref().err().map(ToString::to_string),
        }
    }
}

#[pymethods]
impl PyVectorContact {
    fn __repr__(&self) -> String {
        let PyVectorContact { x_mm, y_mm, force_x_n, force_y_n, force_n, verdict, .. } = self;
        format!(
            "<palpate.VectorContact x {x_mm:.3} mm, y {y_mm:.3} mm, {force_x_n:.3}, {force_y_n:.3}, {force_n:.3} N, {verdict}>"
        )
    }
}

/// Returns a frame with the columns of `palpate solve`.
fn frame(solved: &[Result<VectorSolution, Unanswered>]) -> PyFrame {
    let numbers: Vec<[f64; VECTOR_NUMBERS.len()]> = solved.iter().map(shown).collect();
    let number = |(at, (name, (unit, about))): (usize, (&str, (&str, &str)))| {
        let values: Vec<f64> = numbers.iter().map(|numbers| numbers[at]).collect();
        PyColumn::new(name, unit, about, ColumnValues::F64(values.into()))
    };
    let mut columns: Vec<PyColumn> = VECTOR_NUMBERS.into_iter().zip(ABOUT).enumerate().map(number).collect();
    let texts = |texts: &[Option<String>]| ColumnValues::texts(texts.iter().map(Option::as_deref));
    let verdicts: Vec<Option<String>> = solved.iter().map(|solved| Some(word(solved))).collect();
    columns.push(PyColumn::new("verdict", "", "Whether the contact is credible.", texts(&verdicts)));
    let units: Vec<i64> = solved.iter().map(|solved| unit(solved).map_or(0, |unit| unit as i64)).collect();
    let about = "The taxel that contradicts the others, counted from 1.";
    columns.push(PyColumn::new("unit", "", about, ColumnValues::Ordinal(units.into())));
    let errors: Vec<Option<String>> =
        solved.iter().map(|solved| solved.as_ref().err().map(ToString::to_string)).collect();
    columns.push(PyColumn::new("error", "", "Why there is no contact.", texts(&errors)));
    PyFrame::new("contacts", solved.len(), columns, HashMap::new())
}

fn shown(solved: &Result<VectorSolution, Unanswered>) -> [f64; VECTOR_NUMBERS.len()] {
    solved.as_ref().map_or([f64::NAN; VECTOR_NUMBERS.len()], vector_numbers)
}

fn word(solved: &Result<VectorSolution, Unanswered>) -> String {
    solved.as_ref().map_or_else(|_| UNSOLVED.to_owned(), |solution| solution.verdict.word().into_owned())
}

fn unit(solved: &Result<VectorSolution, Unanswered>) -> Option<usize> {
    solved.as_ref().ok()?.verdict.unit()
}
