//! Tables in memory: columns as numpy arrays, and all of them as an Arrow stream.

use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{
    Array, ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, RecordBatchIterator, StringArray,
};
use arrow_buffer::ScalarBuffer;
use arrow_schema::{ArrowError, Field, Schema};
use numpy::ndarray::Array2;
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::{PyAttributeError, PyKeyError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyCapsule, PyDict};
use std::collections::HashMap;
use std::sync::Arc;

/// Key of a column's unit in the metadata of its Arrow field.
const UNIT: &str = "unit";
/// Key of a column's definition there.
const DEFINITION: &str = "definition";

/// A table: columns of one length, each with its unit and its definition.
///
/// `frame["x_mm"]` and `frame.x_mm` are a column as a numpy array, shape (rows,), which can't be written to. A missing number is
/// NaN. The frame gives its memory to polars, pyarrow and pandas without a copy (Arrow's PyCapsule interface), for example
/// `polars.DataFrame(frame)` and `pandas.DataFrame.from_arrow(frame)`. A missing value is null there.
#[pyclass(name = "Frame", frozen, mapping, module = "palpate")]
pub struct PyFrame {
    name: String,
    rows: usize,
    columns: Vec<PyColumn>,
    metadata: HashMap<String, String>,
}

/// One column of a frame.
pub struct PyColumn {
    name: String,
    unit: String,
    definition: String,
    cells: ColumnValues,
    array: PyOnceLock<Py<PyAny>>,
}

/// Values of a column.
pub enum ColumnValues {
    /// Numbers. A missing one is NaN, and null in Arrow.
    F64(ScalarBuffer<f64>),
    /// Integers, none of which is missing.
    I64(ScalarBuffer<i64>),
    /// Counts from 1. A missing one is 0, and null in Arrow.
    Ordinal(ScalarBuffer<i64>),
    /// Texts: the different ones, and which of them each row has.
    Text(Vec<Option<String>>, Vec<i32>),
    /// Truth values.
    Bool(BooleanArray),
}

impl ColumnValues {
    /// Takes texts.
    pub fn texts<'a>(values: impl Iterator<Item = Option<&'a str>>) -> ColumnValues {
        let (mut words, mut known) = (Vec::new(), HashMap::new());
        let codes = values.map(|value| {
            *known.entry(value).or_insert_with(|| {
                words.push(value.map(str::to_owned));
                words.len() as i32 - 1
            })
        });
        let codes = codes.collect();
        ColumnValues::Text(words, codes)
    }

    fn arrow(&self) -> ArrayRef {
        match self {
            ColumnValues::F64(values) => {
                let is_sparse = values.iter().any(|value| value.is_nan());
                let known = is_sparse.then(|| values.iter().map(|value| !value.is_nan()).collect());
                Arc::new(Float64Array::new(values.clone(), known))
            }
            ColumnValues::I64(values) => Arc::new(Int64Array::new(values.clone(), None)),
            ColumnValues::Ordinal(values) => {
                let known = values.iter().map(|value| *value != 0).collect();
                Arc::new(Int64Array::new(values.clone(), Some(known)))
            }
            ColumnValues::Bool(array) => Arc::new(array.clone()),
            ColumnValues::Text(words, codes) => {
                let word = |code: &i32| words.get(*code as usize).and_then(Option::as_deref);
                Arc::new(codes.iter().map(word).collect::<StringArray>())
            }
        }
    }

    fn numpy(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let array = match self {
            ColumnValues::F64(values) => PyArray1::from_slice(py, values).into_any(),
            ColumnValues::I64(values) | ColumnValues::Ordinal(values) => PyArray1::from_slice(py, values).into_any(),
            ColumnValues::Bool(array) => PyArray1::from_iter(py, array.values().iter()).into_any(),
            // the texts are made once, and numpy refers to them or copies them
            ColumnValues::Text(words, codes) => {
                let kwargs = PyDict::new(py);
                if words.is_empty() || words.contains(&None) {
                    kwargs.set_item("dtype", "object")?;
                }
                let words = py.import("numpy")?.call_method("array", (words,), Some(&kwargs))?;
                words.get_item(PyArray1::from_slice(py, codes))?
            }
        };
        array.call_method1("setflags", (false,))?;
        Ok(array.unbind())
    }
}

impl PyColumn {
    /// Creates a column.
    pub fn new(name: &str, unit: &str, definition: &str, cells: ColumnValues) -> PyColumn {
        let [name, unit, definition] = [name, unit, definition].map(str::to_owned);
        PyColumn { name, unit, definition, cells, array: PyOnceLock::new() }
    }

    fn numpy(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        Ok(self.array.get_or_try_init(py, || self.cells.numpy(py))?.clone_ref(py))
    }

    fn field(&self, array: &ArrayRef) -> Field {
        let about = [(UNIT, &self.unit), (DEFINITION, &self.definition)];
        let about = about.into_iter().filter(|(_, text)| !text.is_empty());
        let metadata = about.map(|(key, text)| (key.to_owned(), text.clone())).collect::<HashMap<_, _>>();
        Field::new(&self.name, array.data_type().clone(), true).with_metadata(metadata)
    }
}

impl PyFrame {
    /// Creates a frame of columns of one length.
    pub fn new(name: &str, rows: usize, columns: Vec<PyColumn>, metadata: HashMap<String, String>) -> PyFrame {
        PyFrame { name: name.to_owned(), rows, columns, metadata }
    }

    /// Returns the name of the table.
    pub fn title(&self) -> &str {
        &self.name
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    fn column(&self, name: &str) -> Option<&PyColumn> {
        self.columns.iter().find(|column| column.name == name)
    }

    fn about(&self, of: impl Fn(&PyColumn) -> &str) -> HashMap<String, String> {
        self.columns.iter().map(|column| (column.name.clone(), of(column).to_owned())).collect()
    }

    fn batch(&self) -> Result<RecordBatch, ArrowError> {
        let arrays: Vec<ArrayRef> = self.columns.iter().map(|column| column.cells.arrow()).collect();
        let fields: Vec<Field> = self.columns.iter().zip(&arrays).map(|(column, array)| column.field(array)).collect();
        RecordBatch::try_new(Arc::new(Schema::new(fields).with_metadata(self.metadata.clone())), arrays)
    }
}

#[pymethods]
impl PyFrame {
    /// Name of the table, such as `presses`.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// Names of the columns, in order.
    #[getter]
    fn columns(&self) -> Vec<&str> {
        self.keys()
    }

    /// Unit of each column, by name; empty if it has none.
    #[getter]
    fn units(&self) -> HashMap<String, String> {
        self.about(|column| &column.unit)
    }

    /// Definition of each column, by name, in a sentence.
    #[getter]
    fn definitions(&self) -> HashMap<String, String> {
        self.about(|column| &column.definition)
    }

    /// The columns out_1 to out_n as one array, shape (rows, n), in the array's unit.
    #[getter]
    fn outputs<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let outputs = self.columns.iter().filter(|column| column.name.starts_with("out_"));
        let outputs: Vec<&[f64]> = outputs
            .filter_map(|column| match &column.cells {
                ColumnValues::F64(values) => Some(&**values),
                _ => None,
            })
            .collect();
        let at = |(row, output): (usize, usize)| outputs[output][row];
        PyArray2::from_owned_array(py, Array2::from_shape_fn((self.rows, outputs.len()), at))
    }

    /// Names of the columns, in order.
    fn keys(&self) -> Vec<&str> {
        self.columns.iter().map(|column| column.name.as_str()).collect()
    }

    fn __len__(&self) -> usize {
        self.rows
    }

    fn __contains__(&self, name: &str) -> bool {
        self.column(name).is_some()
    }

    fn __getitem__(&self, py: Python<'_>, name: &str) -> PyResult<Py<PyAny>> {
        self.column(name).ok_or_else(|| PyKeyError::new_err(name.to_owned()))?.numpy(py)
    }

    fn __getattr__(&self, py: Python<'_>, name: &str) -> PyResult<Py<PyAny>> {
        let unknown = || PyAttributeError::new_err(format!("the table {} has no column {name}", self.name));
        self.column(name).ok_or_else(unknown)?.numpy(py)
    }

    fn __dir__(slf: &Bound<'_, Self>) -> PyResult<Vec<String>> {
        let own = slf.get_type().dir()?.extract::<Vec<String>>()?;
        Ok(own.into_iter().chain(slf.get().keys().into_iter().map(str::to_owned)).collect())
    }

    fn __repr__(&self) -> String {
        format!("<palpate.Frame {}: {} rows of {}>", self.name, self.rows, self.keys().join(", "))
    }

    /// The frame as a stream of Arrow record batches, without a copy of its numbers.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        // other types may be asked for, and needn't be given
        drop(requested_schema);
        let batch = self.batch().map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
        let schema = batch.schema();
        let stream = FFI_ArrowArrayStream::new(Box::new(RecordBatchIterator::new([Ok(batch)], schema)));
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }
}
