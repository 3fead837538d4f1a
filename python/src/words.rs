//! Options of Python as words of the command line, which checks them.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Words of a command.
#[derive(Default)]
pub struct Words(Vec<OsString>);

impl Words {
    /// Adds an option with its value, if there is one.
    pub fn option(mut self, name: &str, value: Option<impl Into<OsString>>) -> Self {
        if let Some(value) = value {
            // one word, so that a value may begin with a hyphen
            let mut word = OsString::from(format!("--{name}="));
            word.push(value.into());
            self.0.push(word);
        }
        self
    }

    /// Adds an option with a number.
    pub fn number(self, name: &str, value: Option<impl ToString>) -> Self {
        self.option(name, value.map(|value| value.to_string()))
    }

    /// Adds an option with two numbers.
    pub fn pair(mut self, name: &str, values: Option<(f64, f64)>) -> Self {
        if let Some((first, second)) = values {
            self.0.extend([format!("--{name}"), first.to_string(), second.to_string()].map(OsString::from));
        }
        self
    }

    /// Adds an option without a value, if it is given.
    pub fn flag(mut self, name: &str, is_given: bool) -> Self {
        self.0.extend(is_given.then(|| OsString::from(format!("--{name}"))));
        self
    }

    /// Adds the file that the command is about, and returns the words.
    pub fn about(mut self, path: &Path) -> Vec<OsString> {
        self.0.extend([OsString::from("--"), path.into()]);
        self.0
    }
}

/// A path, or something that has one: a run.
#[derive(FromPyObject)]
pub enum Place<'py> {
    /// A path.
    Path(PathBuf),
    /// A run or a table that was loaded.
    Run(Bound<'py, super::run::Run>),
}

impl<'py> Place<'py> {
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
            Place::Path(path) => path,
            Place::Run(run) => run.get().path(),
        }
    }

    /// Returns what the columns of a loaded table contain, if it was stated.
    pub fn columns(&self) -> Option<&str> {
        match self {
            Place::Path(_) => None,
            Place::Run(run) => run.get().columns(),
        }
    }
}
