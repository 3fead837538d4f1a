//! Thread that writes readings to their file.

use super::queue::SeriesRequests;
use super::{
    SERIES, SeriesColumn, SeriesMark, SeriesQueue, SeriesReadings, SeriesRequest, SeriesWriteError, encode,
    series_queue,
};
use crate::dataset::{Durability, files};
use arrow_ipc::writer::StreamWriter;
use arrow_schema::SchemaRef;
use palpate_core::quantity::hexadecimal;
use sha2::{Digest as _, Sha256};
use std::fs::File;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};

/// Writer of a run's readings, on a thread of its own.
#[derive(Debug)]
pub(in crate::dataset) struct SeriesWriter {
    pub queue: SeriesQueue,
    thread: JoinHandle<()>,
}

impl SeriesWriter {
    /// Opens the file of a run for adding, and begins to write what its queue gets. What comes after the last mark was cut off before.
    pub(in crate::dataset) fn begin(
        folder: &Path,
        columns: &[SeriesColumn],
        three_axes: bool,
        durability: Durability,
    ) -> io::Result<SeriesWriter> {
        let mut file = SeriesFile::open(folder, columns, three_axes, durability)?;
        let (queue, requests) = series_queue();
        let thread = Builder::new().name(SERIES.to_owned()).spawn(move || file.serve(requests))?;
        Ok(SeriesWriter { queue, thread })
    }

    /// Waits until the file is closed. No other end of the queue may be in use.
    pub(in crate::dataset) fn end(self) {
        drop(self.queue);
        let _ = self.thread.join(); // a writer that failed has said so at the last mark
    }
}

/// File to which batches are added.
struct SeriesFile {
    file: File,
    path: PathBuf,
    writer: StreamWriter<Vec<u8>>,
    schema: SchemaRef,
    three_axes: bool,
    durability: Durability,
    bytes: u64,
    hash: Sha256,
    failed: Option<SeriesWriteError>,
}

impl SeriesFile {
    fn open(folder: &Path, columns: &[SeriesColumn], three_axes: bool, durability: Durability) -> io::Result<Self> {
        let path = folder.join(SERIES);
        let file = files::open_or_create(&path)?;
        let bytes = file.metadata()?.len();
        let schema = Arc::new(encode::schema(columns));
        let mut writer = StreamWriter::try_new(Vec::new(), &schema).map_err(io::Error::other)?;
        if bytes > 0 {
            writer.get_mut().clear(); // a file that continues has its schema
        }
        let hash = Sha256::new();
        Ok(SeriesFile { file, path, writer, schema, three_axes, durability, bytes, hash, failed: None })
    }

    /// Carries out requests until no run adds readings any more.
    fn serve(&mut self, requests: SeriesRequests) {
        for request in requests {
            match request {
                SeriesRequest::Add(readings) if self.failed.is_none() => {
                    self.failed = self.add(&readings).err().map(|why| self.io(why));
                }
                SeriesRequest::Add(_) => {} // the next mark reports the failure
                SeriesRequest::Mark(answer) => {
                    let mark = match self.failed.take() {
                        Some(error) => Err(error),
                        None => self.mark().map_err(|why| self.io(why)),
                    };
                    let _ = answer.send(mark); // a run that waited too long has ended
                }
            }
        }
    }

    fn add(&mut self, readings: &SeriesReadings) -> io::Result<()> {
        let batch = encode::batch(readings, &self.schema, self.three_axes)?;
        self.writer.write(&batch).map_err(io::Error::other)?;
        self.write()
    }

    /// Writes what the encoder has made so far.
    fn write(&mut self) -> io::Result<()> {
        let made = std::mem::take(self.writer.get_mut());
        self.file.write_all(&made)?;
        self.hash.update(&made);
        self.bytes += made.len() as u64;
        Ok(())
    }

    fn mark(&mut self) -> io::Result<SeriesMark> {
        self.write()?; // a run without readings has a schema too
        if self.durability == Durability::Full {
            self.file.sync_data()?;
        }
        let sha256 = hexadecimal(&self.hash.finalize_reset());
        Ok(SeriesMark { bytes: self.bytes, sha256 })
    }

    fn io(&self, why: io::Error) -> SeriesWriteError {
        SeriesWriteError::Io { path: self.path.clone(), why }
    }
}
