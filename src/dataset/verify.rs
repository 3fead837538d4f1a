use super::folder::{JOURNAL, MANIFEST, is_run};
use super::views::TABLES;
use super::{DatasetError, Fingerprint, Journal, JournalError, Manifest, RunFolder};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// How much of a file is hashed at once, bytes.
const CHUNK_BYTES: usize = 64 << 10;

/// What became of a run since it was written.
#[derive(Debug)]
pub struct Verified {
    /// Records of its journal.
    pub records: u64,
    /// Files that are as they were written.
    pub sound: u64,
    /// Whether its manifest says what its files were: a run that was killed, or is under way, has none that does.
    pub has_ended: bool,
    /// What isn't as it was written, in words.
    pub problems: Vec<String>,
}

/// Holds a run folder against its journal, and its files against what the manifest says they were.
///
/// # Errors
/// No run, or a file that can't be read. What is damaged is among the problems.
pub fn verify(path: &Path) -> Result<Verified, DatasetError> {
    is_run(path)?;
    let mut verified = Verified { records: 0, sound: 0, has_ended: false, problems: Vec::new() };
    for record in Journal::records(&path.join(JOURNAL))? {
        match record {
            Ok(_) => verified.records += 1,
            Err(error @ JournalError::Damaged { .. }) => verified.problems.push(error.to_string()),
            Err(error) => return Err(error.into()),
        }
    }
    let told = match RunFolder::recall_manifest(path) {
        Ok(told) => told,
        Err(DatasetError::Journal(JournalError::Damaged { .. })) => return Ok(verified), // told already
        Err(error) => return Err(error),
    };
    verified.hold(path, told.texts())?;
    let manifest = match Manifest::read(&path.join(MANIFEST)) {
        Ok(manifest) => manifest,
        Err(error) => {
            verified.problems.push(error.to_string());
            return Ok(verified);
        }
    };
    if manifest.files.is_empty() {
        return Ok(verified);
    }
    verified.has_ended = true;
    let texts = |file: &&Fingerprint| !told.texts().iter().any(|text| text.name == file.name);
    let files: Vec<Fingerprint> = manifest.files.iter().filter(texts).cloned().collect();
    verified.hold(path, &files)?;
    if (Manifest { files: manifest.files.clone(), ..told }) != manifest {
        verified.problems.push(format!("{MANIFEST} doesn't say what the journal says"));
    }
    Ok(verified)
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

    /// The fingerprint of a file, read piece by piece.
    pub(super) fn of_file(folder: &Path, name: &str) -> io::Result<Fingerprint> {
        let mut file = File::open(folder.join(name))?;
        let (mut hasher, mut bytes, mut chunk) = (Sha256::new(), 0, vec![0; CHUNK_BYTES]);
        loop {
            match file.read(&mut chunk)? {
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
        if !is_plain(name) {
            return Ok(Some(format!("{name:?} is no name of a file in a run folder: it isn't looked at")));
        }
        match Fingerprint::of_file(folder, name) {
            Ok(found) if found == *self => Ok(None),
            Ok(found) if found.bytes != self.bytes => {
                Ok(Some(format!("{name} has {} bytes; it was written with {}", found.bytes, self.bytes)))
            }
            Ok(_) => Ok(Some(format!("{name} isn't as it was written: its SHA-256 is another"))),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Some(format!("{name} is missing"))),
            Err(error) => Err(DatasetError::io("reading", folder.join(name))(error)),
        }
    }
}

/// The fingerprints of all files of a run but its manifest.
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
