//! Named arrays as the columns of a table.

use crate::dataset::table_error::{MAX_COLUMNS, MAX_ROWS, MAX_TABLE_BYTES};
use std::fmt::Write as _;

/// A named array with a value for each row, in one or more columns.
pub(crate) struct Variable {
    /// Name of the array. A frame of an exported file is before it: `presses.x_mm`.
    pub name: String,
    /// Number of rows.
    pub rows: usize,
    /// Values, column by column.
    pub cells: VariableValues,
}

/// Values of an array.
pub(crate) enum VariableValues {
    /// Numbers.
    Numbers(Vec<f64>),
    /// Integers.
    Counts(Vec<i64>),
    /// Texts.
    Texts(Vec<String>),
}

/// Frame that is read from an exported file.
const PRESSES: &str = "presses.";
/// Array of an exported file that has a column for each output.
const OUTPUTS: &str = "outputs";

/// Returns arrays as CSV. The array with the name `x_mm` states the number of rows; without it, the longest does. Arrays with
/// another number of rows, such as a sampling rate, are left out. An array of several columns is numbered: `a_1`, `a_2`.
pub(crate) fn text(mut variables: Vec<Variable>, x_mm: &str) -> Result<String, String> {
    let is_exported = variables.iter().any(|variable| variable.name.starts_with(PRESSES));
    if is_exported {
        variables.retain(|variable| variable.name.starts_with(PRESSES));
        variables.iter_mut().for_each(|variable| variable.name.replace_range(..PRESSES.len(), ""));
    }
    let stated = variables.iter().find(|variable| variable.name == x_mm).map(|variable| variable.rows);
    let rows = stated.or_else(|| variables.iter().map(|variable| variable.rows).max()).unwrap_or_default();
    variables.retain(|variable| variable.rows == rows && rows > 0);
    if variables.is_empty() {
        return Err("it has no array with a value for each press".to_owned());
    }
    let columns: Vec<(String, &Variable, usize)> = variables.iter().flat_map(named).collect();
    if columns.len() > MAX_COLUMNS || rows > MAX_ROWS {
        return Err(format!("more than {MAX_COLUMNS} columns or {MAX_ROWS} rows"));
    }
    let names: Vec<String> = columns.iter().map(|(name, ..)| cell(name)).collect();
    let mut text = names.join(",") + "\n";
    for row in 0..rows {
        for (_, variable, column) in &columns {
            let at = column * rows + row;
            // writing to a string can't fail
            let _ = match &variable.cells {
                // an export has NaN where a table of a run has a blank cell
                VariableValues::Numbers(numbers) if is_exported && numbers[at].is_nan() => Ok(()),
                VariableValues::Numbers(numbers) => write!(text, "{}", numbers[at]),
                VariableValues::Counts(counts) => write!(text, "{}", counts[at]),
                VariableValues::Texts(texts) => write!(text, "{}", cell(&texts[at])),
            };
            text.push(',');
        }
        text.pop();
        text.push('\n');
        if text.len() as u64 > MAX_TABLE_BYTES {
            return Err(format!("more than {MAX_TABLE_BYTES} bytes as text"));
        }
    }
    Ok(text)
}

/// Returns the columns of an array, each with its name.
fn named(variable: &Variable) -> Vec<(String, &Variable, usize)> {
    let count = variable.cells.len() / variable.rows;
    let name = match variable.name.as_str() {
        OUTPUTS => "out",
        name => name,
    };
    let is_numbered = count > 1 || variable.name == OUTPUTS;
    let numbered = |column: usize| if is_numbered { format!("{name}_{}", column + 1) } else { name.to_owned() };
    (0..count).map(|column| (numbered(column), variable, column)).collect()
}

impl VariableValues {
    /// Number of values.
    pub(crate) fn len(&self) -> usize {
        match self {
            VariableValues::Numbers(numbers) => numbers.len(),
            VariableValues::Counts(counts) => counts.len(),
            VariableValues::Texts(texts) => texts.len(),
        }
    }
}

/// Returns a text as a cell of CSV, in one line.
pub(crate) fn cell(text: &str) -> String {
    let text = text.replace(['\n', '\r'], " ");
    match text.contains([',', '"']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text,
    }
}

/// Brings an array in C's order, row by row, into columns.
pub(crate) fn transposed<T: Clone>(values: &[T], rows: usize) -> Vec<T> {
    let across = values.len() / rows.max(1);
    (0..across)
        .flat_map(|column| (0..rows).map(move |row| row * across + column))
        .map(|at| values[at].clone())
        .collect()
}
