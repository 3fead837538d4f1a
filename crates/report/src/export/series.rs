//! Readings of a run as tables, one batch after another, so that memory doesn't grow with them.

use super::frame::{ExportTable, TableColumn, Values};
use super::{ExportFormat, arrow};
use palpate_data::dataset::{DatasetError, Recorded, RecordedSeries, SeriesBatch, SeriesColumn};
use std::io;
use std::path::Path;

/// Name of the table.
pub(crate) const SERIES: &str = "series";

/// Largest number of values of a table that is made in memory: 2 GB.
const VALUES_MOST: usize = 1 << 28;

/// Readings of a run: an iterator over tables with the same columns.
pub(crate) struct SeriesTables {
    series: RecordedSeries,
}

impl SeriesTables {
    /// Opens the readings of a run; `None` if it has none.
    ///
    /// # Errors
    /// The file of readings can't be read.
    pub(crate) fn of(run: &Recorded) -> Result<Option<SeriesTables>, DatasetError> {
        let Some(mark) = &run.series else { return Ok(None) };
        Ok(Some(SeriesTables { series: RecordedSeries::open(&run.path, mark.bytes)? }))
    }

    /// Returns a table without rows.
    pub(crate) fn like(&self) -> ExportTable {
        let others = self.series.columns().len().saturating_sub(1);
        table(self.series.columns(), SeriesBatch { press: Vec::new(), numbers: vec![Vec::new(); others] })
    }

    /// Returns all readings as one table.
    fn whole(mut self) -> Result<ExportTable, DatasetError> {
        let (columns, path) = (self.series.columns().to_vec(), self.series.path().to_owned());
        let mut all = SeriesBatch { press: Vec::new(), numbers: vec![Vec::new(); columns.len() - 1] };
        for batch in &mut self.series {
            let batch = batch?;
            all.press.extend(batch.press);
            all.numbers.iter_mut().zip(batch.numbers).for_each(|(all, more)| all.extend(more));
            if all.press.len() * columns.len() > VALUES_MOST {
                let text = "too many readings for a file that is made in memory: use --format parquet or arrow";
                return Err(DatasetError::io("exporting", path)(io::Error::new(io::ErrorKind::FileTooLarge, text)));
            }
        }
        Ok(table(&columns, all))
    }
}

impl Iterator for SeriesTables {
    type Item = Result<ExportTable, DatasetError>;

    fn next(&mut self) -> Option<Self::Item> {
        let batch = self.series.next()?;
        Some(batch.map(|batch| table(self.series.columns(), batch)))
    }
}

/// Adds the readings of a run to the tables that are written in a format. Parquet and Arrow files are written to `folder` instead, batch
/// by batch.
///
/// # Errors
/// The readings can't be read, or their file can't be written.
pub fn add_series(
    frames: &mut Vec<ExportTable>,
    run: &Recorded,
    manifest: &str,
    format: ExportFormat,
    folder: &Path,
) -> Result<(), DatasetError> {
    let Some(tables) = SeriesTables::of(run)? else { return Ok(()) };
    match format {
        ExportFormat::Parquet | ExportFormat::Arrow => {
            let path = folder.join(format!("{SERIES}.{}", format.name()));
            let written = write(tables, manifest, format, &path);
            written.map_err(DatasetError::io("writing", path))
        }
        _ => {
            frames.push(tables.whole()?);
            Ok(())
        }
    }
}

fn write(tables: SeriesTables, manifest: &str, format: ExportFormat, path: &Path) -> io::Result<()> {
    let like = tables.like();
    let tables = tables.map(|table| table.map_err(io::Error::other));
    let mut out = io::BufWriter::new(std::fs::File::create_new(path)?);
    if format == ExportFormat::Arrow {
        arrow::write_ipc(&like, tables, manifest, &mut out)?;
    } else {
        let mut file = arrow::ParquetFile::new(&mut out, &like, Some(manifest))?;
        for table in tables {
            file.add(table?)?;
        }
        file.finish(manifest)?;
    }
    out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
}

fn table(columns: &[SeriesColumn], batch: SeriesBatch) -> ExportTable {
    let rows = batch.press.len();
    let values = std::iter::once(Values::I64(batch.press)).chain(batch.numbers.into_iter().map(Values::F64));
    let columns = columns.iter().zip(values).map(|(column, values)| {
        let made = TableColumn::new(&column.name, &column.definition, values);
        if column.unit.is_empty() { made } else { TableColumn { unit: column.unit.clone(), ..made } }
    });
    ExportTable { name: SERIES, rows, columns: columns.collect() }
}
