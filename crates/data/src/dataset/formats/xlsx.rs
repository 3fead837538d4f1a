//! A sheet of a workbook.

use super::variables::cell;
use crate::dataset::table_error::{MAX_COLUMNS, MAX_TABLE_BYTES};
use calamine::{Data, Reader as _, Xlsx, XlsxError};
use std::fs::File;
use std::io::BufReader;

/// Returns the name and the text of a sheet: of that name, or the first.
pub(crate) fn text(input: File, sheet: Option<&str>) -> Result<(String, String), String> {
    let not_one = |error: &dyn std::fmt::Display| format!("not a workbook that can be read ({error})");
    check_size(&input)
        .map_err(|error| error.map_or_else(|| "unpacked it is too large".to_owned(), |why| not_one(&why)))?;
    let mut book: Xlsx<_> = Xlsx::new(BufReader::new(input)).map_err(|error| not_one(&error))?;
    let names = book.sheet_names();
    let name = match sheet {
        None => names.first().cloned().ok_or("the workbook has no sheets")?,
        Some(sheet) if names.iter().any(|name| name == sheet) => sheet.to_owned(),
        Some(sheet) => return Err(format!("it has no sheet `{sheet}`; its sheets: {}", names.join(", "))),
    };
    if cells(&mut book, &name).map_err(|error| not_one(&error))? > CELLS_MAX {
        return Err(format!("sheet `{name}` reaches over more than {CELLS_MAX} cells"));
    }
    let range = book.worksheet_range(&name).map_err(|error| not_one(&error))?;
    if range.width() > MAX_COLUMNS {
        return Err(format!("more than {MAX_COLUMNS} columns"));
    }
    // an empty line for each row above the table, so that lines are rows
    let mut text = "\n".repeat(range.start().map_or(0, |(row, _)| row as usize));
    for row in range.rows() {
        if row.iter().any(|value| *value != Data::Empty) {
            let cells: Vec<String> = row.iter().map(|value| cell(&value.to_string())).collect();
            text += &cells.join(",");
        }
        text.push('\n');
        if text.len() as u64 > MAX_TABLE_BYTES {
            return Err(format!("more than {MAX_TABLE_BYTES} bytes as text"));
        }
    }
    Ok((name, text))
}

/// Largest number of cells of the rectangle around a sheet's values, which is in memory at once.
const CELLS_MAX: u64 = 10_000_000;

/// Returns the number of cells of the rectangle around a sheet's values.
fn cells(book: &mut Xlsx<BufReader<File>>, sheet: &str) -> Result<u64, XlsxError> {
    let mut cells = book.worksheet_cells_reader(sheet)?;
    let (mut least, mut most) = ((u32::MAX, u32::MAX), (0, 0));
    while let Some(cell) = cells.next_cell()? {
        let (row, column) = cell.get_position();
        least = (least.0.min(row), least.1.min(column));
        most = (most.0.max(row), most.1.max(column));
    }
    let side = |least: u32, most: u32| if least > most { 0 } else { u64::from(most - least) + 1 };
    Ok(side(least.0, most.0) * side(least.1, most.1))
}

/// Checks the size that the parts of a workbook state, unpacked. `Err(None)` if they are too large.
fn check_size(input: &File) -> Result<(), Option<String>> {
    let mut parts = zip::ZipArchive::new(BufReader::new(input)).map_err(|error| Some(error.to_string()))?;
    let mut bytes = 0u64;
    for index in 0..parts.len() {
        bytes = bytes.saturating_add(parts.by_index_raw(index).map_err(|error| Some(error.to_string()))?.size());
    }
    if bytes > MAX_TABLE_BYTES { Err(None) } else { Ok(()) }
}
