//! Frames as an HDF5 file: a group for each frame, with a dataset for each column and one for all outputs, `outputs`, rows x channels.
//!
//! A dataset has the attributes `unit` and `definition`. The dataset `manifest` is the run's manifest as JSON. A missing number is NaN.

use super::frame::{ExportTable, TableColumn, Values};
use hdf5_pure::{AttrValue, FileBuilder};
use std::io::{self, Write};

/// Rows of a chunk. Readers that take a part of a long series read few chunks.
const CHUNK_ROWS: usize = 4096;

/// Writes frames as an HDF5 file.
///
/// # Errors
/// The library refuses a frame, or an error of the operating system.
pub(crate) fn write(frames: &[ExportTable], manifest: &str, mut out: impl Write) -> io::Result<()> {
    let mut file = FileBuilder::new();
    file.create_dataset("manifest").with_strings(&[manifest]).map_err(io::Error::other)?;
    for frame in frames {
        let mut group = file.create_group(frame.name);
        let outputs = frame.outputs();
        for (index, column) in frame.columns.iter().enumerate() {
            if outputs.contains(&index) {
                continue;
            }
            let dataset = group.create_dataset(&column.name);
            match &column.values {
                Values::F64(numbers) => _ = dataset.with_f64_data(numbers),
                Values::I64(counts) => _ = dataset.with_i64_data(counts),
                Values::Bool(values) => {
                    let bytes: Vec<u8> = values.iter().map(|value| u8::from(*value)).collect();
                    dataset.with_u8_data(&bytes);
                }
                Values::Text(texts) => {
                    let texts: Vec<&str> = texts.iter().map(|text| text.as_deref().unwrap_or_default()).collect();
                    dataset.with_strings(&texts).map_err(io::Error::other)?;
                }
            }
            describe(dataset, column, &[frame.rows]);
        }
        if !outputs.is_empty() {
            let columns = &frame.columns[outputs];
            let number = |row: usize, column: &TableColumn| match &column.values {
                Values::F64(numbers) => numbers[row],
                _ => f64::NAN,
            };
            let rows = (0..frame.rows).flat_map(|row| columns.iter().map(move |column| number(row, column)));
            let dataset = group.create_dataset("outputs");
            dataset.with_f64_data(&rows.collect::<Vec<f64>>());
            describe(dataset, &columns[0], &[frame.rows, columns.len()]);
        }
        file.add_group(group.finish());
    }
    out.write_all(&file.finish().map_err(io::Error::other)?)
}

/// Sets the shape of a dataset, its chunks if it is long, and its attributes.
fn describe(dataset: &mut hdf5_pure::DatasetBuilder, column: &TableColumn, shape: &[usize]) {
    dataset.with_shape(&shape.iter().map(|count| *count as u64).collect::<Vec<u64>>());
    if shape[0] > CHUNK_ROWS {
        let across = shape.iter().skip(1).map(|count| *count as u64);
        dataset.with_chunks(&std::iter::once(CHUNK_ROWS as u64).chain(across).collect::<Vec<u64>>());
    }
    // the unit of a column without one would be an empty attribute, which readers refuse
    if !column.unit.is_empty() {
        dataset.set_attr("unit", AttrValue::String(column.unit.clone()));
    }
    dataset.set_attr("definition", AttrValue::String(column.definition.clone()));
}
