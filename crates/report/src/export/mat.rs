//! Frames as a MAT file of version 5: a struct for each frame, with a field for each column and one for all outputs.
//!
//! The format is that of MathWorks' "MAT-File Format" (R2019b), chapter 1. `unit` and `definition` of a frame are structs with a
//! text for each column. The variable `manifest` is the run's manifest as JSON. Integers are stored as doubles, as MATLAB does.
//! A missing number is NaN.

use super::frame::{ExportTable, TableColumn, Values};
use std::io::{self, Write};

/// Types of data elements.
const INT8: u32 = 1;
const UINT8: u32 = 2;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;

/// Classes of arrays.
const CELL: u32 = 1;
const STRUCT: u32 = 2;
const CHAR: u32 = 4;
const DOUBLES: u32 = 6;
const BYTES: u32 = 9;
/// Flag of an array of truth values.
const LOGICAL: u32 = 0x0200;

/// Bytes of a field's name with its end. MATLAB allows 63 letters.
const NAME_BYTES: usize = 64;

/// Writes frames as a MAT file.
///
/// # Errors
/// A variable has 4 GB or more, which the format can't have. Or an error of the operating system.
pub(crate) fn write(frames: &[ExportTable], manifest: &str, mut out: impl Write) -> io::Result<()> {
    let words = concat!("MATLAB 5.0 MAT-file, written by palpate ", env!("CARGO_PKG_VERSION"));
    let mut header = format!("{words:<124}").into_bytes();
    header.extend([0x00, 0x01, b'I', b'M']);
    out.write_all(&header)?;
    for frame in frames {
        out.write_all(&of_frame(frame)?)?;
    }
    out.write_all(&text("manifest", manifest)?)
}

fn of_frame(frame: &ExportTable) -> io::Result<Vec<u8>> {
    let outputs = frame.outputs();
    let single = |index: &usize| !outputs.contains(index);
    let mut fields = Vec::new();
    for column in (0..frame.columns.len()).filter(single).map(|index| &frame.columns[index]) {
        fields.push((column.name.as_str(), of_column(column, frame.rows)?));
    }
    if !outputs.is_empty() {
        let columns: Vec<&TableColumn> = frame.columns[outputs.clone()].iter().collect();
        fields.push(("outputs", numbers(&columns, frame.rows)?));
    }
    let words = |of: fn(&TableColumn) -> &str| -> io::Result<Vec<u8>> {
        let mut fields = Vec::new();
        for column in (0..frame.columns.len()).filter(single).map(|index| &frame.columns[index]) {
            fields.push((column.name.as_str(), text("", of(column))?));
        }
        if !outputs.is_empty() {
            fields.push(("outputs", text("", of(&frame.columns[outputs.start]))?));
        }
        structure("", &fields)
    };
    fields.push(("unit", words(|column| &column.unit)?));
    fields.push(("definition", words(|column| &column.definition)?));
    // a table of units has a column `unit` of its own
    let twice = fields.iter().filter(|(name, _)| *name == "unit").count() > 1;
    if twice && let Some(units) = fields.iter_mut().rfind(|(name, _)| *name == "unit") {
        units.0 = "units";
    }
    structure(frame.name, &fields)
}

fn of_column(column: &TableColumn, rows: usize) -> io::Result<Vec<u8>> {
    match &column.values {
        Values::F64(_) | Values::I64(_) => numbers(&[column], rows),
        Values::Bool(values) => {
            let bytes: Vec<u8> = values.iter().map(|value| u8::from(*value)).collect();
            array("", BYTES | LOGICAL, [rows, 1], &element(UINT8, &bytes)?)
        }
        Values::Text(texts) => {
            let mut cells = Vec::new();
            for its in texts {
                cells.extend(text("", its.as_deref().unwrap_or_default())?);
            }
            array("", CELL, [rows, 1], &cells)
        }
    }
}

/// Columns of numbers as one array of doubles.
fn numbers(columns: &[&TableColumn], rows: usize) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::with_capacity(8 * rows * columns.len());
    for column in columns {
        match &column.values {
            Values::F64(values) => values.iter().for_each(|value| bytes.extend(value.to_le_bytes())),
            Values::I64(values) => values.iter().for_each(|value| bytes.extend((*value as f64).to_le_bytes())),
            _ => {}
        }
    }
    array("", DOUBLES, [rows, columns.len()], &element(DOUBLE, &bytes)?)
}

/// A text as a row of letters, UTF-16.
fn text(name: &str, text: &str) -> io::Result<Vec<u8>> {
    let letters: Vec<u16> = text.encode_utf16().collect();
    let bytes: Vec<u8> = letters.iter().flat_map(|letter| letter.to_le_bytes()).collect();
    // MATLAB's empty text has no rows
    array(name, CHAR, [usize::from(!letters.is_empty()), letters.len()], &element(UINT16, &bytes)?)
}

fn structure(name: &str, fields: &[(&str, Vec<u8>)]) -> io::Result<Vec<u8>> {
    let mut content = small(INT32, NAME_BYTES as u32);
    let mut names = Vec::with_capacity(NAME_BYTES * fields.len());
    for (name, _) in fields {
        let start = names.len();
        names.extend(name.bytes().take(NAME_BYTES - 1));
        names.resize(start + NAME_BYTES, 0);
    }
    content.extend(element(INT8, &names)?);
    fields.iter().for_each(|(_, field)| content.extend(field));
    array(name, STRUCT, [1, 1], &content)
}

/// An array of a class: its flags, its shape, its name, its content.
fn array(name: &str, class: u32, shape: [usize; 2], content: &[u8]) -> io::Result<Vec<u8>> {
    let shape = shape.map(|count| i32::try_from(count).map_err(|_| too_large()));
    let [rows, columns] = shape;
    let flags: Vec<u8> = [class, 0].iter().flat_map(|word| word.to_le_bytes()).collect();
    let shape: Vec<u8> = [rows?, columns?].iter().flat_map(|count| count.to_le_bytes()).collect();
    let parts = [element(UINT32, &flags)?, element(INT32, &shape)?, element(INT8, name.as_bytes())?, content.to_vec()];
    element(MATRIX, &parts.concat())
}

/// A data element: its type, its size, its bytes, filled up to 8.
fn element(kind: u32, bytes: &[u8]) -> io::Result<Vec<u8>> {
    let size = u32::try_from(bytes.len()).map_err(|_| too_large())?;
    let mut element = Vec::with_capacity(bytes.len() + 16);
    element.extend(kind.to_le_bytes());
    element.extend(size.to_le_bytes());
    element.extend(bytes);
    element.resize(element.len().next_multiple_of(8), 0);
    Ok(element)
}

/// A small data element: a value of 4 bytes within its tag.
fn small(kind: u32, value: u32) -> Vec<u8> {
    [(4 << 16 | kind).to_le_bytes(), value.to_le_bytes()].concat()
}

fn too_large() -> io::Error {
    io::Error::other("a variable of a MAT file of version 5 has at most 4 GB: use parquet or npz")
}
