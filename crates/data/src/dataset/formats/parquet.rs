//! A table of Parquet.

use super::variables::{Variable, VariableValues};
use crate::dataset::table_error::MAX_ROWS;
use arrow_array::cast::AsArray;
use arrow_array::types::{
    Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrowPrimitiveType};
use arrow_schema::DataType;
use parquet::arrow::arrow_reader::{ArrowReaderOptions, ParquetRecordBatchReaderBuilder};
use std::fs::File;

/// Reads the columns. A column of another type than numbers, truth values and texts has the name of its type in every cell.
pub(crate) fn read(input: File) -> Result<Vec<Variable>, String> {
    let failed = |error: &dyn std::fmt::Display| {
        let text = error.to_string();
        match text.contains("Disabled feature") {
            true => format!("its compression can't be read ({text}): save it with snappy, which most programs use"),
            false => format!("not a Parquet file that can be read ({text})"),
        }
    };
    // uses Parquet's own types, because Arrow has several string types
    let options = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
    let reader =
        ParquetRecordBatchReaderBuilder::try_new_with_options(input, options).map_err(|error| failed(&error))?;
    if reader.metadata().file_metadata().num_rows() > MAX_ROWS as i64 {
        return Err(format!("more than {MAX_ROWS} rows"));
    }
    let schema = reader.schema().clone();
    let mut columns: Vec<Vec<String>> = vec![Vec::new(); schema.fields().len()];
    for batch in reader.build().map_err(|error| failed(&error))? {
        let batch = batch.map_err(|error| failed(&error))?;
        columns.iter_mut().zip(batch.columns()).for_each(|(texts, array)| extend(texts, array));
    }
    let named = schema.fields().iter().zip(columns);
    let variable = |name: &str, texts: Vec<String>| Variable {
        name: name.to_owned(),
        rows: texts.len(),
        cells: VariableValues::Texts(texts),
    };
    Ok(named.map(|(field, texts)| variable(field.name(), texts)).collect())
}

/// Adds the values of an array as texts. A null is an empty text.
fn extend(texts: &mut Vec<String>, array: &dyn Array) {
    match array.data_type() {
        DataType::Float64 => numbers::<Float64Type>(texts, array, |number| number.to_string()),
        // the number with the same shortest text: converting the f32 would give another f64
        DataType::Float32 => numbers::<Float32Type>(texts, array, |number| f64::from(number).to_string()),
        DataType::Int64 => numbers::<Int64Type>(texts, array, |count| count.to_string()),
        DataType::Int32 => numbers::<Int32Type>(texts, array, |count| count.to_string()),
        DataType::Int16 => numbers::<Int16Type>(texts, array, |count| count.to_string()),
        DataType::Int8 => numbers::<Int8Type>(texts, array, |count| count.to_string()),
        DataType::UInt64 => numbers::<UInt64Type>(texts, array, |count| count.to_string()),
        DataType::UInt32 => numbers::<UInt32Type>(texts, array, |count| count.to_string()),
        DataType::UInt16 => numbers::<UInt16Type>(texts, array, |count| count.to_string()),
        DataType::UInt8 => numbers::<UInt8Type>(texts, array, |count| count.to_string()),
        DataType::Utf8 => texts.extend(array.as_string::<i32>().iter().map(|text| text.unwrap_or_default().to_owned())),
        DataType::Boolean => {
            texts.extend(
                array.as_boolean().iter().map(|value| value.map_or("", |is| if is { "1" } else { "0" }).to_owned()),
            );
        }
        DataType::Null => texts.extend(std::iter::repeat_n(String::new(), array.len())),
        other => texts.extend(std::iter::repeat_n(other.to_string(), array.len())),
    }
}

fn numbers<T: ArrowPrimitiveType>(texts: &mut Vec<String>, array: &dyn Array, text: fn(T::Native) -> String) {
    texts.extend(array.as_primitive::<T>().iter().map(|value| value.map_or_else(String::new, text)));
}
