//! Exceptions: one for each exit code of the command line, with the text that it prints.

use palpate::api::{Failure, FailureKind};
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyUserWarning};
use pyo3::prelude::*;
use std::ffi::CString;

create_exception!(palpate, Error, PyException, "A command failed. `code` is the exit code of the command line.");
create_exception!(palpate, UsageError, Error, "Bad recipe, rig, table or option; nothing moved. Code 2.");
create_exception!(palpate, DeviceError, Error, "A device failed. Code 3.");
create_exception!(palpate, TripError, Error, "A safety rule was broken. Code 4.");
create_exception!(palpate, RecordError, Error, "A result couldn't be recorded. Code 5.");

/// Gives each exception its exit code.
pub fn number(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let kinds = [
        ("Error", FailureKind::NotAccepted),
        ("UsageError", FailureKind::Usage),
        ("DeviceError", FailureKind::Device),
        ("TripError", FailureKind::Trip),
        ("RecordError", FailureKind::Record),
    ];
    kinds.into_iter().try_for_each(|(name, kind)| module.getattr(name)?.setattr("code", kind.code()))
}

/// The exception for a failure.
pub fn raised(failure: Failure) -> PyErr {
    let text = failure.to_string();
    match failure.kind() {
        FailureKind::Usage => UsageError::new_err(text),
        FailureKind::Device => DeviceError::new_err(text),
        FailureKind::Trip => TripError::new_err(text),
        FailureKind::Record => RecordError::new_err(text),
        FailureKind::NotAccepted | FailureKind::Cancelled => Error::new_err(text),
    }
}

/// Warns of the lines that a command prints about its input. Mere notes are no warning.
pub fn warn(py: Python<'_>, notes: &[String]) -> PyResult<()> {
    // what is stated of a sound input is no warning
    let is_statement = |note: &&String| note.starts_with("note: ") || note.starts_with("hold-out: ");
    for note in notes.iter().filter(|note| !is_statement(note)) {
        let text = note.trim_start_matches("warning: ").replace('\0', "");
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &CString::new(text)?, 1)?;
    }
    Ok(())
}
