//! Formats of an export, and the files of a run in a format.

use super::csv;
use super::frame::ExportTable;
use miette::Diagnostic;
use palpate_data::dataset::Manifest;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// Format of exported files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// Text, with units, definitions and manifest in a .json file of the same name
    Csv,
    /// Apache Parquet
    Parquet,
    /// Apache Arrow IPC (Feather 2)
    Arrow,
    /// All tables in one file of numpy
    Npz,
    /// All tables in one MAT file (v5) for MATLAB, Octave and scipy
    Mat,
    /// All tables in one HDF5 file
    Hdf5,
    /// A sensor file as C99, for a controller
    C,
}

/// This program was built without a feature.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("{what} needs the feature `files`, which this program was built without")]
#[diagnostic(help(
    "install it with `cargo install --path . --features files`, in the program's repository; `--format csv` works without it"
))]
pub struct NotBuilt {
    /// What was asked for.
    pub what: String,
}

impl ExportFormat {
    /// Name of the format, and extension of its files.
    pub fn name(self) -> &'static str {
        match self {
            ExportFormat::Csv => "csv",
            ExportFormat::Parquet => "parquet",
            ExportFormat::Arrow => "arrow",
            ExportFormat::Npz => "npz",
            ExportFormat::Mat => "mat",
            ExportFormat::Hdf5 => "h5",
            ExportFormat::C => "c",
        }
    }

    /// Whether all tables of a run are in one file.
    pub fn is_one_file(self) -> bool {
        matches!(self, ExportFormat::Npz | ExportFormat::Mat | ExportFormat::Hdf5)
    }

    /// Checks that this program was built with the format.
    ///
    /// # Errors
    /// It was built without.
    pub fn check(self) -> Result<(), NotBuilt> {
        match matches!(self, ExportFormat::Csv | ExportFormat::C) || cfg!(feature = "files") {
            true => Ok(()),
            false => Err(NotBuilt { what: format!("the format {}", self.name()) }),
        }
    }
}

/// Writes each frame as a new file in a folder.
///
/// # Errors
/// An error of the operating system.
pub fn write_tables(
    frames: Vec<ExportTable>,
    manifest: &Manifest,
    format: ExportFormat,
    folder: &Path,
) -> io::Result<()> {
    for frame in frames {
        if format == ExportFormat::Csv {
            let mut described = File::create_new(folder.join(format!("{}.json", frame.name)))?;
            described.write_all(csv::description(&frame, manifest).as_bytes())?;
        }
        let file = folder.join(format!("{}.{}", frame.name, format.name()));
        write_file(vec![frame], manifest, format, &file)?;
    }
    Ok(())
}

/// Writes frames to a new file; one frame, if the format has one table in a file.
///
/// # Errors
/// An error of the operating system.
pub fn write_file(frames: Vec<ExportTable>, manifest: &Manifest, format: ExportFormat, path: &Path) -> io::Result<()> {
    let mut out = io::BufWriter::new(File::create_new(path)?);
    put(frames, manifest, format, &mut out)?;
    out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
}

#[cfg(feature = "files")]
fn put(
    frames: Vec<ExportTable>,
    manifest: &Manifest,
    format: ExportFormat,
    out: &mut io::BufWriter<File>,
) -> io::Result<()> {
    // text and numbers can't fail to be written
    let json = serde_json::to_string(manifest).unwrap_or_default();
    match format {
        ExportFormat::Npz => super::npz::write(&frames, manifest, out).map(drop),
        ExportFormat::Mat => super::mat::write(&frames, &json, out),
        ExportFormat::Hdf5 => super::hdf5::write(&frames, &json, out),
        _ => frames.into_iter().try_for_each(|frame| match format {
            ExportFormat::Parquet => {
                let mut file = super::arrow::ParquetFile::new(&mut *out, &frame, Some(&json))?;
                file.add(frame)?;
                file.finish(&json).map(drop)
            }
            ExportFormat::Arrow => super::arrow::write_ipc(&frame, [Ok(frame.clone())], &json, &mut *out),
            _ => out.write_all(csv::text(&frame).as_bytes()),
        }),
    }
}

#[cfg(not(feature = "files"))]
fn put(frames: Vec<ExportTable>, _: &Manifest, format: ExportFormat, out: &mut io::BufWriter<File>) -> io::Result<()> {
    format.check().map_err(io::Error::other)?;
    frames.iter().try_for_each(|frame| out.write_all(csv::text(frame).as_bytes()))
}
