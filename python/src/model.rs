//! `palpate.fit`, models and sessions: place and force of unknown contacts.

use super::contact::{PyContact, PyContacts};
use super::given::{RunPath, noted};
use super::readings::PyReadings;
use super::refused::{UsageError, raised, warn};
use palpate::api::{self, ColumnsOptions, Measure, MethodOptions, Note, Sensor, SensorModel};
use palpate_core::parallel::lock;
use palpate_data::dataset::{Fingerprint, LiveSession};
use palpate_solver::{self as solver, Solver as _};
use pyo3::prelude::*;
use pyo3::types::PyList;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

/// Largest number of idle sessions that a model keeps, so that calls of many threads find their memory ready.
const IDLE_MAX: usize = 16;

/// Refusal of the sensor file of a series.
pub const SERIES: &str =
    "the sensor file solves a series of readings: use the commands `palpate solve` or `palpate serve`";

/// A calibrated sensor: a method that is fitted to presses.
#[pyclass(name = "Model", frozen, module = "palpate")]
pub struct PyModel {
    model: Arc<solver::Model>,
    sensor: Option<String>,
    made_from: Vec<Fingerprint>,
    /// Sessions that no call uses. They keep their working memory and their fits for missing outputs.
    idle: Mutex<Vec<solver::Session>>,
}

/// One reading after another of one sensor. An output that breaks is excluded from then on.
#[pyclass(name = "Session", frozen, module = "palpate")]
pub struct PySession {
    session: Mutex<LiveSession>,
    model: Arc<solver::Model>,
}

/// Fits a method to a run or a table of presses, like `palpate fit`.
///
/// `run` is a run folder, a table, or a `Run`; a list of them, one for each sensor of a design, gives one map. `solver` is the name of a method; `best` selects by cross-validation.
/// `constant_load`: every contact has the force of the calibration. `common_offset`: solve also for an offset that all outputs
/// share. `false_alarms`: accepted share of single contacts with a wrong verdict (0.01). `forces_n`: the expected forces
/// (least, most), N, if the calibration has one force. `columns`: what the columns of a table contain.
///
/// `quantity`: what is solved besides the place, `force` or `depth`; without it the force, or the depth if only depths are known.
///
/// Forces are those of the load cell. Raises `UsageError` for bad input. Other threads continue meanwhile.
#[pyfunction]
#[pyo3(signature = (
    run, solver="best", *, constant_load=false, common_offset=false, false_alarms=None, forces_n=None, columns=None,
    quantity=None
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn fit(
    py: Python<'_>,
    run: &Bound<'_, PyAny>,
    solver: &str,
    constant_load: bool,
    common_offset: bool,
    false_alarms: Option<f64>,
    forces_n: Option<(f64, f64)>,
    columns: Option<String>,
    quantity: Option<&str>,
) -> PyResult<PyModel> {
    let runs = match run.cast::<PyList>() {
        Ok(several) => several.iter().map(|run| RunPath::of(&run)).collect::<PyResult<Vec<_>>>()?,
        Err(_) => vec![RunPath::of(run)?],
    };
    let columns = columns.or_else(|| runs.first()?.columns().map(str::to_owned));
    let default = MethodOptions::default();
    let options = MethodOptions {
        solver: solver.to_owned(),
        constant_load,
        quantity: quantity.map(|word| api::choice("--quantity", word)).transpose().map_err(raised)?,
        common_offset,
        false_alarms: false_alarms.unwrap_or(default.false_alarms),
        forces_n: forces_n.into_iter().flat_map(|(least, most)| [least, most]).collect(),
        vector: false,
        history: false,
        columns: ColumnsOptions { columns, sheet: None },
    };
    let paths: Vec<PathBuf> = runs.iter().map(|run| run.path().to_owned()).collect();
    let fitted = |note: Note<'_>| match paths.as_slice() {
        [path] => api::fit(path, &options, note),
        paths => api::fit_design(paths, &options, note).map(|design| design.sensor),
    };
    PyModel::of(py, py.detach(|| noted(fitted)))
}

impl PyModel {
    fn of(py: Python<'_>, sensor: Result<(Sensor, Vec<String>), api::Failure>) -> PyResult<Self> {
        let (Sensor { model, sensor, made_from }, notes) = sensor.map_err(raised)?;
        warn(py, &notes)?;
        match model {
            SensorModel::Contact(model) => {
                Ok(PyModel { model: Arc::new(*model), sensor, made_from, idle: Mutex::default() })
            }
            SensorModel::Vector(_) => {
                Err(UsageError::new_err("the sensor file solves force vectors: load it with palpate.VectorModel.load"))
            }
            SensorModel::History(_) => Err(UsageError::new_err(SERIES)),
        }
    }

    /// Runs with a session that knows no reading.
    fn with_session(&self, solve: &mut dyn FnMut(&mut solver::Session)) {
        let idle = lock(&self.idle).pop();
        let mut session = idle.unwrap_or_else(|| solver::Session::new(self.model.clone()));
        solve(&mut session);
        session.restart();
        let mut idle = lock(&self.idle);
        if idle.len() < IDLE_MAX {
            idle.push(session);
        }
    }
}

#[pymethods]
impl PyModel {
    /// Loads a sensor file, which `save` or `palpate fit` wrote.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<PyModel> {
        PyModel::of(py, py.detach(|| noted(|note| api::read_sensor(&path, note))))
    }

    /// Writes the model to a sensor file. Replaces a sensor file, but nothing else.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let (sensor, made_from) = (self.sensor.clone(), self.made_from.clone());
        let copy = SensorModel::copy_of(&self.model).map_err(|why| UsageError::new_err(why.to_string()))?;
        py.detach(|| api::write_sensor(copy, sensor, made_from, &path)).map_err(raised)
    }

    /// Solves one reading, shape (outputs,), or a batch, shape (rows, outputs). A missing output is NaN.
    ///
    /// Readings are the outputs minus those without load, in the unit of the calibration. One reading gives a `Contact`, a batch a
    /// `Frame` with a row for each reading. The numbers are those of `palpate solve`, to the last bit. Each call is a session of
    /// its own: an output that breaks within a batch is excluded from the rest of the batch. Other threads continue meanwhile.
    fn solve<'py>(&self, py: Python<'py>, readings: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        solved(py, readings, &self.model, |_, solve| {
            self.with_session(&mut |session| solve(&mut |outputs| session.solve(outputs)));
        })
    }

    /// Begins a session: one reading after another, where an output that breaks is excluded from then on, as in `palpate solve`.
    fn session(&self) -> PySession {
        let session = LiveSession::new(solver::Session::new(self.model.clone()));
        PySession { session: Mutex::new(session), model: self.model.clone() }
    }

    /// Name of the method.
    #[getter]
    fn solver(&self) -> &str {
        self.model.fitted().name()
    }

    /// ID of the sensor; None if its run has none.
    #[getter]
    fn sensor(&self) -> Option<&str> {
        self.sensor.as_deref()
    }

    /// Number of outputs of a reading.
    #[getter]
    fn outputs(&self) -> usize {
        self.model.validity().units
    }

    /// Outputs that are excluded, counted from 1.
    #[getter]
    fn broken(&self) -> Vec<usize> {
        self.model.fitted().broken().iter().map(|broken| broken.unit + 1).collect()
    }

    /// Smallest and largest x of the calibration, mm.
    #[getter]
    fn x_mm(&self) -> (f64, f64) {
        self.model.validity().x_mm.into()
    }

    /// Smallest and largest y of the calibration, mm.
    #[getter]
    fn y_mm(&self) -> (f64, f64) {
        self.model.validity().y_mm.into()
    }

    /// Smallest and largest depth of the calibration, mm; None unless presses are known by depth.
    #[getter]
    fn depth_mm(&self) -> Option<(f64, f64)> {
        self.model.validity().depth_mm.map(Into::into)
    }

    /// Smallest and largest force of the calibration, N; None if forces are relative.
    #[getter]
    fn force_n(&self) -> Option<(f64, f64)> {
        self.model.validity().force_n.map(Into::into)
    }

    fn __repr__(&self) -> String {
        let validity = self.model.validity();
        format!("<palpate.Model {}: {} presses of {} outputs>", self.solver(), validity.presses, validity.units)
    }
}

#[pymethods]
impl PySession {
    /// Solves the next reading, shape (outputs,), or the next batch, shape (rows, outputs), as `Model.solve` does.
    fn solve<'py>(&self, py: Python<'py>, readings: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        solved(py, readings, &self.model, |is_batch, solve| {
            let mut session = lock(&self.session);
            match is_batch {
                true => solve(&mut |outputs| session.solve_known(outputs)),
                false => solve(&mut |outputs| session.solve(outputs)),
            }
        })
    }

    /// Whether so many contacts didn't fit the calibration that the sensor should be calibrated again.
    #[getter]
    fn is_out_of_date(&self, py: Python<'_>) -> bool {
        py.detach(|| lock(&self.session).session().is_out_of_date())
    }

    /// Outputs that are excluded, counted from 1.
    #[getter]
    fn broken(&self, py: Python<'_>) -> Vec<usize> {
        let broken = || lock(&self.session).session().broken().iter().map(|broken| broken.unit + 1).collect();
        py.detach(broken)
    }

    /// Outputs at fault since the calibration, counted from 1, which are excluded: each with the odds to one that it is at fault.
    #[getter]
    fn at_fault(&self, py: Python<'_>) -> BTreeMap<usize, f64> {
        let at_fault = || lock(&self.session).session().at_fault();
        py.detach(at_fault).into_iter().map(|faulty| (faulty.unit + 1, faulty.odds)).collect()
    }
}

/// Solves the next reading of a session.
type SolveNext<'a> = dyn FnMut(&[f64]) -> Result<solver::Solution, solver::Unanswered> + 'a;

/// Solves readings with a session, without the interpreter's lock. `session` receives whether they are a batch.
fn solved<'py>(
    py: Python<'py>,
    given: &Bound<'py, PyAny>,
    model: &solver::Model,
    session: impl FnOnce(bool, &mut dyn FnMut(&mut SolveNext<'_>)) + Send,
) -> PyResult<Bound<'py, PyAny>> {
    let (units, measure) = (model.validity().units, Measure::of(model));
    let readings = PyReadings::of(given, units)?;
    let numbers = readings.numbers()?;
    match readings.rows {
        None => {
            let mut contact = None;
            py.detach(|| {
                session(false, &mut |solve| contact = Some(PyContact::of(&solve(numbers), measure)));
            });
            Ok(contact.into_pyobject(py)?.into_any())
        }
        Some(rows) => {
            let (mut contacts, has_two_methods) =
                (PyContacts::new(rows), model.fitted().at_calibrated_load().is_some());
            py.detach(|| {
                // a reading without outputs is refused above: no array has none
                session(true, &mut |solve| {
                    numbers.chunks_exact(units).for_each(|reading| contacts.add(&solve(reading), measure));
                });
            });
            Ok(contacts.frame(has_two_methods, measure).into_pyobject(py)?.into_any())
        }
    }
}
