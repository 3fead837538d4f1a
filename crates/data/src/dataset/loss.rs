//! Checks whether a journal contains all presses that the other files of its run state as recorded.

use super::journal::JOURNAL;
use super::known::JournalSummary;
use super::manifest::MANIFEST;
use super::views::{MATRICES, PRESSES, SCENE};
use super::{DatasetError, Fingerprint, Manifest, Status, files};
use std::collections::BTreeSet;
use std::io::{self, BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

/// Longest line of a table that is checked, bytes. This program doesn't write longer lines.
const LINE_MAX_BYTES: u64 = 16 << 20;

/// Largest number of ranges of press numbers in a message.
const STRETCHES_NAMED: usize = 8;

/// Returns descriptions of data that a run's manifest and tables contain but its journal lacks. The list is empty if nothing is
/// missing from the journal.
///
/// A journal can't have lost anything if its last record is the end of a complete plan. If other files contain more, those files
/// are damaged. A run that was killed hasn't lost anything either, because the journal is written first.
///
/// # Errors
/// Returns an error if a file can't be read. A file that is missing or can't be parsed is ignored.
pub(super) fn lost(folder: &Path, known: &JournalSummary) -> Result<Vec<String>, DatasetError> {
    if known.is_complete() {
        return Ok(Vec::new());
    }
    let mut lost = Vec::new();
    match Manifest::read(&folder.join(MANIFEST)) {
        Ok(manifest) => lost.extend(beyond(folder, &manifest, known)?),
        Err(DatasetError::Io { why, .. }) if why.kind() == ErrorKind::NotFound => {}
        Err(error @ DatasetError::Io { .. }) => return Err(error),
        Err(_) => {}
    }
    for table in [PRESSES, SCENE] {
        // a press that tripped has only a row of true values
        let tripped = |press: &u64| table == SCENE && known.trips.iter().any(|(tripped, _)| *tripped == Some(*press));
        let is_missing = |press: &u64| !known.contacts.has(*press) && !tripped(press);
        let missing: BTreeSet<u64> = presses_in(&folder.join(table))?.into_iter().filter(is_missing).collect();
        if !missing.is_empty() {
            lost.push(format!("{table} holds {}, which {JOURNAL} doesn't", stretches(&missing)));
        }
    }
    for (phase, table) in MATRICES {
        let (points, levels) = (points_in(&folder.join(table))?, known.levels_of(phase));
        if points > levels {
            lost.push(format!("{table} holds {points} points, {JOURNAL} {levels}"));
        }
    }
    Ok(lost)
}

/// Returns descriptions of data in a manifest that the journal lacks.
fn beyond(folder: &Path, manifest: &Manifest, known: &JournalSummary) -> Result<Vec<String>, DatasetError> {
    let mut lost = Vec::new();
    if let Some(vouched) = manifest.files.iter().find(|file| file.name == JOURNAL) {
        let start = Fingerprint::of_start(folder, JOURNAL, vouched.bytes)
            .map_err(DatasetError::io("reading", folder.join(JOURNAL)))?;
        if start.bytes < vouched.bytes {
            lost.push(format!("{MANIFEST} states {} bytes for {JOURNAL}, which has {}", vouched.bytes, start.bytes));
        } else if start != *vouched {
            lost.push(format!("the SHA-256 of the first {} bytes of {JOURNAL} differs from {MANIFEST}", vouched.bytes));
        }
    }
    let (text, found) = (manifest.presses_done, known.manifest.presses_done);
    if text > found {
        lost.push(format!("{MANIFEST} counts {text} presses, {JOURNAL} holds {found}"));
    } else if manifest.status == Status::Complete && lost.is_empty() {
        lost.push(format!("{MANIFEST} states that the run is complete, but {JOURNAL} doesn't"));
    }
    Ok(lost)
}

/// Returns the numbers in the column `press` of a table, from every complete line.
fn presses_in(path: &Path) -> Result<BTreeSet<u64>, DatasetError> {
    let mut presses = BTreeSet::new();
    let Some(mut lines) = CompleteLines::open(path)? else { return Ok(presses) };
    let Some(header) = lines.next_line()? else { return Ok(presses) };
    let Some(column) = header.split(',').position(|name| name.trim() == "press") else { return Ok(presses) };
    while let Some(line) = lines.next_line()? {
        presses.extend(line.split(',').nth(column).and_then(|cell| cell.trim().parse::<u64>().ok()));
    }
    Ok(presses)
}

/// Returns the number of cells in a matrix' first line, if the line is complete.
fn points_in(path: &Path) -> Result<u64, DatasetError> {
    let Some(mut lines) = CompleteLines::open(path)? else { return Ok(0) };
    Ok(lines.next_line()?.map_or(0, |line| line.split(',').count() as u64))
}

/// Complete lines of a table that may be damaged in any way.
struct CompleteLines<'a> {
    path: &'a Path,
    reader: BufReader<std::fs::File>,
}

impl<'a> CompleteLines<'a> {
    /// Opens a table. Returns `None` if the file doesn't exist.
    fn open(path: &'a Path) -> Result<Option<Self>, DatasetError> {
        match files::open(path) {
            Ok(file) => Ok(Some(CompleteLines { path, reader: BufReader::new(file) })),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(DatasetError::io("reading", path)(error)),
        }
    }

    fn next_line(&mut self) -> Result<Option<String>, DatasetError> {
        let mut line = Vec::new();
        let read = (&mut self.reader).take(LINE_MAX_BYTES).read_until(b'\n', &mut line);
        read.map_err(|error: io::Error| DatasetError::io("reading", self.path)(error))?;
        Ok((line.pop() == Some(b'\n')).then(|| String::from_utf8_lossy(&line).into_owned()))
    }
}

/// Formats press numbers for a message: `press 3`, `presses 3 to 9, 12`.
fn stretches(presses: &BTreeSet<u64>) -> String {
    let mut found: Vec<(u64, u64)> = Vec::new();
    for &press in presses {
        match found.last_mut() {
            Some((_, last)) if *last + 1 == press => *last = press,
            _ => found.push((press, press)),
        }
    }
    let named: Vec<String> = found
        .iter()
        .take(STRETCHES_NAMED)
        .map(|(first, last)| if first == last { first.to_string() } else { format!("{first} to {last}") })
        .collect();
    let more = if found.len() > STRETCHES_NAMED { " and more" } else { "" };
    format!("{} {}{more}", if presses.len() == 1 { "press" } else { "presses" }, named.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_listed_as_ranges() {
        let of = |presses: &[u64]| stretches(&presses.iter().copied().collect());
        assert_eq!(of(&[3]), "press 3");
        assert_eq!(of(&[3, 4, 5, 9, 12, 13]), "presses 3 to 5, 9, 12 to 13");
        let many: Vec<u64> = (0..20).map(|n| 2 * n).collect();
        assert!(of(&many).ends_with("12, 14 and more"), "{}", of(&many));
    }

    #[test]
    fn damaged_table_keeps_its_readable_lines() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("presses.csv");
        let found = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            presses_in(&path).unwrap().into_iter().collect::<Vec<_>>()
        };
        assert_eq!(found(b"press,x\n1,0\nfoo\n\xff\n2,0\n3,"), [1, 2], "the last line is torn");
        assert_eq!(found(b""), [0; 0]);
        assert_eq!(found(b"a,b\n1,2\n"), [0; 0]);
        assert_eq!(presses_in(&folder.path().join("none")).unwrap().len(), 0);
    }
}
