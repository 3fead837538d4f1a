//! `-` as the name of a file: standard input. It is read once and kept, because a table is read and its SHA-256 is recorded.

use palpate_data::dataset::{
    DatasetError, Fingerprint, MAX_TABLE_BYTES, Mapping, Presses, TableError, parse_table, read_table,
    source_fingerprint,
};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::OnceLock;

/// Name of standard input on the command line, and in messages and records.
pub(crate) const DASH: &str = "-";
const NAME: &str = "standard input";

/// Opens a file, or standard input.
pub(crate) fn open(path: &Path) -> io::Result<Box<dyn Read>> {
    if is_stdin(path) { Ok(Box::new(content()?)) } else { Ok(Box::new(File::open(path)?)) }
}

/// Reads a table of presses from a file or from standard input, where it is text.
pub(crate) fn table(path: &Path, mapping: &Mapping) -> Result<Presses, TableError> {
    if !is_stdin(path) {
        return read_table(path, mapping);
    }
    let unreadable = |source| TableError::Unreadable { file: NAME.to_owned(), source };
    parse_table(NAME, content().map_err(unreadable)?, mapping)
}

/// Fingerprint of a file, of a run's journal, or of standard input.
pub(crate) fn fingerprint(path: &Path) -> Result<Fingerprint, DatasetError> {
    if !is_stdin(path) {
        return source_fingerprint(path);
    }
    Ok(Fingerprint::of(NAME, content().map_err(DatasetError::io("reading", path))?))
}

/// Whether a path is `-`.
pub(crate) fn is_stdin(path: &Path) -> bool {
    path.as_os_str() == DASH
}

/// Returns all of standard input, up to one byte more than a table may have.
fn content() -> io::Result<&'static [u8]> {
    static CONTENT: OnceLock<Vec<u8>> = OnceLock::new();
    if CONTENT.get().is_none() {
        let mut bytes = Vec::new();
        io::stdin().lock().take(MAX_TABLE_BYTES + 1).read_to_end(&mut bytes)?;
        let _ = CONTENT.set(bytes);
    }
    Ok(CONTENT.get().map_or(&[], Vec::as_slice))
}
