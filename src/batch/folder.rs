//! A batch on disk: its journal, copies of its texts, and the run folders of its sensors.

use super::{Event, Facts, Session, State};
use crate::dataset::{DatasetError, JOURNAL, Journal, JournalError, Text, hold_folder, make_folder};
use miette::Diagnostic;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Folder of the runs in a batch folder.
pub const RUNS: &str = "runs";

/// Largest number of names that are tried for a run's folder.
const NAMES_MAX: u64 = 100_000;

/// A batch on disk, locked by this program.
#[derive(Debug)]
pub struct BatchFolder {
    path: PathBuf,
    /// Lock that is released when its owner ends, for any reason.
    _lock: File,
    journal: Journal<Event>,
    state: State,
}

/// Reason why a batch couldn't be recorded or read.
#[derive(Debug, Error, Diagnostic)]
pub enum BatchError {
    /// There is no batch at the path.
    #[error("{} is not a batch folder (journal.log not found)", path.display())]
    #[diagnostic(help("give the folder of a batch; `palpate batch run` makes one, and prints its name"))]
    NoBatch {
        /// Named folder.
        path: PathBuf,
    },
    /// Another program works on the batch.
    #[error("{} is in use by another program", path.display())]
    #[diagnostic(help(
        "type the command in the `palpate batch run` that uses it (`.repeat SERIAL`), or end that program first"
    ))]
    Held {
        /// The folder.
        path: PathBuf,
    },
    /// The folder or its journal can't be written or read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Dataset(#[from] DatasetError),
}

impl From<JournalError> for BatchError {
    fn from(error: JournalError) -> Self {
        BatchError::Dataset(error.into())
    }
}

impl BatchFolder {
    /// Creates the folder of a new batch. The complete folder appears by one rename.
    ///
    /// # Errors
    /// The folder already exists, or can't be created.
    pub fn create(
        out: &Path,
        facts: Facts,
        texts: &[Text],
        serials: &[String],
        session: Session,
    ) -> Result<BatchFolder, BatchError> {
        let name = facts.name.clone();
        let fill = |draft: &Path| fill(draft, facts, texts, serials, session);
        make_folder(Some(out), &name, fill)?;
        BatchFolder::open(out)
    }

    /// Opens a batch to continue it, and cuts off an incomplete last record. Changes nothing else.
    ///
    /// # Errors
    /// There is no batch, its journal is damaged, or another program works on it. Nothing is changed in these cases.
    pub fn open(path: &Path) -> Result<BatchFolder, BatchError> {
        check_batch(path)?;
        let lock = hold_folder(path).map_err(|error| match error {
            DatasetError::Held { path } => BatchError::Held { path },
            error => error.into(),
        })?;
        let mut state = State::default();
        let journal = Journal::open(&path.join(JOURNAL), |_, event| state.take_in(event))?;
        Ok(BatchFolder { path: path.to_owned(), _lock: lock, journal, state })
    }

    /// Adds an event. When this returns, the event is on the disk.
    ///
    /// # Errors
    /// An event that contradicts those before, or an error of the operating system. Nothing is added in both cases.
    pub fn record(&mut self, event: &Event) -> Result<(), BatchError> {
        let mut state = self.state.clone();
        let contradicts = |problem: String| DatasetError::Io {
            doing: "recording in",
            path: self.path.clone(),
            why: std::io::Error::other(problem),
        };
        state.take_in(event).map_err(contradicts)?;
        self.journal.append(event)?;
        self.state = state;
        Ok(())
    }

    /// Returns the state after all events.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Returns the path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns an unused folder for a sensor's next run, relative to the batch folder: `runs/SERIAL`, `runs/SERIAL-2`, ... A name
    /// that is the serial number of another sensor isn't used.
    ///
    /// # Errors
    /// There are too many runs.
    pub fn next_run(&self, serial: &str) -> Result<String, BatchError> {
        let name = |number: u64| if number == 1 { serial.to_owned() } else { format!("{serial}-{number}") };
        let is_free = |name: &String| {
            let is_anothers = name != serial && self.state.item(name).is_some();
            !is_anothers && self.path.join(RUNS).join(name).symlink_metadata().is_err()
        };
        let free = (1..=NAMES_MAX).map(name).find(is_free);
        let exists = || DatasetError::Exists { path: self.path.join(RUNS).join(serial) };
        Ok(format!("{RUNS}/{}", free.ok_or_else(exists)?))
    }
}

/// Reads the state of a batch from its journal. The batch may be in use.
///
/// # Errors
/// There is no batch, or its journal is damaged.
pub fn read_state(path: &Path) -> Result<State, BatchError> {
    check_batch(path)?;
    let mut state = State::default();
    Journal::<Event>::read(&path.join(JOURNAL), |_, event| state.take_in(event))?;
    Ok(state)
}

fn check_batch(path: &Path) -> Result<(), BatchError> {
    match path.join(JOURNAL).is_file() {
        true => Ok(()),
        false => Err(BatchError::NoBatch { path: path.to_owned() }),
    }
}

/// Writes everything that a batch folder contains before its first sensor.
fn fill(draft: &Path, facts: Facts, texts: &[Text], serials: &[String], session: Session) -> Result<(), DatasetError> {
    let added = Event::Added { at: facts.at.clone(), serials: serials.to_vec() };
    let mut journal = Journal::create(&draft.join(JOURNAL))?;
    journal.append(&Event::Batch(facts))?;
    for text in texts {
        journal.append(&Event::Text(text.clone()))?;
        let path = draft.join(&text.name);
        let written = File::create_new(&path).and_then(|mut file| {
            std::io::Write::write_all(&mut file, text.text.as_bytes())?;
            file.sync_all()
        });
        written.map_err(DatasetError::io("writing", path))?;
    }
    journal.append(&added)?;
    journal.append(&Event::Session(session))?;
    let runs = draft.join(RUNS);
    fs::create_dir(&runs).map_err(DatasetError::io("making", runs))
}
