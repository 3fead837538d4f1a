//! Checks whether a run folder is unchanged: compares journal, manifest and tables in every direction.

use super::fingerprint::is_plain;
use super::foreign::foreign;
use super::journal::JOURNAL;
use super::known::{JournalSummary, check_run};
use super::lock::is_held;
use super::loss::lost;
use super::manifest::MANIFEST;
use super::press::{csv_header, csv_line};
use super::views::{PRESSES, TABLES, write};
use super::{DatasetError, Fingerprint, Journal, JournalError, Loss, Manifest, Record, files, series};
use palpate_core::quantity::ArrayLayout;
use std::collections::HashSet;
use std::hash::{BuildHasher, RandomState};
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::Path;

/// Changes of a run since it was written.
#[derive(Debug, Default)]
pub struct Verified {
    /// Number of records of the journal.
    pub records: u64,
    /// Number of unchanged files.
    pub sound: u64,
    /// Whether the journal states that the run has ended. A run that was killed, or is in progress, may have tables without all
    /// presses.
    pub has_ended: bool,
    /// Whether a program is writing the run now, so that its tables weren't compared.
    pub is_under_way: bool,
    /// Losses and other journals that a person accepted.
    pub losses: Vec<Loss>,
    /// Position of the first damaged record of the journal, bytes.
    pub damaged_at: Option<u64>,
    /// Descriptions of what differs from the written run.
    pub problems: Vec<String>,
}

/// Compares a run folder with its journal. Texts are compared by their SHA-256 in the journal, and tables by regenerating them.
/// All files are compared by their SHA-256 in the manifest, and by the presses that each contains.
///
/// # Errors
/// The path isn't a run, or a file can't be read. Damage is listed in the problems. `layout` is that of the rig in the journal;
/// `None` if the journal has lost the rig too.
pub fn verify(path: &Path, layout: Option<&ArrayLayout>) -> Result<Verified, DatasetError> {
    check_run(path)?;
    let mut verified = Verified::default();
    let known = match JournalSummary::read(path, layout.map(ArrayLayout::len)) {
        Ok((known, _)) => known,
        Err(DatasetError::Journal(error @ JournalError::Damaged { offset, .. })) => {
            verified.damaged_at = Some(offset);
            verified.records =
                Journal::<Record>::records(&path.join(JOURNAL))?.take_while(Result::is_ok).count() as u64;
            verified.problems.push(format!("{error}; the {} records before it are sound", verified.records));
            return Ok(verified);
        }
        Err(error) => return Err(error),
    };
    verified.records = known.records;
    verified.has_ended = known.end.is_some();
    verified.losses.clone_from(&known.manifest.losses);
    let is_under_way = known.end.is_none() && is_held(path);
    let foreign = if is_under_way { Vec::new() } else { foreign(path, &known)? };
    if !foreign.is_empty() {
        // no other file in the folder is compared with it
        verified.problems.push(DatasetError::Foreign { path: path.to_owned(), found: foreign }.to_string());
        return Ok(verified);
    }
    verified.compare(path, known.manifest.texts())?;
    let Some(layout) = layout else {
        verified.problems.push(format!("{JOURNAL} has lost its beginning: the first record is missing"));
        return Ok(verified);
    };
    if is_under_way {
        verified.is_under_way = true; // its tables grow while they are read
        return Ok(verified);
    }
    verified.problems.extend(lost(path, &known)?);
    verified.problems.extend(series::problems(path, verified.has_ended)?);
    if !verified.has_ended {
        verified.problems.extend(stray_lines(path, layout, &known)?);
        return Ok(verified);
    }
    let found = fingerprints(path, known.manifest.texts())?;
    match Manifest::read(&path.join(MANIFEST)) {
        Err(error) => verified.problems.push(error.to_string()),
        Ok(words) => {
            let is_text = |file: &&Fingerprint| known.manifest.texts().iter().any(|text| text.name == file.name);
            let vouched: Vec<Fingerprint> = words.files.iter().filter(|file| !is_text(file)).cloned().collect();
            verified.compare(path, &vouched)?;
            for file in found.iter().filter(|file| !words.files.iter().any(|other| other.name == file.name)) {
                verified.problems.push(format!("{MANIFEST} has no SHA-256 of {}", file.name));
            }
            if words != (Manifest { files: words.files.clone(), ..known.manifest.clone() }) {
                verified.problems.push(format!("{MANIFEST} differs from the journal"));
            }
        }
    }
    let again = tables_again(path, layout, &known)?;
    for name in TABLES {
        let of = |files: &[Fingerprint]| files.iter().find(|file| file.name == name).cloned();
        if of(&again) != of(&found) {
            verified.problems.push(format!("{name} differs from the journal"));
        }
    }
    Ok(verified)
}

impl Verified {
    /// Compares files with their fingerprints.
    fn compare(&mut self, path: &Path, files: &[Fingerprint]) -> Result<(), DatasetError> {
        for file in files {
            match file.problem_in(path).map_err(DatasetError::io("reading", path.join(&file.name)))? {
                None => self.sound += 1,
                Some(problem) => self.problems.push(problem),
            }
        }
        Ok(())
    }
}

/// Returns the fingerprints of all files of a run except its manifest.
pub(super) fn fingerprints(folder: &Path, texts: &[Fingerprint]) -> Result<Vec<Fingerprint>, DatasetError> {
    let texts = texts.iter().map(|text| text.name.as_str());
    let mut found = Vec::new();
    for name in texts.chain([JOURNAL]).chain(TABLES).filter(|name| is_plain(name)) {
        match Fingerprint::of_file(folder, name) {
            Ok(fingerprint) => found.push(fingerprint),
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(DatasetError::io("reading", folder.join(name))(error)),
        }
    }
    Ok(found)
}

/// Returns the tables that follow from a journal. They are written to a temporary folder, which is then removed.
fn tables_again(path: &Path, layout: &ArrayLayout, known: &JournalSummary) -> Result<Vec<Fingerprint>, DatasetError> {
    let folder = std::env::temp_dir().join(format!(".palpate-verify-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder); // of a killed program with this number
    std::fs::create_dir(&folder).map_err(DatasetError::io("making", &folder))?;
    let contacts = || Ok(known.contacts.contacts(Journal::records(&path.join(JOURNAL))?));
    let made = write(&folder, layout, known.manifest.facts.columns(), &contacts, &known.trips)
        .and_then(|()| fingerprints(&folder, &[]));
    std::fs::remove_dir_all(&folder).map_err(DatasetError::io("removing", &folder))?;
    made
}

/// Returns the lines of a growing table of presses that don't belong to a press of the journal. A line that was cut off by a kill
/// doesn't count.
fn stray_lines(path: &Path, layout: &ArrayLayout, known: &JournalSummary) -> Result<Option<String>, DatasetError> {
    let table = path.join(PRESSES);
    let failed = |error| DatasetError::io("reading", &table)(error);
    let file = match files::open(&table) {
        Ok(file) => file,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None), // it may have been killed before
        Err(error) => return Err(failed(error)),
    };
    let (hasher, columns) = (RandomState::new(), known.manifest.facts.columns());
    let mut expected = HashSet::from([hasher.hash_one(csv_header(layout.len(), columns).as_bytes())]);
    for contact in known.contacts.contacts(Journal::records(&path.join(JOURNAL))?) {
        expected.extend(contact?.levels.iter().map(|press| hasher.hash_one(csv_line(press, columns).as_bytes())));
    }
    let (mut reader, mut line, mut number) = (BufReader::new(file), Vec::new(), 0);
    loop {
        line.clear();
        reader.read_until(b'\n', &mut line).map_err(failed)?;
        if line.last() != Some(&b'\n') {
            return Ok(None);
        }
        number += 1;
        if !expected.contains(&hasher.hash_one(line.as_slice())) {
            return Ok(Some(format!("{PRESSES}, line {number} differs from the journal")));
        }
    }
}
