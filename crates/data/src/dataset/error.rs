//! Reasons why a run couldn't be recorded or read.

use super::SeriesWriteError;
use super::files;
use super::journal::{JOURNAL, JournalError};
use miette::Diagnostic;
use std::path::PathBuf;
use thiserror::Error;

/// Reason why a run couldn't be recorded or read.
#[derive(Debug, Error, Diagnostic)]
pub enum DatasetError {
    /// The operating system reported an error.
    #[error("{doing} {}: {why}", path.display())]
    #[diagnostic(help("{}", files::advice(why)))]
    Io {
        /// Operation that failed.
        doing: &'static str,
        /// File or folder of the operation.
        path: PathBuf,
        /// Error of the operating system.
        why: std::io::Error,
    },
    /// The journal is damaged, or can't be read or written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Journal(#[from] JournalError),
    /// Nothing at the path of a run.
    #[error("{} doesn't exist", path.display())]
    #[diagnostic(help("give the folder of a run; `palpate run` makes one, and prints its name"))]
    Missing {
        /// Path that was named.
        path: PathBuf,
    },
    /// A run folder has lost its journal.
    #[error("{}: journal.log is missing; the other files of a run are there", path.display())]
    #[diagnostic(help("restore journal.log from a copy: it is the record, and the other files follow from it"))]
    NoJournal {
        /// The run folder.
        path: PathBuf,
    },
    /// A folder has the name of the journal.
    #[error("{}: journal.log is a folder, not a file", path.display())]
    #[diagnostic(help("restore journal.log from a copy: it is the record, and the other files follow from it"))]
    JournalFolder {
        /// The run folder.
        path: PathBuf,
    },
    /// There is no journal where a run was expected.
    #[error("{} is not a run folder (journal.log not found)", path.display())]
    #[diagnostic(help("give the folder of a run, such as runs/paper; `palpate import` makes one from tables"))]
    NoRun {
        /// Named folder.
        path: PathBuf,
    },
    /// The folder can't be created, because its parent is a file.
    #[error("{} can't hold a run: it is not a folder", path.display())]
    #[diagnostic(help("choose another --out"))]
    NoFolder {
        /// The file instead of a parent folder.
        path: PathBuf,
    },
    /// The folder to be created already exists.
    #[error("{} already exists", path.display())]
    #[diagnostic(help(
        "choose another --out: no existing folder is changed. To judge a run again, use `palpate evaluate RUN --accept FILE`"
    ))]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// Another program has locked the run.
    #[error("{} is being written by another program", path.display())]
    #[diagnostic(help("wait for it to end, or end it: only one program can write a run"))]
    Held {
        /// The folder.
        path: PathBuf,
    },
    /// A text used by a run differs from the text with which the run began.
    #[error("{} has changed since the start of the run", path.display())]
    #[diagnostic(help("restore it, or start a new run: this run would mix the presses of two plans"))]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// The journal contains fewer presses than the other files of the run.
    #[error("{}: presses are missing from the journal: {}", path.display(), lost.join("; "))]
    #[diagnostic(help(
        "restore journal.log from a copy. Without one, copy the folder first: then `palpate rebuild --accept-loss` regenerates the \
         tables from the journal. Nothing was changed"
    ))]
    Lost {
        /// The folder.
        path: PathBuf,
        /// Statements of the other files about the lost presses.
        lost: Vec<String>,
    },
    /// The journal isn't the one that the manifest of its folder describes.
    #[error("{}: the journal isn't the one that manifest.json describes: {}", path.join(JOURNAL).display(), found.join("; "))]
    #[diagnostic(help(
        "restore journal.log from a copy. If this journal is the right one, copy the folder first: then `palpate rebuild \
         --accept-journal` regenerates manifest and tables from it, and records this. Nothing was changed"
    ))]
    Foreign {
        /// The folder.
        path: PathBuf,
        /// Differences of the journal from the manifest.
        found: Vec<String>,
    },
    /// The file of readings has lost its end.
    #[error("{} has {bytes} bytes; the journal states {recorded}", path.display())]
    #[diagnostic(help(
        "restore it from a copy: readings can't be regenerated. Presses and evaluations don't need it; nothing was changed"
    ))]
    Series {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
        /// Its length after the last recorded press.
        recorded: u64,
    },
    /// Readings weren't kept.
    #[error(transparent)]
    #[diagnostic(help(
        "free disk space or use a faster disk, then continue with `palpate resume`: acknowledged presses are stored"
    ))]
    Readings(#[from] SeriesWriteError),
    /// The manifest is invalid.
    #[error("{}{at}: {problem}", path.display())]
    #[diagnostic(help("`palpate rebuild` regenerates it from the run's journal"))]
    Manifest {
        /// The file.
        path: PathBuf,
        /// Line and column, as `:3:14`; empty if unknown.
        at: String,
        /// Problem in the manifest.
        problem: String,
    },
}

impl DatasetError {
    /// Returns the error of an operation on a file, from the error of the operating system.
    pub fn io(doing: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> DatasetError {
        let path = path.into();
        move |why| DatasetError::Io { doing, path, why }
    }
}
