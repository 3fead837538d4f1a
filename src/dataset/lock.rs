//! Allows one writer at a time: a run belongs to the program that holds its lock.

use super::journal::JOURNAL;
use super::{DatasetError, files};
use std::fs::{File, TryLockError};
use std::path::Path;

/// What is locked: the journal, which nobody takes for a left-over; where a lock bars readers too, a file beside it.
const LOCKED: &str = if cfg!(windows) { "run.lock" } else { JOURNAL };

/// Takes a run for this program alone. The system releases it when the program ends, however it does.
///
/// # Errors
/// Another program holds it, or the operating system's.
pub(super) fn hold(path: &Path) -> Result<File, DatasetError> {
    let held = path.join(LOCKED);
    let opened = if cfg!(windows) { files::open_or_create(&held) } else { files::open_to_append(&held) };
    let file = opened.map_err(DatasetError::io("opening", &held))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(DatasetError::Held { path: path.to_owned() }),
        Err(TryLockError::Error(error)) => Err(DatasetError::io("locking", held)(error)),
    }
}

/// Whether a program is writing the run now.
pub(super) fn is_held(path: &Path) -> bool {
    files::open(&path.join(LOCKED)).is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}
