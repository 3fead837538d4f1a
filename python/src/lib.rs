//! The Python package of palpate: runs on a rig, their presses as arrays, and the place and force of unknown contacts.
//!
//! It contains the program as a library, and starts no other. What a function does is documented for Python, and in
//! `palpate.pyi` with types.

mod contact;
mod events;
mod frame;
mod given;
mod model;
mod readings;
mod refused;
mod results;
mod run;
mod vectors;

use pyo3::prelude::*;

/// Calibrates tactile sensors: runs on a rig, their presses as arrays, and the place and force of unknown contacts.
///
/// Places are in mm, forces in N, times in s; names end with the unit. The functions take the options of the commands of the
/// same name.
#[pymodule(name = "palpate")]
mod package {
    #[pymodule_export]
    use super::contact::PyContact;
    #[pymodule_export]
    use super::events::{PyEvents, resume, run, simulate};
    #[pymodule_export]
    use super::frame::PyFrame;
    #[pymodule_export]
    use super::model::{PyModel, PySession, fit};
    #[pymodule_export]
    use super::refused::{DeviceError, Error, RecordError, TripError, UsageError};
    #[pymodule_export]
    use super::results::{PyEvaluation, certificate, evaluate, report};
    #[pymodule_export]
    use super::run::{PyRun, load};
    #[pymodule_export]
    use super::vectors::{PyVectorContact, PyVectorModel, fit_vector};

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        let commit = palpate_commit::commit!();
        palpate::api::built_from(commit);
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("__commit__", commit)?;
        super::refused::number(module)?;
        super::events::park_at_exit(module.py())
    }
}
