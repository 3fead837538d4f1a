//! A batch on disk: its journal, copies of its texts, and the run folders of its sensors.

use super::{BatchEvent, BatchSession, BatchState, Began, Ended, Facts};
use miette::Diagnostic;
use palpate_data::dataset::{DatasetError, JOURNAL, Journal, JournalError, RecordedText, hold_folder, make_folder};
use std::collections::HashSet;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
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
    journal: Journal<BatchEvent>,
    state: BatchState,
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
    /// The journal has lost the beginning of runs.
    #[error("{}: journal.log doesn't have the runs {}", path.display(), runs.join(", "))]
    #[diagnostic(help(
        "restore the journal of the batch from a copy. Without one, move these folders out of the batch: then their sensors are \
         calibrated again. Nothing was changed"
    ))]
    Unlisted {
        /// The batch folder.
        path: PathBuf,
        /// The folders, relative to the batch folder.
        runs: Vec<String>,
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
    /// Creates the folder of a new batch, with its first events. The complete folder appears by one rename.
    ///
    /// # Errors
    /// The folder already exists, or can't be created.
    pub fn create(out: &Path, name: &str, beginning: &[BatchEvent]) -> Result<BatchFolder, BatchError> {
        make_folder(Some(out), name, |draft| fill(draft, beginning))?;
        BatchFolder::open(out)
    }

    /// Opens a batch to continue it, and cuts off an incomplete last record. Changes nothing else.
    ///
    /// # Errors
    /// There is no batch, its journal is damaged or lacks runs that are there, or another program works on it. Nothing is changed
    /// in these cases.
    pub fn open(path: &Path) -> Result<BatchFolder, BatchError> {
        check_batch(path)?;
        let lock = hold_folder(path).map_err(|error| match error {
            DatasetError::Held { path } => BatchError::Held { path },
            error => error.into(),
        })?;
        let (mut state, mut listed, mut unfinished) = (BatchState::default(), HashSet::new(), HashSet::new());
        let records = Journal::read(&path.join(JOURNAL), |_, event| {
            match event {
                BatchEvent::Began(Began { serial, run, .. }) => {
                    listed.insert(run.clone());
                    unfinished.insert(serial.clone());
                }
                BatchEvent::Ended(Ended { serial, runs, .. }) => {
                    listed.extend(runs.iter().cloned());
                    unfinished.remove(serial);
                }
                _ => {}
            }
            state.take_in(event)
        })?;
        let is_further = |name: &str| is_further(name, &state, &unfinished);
        let runs = unlisted(path, |name, run| listed.contains(run) || is_further(name))?;
        if !runs.is_empty() {
            return Err(BatchError::Unlisted { path: path.to_owned(), runs });
        }
        let journal = records.go_on()?;
        Ok(BatchFolder { path: path.to_owned(), _lock: lock, journal, state })
    }

    /// Adds an event. When this returns, the event is on the disk.
    ///
    /// # Errors
    /// An event that contradicts those before, or an error of the operating system. Nothing is added in both cases.
    pub fn record(&mut self, event: &BatchEvent) -> Result<(), BatchError> {
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
    pub fn state(&self) -> &BatchState {
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

/// Returns the run folders of a batch that aren't known by their name and by their path in the batch.
fn unlisted(path: &Path, is_known: impl Fn(&str, &str) -> bool) -> Result<Vec<String>, DatasetError> {
    let folder = path.join(RUNS);
    let entries = match fs::read_dir(&folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(DatasetError::io("reading", &folder))?,
    };
    let mut runs = Vec::new();
    for entry in entries {
        let name = entry.map_err(DatasetError::io("reading", &folder))?.file_name().to_string_lossy().into_owned();
        let run = format!("{RUNS}/{name}");
        let is_run = !name.starts_with('.') && folder.join(&name).join(JOURNAL).is_file();
        if is_run && !is_known(&name, &run) {
            runs.push(run);
        }
    }
    runs.sort_unstable();
    Ok(runs)
}

/// Whether a run folder may be a further run of a sensor. Such a run is recorded when the sensor ends, so one that was killed has
/// unrecorded runs after its first. Its next first run has a larger number.
fn is_further(name: &str, state: &BatchState, unfinished: &HashSet<String>) -> bool {
    let Some((serial, number)) = name.rsplit_once('-') else { return false };
    let (Some(item), Ok(number)) = (state.item(serial), number.parse::<u64>()) else { return false };
    let last = item.run.as_deref().and_then(|run| run.strip_prefix(&format!("{RUNS}/{serial}-"))?.parse().ok());
    unfinished.contains(serial) || item.times > 0 && number < last.unwrap_or(1)
}

/// Reads the state of a batch from its journal. The batch may be in use.
///
/// # Errors
/// There is no batch, or its journal is damaged.
pub fn read_state(path: &Path) -> Result<BatchState, BatchError> {
    let mut state = BatchState::default();
    read_events(path, |event| state.take_in(event))?;
    Ok(state)
}

/// Passes each event of a batch's journal to `accept`, which may refuse it as damage.
pub(super) fn read_events(
    path: &Path,
    mut accept: impl FnMut(&BatchEvent) -> Result<(), String>,
) -> Result<(), BatchError> {
    check_batch(path)?;
    Journal::<BatchEvent>::read(&path.join(JOURNAL), |_, event| accept(event))?;
    Ok(())
}

fn check_batch(path: &Path) -> Result<(), BatchError> {
    match path.join(JOURNAL).is_file() {
        true => Ok(()),
        false => Err(BatchError::NoBatch { path: path.to_owned() }),
    }
}

/// Returns the first events of a batch.
pub fn beginning(facts: Facts, texts: &[RecordedText], serials: &[String], session: BatchSession) -> Vec<BatchEvent> {
    let added = BatchEvent::Added { at: facts.at.clone(), serials: serials.to_vec() };
    let texts = texts.iter().cloned().map(BatchEvent::Text);
    [BatchEvent::Batch(facts)].into_iter().chain(texts).chain([added, BatchEvent::Session(session)]).collect()
}

/// Writes everything that a batch folder contains before its first sensor.
fn fill(draft: &Path, beginning: &[BatchEvent]) -> Result<(), DatasetError> {
    let mut journal = Journal::create(&draft.join(JOURNAL))?;
    for event in beginning {
        journal.append(event)?;
        if let BatchEvent::Text(RecordedText { name, text }) = event {
            let path = draft.join(name);
            let written = File::create_new(&path).and_then(|mut file| {
                file.write_all(text.as_bytes())?;
                file.sync_all()
            });
            written.map_err(DatasetError::io("writing", path))?;
        }
    }
    let runs = draft.join(RUNS);
    fs::create_dir(&runs).map_err(DatasetError::io("making", runs))
}

#[cfg(test)]
mod tests {
    use super::super::state::tests::{at, began, ended};
    use super::super::{ReferenceSensor, SensorState};
    use super::*;
    use palpate_data::acceptance::SensorVerdict;
    use palpate_data::dataset::Status;

    fn texts() -> [RecordedText; 1] {
        [RecordedText { name: "batch.toml".to_owned(), text: "name = \"day\"\n".to_owned() }]
    }

    fn created(out: &Path) -> BatchFolder {
        let facts = Facts { format: 1, name: "day".to_owned(), at: at(), reference: None, ..Facts::default() };
        let serials = ["A-1", "A-2", "A-3"].map(str::to_owned);
        BatchFolder::create(out, "day", &beginning(facts, &texts(), &serials, BatchSession::default())).unwrap()
    }

    /// A whole day: A-1 is judged, A-2 ends, A-3 begins.
    fn events() -> [BatchEvent; 5] {
        let judged = |serial| ended(serial, Status::Complete, Some(SensorVerdict::Accepted));
        [began("A-1"), judged("A-1"), began("A-2"), judged("A-2"), began("A-3")]
    }

    #[test]
    fn runs_that_the_journal_has_lost_are_named_and_nothing_is_changed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("day");
        let mut batch = created(&path);
        events().iter().for_each(|event| batch.record(event).unwrap());
        drop(batch);
        let run = |name: &str| {
            fs::create_dir(path.join(RUNS).join(name)).unwrap();
            fs::write(path.join(RUNS).join(name).join(JOURNAL), "").unwrap();
        };
        ["A-1", "A-2", "A-3", "A-3-2"].into_iter().for_each(run);
        fs::create_dir(path.join(RUNS).join("notes")).unwrap();
        let whole = fs::read(path.join(JOURNAL)).unwrap();
        BatchFolder::open(&path).expect("A-3 was interrupted in its second run");
        // each cut at a line end after the beginning, until A-1 begins
        let ends: Vec<usize> = (0..whole.len()).filter(|at| whole[*at] == b'\n').map(|at| at + 1).collect();
        let lost = ["runs/A-1", "runs/A-2", "runs/A-3, runs/A-3-2"];
        for (cut, first) in [(1, 2), (2, 2), (3, 1), (4, 1), (5, 0)] {
            let journal = &whole[..ends[ends.len() - 1 - cut]];
            fs::write(path.join(JOURNAL), journal).unwrap();
            let text = BatchFolder::open(&path).unwrap_err().to_string();
            assert!(
                text.ends_with(&format!("journal.log doesn't have the runs {}", lost[first..].join(", "))),
                "{cut}: {text}"
            );
            assert_eq!(fs::read(path.join(JOURNAL)).unwrap(), journal);
        }
        fs::write(path.join(JOURNAL), &whole).unwrap();
        run("A-1-2"); // a retry that the journal has lost: A-1 had ended
        let text = BatchFolder::open(&path).unwrap_err().to_string();
        assert!(text.ends_with("doesn't have the runs runs/A-1-2"), "{text}");
    }

    /// Largest number of times that a held folder is opened again.
    const OPENS_MOST: usize = 100_000;

    #[test]
    fn batch_journal_cut_at_any_byte_loses_no_event_and_judges_nothing_twice() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("day");
        let mut batch = created(&path);
        let journal = path.join(JOURNAL);
        let mut ends = Vec::new();
        for event in events() {
            batch.record(&event).unwrap();
            ends.push(fs::metadata(&journal).unwrap().len() as usize);
        }
        drop(batch);
        let whole = fs::read(&journal).unwrap();
        let kept_after = |cut: usize| ends.iter().filter(|end| **end <= cut).count();
        for cut in ends[1]..=whole.len() {
            fs::write(&journal, &whole[..cut]).unwrap();
            let kept = kept_after(cut);
            assert_eq!(read_state(&path).unwrap().mountings, [1, 2, 2, 3][kept - 2], "{cut}");
            // a program that another test starts holds the lock until it executes
            let opened = (0..OPENS_MOST).find_map(|_| match BatchFolder::open(&path) {
                Err(BatchError::Held { .. }) => None,
                other => Some(other),
            });
            let mut batch = opened.expect("not held for long").unwrap();
            let sensor_state = |batch: &BatchFolder, serial: &str| batch.state().item(serial).unwrap().sensor_state;
            let expected =
                [SensorState::Waiting, SensorState::Interrupted, SensorState::Accepted, SensorState::Accepted]
                    [kept - 2];
            assert_eq!(
                (sensor_state(&batch, "A-1"), sensor_state(&batch, "A-2")),
                (SensorState::Accepted, expected),
                "{cut}"
            );
            // a sensor that began or has its result isn't begun again, and the batch continues
            assert_eq!(batch.state().admit("A-2", &[]).is_ok(), kept == 2, "{cut}");
            assert!(batch.state().admit("A-1", &[]).is_err());
            let last = batch.state().clone();
            batch.record(&BatchEvent::Noted { at: at(), serial: "A-1".to_owned(), note: "n".to_owned() }).unwrap();
            drop(batch);
            let noted = read_state(&path).unwrap();
            assert_eq!(noted.item("A-1").unwrap().note.as_deref(), Some("n"));
            assert_eq!((noted.items[1..].to_vec(), noted.mountings), (last.items[1..].to_vec(), last.mountings));
        }
    }

    #[test]
    fn batch_has_one_writer_and_any_number_of_readers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("day");
        let batch = created(&path);
        let held = BatchFolder::open(&path).unwrap_err();
        assert!(matches!(held, BatchError::Held { .. }), "{held}");
        assert_eq!(read_state(&path).unwrap(), *batch.state());
        drop(batch);
        BatchFolder::open(&path).unwrap();
        assert_eq!(fs::read_to_string(path.join("batch.toml")).unwrap(), texts()[0].text);
    }

    #[test]
    fn an_event_that_contradicts_the_batch_is_not_recorded() {
        let folder = tempfile::tempdir().unwrap();
        let mut batch = created(&folder.path().join("day"));
        let before = (batch.state().clone(), fs::read(batch.path().join(JOURNAL)).unwrap());
        let error = batch.record(&began("B-1")).unwrap_err().to_string();
        assert!(error.ends_with("the batch has no sensor \"B-1\""), "{error}");
        assert_eq!((batch.state().clone(), fs::read(batch.path().join(JOURNAL)).unwrap()), before);
    }

    #[test]
    fn run_folder_and_batch_folder_are_not_confused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("day");
        drop(created(&path));
        let as_run = palpate_data::dataset::Recorded::read(&path).unwrap_err().to_string();
        assert!(as_run.ends_with("the journal of a batch, not of a run"), "{as_run}");
        let missing = read_state(folder.path()).unwrap_err().to_string();
        assert!(missing.ends_with("is not a batch folder (journal.log not found)"), "{missing}");
    }

    #[test]
    fn a_run_never_takes_the_name_of_another_sensor_or_of_a_folder_that_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("day");
        let facts = Facts {
            format: 1,
            name: "day".to_owned(),
            reference: Some(ReferenceSensor { serial: "S-3".to_owned(), every: 1 }),
            ..Facts::default()
        };
        let serials = ["S", "S-2"].map(str::to_owned);
        let batch =
            BatchFolder::create(&path, "day", &beginning(facts, &texts(), &serials, BatchSession::default())).unwrap();
        let next = || batch.next_run("S").unwrap();
        assert_eq!(next(), "runs/S");
        fs::create_dir(path.join("runs/S")).unwrap();
        assert_eq!(next(), "runs/S-4", "S-2 and S-3 are sensors");
        fs::create_dir(path.join("runs/S-4")).unwrap();
        assert_eq!(next(), "runs/S-5");
    }

    #[test]
    fn five_thousand_sensors_are_read_in_one_pass() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("day");
        let facts = Facts { format: 1, name: "day".to_owned(), ..Facts::default() };
        let serials: Vec<String> = (0..5000).map(|number| format!("S{number}")).collect();
        let mut batch =
            BatchFolder::create(&path, "day", &beginning(facts, &texts(), &serials, BatchSession::default())).unwrap();
        batch.journal.keep_for(palpate_data::dataset::Durability::Fast);
        for serial in &serials {
            batch.journal.append(&began(serial)).unwrap();
            batch.journal.append(&ended(serial, Status::Complete, Some(SensorVerdict::Accepted))).unwrap();
        }
        drop(batch);
        let state = read_state(&path).unwrap();
        assert_eq!((state.count(SensorState::Accepted), state.mountings), (5000, 5000));
    }
}
