//! `palpate.load`: runs and tables as frames.

use super::frame::{ColumnValues, PyColumn, PyFrame};
use super::given::noted;
use super::refused::{raised, warn};
use palpate::api::{self, ColumnsOptions};
use palpate_report::export::frame::{self, Values};
use pyo3::prelude::*;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Key of the manifest in the metadata of a frame.
const MANIFEST: &str = "palpate.manifest";

/// A run, or the presses of a table.
#[pyclass(name = "Run", frozen, module = "palpate")]
pub struct PyRun {
    path: PathBuf,
    columns: Option<String>,
    manifest: Option<String>,
    notes: Vec<String>,
    frames: Vec<Py<PyFrame>>,
}

impl PyRun {
    /// Returns the path of the run or the table.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the columns file with which the table was read.
    pub fn columns(&self) -> Option<&str> {
        self.columns.as_deref()
    }

    fn frame<'py>(&self, py: Python<'py>, name: &str) -> Option<Bound<'py, PyFrame>> {
        let frame = self.frames.iter().find(|frame| frame.get().title() == name)?;
        Some(frame.bind(py).clone())
    }
}

#[pymethods]
impl PyRun {
    /// The run folder or the table.
    #[getter(path)]
    fn path_of(&self) -> PathBuf {
        self.path.clone()
    }

    /// The manifest of a run: recipe, labels, devices, programs; None for a table.
    #[getter]
    fn manifest<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let read = |text: &String| py.import("json")?.call_method1("loads", (text,));
        self.manifest.as_ref().map(read).transpose()
    }

    /// Lines that `palpate fit` prints about the files.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// The presses, a row for each level: the columns of `presses.csv`.
    #[getter]
    fn presses<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyFrame>> {
        self.frame(py, "presses")
    }

    /// The outputs at the places of the calibration; None without them.
    #[getter]
    fn calibration_matrix<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyFrame>> {
        self.frame(py, "calibration_matrix")
    }

    /// The outputs at the places of the test; None without them.
    #[getter]
    fn test_matrix<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyFrame>> {
        self.frame(py, "test_matrix")
    }

    /// Repeatability, hysteresis and linearity of each unit; None without staircases.
    #[getter]
    fn characteristics<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyFrame>> {
        self.frame(py, "characteristics")
    }

    /// The true values of a simulated run; None otherwise.
    #[getter]
    fn truth<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyFrame>> {
        self.frame(py, "truth")
    }

    /// All frames, by name.
    #[getter]
    fn frames(&self, py: Python<'_>) -> HashMap<String, Py<PyFrame>> {
        self.frames.iter().map(|frame| (frame.get().title().to_owned(), frame.clone_ref(py))).collect()
    }

    fn __len__(&self) -> usize {
        self.frames.first().map_or(0, |frame| frame.get().rows())
    }

    fn __repr__(&self) -> String {
        let frames: Vec<String> =
            self.frames.iter().map(|frame| format!("{} ({})", frame.get().title(), frame.get().rows())).collect();
        format!("<palpate.Run {}: {}>", self.path.display(), frames.join(", "))
    }
}

/// Loads a run folder or a table of presses.
///
/// `columns` states what the columns of a table contain: a columns file, or a short form such as
/// `x_mm=X,y_mm=Y,outputs=ch0..ch15`.
///
/// The presses are in `.presses`, a `Frame` with x_mm, y_mm (mm), force_n (N), out_1 to out_n (in the array's unit), t_s (s) and
/// the other columns of `presses.csv`.
///
/// Raises `UsageError` if the path is no run or table, or is damaged. Warns if a file of the run differs from its journal.
#[pyfunction]
#[pyo3(signature = (run, *, columns=None))]
pub fn load(py: Python<'_>, run: PathBuf, columns: Option<String>) -> PyResult<PyRun> {
    let read = py.detach(|| if run.is_dir() { frames_of_run(&run) } else { frames_of_table(&run, columns.clone()) });
    let ReadPresses { manifest, notes, frames } = read.map_err(raised)?;
    warn(py, &notes)?;
    let frames = frames.into_iter().map(|frame| Py::new(py, frame)).collect::<PyResult<Vec<Py<PyFrame>>>>()?;
    Ok(PyRun { path: run, columns, manifest, notes, frames })
}

/// What was read of a run or a table.
struct ReadPresses {
    manifest: Option<String>,
    notes: Vec<String>,
    frames: Vec<PyFrame>,
}

fn frames_of_run(run: &Path) -> Result<ReadPresses, api::Failure> {
    let ((recorded, bench), notes) = noted(|note| api::read_run(run, note))?;
    let manifest = frame::manifest(&recorded);
    let metadata = HashMap::from([(MANIFEST.to_owned(), manifest.clone())]);
    let frames = frame::all(&recorded, &bench).into_iter().map(|frame| framed(frame, &metadata)).collect();
    Ok(ReadPresses { manifest: Some(manifest), notes, frames })
}

fn frames_of_table(table: &Path, columns: Option<String>) -> Result<ReadPresses, api::Failure> {
    let columns = ColumnsOptions { columns, sheet: None };
    let (presses, notes) = noted(|note| api::read_table(table, &columns, note))?;
    let presses = frame::presses_of(&presses.presses, presses.channels, "");
    Ok(ReadPresses { manifest: None, notes, frames: vec![framed(presses, &HashMap::new())] })
}

/// The same frame for Python.
fn framed(frame: frame::ExportTable, metadata: &HashMap<String, String>) -> PyFrame {
    let column = |frame::TableColumn { name, unit, definition, values }| {
        let cells = match values {
            Values::F64(values) => ColumnValues::F64(values.into()),
            Values::I64(values) => ColumnValues::I64(values.into()),
            Values::Text(values) => ColumnValues::texts(values.iter().map(|value| value.as_deref())),
            Values::Bool(values) => ColumnValues::Bool(values.into()),
        };
        PyColumn::new(&name, &unit, &definition, cells)
    };
    PyFrame::new(frame.name, frame.rows, frame.columns.into_iter().map(column).collect(), metadata.clone())
}
