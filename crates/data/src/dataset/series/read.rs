//! Reads a file of readings, batch by batch.

use super::{SERIES, SeriesColumn};
use crate::dataset::{DatasetError, files};
use arrow_array::{Array as _, Float64Array, Int64Array, RecordBatch};
use arrow_ipc::reader::StreamReader;
use arrow_schema::ArrowError;
use std::fs::File;
use std::io::{self, BufReader, Read as _, Take};
use std::path::{Path, PathBuf};

/// Readings of a run, up to its last recorded press.
pub struct RecordedSeries {
    path: PathBuf,
    columns: Vec<SeriesColumn>,
    batches: StreamReader<BufReader<Take<File>>>,
}

/// Some readings, column by column.
#[derive(Clone, Debug, PartialEq)]
pub struct SeriesBatch {
    /// Number of the press of each reading.
    pub press: Vec<i64>,
    /// Every other column; NaN where a value is missing.
    pub numbers: Vec<Vec<f64>>,
}

impl RecordedSeries {
    /// Opens the file of a run, of which the journal states `bytes`.
    ///
    /// # Errors
    /// The file isn't one of readings, or an error of the operating system.
    pub fn open(folder: &Path, bytes: u64) -> Result<RecordedSeries, DatasetError> {
        let path = folder.join(SERIES);
        let failed = |why| DatasetError::io("reading", &path)(why);
        let file = match files::open(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Err(DatasetError::Series { path, bytes: 0, recorded: bytes });
            }
            opened => opened.map_err(failed)?,
        };
        let length = file.metadata().map_err(failed)?.len();
        if length < bytes {
            return Err(DatasetError::Series { path, bytes: length, recorded: bytes });
        }
        let batches = StreamReader::try_new(BufReader::new(file.take(bytes)), None).map_err(read_by).map_err(failed)?;
        let schema = batches.schema();
        let columns = schema.fields().iter().map(|field| {
            let text = |key: &str| field.metadata().get(key).cloned().unwrap_or_default();
            SeriesColumn { name: field.name().clone(), unit: text("unit"), definition: text("definition") }
        });
        Ok(RecordedSeries { columns: columns.collect(), path, batches })
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the columns: the press first.
    pub fn columns(&self) -> &[SeriesColumn] {
        &self.columns
    }
}

impl Iterator for RecordedSeries {
    type Item = Result<SeriesBatch, DatasetError>;

    fn next(&mut self) -> Option<Self::Item> {
        let batch = self.batches.next()?.map_err(read_by).and_then(|batch| of_batch(&batch));
        Some(batch.map_err(|why| DatasetError::io("reading", &self.path)(why)))
    }
}

fn of_batch(batch: &RecordBatch) -> io::Result<SeriesBatch> {
    let other = || io::Error::new(io::ErrorKind::InvalidData, "a column isn't of the type that this program writes");
    let (press, others) = batch.columns().split_first().ok_or_else(other)?;
    let press = press.as_any().downcast_ref::<Int64Array>().ok_or_else(other)?.values().to_vec();
    let numbers = others.iter().map(|column| {
        let column = column.as_any().downcast_ref::<Float64Array>().ok_or_else(other)?;
        Ok(column.iter().map(|value| value.unwrap_or(f64::NAN)).collect())
    });
    Ok(SeriesBatch { press, numbers: numbers.collect::<io::Result<_>>()? })
}

fn read_by(error: ArrowError) -> io::Error {
    match error {
        ArrowError::IoError(_, why) => why,
        error => io::Error::new(io::ErrorKind::InvalidData, error),
    }
}
