//! Reads runs: the complete content of a run's journal, in one pass.

use super::foreign::foreign;
use super::journal::JOURNAL;
use super::known::{JournalSummary, check_run};
use super::lock::is_held;
use super::loss::lost;
use super::manifest::MANIFEST;
use super::press::{csv_header, csv_line};
use super::table_error::MAX_TABLE_BYTES;
use super::views::PRESSES;
use super::{
    DatasetError, Fingerprint, Journal, Manifest, Presses, Record, RecordedCheck, RecordedContact, RecordedText,
    Retouch, SeriesMark, files,
};
use palpate_control::Trip;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};

/// File names of the two text files that every run of this program uses.
pub(super) const RECIPE: &str = "recipe.toml";
pub(super) const RIG: &str = "rig.toml";
/// File name of the columns file of an import.
pub(super) const COLUMNS: &str = "columns.toml";

/// A run, read from its journal.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// The run folder.
    pub path: PathBuf,
    /// Description of the run and its ending, without the files' fingerprints.
    pub manifest: Manifest,
    /// Texts that the run uses.
    pub texts: Texts,
    /// Zeros measured without load: time, s since the run's start, and the load cell's reading, N.
    pub zeros: Vec<(f64, f64)>,
    /// Broken rules: time, s, the press and the rule.
    pub trips: Vec<(f64, Option<u64>, Trip)>,
    /// Places that were touched again before the run continued.
    pub retouches: Vec<Retouch>,
    /// Checks in the order of measurement.
    pub checks: Vec<RecordedCheck>,
    /// File of readings after the last contact; `None` if none are kept.
    pub series: Option<SeriesMark>,
    /// Contacts in the order of measurement.
    pub contacts: Vec<RecordedContact>,
    /// Whether the run has ended, and nothing was measured or lost after its end.
    pub has_ended: bool,
}

/// Texts of a run, from its journal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Texts {
    all: Vec<RecordedText>,
}

impl Recorded {
    /// Reads a run's journal.
    ///
    /// # Errors
    /// The path isn't a run. Or its journal is damaged, contains fewer presses than the other files of the run, or can't be read.
    pub fn read(path: &Path) -> Result<Recorded, DatasetError> {
        let mut contacts = Vec::new();
        let read = Recorded::read_each(path, |_, _, contact| -> Result<(), DatasetError> {
            contacts.push(contact);
            Ok(())
        });
        Ok(Recorded { contacts, ..read? })
    }

    /// Reads a run's journal and passes each contact on, with the manifest so far and the texts. The returned run has no
    /// contacts, so its memory doesn't grow with them.
    ///
    /// # Errors
    /// The same as for [`read`](Self::read), and those of `accept`.
    pub fn read_each<E: From<DatasetError>>(
        path: &Path,
        mut accept: impl FnMut(&Manifest, &Texts, RecordedContact) -> Result<(), E>,
    ) -> Result<Recorded, E> {
        check_run(path)?;
        let mut known = JournalSummary::of(None);
        let mut texts = None;
        let (mut zeros, mut trips, mut retouches, mut checks) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut records = Journal::records(&path.join(JOURNAL)).map_err(DatasetError::from)?;
        while let Some(next) = records.next() {
            let (offset, record) = next.map_err(DatasetError::from)?;
            let taken = known.take_in(offset, &record);
            taken.map_err(|problem| DatasetError::from(records.damaged(offset, problem)))?;
            match record {
                Record::Zero { t_s, offset_n, .. } => zeros.push((t_s, offset_n)),
                Record::Trip { t_s, press, trip, .. } => trips.push((t_s, press, trip)),
                Record::Retouch(retouch) => retouches.push(retouch),
                Record::Check(check) => checks.push(check),
                Record::Contact(contact) => {
                    let texts = texts.get_or_insert_with(|| Texts::of(&known.texts));
                    accept(&known.manifest, texts, contact)?;
                }
                _ => {}
            }
        }
        // the tables of a run under way grow while they would be read
        if !is_held(path) {
            check_manifest(path, &known)?;
            let lost = lost(path, &known)?;
            if !lost.is_empty() {
                return Err(DatasetError::Lost { path: path.to_owned(), lost }.into());
            }
        }
        let (has_ended, series) = (known.end.is_some(), known.series);
        let (manifest, texts) = (known.manifest, Texts { all: known.texts });
        let contacts = Vec::new();
        let path = path.to_owned();
        Ok(Recorded { path, manifest, texts, zeros, trips, retouches, checks, series, contacts, has_ended })
    }

    /// Returns the presses, in the order of the plan.
    pub fn presses(&self) -> Presses {
        let mut presses = Presses::of_contacts(&self.path.display().to_string(), &self.contacts);
        presses.cell = self.checks.iter().map(|check| check.cell).fold(0.0, f64::max);
        presses
    }

    /// Returns the name of the run's folder, even if the path has no name, such as `.`.
    pub fn name(&self) -> String {
        let whole = if self.path.file_name().is_none() { self.path.canonicalize().ok() } else { None };
        let path = whole.as_deref().unwrap_or(&self.path);
        path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
    }

    /// Returns the differences between the files for people and the journal, one line each. These files weren't used for the
    /// data. The table of a run that was killed or is in progress may lack presses.
    ///
    /// # Errors
    /// A file can't be read.
    pub fn warnings(&self) -> Result<Vec<String>, DatasetError> {
        let path = self.path.display();
        let mut warnings: Vec<String> = self.manifest.doubts().map(|doubt| format!("{path}: {doubt}")).collect();
        if let Some(problem) = self.has_ended.then(|| self.table_problem(PRESSES)).transpose()?.flatten() {
            warnings.push(format!(
                "{path}: {PRESSES} {problem}; the journal was read (`palpate rebuild` regenerates the table)"
            ));
        }
        if let Err(error @ DatasetError::Manifest { .. }) = Manifest::read(&self.path.join(MANIFEST)) {
            warnings.push(format!("{error}; the journal was read (`palpate rebuild` regenerates the manifest)"));
        }
        for text in self.manifest.texts() {
            if let Some(problem) =
                text.problem_in(&self.path).map_err(DatasetError::io("reading", self.path.join(&text.name)))?
            {
                warnings.push(format!("{path}: {problem}; the text in the journal was read instead"));
            }
        }
        Ok(warnings)
    }

    /// Returns the difference between a table, named by its path, and the journal; `None` if they agree.
    ///
    /// # Errors
    /// A file can't be read.
    pub fn table_problem(&self, name: &str) -> Result<Option<&'static str>, DatasetError> {
        let table = self.path.join(name);
        let presses = self.presses();
        let columns = self.manifest.facts.columns();
        let lines = presses.presses.iter().map(|press| csv_line(press, columns));
        let expected = csv_header(presses.channels, columns) + &lines.collect::<String>();
        let read = files::open(&table).and_then(|file| {
            let mut found = Vec::new();
            file.take(expected.len() as u64 + 1).read_to_end(&mut found).map(|_| found)
        });
        match read {
            Ok(found) if found == expected.as_bytes() => Ok(None),
            // an array without a press has no channels that the journal knows
            Ok(_) if presses.presses.is_empty() => Ok(None),
            Ok(_) => Ok(Some("differs from the journal")),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Some("is missing")),
            Err(error) if error.kind() == ErrorKind::InvalidInput => Ok(Some("isn't a regular file with one name")),
            Err(error) => Err(DatasetError::io("reading", table)(error)),
        }
    }
}

impl Texts {
    /// Returns the texts in the journal of a run, and its other content except the presses.
    ///
    /// # Errors
    /// The same as for [`Recorded::read`], except for missing presses.
    pub fn read(path: &Path) -> Result<(Manifest, Texts), DatasetError> {
        Texts::read_accepting(path, false)
    }

    /// Does the same. With `any_journal`, the journal needn't be the one that the manifest describes.
    ///
    /// # Errors
    /// The same as for [`read`](Self::read).
    pub fn read_accepting(path: &Path, any_journal: bool) -> Result<(Manifest, Texts), DatasetError> {
        check_run(path)?;
        let (known, _) = JournalSummary::read(path, None)?;
        if !any_journal && !is_held(path) {
            check_manifest(path, &known)?;
        }
        Ok((known.manifest, Texts { all: known.texts }))
    }

    pub(super) fn of(texts: &[RecordedText]) -> Texts {
        Texts { all: texts.to_vec() }
    }

    /// Returns the recipe.
    pub fn recipe(&self) -> &str {
        self.latest(RECIPE).unwrap_or_default()
    }

    /// Returns the rig that the run uses.
    pub fn rig(&self) -> &str {
        self.latest(RIG).unwrap_or_default()
    }

    /// Returns the columns file of an import; empty without one.
    pub fn columns(&self) -> &str {
        self.latest(COLUMNS).unwrap_or_default()
    }

    /// Returns the rig with which the run began.
    pub fn first_rig(&self) -> &str {
        self.all.iter().find(|text| text.name == RIG).map_or("", |text| text.text.as_str())
    }

    /// Returns the most recent text of that name.
    pub fn latest(&self, name: &str) -> Option<&str> {
        self.all.iter().rfind(|text| text.name == name).map(|text| text.text.as_str())
    }
}

/// Checks that a journal is the one that the manifest of its folder describes.
fn check_manifest(path: &Path, known: &JournalSummary) -> Result<(), DatasetError> {
    let found = foreign(path, known)?;
    if found.is_empty() { Ok(()) } else { Err(DatasetError::Foreign { path: path.to_owned(), found }) }
}

/// Returns the SHA-256 of a run's journal on the disk, in hexadecimal.
///
/// # Errors
/// The path isn't a run, or its journal can't be read.
pub fn journal_sha256(run: &Path) -> Result<String, DatasetError> {
    Ok(journal_fingerprint(run)?.sha256)
}

/// Returns the fingerprint of a source of presses: the journal of a run folder, or a table. Its name is that of the run or the
/// table.
///
/// # Errors
/// The path isn't a run, or the file can't be read.
pub fn source_fingerprint(path: &Path) -> Result<Fingerprint, DatasetError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if path.is_dir() {
        return Ok(Fingerprint { name, ..journal_fingerprint(path)? });
    }
    let read = File::open(path).and_then(|file| Fingerprint::of_reader(&name, file.take(MAX_TABLE_BYTES + 1)));
    let too_large = || io::Error::new(ErrorKind::InvalidInput, format!("more than {MAX_TABLE_BYTES} bytes"));
    let read = read.and_then(|found| if found.bytes > MAX_TABLE_BYTES { Err(too_large()) } else { Ok(found) });
    read.map_err(DatasetError::io("reading", path))
}

fn journal_fingerprint(run: &Path) -> Result<Fingerprint, DatasetError> {
    check_run(run)?;
    Fingerprint::of_file(run, JOURNAL).map_err(DatasetError::io("reading", run.join(JOURNAL)))
}
