//! A frame as CSV, and its units, definitions and manifest as JSON in a file of the same name.

use super::frame::{ExportTable, Values};
use palpate_data::dataset::Manifest;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt::Write as _;

/// The JSON file of a CSV table.
#[derive(Serialize)]
struct Described<'a> {
    table: &'a str,
    columns: Vec<ColumnJson<'a>>,
    manifest: &'a Manifest,
}

#[derive(Serialize)]
struct ColumnJson<'a> {
    name: &'a str,
    unit: &'a str,
    definition: &'a str,
}

/// Returns a frame as CSV with a header. A missing value is an empty cell. Numbers have as many digits as they need to be read
/// again to the last bit.
pub(super) fn text(frame: &ExportTable) -> String {
    let names: Vec<Cow<'_, str>> = frame.columns.iter().map(|column| cell(&column.name)).collect();
    let mut text = names.join(",") + "\n";
    for row in 0..frame.rows {
        for column in &frame.columns {
            // writing to a string can't fail
            let _ = match &column.values {
                Values::F64(values) if values[row].is_nan() => Ok(()),
                Values::F64(values) => write!(text, "{}", values[row]),
                Values::I64(values) => write!(text, "{}", values[row]),
                Values::Bool(values) => write!(text, "{}", values[row]),
                Values::Text(values) => write!(text, "{}", cell(values[row].as_deref().unwrap_or_default())),
            };
            text.push(',');
        }
        text.pop();
        text.push('\n');
    }
    text
}

/// Returns the description of a frame as JSON.
pub(super) fn description(frame: &ExportTable, manifest: &Manifest) -> String {
    let columns = frame.columns.iter();
    let columns = columns.map(|its| ColumnJson { name: &its.name, unit: &its.unit, definition: &its.definition });
    let described = Described { table: frame.name, columns: columns.collect(), manifest };
    // text and numbers can't fail to be written
    serde_json::to_string_pretty(&described).unwrap_or_default() + "\n"
}

/// Returns a text as a cell, in quotation marks if it needs them.
pub(crate) fn cell(text: &str) -> Cow<'_, str> {
    match text.contains([',', '"', '\n', '\r']) {
        true => Cow::Owned(format!("\"{}\"", text.replace('"', "\"\""))),
        false => Cow::Borrowed(text),
    }
}
