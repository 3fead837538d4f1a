//! Allows one writer at a time: a run or a batch belongs to the program that holds its lock.

use super::journal::JOURNAL;
use super::{DatasetError, files};
use std::fs::{File, TryLockError};
use std::io;
use std::path::Path;

/// File that is locked. It is the journal, which nobody deletes as a left-over file. If a lock would also block readers, it is a
/// separate file.
const LOCKED: &str = if cfg!(windows) { "run.lock" } else { JOURNAL };

/// Locks the folder of a run or a batch for this program. The system releases the lock when the program ends for any reason.
///
/// # Errors
/// Returns an error if another program holds the lock, or the operating system's error.
pub fn hold(path: &Path) -> Result<File, DatasetError> {
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

/// Locks a file that took the journal's place, for the program that has the folder. Returns whether no other program has it.
pub(super) fn follow(journal: &File) -> io::Result<bool> {
    match journal.try_lock() {
        Ok(()) => Ok(true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(error)) => Err(error),
    }
}
