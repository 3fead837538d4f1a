//! `palpate.evaluate`, `palpate.report` and `palpate.certificate`.

use super::given::{RunPath, noted};
use super::refused::{raised, warn};
use palpate::api::{
    self, AcceptOptions, CertificateOptions, Certified, ColumnsOptions, EvaluateOptions, Failure, HoldoutOptions,
    ReportOptions,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use serde::Serialize;
use std::path::PathBuf;

/// Errors of methods on test presses, and the verdict: the objects of `palpate evaluate --json`.
#[pyclass(name = "Evaluation", frozen, module = "palpate")]
pub struct PyEvaluation(api::Evaluated);

#[pymethods]
impl PyEvaluation {
    /// The evaluation of each method, by its name: a dict of the errors.
    #[getter]
    fn methods<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let methods = PyDict::new(py);
        for (_, outcome) in &self.0.outcomes {
            if let Ok(evaluation) = outcome {
                methods.set_item(&evaluation.solver, object(py, evaluation)?)?;
            }
        }
        Ok(methods)
    }

    /// Why a method has no evaluation, by its name.
    #[getter]
    fn failures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let failures = PyDict::new(py);
        for (solver, outcome) in &self.0.outcomes {
            outcome.as_ref().err().map_or(Ok(()), |why| failures.set_item(solver, why))?;
        }
        Ok(failures)
    }

    /// The errors on presses that were held out in turn, the best method first, if there is no test; None otherwise.
    #[getter]
    fn cross_validated<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.0.cross_validated.as_ref().map(|candidates| object(py, candidates)).transpose()
    }

    /// The verdict: accepted, not-accepted or not-decided; None without a rule.
    #[getter]
    fn verdict<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.0.judgement.as_ref().map(|judgement| object(py, &judgement.verdict)).transpose()
    }

    /// The verdict with each limit, a dict; None without a rule.
    #[getter]
    fn judgement<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.0.judgement.as_ref().map(|judgement| object(py, judgement)).transpose()
    }

    fn __repr__(&self) -> String {
        let methods: Vec<String> =
            self.0.outcomes.iter().filter_map(|(_, outcome)| line(outcome.as_ref().ok()?)).collect();
        format!("<palpate.Evaluation {}>", methods.join("; "))
    }
}

/// Solves the test presses of a run, of two tables, or held out of one, and judges them, like `palpate evaluate`.
///
/// `run` is a run folder, a table of calibration presses, or a `Run`; `test` is a table of test presses. `solver` is the name of a
/// method; `best` selects by cross-validation, `all` evaluates every method. `constant_load`: every contact has the force of the
/// calibration. `holdout` holds out presses as the test: places, press or time, and their share, such as ("places", 0.2). `seed`
/// selects them, `same_place` (mm) is the largest distance of presses at one place, and `save` is a folder for both parts. `columns`:
/// what the columns of a table contain. `accept` is a file with the acceptance rule that replaces the recipe's.
/// `quantity`: what is solved besides the place, `force` or `depth`; without it the force, or the depth if only depths are known.
///
/// Raises `UsageError` for bad input. Other threads continue meanwhile.
#[pyfunction]
#[pyo3(signature = (
    run, test=None, solver="best", *, constant_load=false, holdout=None, seed=1, same_place=None, save=None, columns=None, accept=None,
    quantity=None
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn evaluate(
    py: Python<'_>,
    run: &Bound<'_, PyAny>,
    test: Option<PathBuf>,
    solver: &str,
    constant_load: bool,
    holdout: Option<(String, f64)>,
    seed: u64,
    same_place: Option<f64>,
    save: Option<PathBuf>,
    columns: Option<String>,
    accept: Option<PathBuf>,
    quantity: Option<&str>,
) -> PyResult<PyEvaluation> {
    let run = RunPath::of(run)?;
    let default = HoldoutOptions::default();
    let options = EvaluateOptions {
        run: [run.path().to_owned()].into_iter().chain(test).collect(),
        solver: solver.to_owned(),
        constant_load,
        quantity: quantity.map(|word| api::choice("--quantity", word)).transpose().map_err(raised)?,
        holdout: HoldoutOptions {
            holdout: holdout.into_iter().flat_map(|(by, share)| [by, share.to_string()]).collect(),
            seed,
            same_place: same_place.unwrap_or(default.same_place),
            save,
        },
        columns: ColumnsOptions { columns: columns.or_else(|| run.columns().map(str::to_owned)), sheet: None },
        accept: AcceptOptions { accept },
        ..EvaluateOptions::default()
    };
    let evaluated = called(py, || noted(|note| api::evaluate(&options, note)))?;
    Ok(PyEvaluation(evaluated))
}

/// Writes a page about one run, about runs of one sensor, or a comparison of many sensors, like `palpate report`.
///
/// `runs` are run folders or `Run`s. `out` is the page [report.html in the first run's folder, or comparison.html]. `figures` is a
/// folder for the figures, each as SVG with its numbers as CSV. `compare` compares runs. `same_sensor`: runs without a sensor ID are
/// of the same sensor. `accept` is a file with the acceptance rule. `solver` is the method of a comparison.
///
/// Returns the object of `palpate report --json`: page, figures and result. Raises `UsageError` for bad input and `RecordError` if
/// the page can't be written.
#[pyfunction]
#[pyo3(signature = (*runs, out=None, figures=None, compare=false, same_sensor=false, accept=None, solver=None))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn report<'py>(
    py: Python<'py>,
    runs: &Bound<'py, PyTuple>,
    out: Option<PathBuf>,
    figures: Option<PathBuf>,
    compare: bool,
    same_sensor: bool,
    accept: Option<PathBuf>,
    solver: Option<String>,
) -> PyResult<Bound<'py, PyDict>> {
    let default = ReportOptions::of(paths(runs)?);
    let (accept, solver) = (AcceptOptions { accept }, solver.unwrap_or(default.solver));
    let options = ReportOptions { out, figures, compare, same_sensor, accept, solver, runs: default.runs };
    let report = called(py, || {
        noted(|note| {
            let report = api::report(&options, note)?;
            report.write()?;
            Ok(report)
        })
    })?;
    let object_of = PyDict::new(py);
    object_of.set_item("page", report.out)?;
    object_of.set_item("figures", options.figures)?;
    object_of.set_item("result", object(py, &report.result)?)?;
    Ok(object_of)
}

/// Writes the calibration certificate of a sensor, like `palpate certificate`: a page and a Digital Calibration Certificate.
///
/// `runs` are the run folders or `Run`s of the sensor. `given` is the TOML file with laboratory, customer, item and procedure. `out` is
/// the path without extension [certificate in the first run's folder]. `same_sensor`: runs without a sensor ID are of the same
/// sensor. `accept` is a file with the acceptance rule.
///
/// Returns the object of `palpate certificate --json`: result, files and verdict. Raises `UsageError` for bad input, and replaces no
/// file.
#[pyfunction]
#[pyo3(signature = (*runs, given, out=None, same_sensor=false, accept=None))]
pub fn certificate<'py>(
    py: Python<'py>,
    runs: &Bound<'py, PyTuple>,
    given: PathBuf,
    out: Option<PathBuf>,
    same_sensor: bool,
    accept: Option<PathBuf>,
) -> PyResult<Bound<'py, PyDict>> {
    let (runs, with, accept) = (paths(runs)?, Some(given), AcceptOptions { accept });
    let options = CertificateOptions { runs, with, out, same_sensor, accept };
    let Certified { summary, verdict, html, xml } = called(py, || noted(|note| api::certificate(&options, note)))?;
    let object_of = PyDict::new(py);
    object_of.set_item("result", summary)?;
    object_of.set_item("files", [html, xml])?;
    object_of.set_item("verdict", object(py, &verdict)?)?;
    Ok(object_of)
}

/// Calls without the interpreter's lock, and warns of what the call notes.
fn called<T: Send>(py: Python<'_>, call: impl FnOnce() -> Result<(T, Vec<String>), Failure> + Send) -> PyResult<T> {
    let (result, notes) = py.detach(call).map_err(raised)?;
    warn(py, &notes)?;
    Ok(result)
}

fn paths(runs: &Bound<'_, PyTuple>) -> PyResult<Vec<PathBuf>> {
    if runs.is_empty() {
        return Err(PyTypeError::new_err("expected one run or more"));
    }
    runs.iter().map(|run| Ok(RunPath::of(&run)?.path().to_owned())).collect()
}

/// Returns the objects of Python that JSON describes.
fn object<'py>(py: Python<'py>, content: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(content).map_err(|why| PyTypeError::new_err(why.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}

fn line(evaluation: &palpate_solver::Evaluation) -> Option<String> {
    Some(format!("{}: {:.3} mm", evaluation.solver, evaluation.location_error_mm.mean))
}
