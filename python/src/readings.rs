//! Readings as Python gives them: one, or a batch, of anything that numpy makes an array of numbers from.

use super::frame::PyFrame;
use numpy::{PyArrayDyn, PyArrayMethods as _, PyReadonlyArrayDyn, PyUntypedArrayMethods as _};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Readings of an array of sensors, row-major.
pub struct PyReadings<'py> {
    array: PyReadonlyArrayDyn<'py, f64>,
    /// Number of rows; `None` for one reading.
    pub rows: Option<usize>,
}

impl<'py> PyReadings<'py> {
    /// Takes an array of shape (outputs,) or (rows, outputs) for a calibration of `units` outputs. Other types are converted by
    /// `numpy.asarray`.
    pub fn of(given: &Bound<'py, PyAny>, units: usize) -> PyResult<Self> {
        if let Some(array) = given.cast::<PyArrayDyn<f64>>().ok().filter(|array| array.is_c_contiguous()) {
            return PyReadings::of_array(array, units);
        }
        if given.cast::<PyFrame>().is_ok() {
            return Err(PyTypeError::new_err("readings are an array of numbers: use the `outputs` of the frame"));
        }
        let py = given.py();
        let kwargs = PyDict::new(py);
        kwargs.set_item(intern!(py, "dtype"), "float64")?;
        kwargs.set_item(intern!(py, "order"), "C")?;
        let array = py.import(intern!(py, "numpy"))?.call_method("asarray", (given,), Some(&kwargs))?;
        PyReadings::of_array(array.cast::<PyArrayDyn<f64>>()?, units)
    }

    fn of_array(array: &Bound<'py, PyArrayDyn<f64>>, units: usize) -> PyResult<Self> {
        let (rows, outputs) = match *array.shape() {
            [outputs] => (None, outputs),
            [rows, outputs] => (Some(rows), outputs),
            _ => {
                let dimensions = array.ndim();
                let text = format!(
                    "readings have {dimensions} dimensions; expected one reading, shape (outputs,), or a batch, shape (rows, outputs)"
                );
                return Err(PyValueError::new_err(text));
            }
        };
        if outputs != units {
            let text = format!("the reading has {outputs} outputs, the calibration has {units}");
            return Err(PyValueError::new_err(text));
        }
        Ok(PyReadings { array: array.try_readonly()?, rows })
    }

    /// Returns the numbers, one reading after the other.
    pub fn numbers(&self) -> PyResult<&[f64]> {
        Ok(self.array.as_slice()?)
    }
}
