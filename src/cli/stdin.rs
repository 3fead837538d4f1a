//! `-` as the name of a file: standard input. It is read once and kept, because a table is read and its SHA-256 is recorded.

use super::Command;
use super::exit::Failure;
use palpate_data::dataset::{
    DatasetError, Fingerprint, MAX_TABLE_BYTES, Mapping, Presses, TableError, parse_table, read_table,
    source_fingerprint,
};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::OnceLock;

/// Name of standard input on the command line, and in messages and records.
const DASH: &str = "-";
const NAME: &str = "standard input";

/// Checks that standard input is named once, and only by a command that doesn't read readings or serial numbers from it.
pub(super) fn check(command: &Command) -> Result<(), Failure> {
    let names = std::env::args_os().skip(1).filter(|word| word == DASH).count();
    let help = "save it as a file, and name that";
    let refused = match command {
        _ if names == 0 => return Ok(()),
        Command::Solve(_) | Command::Serve(_) => "standard input has the readings: `-` can't be another file",
        Command::Batch(_) => "standard input has the serial numbers: `-` can't be another file",
        _ if names > 1 => "`-` is standard input, and is named twice",
        _ => return Ok(()),
    };
    Err(Failure::usage(miette::miette!(help = help, "{refused}")))
}

/// Opens a file, or standard input.
pub(super) fn open(path: &Path) -> io::Result<Box<dyn Read>> {
    if is_stdin(path) { Ok(Box::new(content()?)) } else { Ok(Box::new(File::open(path)?)) }
}

/// Reads a table of presses from a file or from standard input, where it is text.
pub(super) fn table(path: &Path, mapping: &Mapping) -> Result<Presses, TableError> {
    if !is_stdin(path) {
        return read_table(path, mapping);
    }
    let unreadable = |source| TableError::Unreadable { file: NAME.to_owned(), source };
    parse_table(NAME, content().map_err(unreadable)?, mapping)
}

/// Fingerprint of a file, of a run's journal, or of standard input.
pub(super) fn fingerprint(path: &Path) -> Result<Fingerprint, DatasetError> {
    if !is_stdin(path) {
        return source_fingerprint(path);
    }
    Ok(Fingerprint::of(NAME, content().map_err(DatasetError::io("reading", path))?))
}

/// Whether a path is `-`.
pub(super) fn is_stdin(path: &Path) -> bool {
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
