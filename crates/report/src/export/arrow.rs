//! Frames as record batches of Arrow, and as files of Arrow (IPC, also called Feather 2) and Parquet.
//!
//! Fields have the metadata `unit` and `definition`, and a schema has `palpate.manifest`. A missing value is null.

use super::frame::{ExportTable, Values};
use arrow_array::{ArrayRef, BooleanArray, Int64Array, RecordBatch, StringArray};
use arrow_ipc::writer::FileWriter;
use arrow_schema::{DataType, Field, Schema, SchemaRef};
use palpate_data::dataset::arrow;
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use std::collections::HashMap;
use std::io::{self, Write};
use std::sync::Arc;

/// Key of the manifest in the metadata of a schema or a file.
pub const MANIFEST: &str = "palpate.manifest";

/// Bytes of a row group in memory from which it is written. So memory is bounded for any number of rows.
const GROUP_BYTES: usize = 16 << 20;

/// Returns the schema of a frame, without metadata of its own.
pub fn schema(frame: &ExportTable) -> Schema {
    let fields = frame.columns.iter().map(|column| {
        let (kind, may_miss) = match &column.values {
            Values::F64(_) => (DataType::Float64, true),
            Values::I64(_) => (DataType::Int64, false),
            Values::Text(_) => (DataType::Utf8, true),
            Values::Bool(_) => (DataType::Boolean, false),
        };
        arrow::field(&column.name, kind, may_miss, [&column.unit, &column.definition])
    });
    Schema::new(fields.collect::<Vec<Field>>())
}

/// Returns the rows of a frame as a batch of that schema.
///
/// # Errors
/// The schema isn't that of the frame.
pub fn batch(frame: ExportTable, schema: SchemaRef) -> io::Result<RecordBatch> {
    let array = |values: Values| -> ArrayRef {
        match values {
            Values::F64(numbers) => arrow::numbers(numbers),
            Values::I64(counts) => Arc::new(Int64Array::from(counts)),
            Values::Text(texts) => Arc::new(texts.iter().map(|text| text.as_deref()).collect::<StringArray>()),
            Values::Bool(values) => Arc::new(BooleanArray::from(values)),
        }
    };
    let arrays = frame.columns.into_iter().map(|column| array(column.values)).collect();
    RecordBatch::try_new(schema, arrays).map_err(io::Error::other)
}

/// Writes frames with the columns of `like` as a file of Arrow, a batch for each.
///
/// # Errors
/// An error of a frame or of the operating system.
pub(crate) fn write_ipc(
    like: &ExportTable,
    frames: impl IntoIterator<Item = io::Result<ExportTable>>,
    manifest: &str,
    out: impl Write,
) -> io::Result<()> {
    let metadata = HashMap::from([(MANIFEST.to_owned(), manifest.to_owned())]);
    let schema = Arc::new(schema(like).with_metadata(metadata));
    let mut writer = FileWriter::try_new_buffered(out, &schema).map_err(io::Error::other)?;
    for frame in frames {
        writer.write(&batch(frame?, schema.clone())?).map_err(io::Error::other)?;
    }
    writer.finish().map_err(io::Error::other)
}

/// A file of Parquet that is written piece by piece.
pub struct ParquetFile<W: Write + Send> {
    writer: ArrowWriter<W>,
    schema: SchemaRef,
}

impl<W: Write + Send> ParquetFile<W> {
    /// Begins a file for frames with the columns of `like`. The manifest is also in the schema if it is already known, where
    /// pyarrow looks for it.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn new(out: W, like: &ExportTable, manifest: Option<&str>) -> io::Result<ParquetFile<W>> {
        let metadata = manifest.map(|manifest| (MANIFEST.to_owned(), manifest.to_owned()));
        let schema = Arc::new(schema(like).with_metadata(metadata.into_iter().collect::<HashMap<_, _>>()));
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(concat!("palpate ", env!("CARGO_PKG_VERSION")).to_owned());
        // measured values hardly repeat: a dictionary of them takes time and saves nothing
        for column in like.columns.iter().filter(|column| matches!(column.values, Values::F64(_))) {
            properties = properties.set_column_dictionary_enabled(column.name.as_str().into(), false);
        }
        let writer = ArrowWriter::try_new(out, schema.clone(), Some(properties.build())).map_err(io::Error::other)?;
        Ok(ParquetFile { writer, schema })
    }

    /// Adds rows.
    ///
    /// # Errors
    /// The frame has other columns, or an error of the operating system.
    pub fn add(&mut self, frame: ExportTable) -> io::Result<()> {
        self.writer.write(&batch(frame, self.schema.clone())?).map_err(io::Error::other)?;
        match self.writer.in_progress_size() > GROUP_BYTES {
            true => self.writer.flush().map_err(io::Error::other),
            false => Ok(()),
        }
    }

    /// Ends the file with a manifest in its metadata. Returns the output.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn finish(mut self, manifest: &str) -> io::Result<W> {
        self.writer.append_key_value_metadata(KeyValue::new(MANIFEST.to_owned(), manifest.to_owned()));
        self.writer.into_inner().map_err(io::Error::other)
    }
}
