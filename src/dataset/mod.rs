//! What a run leaves on disk: the journal, which is the truth, and plain tables that are views of it.
//!
//! A run folder appears by one rename with its recipe, its rig and its manifest in it. Each press is in the [`Journal`],
//! flushed to the disk, before the next begins; `presses.csv` grows with it, and all tables are written anew at the end. They
//! and the manifest are views: [`RunFolder::rebuild`] makes them from the journal. Whoever makes presses sees a [`Ledger`]
//! only: a run folder, or a [`Memory`] that leaves no files.

pub mod calibration;
pub mod characteristics;
pub mod evaluate;
mod folder;
mod header;
mod index;
mod journal;
mod ledger;
mod manifest;
pub mod readings;
mod record;
mod session;
pub mod table;
mod verify;
mod views;

pub use folder::{Origins, RunFolder, check_run};
pub use index::Contacts;
pub use journal::{Journal, JournalError, Records};
pub use ledger::{Ledger, Memory};
pub use manifest::{Manifest, Status};
pub(crate) use record::round;
pub use record::{Contact, Flag, Left, Record, Retouch, Row, RowTruth};
pub use session::{Durability, End, Fingerprint, RunFacts, Session};
pub use verify::{Verified, altered, verify};
pub use views::TABLES;

use miette::Diagnostic;
use std::path::PathBuf;
use thiserror::Error;

/// A run couldn't be recorded or read back.
#[derive(Debug, Error, Diagnostic)]
pub enum DatasetError {
    /// The operating system refused.
    #[error("{doing} {}: {why}", path.display())]
    #[diagnostic(help(
        "make room or set the permissions right, then `palpate resume` the run: what was acknowledged is safe"
    ))]
    Io {
        /// What was being done.
        doing: &'static str,
        /// To which file or folder.
        path: PathBuf,
        /// What came back.
        why: std::io::Error,
    },
    /// The journal is damaged, or can't be read or written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Journal(#[from] JournalError),
    /// There is no journal where a run was expected.
    #[error("{} is no run: it has no journal.log", path.display())]
    #[diagnostic(help("name the folder of a run, such as runs/paper"))]
    NoRun {
        /// The folder that was named.
        path: PathBuf,
    },
    /// The folder to be made can't be, since what is to hold it is a file.
    #[error("{} can't hold a run: it is not a folder", path.display())]
    #[diagnostic(help("choose another --out"))]
    NoFolder {
        /// What is to hold it.
        path: PathBuf,
    },
    /// The folder to be made is there already.
    #[error("{} is there already", path.display())]
    #[diagnostic(help("choose another --out; a folder that exists is never touched"))]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// Another program holds the run.
    #[error("{} is being written by another program", path.display())]
    #[diagnostic(help("wait for it to end, or end it: a run has one writer at a time"))]
    Held {
        /// The folder.
        path: PathBuf,
    },
    /// A text that a run goes by isn't the one it began with.
    #[error("{} isn't the one that the run began with", path.display())]
    #[diagnostic(help("put it back, or begin a new run: what is measured would be of two plans"))]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// A manifest that can't be understood.
    #[error("{}{at}: {problem}", path.display())]
    #[diagnostic(help("`palpate rebuild` writes it anew from the run's journal"))]
    Manifest {
        /// The file.
        path: PathBuf,
        /// Line and column, as `:3:14`; empty where there is none.
        at: String,
        /// What is wrong.
        problem: String,
    },
}

impl DatasetError {
    pub(crate) fn io(doing: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> DatasetError {
        let path = path.into();
        move |why| DatasetError::Io { doing, path, why }
    }
}
