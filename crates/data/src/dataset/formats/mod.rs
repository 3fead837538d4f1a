//! Tables in files of other programs: .xlsx, .npz, .mat (v5) and Parquet. Each becomes the text that the reader of CSV parses.
//!
//! Numbers are written with as many digits as they need, so they are read again to the last bit. Line 1 of the text is the
//! header. In a sheet, lines are the sheet's rows.

#[cfg(feature = "files")]
mod mat;
#[cfg(feature = "files")]
mod npz;
#[cfg(feature = "files")]
mod parquet;
#[cfg(feature = "files")]
mod variables;
#[cfg(feature = "files")]
mod xlsx;

use super::mapping::{Decimal, Mapping};
use super::table_error::TableError;
use std::path::Path;

/// A kind of file that isn't text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BinaryFormat {
    /// A workbook of a spreadsheet.
    Xlsx,
    /// Arrays of numpy.
    Npz,
    /// Variables of MATLAB, Octave or scipy.
    Mat,
    /// A table of Parquet.
    Parquet,
}

impl BinaryFormat {
    /// Returns the kind of a file by the extension of its name; `None` if it is read as text.
    pub(super) fn of(path: &Path) -> Option<BinaryFormat> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "xlsx" => Some(BinaryFormat::Xlsx),
            "npz" => Some(BinaryFormat::Npz),
            "mat" => Some(BinaryFormat::Mat),
            "parquet" => Some(BinaryFormat::Parquet),
            _ => None,
        }
    }
}

/// Returns what to do about a table of a kind that isn't read, by the extension of its name.
pub(super) fn unread(path: &Path) -> Option<&'static str> {
    match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
        "arrow" | "feather" | "ipc" => Some("Arrow files aren't read: save the table as Parquet or CSV"),
        "xls" | "ods" | "xlsb" => Some("this kind of workbook isn't read: save it as .xlsx or CSV"),
        "h5" | "hdf5" => Some("HDF5 files aren't read: save the table as .npz, Parquet or CSV"),
        "npy" => Some("single arrays aren't read: save all columns in one .npz file (numpy.savez)"),
        _ => None,
    }
}

/// Returns the mapping for the text of a file: commas and decimal points, and a header where columns have names.
pub(super) fn mapping(kind: BinaryFormat, mapping: &Mapping) -> Mapping {
    let has_header = mapping.has_header || kind != BinaryFormat::Xlsx;
    Mapping { separator: Some(b','), decimal: Some(Decimal::Point), has_header, ..mapping.clone() }
}

/// Returns the name of the table for messages, and its text.
///
/// # Errors
/// The file can't be read, or isn't of its kind.
#[cfg(feature = "files")]
pub(crate) fn text(path: &Path, kind: BinaryFormat, mapping: &Mapping) -> Result<(String, String), TableError> {
    let file = path.display().to_string();
    let unreadable = |source| TableError::Unreadable { file: file.clone(), source };
    let malformed = |problem| TableError::Malformed { file: file.clone(), problem };
    let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
    if bytes > super::table_error::MAX_TABLE_BYTES {
        let limit = super::table_error::MAX_TABLE_BYTES;
        return Err(TableError::TooLarge { file, line: None, limit, what: "bytes" });
    }
    let input = std::fs::File::open(path).map_err(unreadable)?;
    if kind == BinaryFormat::Xlsx {
        let (sheet, text) = xlsx::text(input, mapping.sheet.as_deref()).map_err(malformed)?;
        return Ok((format!("{file}, sheet {}", super::table_error::quoted(&sheet)), text));
    }
    let variables = match kind {
        BinaryFormat::Npz => npz::read(input),
        BinaryFormat::Mat => mat::read(input),
        _ => parquet::read(input),
    };
    let text = variables.and_then(|variables| variables::text(variables, &mapping.x_mm)).map_err(malformed)?;
    Ok((file, text))
}

/// Returns an error: this program was built without the libraries.
#[cfg(not(feature = "files"))]
pub(super) fn text(path: &Path, _: BinaryFormat, _: &Mapping) -> Result<(String, String), TableError> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
    Err(TableError::NotBuilt { file: path.display().to_string(), extension })
}
