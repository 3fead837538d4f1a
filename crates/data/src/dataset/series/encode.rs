//! Readings as record batches of Arrow.

use super::{COMMON, ReadValue, SeriesColumn, SeriesReadings};
use crate::dataset::arrow;
use arrow_array::{ArrayRef, Int64Array, RecordBatch};
use arrow_schema::{DataType, Field, Schema, SchemaRef};
use std::io;
use std::sync::Arc;

/// Returns the schema of some columns. Each field has the metadata `unit` and `definition`.
pub(super) fn schema(columns: &[SeriesColumn]) -> Schema {
    let field = |(index, column): (usize, &SeriesColumn)| {
        let (kind, may_miss) = match index {
            0 => (DataType::Int64, false),
            1 => (DataType::Float64, false),
            _ => (DataType::Float64, true),
        };
        arrow::field(&column.name, kind, may_miss, [&column.unit, &column.definition])
    };
    Schema::new(columns.iter().enumerate().map(field).collect::<Vec<Field>>())
}

/// Returns readings as a batch of that schema. The columns that a reading doesn't fill are null.
pub(super) fn batch(readings: &SeriesReadings, schema: &SchemaRef, three_axes: bool) -> io::Result<RecordBatch> {
    let (rows, columns) = (readings.rows.len(), schema.fields().len());
    let first_output = if three_axes { COMMON + 2 } else { COMMON };
    let mut numbers: Vec<Vec<f64>> = (1..columns).map(|_| vec![f64::NAN; rows]).collect();
    for (row, reading) in readings.rows.iter().enumerate() {
        let mut put = |column: usize, value: f64| {
            if let Some(cell) = numbers.get_mut(column - 1) {
                cell[row] = value;
            }
        };
        put(1, reading.t_s);
        put(2, reading.taken_s.unwrap_or(f64::NAN));
        match &reading.value {
            ReadValue::Height(z_mm) => put(3, *z_mm),
            ReadValue::Monitor(monitor) => {
                put(schema.index_of(&monitor.name).map_err(io::Error::other)?, monitor.value)
            }
            ReadValue::Force { force_n, side_n } => {
                put(4, *force_n);
                if let Some([x_n, y_n]) = side_n.filter(|_| three_axes) {
                    put(5, x_n);
                    put(6, y_n);
                }
            }
            ReadValue::Outputs(outputs) => {
                (first_output..).zip(outputs).for_each(|(column, output)| put(column, *output));
            }
        }
    }
    let press = Int64Array::from(vec![readings.press as i64; rows]);
    let others = numbers.into_iter().map(arrow::numbers);
    let arrays: Vec<ArrayRef> = std::iter::once(Arc::new(press) as ArrayRef).chain(others).collect();
    RecordBatch::try_new(schema.clone(), arrays).map_err(io::Error::other)
}
