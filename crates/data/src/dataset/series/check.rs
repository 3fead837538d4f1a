//! Compares a file of readings with the marks of the journal.

use super::{SERIES, SeriesMark};
use crate::dataset::journal::JOURNAL;
use crate::dataset::{DatasetError, Fingerprint, Journal, Record, files};
use std::io::{ErrorKind, Read as _};
use std::path::Path;

/// Cuts off what follows the last mark: readings of a press that wasn't recorded. `mark` is the last mark of the journal.
///
/// # Errors
/// The file is shorter than the journal states, or an error of the operating system. Nothing is changed.
pub(in crate::dataset) fn cut(folder: &Path, mark: Option<&SeriesMark>) -> Result<(), DatasetError> {
    let path = folder.join(SERIES);
    let recorded = mark.map_or(0, |mark| mark.bytes);
    let file = match files::open_to_append(&path) {
        Err(error) if error.kind() == ErrorKind::NotFound && recorded == 0 => return Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => return Err(shorter(folder, 0, recorded)),
        opened => opened.map_err(DatasetError::io("opening", &path))?,
    };
    let bytes = file.metadata().map_err(DatasetError::io("reading", &path))?.len();
    if bytes < recorded {
        return Err(shorter(folder, bytes, recorded));
    }
    if bytes > recorded {
        file.set_len(recorded).and_then(|()| file.sync_data()).map_err(DatasetError::io("shortening", &path))?;
    }
    Ok(())
}

fn shorter(folder: &Path, bytes: u64, recorded: u64) -> DatasetError {
    DatasetError::Series { path: folder.join(SERIES), bytes, recorded }
}

/// Returns how a file of readings differs from the marks of a run's journal. A run that hasn't ended may have more readings.
///
/// # Errors
/// A file can't be read.
pub(in crate::dataset) fn problems(folder: &Path, has_ended: bool) -> Result<Vec<String>, DatasetError> {
    let path = folder.join(SERIES);
    let failed = |why| DatasetError::io("reading", &path)(why);
    let mut file = match files::open(&path) {
        Ok(file) => Some(file),
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        Err(error) => return Err(failed(error)),
    };
    let mut compared = 0;
    for next in Journal::<Record>::records(&folder.join(JOURNAL))? {
        let (_, record) = next?;
        let Some((press, mark)) = record.contact().and_then(|contact| Some((contact.press, contact.series.as_ref()?)))
        else {
            continue;
        };
        let Some(file) = &mut file else { return Ok(vec![format!("{SERIES} is missing")]) };
        let added = Fingerprint::of_reader(SERIES, file.take(mark.bytes.saturating_sub(compared))).map_err(failed)?;
        compared += added.bytes;
        if compared != mark.bytes {
            return Ok(vec![format!("{SERIES} ends at byte {compared}, within press {press}")]);
        }
        if added.sha256 != mark.sha256 {
            return Ok(vec![format!("{SERIES} has changed since press {press} was recorded (SHA-256 differs)")]);
        }
    }
    let bytes = file.as_ref().map(|file| file.metadata().map_err(failed)).transpose()?.map_or(0, |about| about.len());
    let is_longer = has_ended && bytes > compared;
    Ok(is_longer.then(|| format!("{SERIES} has {} bytes after the last press", bytes - compared)).into_iter().collect())
}
