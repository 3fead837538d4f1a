//! Frames as one .npz file: an array for each column, `presses.x_mm`, and one for all outputs, `presses.outputs`.
//!
//! The format of an array is NEP 1 (numpy/lib/format.py). The entry `metadata.json` has units, definitions and the manifest.

use super::csv;
use super::frame::{ExportTable, TableColumn, Values};
use palpate_data::dataset::Manifest;
use std::io::{self, Seek, Write};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// Bytes that the header of an array is a multiple of.
const ALIGNED: usize = 64;

/// Writes frames as an .npz file. Returns the output.
///
/// # Errors
/// An error of the operating system.
pub(crate) fn write<W: Write + Seek>(frames: &[ExportTable], manifest: &Manifest, out: W) -> io::Result<W> {
    let mut zip = ZipWriter::new(out);
    for frame in frames {
        let outputs = frame.outputs();
        for (index, column) in frame.columns.iter().enumerate() {
            if !outputs.contains(&index) {
                begin(&mut zip, &format!("{}.{}.npy", frame.name, column.name), frame.rows, 1)?;
                write_array(&mut zip, frame.rows, None, &[column])?;
            }
        }
        if !outputs.is_empty() {
            begin(&mut zip, &format!("{}.outputs.npy", frame.name), frame.rows, outputs.len())?;
            let columns: Vec<&TableColumn> = frame.columns[outputs].iter().collect();
            write_array(&mut zip, frame.rows, Some(columns.len()), &columns)?;
        }
    }
    begin(&mut zip, "metadata.json", 0, 1)?;
    let described: Vec<String> = frames.iter().map(|frame| csv::description(frame, manifest)).collect();
    zip.write_all(format!("[{}]\n", described.join(",").replace("\n,", ",")).as_bytes())?;
    zip.finish().map_err(io::Error::other)
}

fn begin<W: Write + Seek>(zip: &mut ZipWriter<W>, name: &str, rows: usize, columns: usize) -> io::Result<()> {
    // a text takes more than 8 bytes, but a table of 500 MB of texts isn't a run's
    let is_large = rows.saturating_mul(columns).saturating_mul(8) > u32::MAX as usize / 8;
    zip.start_file(name, SimpleFileOptions::default().large_file(is_large)).map_err(io::Error::other)
}

/// Writes columns as an array: of one dimension, or of two with `across` columns in Fortran's order, column by column.
fn write_array(out: &mut impl Write, rows: usize, across: Option<usize>, columns: &[&TableColumn]) -> io::Result<()> {
    let width = |texts: &[Option<std::borrow::Cow<'static, str>>]| {
        texts.iter().flatten().map(|text| text.chars().count()).max().unwrap_or_default().max(1)
    };
    let kind = match &columns[0].values {
        Values::F64(_) => "<f8".to_owned(),
        Values::I64(_) => "<i8".to_owned(),
        Values::Bool(_) => "|b1".to_owned(),
        Values::Text(texts) => format!("<U{}", width(texts)),
    };
    let (shape, fortran) = match across {
        None => (format!("({rows},)"), "False"),
        Some(columns) => (format!("({rows}, {columns})"), "True"),
    };
    let header = format!("{{'descr': '{kind}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
    let padded = (10 + header.len() + 1).next_multiple_of(ALIGNED) - 10;
    out.write_all(b"\x93NUMPY\x01\x00")?;
    out.write_all(&(padded as u16).to_le_bytes())?;
    out.write_all(format!("{header:<width$}\n", width = padded - 1).as_bytes())?;
    for column in columns {
        match &column.values {
            Values::F64(values) => values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))?,
            Values::I64(values) => values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))?,
            Values::Bool(values) => values.iter().try_for_each(|value| out.write_all(&[u8::from(*value)]))?,
            Values::Text(texts) => {
                let width = width(texts);
                for text in texts {
                    let text = text.as_deref().unwrap_or_default();
                    let letters = text.chars().map(u32::from).chain(std::iter::repeat(0)).take(width);
                    for letter in letters {
                        out.write_all(&letter.to_le_bytes())?;
                    }
                }
            }
        }
    }
    Ok(())
}
