//! Exceptions: one for each exit code of the command line, with the text that it prints.

use palpate::cli::calls::Refusal;
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
    let codes = [("Error", 1), ("UsageError", 2), ("DeviceError", 3), ("TripError", 4), ("RecordError", 5)];
    codes.into_iter().try_for_each(|(name, code)| module.getattr(name)?.setattr("code", code))
}

/// The exception for a refusal.
pub fn raised(Refusal { code, text }: Refusal) -> PyErr {
    match code {
        2 => UsageError::new_err(text),
        3 => DeviceError::new_err(text),
        4 => TripError::new_err(text),
        5 => RecordError::new_err(text),
        _ => Error::new_err(text),
    }
}

/// Warns of the lines that a command prints about its input. Mere notes are no warning.
pub fn warn(py: Python<'_>, notes: &[String]) -> PyResult<()> {
    for note in notes.iter().filter(|note| !note.starts_with("note: ")) {
        let text = note.trim_end().trim_start_matches("warning: ").replace('\0', "");
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &CString::new(text)?, 1)?;
    }
    Ok(())
}
