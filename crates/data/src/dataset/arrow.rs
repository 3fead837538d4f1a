//! Columns of Arrow, the same in every file of this program: a field states its unit and its definition, and a missing number is null.

use arrow_array::{ArrayRef, Float64Array};
use arrow_buffer::NullBuffer;
use arrow_schema::{DataType, Field};
use std::collections::HashMap;
use std::sync::Arc;

/// Returns the field of a column, with the metadata `unit` and `definition`.
pub fn field(name: &str, kind: DataType, may_miss: bool, [unit, definition]: [&str; 2]) -> Field {
    let metadata = [("unit", unit), ("definition", definition)];
    let metadata = metadata.map(|(key, text)| (key.to_owned(), text.to_owned()));
    Field::new(name, kind, may_miss).with_metadata(HashMap::from(metadata))
}

/// Returns numbers as a column in which NaN is null.
pub fn numbers(numbers: Vec<f64>) -> ArrayRef {
    let missing = numbers.iter().any(|number| number.is_nan());
    let known = missing.then(|| numbers.iter().map(|number| !number.is_nan()).collect::<NullBuffer>());
    Arc::new(Float64Array::new(numbers.into(), known))
}
