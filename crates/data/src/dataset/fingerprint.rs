//! Identifies a file by its content: its size and its SHA-256.

use super::files;
use palpate_core::quantity::hexadecimal;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;

/// Fingerprint of a file's content.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// Name in the run folder.
    pub name: String,
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256 of its bytes, in hexadecimal.
    pub sha256: String,
}

impl Fingerprint {
    /// Returns the fingerprint of some bytes, with a name.
    pub fn of(name: &str, bytes: &[u8]) -> Fingerprint {
        Fingerprint { name: name.to_owned(), bytes: bytes.len() as u64, sha256: hexadecimal(&Sha256::digest(bytes)) }
    }

    /// Returns the fingerprint of a file in a folder. The file is read piece by piece.
    ///
    /// # Errors
    /// Returns an error if the name leads out of the folder or the file isn't regular, or the operating system's error.
    pub(super) fn of_file(folder: &Path, name: &str) -> io::Result<Fingerprint> {
        Fingerprint::of_start(folder, name, u64::MAX)
    }

    /// Returns the fingerprint of a file's first bytes, at most `most_bytes`.
    pub(super) fn of_start(folder: &Path, name: &str, most_bytes: u64) -> io::Result<Fingerprint> {
        if !is_plain(name) {
            let text = format!("{name:?} is not a valid name of a file in a run folder");
            return Err(io::Error::new(ErrorKind::InvalidInput, text));
        }
        Fingerprint::of_reader(name, files::open(&folder.join(name))?.take(most_bytes))
    }

    /// Returns the fingerprint of all bytes of an input, read piece by piece.
    pub(super) fn of_reader(name: &str, mut input: impl Read) -> io::Result<Fingerprint> {
        let mut hasher = Hasher(Sha256::new());
        let bytes = io::copy(&mut input, &mut hasher)?;
        Ok(Fingerprint { name: name.to_owned(), bytes, sha256: hexadecimal(&hasher.0.finalize()) })
    }

    /// Returns a description of what is wrong with the file of this name in a folder; `None` if the file is unchanged.
    pub(super) fn problem_in(&self, folder: &Path) -> io::Result<Option<String>> {
        let name = &self.name;
        Ok(match Fingerprint::of_file(folder, name) {
            Ok(found) if found == *self => None,
            Ok(found) if found.bytes != self.bytes => {
                Some(format!("{name} has {} bytes, but was written with {}", found.bytes, self.bytes))
            }
            Ok(_) => Some(format!("{name} has changed since it was written (its SHA-256 differs)")),
            Err(error) if error.kind() == ErrorKind::NotFound => Some(format!("{name} is missing")),
            Err(error) if error.kind() == ErrorKind::InvalidInput => Some(error.to_string()),
            Err(error) => return Err(error),
        })
    }
}

/// Hashes what is written to it.
struct Hasher(Sha256);

impl Write for Hasher {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Whether a name can't lead out of its folder, because it has only one plain part, and can be printed.
pub(super) fn is_plain(name: &str) -> bool {
    let is_other = |c: char| c.is_control() || matches!(c, '/' | '\\' | ':');
    !name.is_empty() && !name.contains(is_other) && name != "." && name != ".."
}
