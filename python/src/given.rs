//! What Python gives as an argument: paths, runs and words.

use palpate::api::{Failure, Note};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use std::cell::RefCell;
use std::path::{Path, PathBuf};

/// Calls a function of the library, and returns the lines that it notes.
pub fn noted<T>(call: impl FnOnce(Note<'_>) -> Result<T, Failure>) -> Result<(T, Vec<String>), Failure> {
    let notes = RefCell::new(Vec::new());
    let result = call(&|line| notes.borrow_mut().push(line.to_owned()))?;
    Ok((result, notes.into_inner()))
}

/// A path, or something that has one: a run.
#[derive(FromPyObject)]
pub enum RunPath<'py> {
    /// A path.
    Path(PathBuf),
    /// A run or a table that was loaded.
    Run(Bound<'py, super::run::PyRun>),
}

impl<'py> RunPath<'py> {
    /// Takes what Python gives.
    pub fn of(given: &Bound<'py, PyAny>) -> PyResult<Self> {
        given.extract().map_err(|_| {
            let kind = given.get_type();
            PyTypeError::new_err(format!("expected a Run, or the path of a run folder or of a table, not {kind}"))
        })
    }

    /// Returns the path.
    pub fn path(&self) -> &Path {
        match self {
            RunPath::Path(path) => path,
            RunPath::Run(run) => run.get().path(),
        }
    }

    /// Returns what the columns of a loaded table contain, if it was stated.
    pub fn columns(&self) -> Option<&str> {
        match self {
            RunPath::Path(_) => None,
            RunPath::Run(run) => run.get().columns(),
        }
    }
}
