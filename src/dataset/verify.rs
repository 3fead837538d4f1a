use super::folder::{JOURNAL, Known, MANIFEST, check_run};
use super::views::{TABLES, write};
use super::{DatasetError, Fingerprint, Journal, JournalError, Manifest, Record};
use crate::quantity::ArrayLayout;
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// How much of a file is hashed at once, bytes.
const CHUNK_BYTES: usize = 64 << 10;

/// What became of a run since it was written.
#[derive(Debug, Default)]
pub struct Verified {
    /// Records of its journal.
    pub records: u64,
    /// Files that are as they were written.
    pub sound: u64,
    /// Whether the journal says that the run has ended. Of one that was killed, or is under way, the tables aren't looked at.
    pub has_ended: bool,
    /// What isn't as it was written, in words.
    pub problems: Vec<String>,
}

/// Holds a run folder against its journal: the texts by their SHA-256 in it, the tables by making them anew, and all files by
/// their SHA-256 in the manifest.
///
/// # Errors
/// No run, or a file that can't be read. What is damaged is among the problems.
pub fn verify(path: &Path, layout: &ArrayLayout) -> Result<Verified, DatasetError> {
    check_run(path)?;
    let mut verified = Verified::default();
    let mut known = Known::of(Some(layout.len()));
    let mut records = Journal::records(&path.join(JOURNAL))?;
    while let Some(next) = records.next() {
        let taken = next.and_then(|(offset, record)| {
            verified.has_ended = matches!(record, Record::End(_));
            known.take_in(offset, &record).map_err(|problem| records.damaged(offset, problem))
        });
        match taken {
            Ok(()) => verified.records += 1,
            Err(error @ JournalError::Damaged { .. }) => {
                verified.problems.push(error.to_string());
                return Ok(verified);
            }
            Err(error) => return Err(error.into()),
        }
    }
    verified.hold(path, known.manifest.texts())?;
    if !verified.has_ended {
        return Ok(verified);
    }
    let files = fingerprints(path, known.manifest.texts())?;
    match Manifest::read(&path.join(MANIFEST)) {
        Err(error) => verified.problems.push(error.to_string()),
        Ok(told) => {
            let is_text = |file: &&Fingerprint| known.manifest.texts().iter().any(|text| text.name == file.name);
            let vouched: Vec<Fingerprint> = told.files.iter().filter(|file| !is_text(file)).cloned().collect();
            verified.hold(path, &vouched)?;
            for file in files.iter().filter(|file| !told.files.iter().any(|other| other.name == file.name)) {
                verified.problems.push(format!("{MANIFEST} doesn't vouch for {}", file.name));
            }
            if told != (Manifest { files: told.files.clone(), ..known.manifest.clone() }) {
                verified.problems.push(format!("{MANIFEST} doesn't say what the journal says"));
            }
        }
    }
    let anew = tables_anew(path, layout, &known)?;
    for name in TABLES {
        let of = |files: &[Fingerprint]| files.iter().find(|file| file.name == name).cloned();
        if of(&anew) != of(&files) {
            verified.problems.push(format!("{name} isn't what the journal says"));
        }
    }
    Ok(verified)
}

/// The tables that follow from a journal, made in a folder that is taken away again.
fn tables_anew(path: &Path, layout: &ArrayLayout, known: &Known) -> Result<Vec<Fingerprint>, DatasetError> {
    let folder = std::env::temp_dir().join(format!(".palpate-verify-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder); // of a program of this number that was killed
    std::fs::create_dir(&folder).map_err(DatasetError::io("making", &folder))?;
    let contacts = || Ok(known.contacts.contacts(Journal::records(&path.join(JOURNAL))?));
    let made = write(&folder, layout, &contacts).and_then(|()| fingerprints(&folder, &[]));
    std::fs::remove_dir_all(&folder).map_err(DatasetError::io("removing", &folder))?;
    made
}

/// What of a run's files isn't as its manifest vouches for, in words; nothing is said of a run under way.
///
/// # Errors
/// A file that can't be read.
pub fn altered(path: &Path, manifest: &Manifest) -> Result<Vec<String>, DatasetError> {
    let problems = manifest.files.iter().map(|file| file.problem_in(path));
    Ok(problems.collect::<Result<Vec<Option<String>>, DatasetError>>()?.into_iter().flatten().collect())
}

impl Verified {
    /// Holds files against their fingerprints.
    fn hold(&mut self, path: &Path, files: &[Fingerprint]) -> Result<(), DatasetError> {
        for file in files {
            match file.problem_in(path)? {
                None => self.sound += 1,
                Some(problem) => self.problems.push(problem),
            }
        }
        Ok(())
    }
}

impl Fingerprint {
    /// The fingerprint of some bytes under a name.
    pub fn of(name: &str, bytes: &[u8]) -> Fingerprint {
        Fingerprint { name: name.to_owned(), bytes: bytes.len() as u64, sha256: hex(&Sha256::digest(bytes)) }
    }

    /// The fingerprint of a plain file of a folder, read piece by piece.
    ///
    /// # Errors
    /// A name that leads elsewhere, what is no file, or the operating system's.
    pub(super) fn of_file(folder: &Path, name: &str) -> Result<Fingerprint, DatasetError> {
        let path = folder.join(name);
        let failed = |error| DatasetError::io("reading", &path)(error);
        if !is_plain(name) || !path.is_file() {
            let told = format!("{name:?} is no name of a file in a run folder");
            let kind = if is_plain(name) && !path.exists() { ErrorKind::NotFound } else { ErrorKind::InvalidInput };
            return Err(failed(io::Error::new(kind, told)));
        }
        let mut file = File::open(&path).map_err(failed)?;
        let (mut hasher, mut bytes, mut chunk) = (Sha256::new(), 0, vec![0; CHUNK_BYTES]);
        loop {
            match file.read(&mut chunk).map_err(failed)? {
                0 => break,
                count => {
                    hasher.update(&chunk[..count]);
                    bytes += count as u64;
                }
            }
        }
        Ok(Fingerprint { name: name.to_owned(), bytes, sha256: hex(&hasher.finalize()) })
    }

    /// What is wrong with the file of this name in a folder, in words; none where it is as it was written.
    fn problem_in(&self, folder: &Path) -> Result<Option<String>, DatasetError> {
        let name = &self.name;
        Ok(match Fingerprint::of_file(folder, name) {
            Ok(found) if found == *self => None,
            Ok(found) if found.bytes != self.bytes => {
                Some(format!("{name} has {} bytes; it was written with {}", found.bytes, self.bytes))
            }
            Ok(_) => Some(format!("{name} isn't as it was written: its SHA-256 is another")),
            Err(DatasetError::Io { why, .. }) if why.kind() == ErrorKind::NotFound => {
                Some(format!("{name} is missing"))
            }
            Err(DatasetError::Io { why, .. }) if why.kind() == ErrorKind::InvalidInput => Some(why.to_string()),
            Err(error) => return Err(error),
        })
    }
}

/// The fingerprints of all files of a run but its manifest.
pub(super) fn fingerprints(folder: &Path, texts: &[Fingerprint]) -> Result<Vec<Fingerprint>, DatasetError> {
    let texts = texts.iter().map(|text| text.name.as_str());
    let mut found = Vec::new();
    for name in texts.chain([JOURNAL]).chain(TABLES).filter(|name| is_plain(name)) {
        match Fingerprint::of_file(folder, name) {
            Ok(fingerprint) => found.push(fingerprint),
            Err(DatasetError::Io { why, .. }) if why.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
    }
    Ok(found)
}

/// A name that can't lead out of its folder: one plain part.
fn is_plain(name: &str) -> bool {
    !name.is_empty() && !name.contains(['/', '\\', ':', '\0']) && name != "." && name != ".."
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}"); // writing to a string can't fail
        text
    })
}
