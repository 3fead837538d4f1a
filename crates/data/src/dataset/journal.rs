//! Journal of a run or a batch: append-only, one record per line, read record by record.

mod place;

use super::{Durability, Record, files};
use miette::Diagnostic;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Name of the journal in its folder.
pub const JOURNAL: &str = "journal.log";

/// Kinds of the first records of all journals.
const FIRSTS: [&str; 2] = ["run", "batch"];

/// Largest journal that is written or read, bytes. Ten million presses of 64 units take some 15 GB. The journal is read piece by
/// piece.
const JOURNAL_MAX_BYTES: u64 = 64 << 30;

/// Longest record that is written or read, bytes. A staircase of 20 levels on 4096 units takes some 1 MB.
const RECORD_MAX_BYTES: u64 = 16 << 20;

/// Record that a journal keeps.
pub trait Logged: Serialize + DeserializeOwned {
    /// Name of the first record's kind, which states the format: `run` or `batch`.
    const FIRST: &'static str;
    /// Format that this program writes and reads.
    const FORMAT: u32;

    /// Checks that the record can be read again as it was written.
    ///
    /// # Errors
    /// Description of what JSON can't keep.
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

/// Append-only record of a run or a batch, with one record per line: `sequence checksum json`.
///
/// The checksum is CRC-32 over the sequence number and the text. A last line without its end, left by a power cut, is cut off.
/// Any other mismatch is damage, and the error states its offset. The journal is read record by record and is never completely in
/// memory.
#[derive(Debug)]
pub struct Journal<R = Record> {
    file: File,
    path: PathBuf,
    durability: Durability,
    next: u64,
    end: u64,
    line: Vec<u8>,
    /// Whether a record that was never acknowledged may be at the end. Nothing is added after such a record.
    broken: bool,
    warnings: Vec<String>,
    kind: PhantomData<fn(&R)>,
}

/// Records of a journal in the order they were made, each with the byte at which it begins; without an incomplete last line.
#[derive(Debug)]
pub struct JournalRecords<R = Record> {
    reader: BufReader<File>,
    path: PathBuf,
    next: u64,
    offset: u64,
    line: Vec<u8>,
    /// Whether the line has no end because the file ends in it.
    is_torn: bool,
    /// Whether damage was reported. No record after the damage is reliable.
    is_over: bool,
    kind: PhantomData<fn() -> R>,
}

/// Reason why a journal isn't reliable.
#[derive(Debug, Error, Diagnostic)]
pub enum JournalError {
    /// A record differs from what was written.
    #[error("{}: the record at byte {offset} is damaged: {problem}", path.display())]
    #[diagnostic(help(
        "restore the journal from a copy; `palpate verify` reports what can be kept without one; nothing was changed"
    ))]
    Damaged {
        /// The journal.
        path: PathBuf,
        /// Position at which the record begins, bytes.
        offset: u64,
        /// Problem of the record.
        problem: String,
    },
    /// Another version of the program wrote the journal.
    #[error("{}: a journal of format {found}; this program reads format {reads}", path.display())]
    #[diagnostic(help("read it with the version of palpate that wrote it; nothing was changed"))]
    Format {
        /// The journal.
        path: PathBuf,
        /// Format that its first record states; 1 if it states none.
        found: u32,
        /// Format that this program reads.
        reads: u32,
    },
    /// The journal is that of another kind of folder.
    #[error("{}: the journal of a {found}, not of a {expected}", path.display())]
    #[diagnostic(help("give the folder of a {expected}; `palpate batch` has the commands for a batch"))]
    Kind {
        /// The journal.
        path: PathBuf,
        /// Kind of its first record.
        found: String,
        /// Kind that was expected.
        expected: &'static str,
    },
    /// The name of the journal no longer leads to the file that is being written.
    #[error("recording in {}: the journal {what}; the last record isn't acknowledged", path.display())]
    #[diagnostic(help(
        "the record so far is in the file that had this name: find it (a moved folder, a copy, the trash), put it back, and continue \
         with `palpate resume`. Keep other programs away from the folder of a run until it ends"
    ))]
    Displaced {
        /// The journal.
        path: PathBuf,
        /// What happened to it.
        what: &'static str,
    },
    /// The journal couldn't be read or written.
    #[error("keeping {}: {why}", path.display())]
    #[diagnostic(help("{}", files::advice(why)))]
    Io {
        /// The journal.
        path: PathBuf,
        /// Error of the operating system.
        why: io::Error,
    },
}

impl<R: Logged> Journal<R> {
    /// Creates an empty journal at an unused path.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn create(path: &Path) -> Result<Journal<R>, JournalError> {
        let file = OpenOptions::new().read(true).append(true).create_new(true).open(path).map_err(failed(path))?;
        Ok(Journal::at_end(file, path, 0, 0))
    }

    /// Reads a journal to its end. Passes each record to `accept` with the byte at which it begins. A record that `accept`
    /// refuses is damage.
    ///
    /// # Errors
    /// Damage before the last line, or an error of the operating system.
    pub fn read(
        path: &Path,
        mut accept: impl FnMut(u64, &R) -> Result<(), String>,
    ) -> Result<JournalRecords<R>, JournalError> {
        let mut records = Journal::records(path)?;
        while let Some((offset, record)) = records.advance()? {
            accept(offset, &record).map_err(|problem| records.damaged(offset, problem))?;
        }
        Ok(records)
    }

    /// Opens a journal to continue it, and cuts off an incomplete last line. Passes its records to `accept` like
    /// [`read`](Self::read).
    ///
    /// # Errors
    /// The same as for [`read`](Self::read).
    pub fn open(path: &Path, accept: impl FnMut(u64, &R) -> Result<(), String>) -> Result<Journal<R>, JournalError> {
        Journal::read(path, accept)?.go_on()
    }

    fn at_end(file: File, path: &Path, next: u64, end: u64) -> Journal<R> {
        let durability = Durability::Full;
        let path = path.to_owned();
        let (line, warnings) = (Vec::new(), Vec::new());
        Journal { file, path, durability, next, end, line, broken: false, warnings, kind: PhantomData }
    }

    /// Returns the warnings about the file of the journal, each once.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Sets the durability of every further record.
    pub fn keep_for(&mut self, durability: Durability) {
        self.durability = durability;
    }

    /// Returns the durability of further records.
    #[cfg(feature = "files")]
    pub(super) fn durability(&self) -> Durability {
        self.durability
    }

    /// Returns the records of a journal from its beginning. Damage before the last line is returned as an error in its place; no
    /// record after the damage is reliable.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn records(path: &Path) -> Result<JournalRecords<R>, JournalError> {
        let file = files::open(path).map_err(failed(path))?;
        if file.metadata().map_err(failed(path))?.len() > JOURNAL_MAX_BYTES {
            let too_large = io::Error::new(io::ErrorKind::FileTooLarge, format!("over {JOURNAL_MAX_BYTES} bytes"));
            return Err(failed(path)(too_large));
        }
        Ok(JournalRecords {
            reader: BufReader::new(file),
            path: path.to_owned(),
            next: 0,
            offset: 0,
            line: Vec::new(),
            is_torn: false,
            is_over: false,
            kind: PhantomData,
        })
    }

    /// Appends a record and returns the byte at which it begins. On return the record is on the disk, unless this durability was
    /// waived.
    ///
    /// # Errors
    /// An error of the operating system. The part of the record that was written is removed. If the removal fails too, nothing
    /// more is added.
    pub fn append(&mut self, record: &R) -> Result<u64, JournalError> {
        let offset = self.add(record, self.durability)?;
        // checks the folder once, so that nothing is acknowledged in a lost file
        self.keep_place().inspect_err(|_| self.broken = true)?;
        Ok(offset)
    }

    /// Appends a record that reaches the disk only with the next record. For records during which a stage must not wait.
    ///
    /// # Errors
    /// The same as for [`append`](Self::append).
    pub fn append_unsynced(&mut self, record: &R) -> Result<u64, JournalError> {
        self.add(record, Durability::Fast)
    }

    fn add(&mut self, record: &R, durability: Durability) -> Result<u64, JournalError> {
        if self.broken {
            return Err(failed(&self.path)(io::Error::other("nothing can be appended after a failed write")));
        }
        let text = serde_json::to_string(record).map_err(|error| failed(&self.path)(error.into()))?;
        self.line.clear();
        // writing to memory can't fail
        let _ = writeln!(self.line, "{} {:08x} {text}", self.next, checksum(self.next, &text));
        self.check_line(record).map_err(failed(&self.path))?;
        self.write_line(durability).map_err(|error| {
            // half a line would be damage if another line followed it
            self.broken = self.file.set_len(self.end).and_then(|()| self.file.sync_data()).is_err();
            failed(&self.path)(error)
        })?;
        let offset = self.end;
        self.next += 1;
        self.end += self.line.len() as u64;
        Ok(offset)
    }

    /// Checks that the program can read the line again; otherwise it isn't written.
    fn check_line(&self, record: &R) -> io::Result<()> {
        let bytes = self.line.len() as u64;
        if bytes >= RECORD_MAX_BYTES || self.end + bytes > JOURNAL_MAX_BYTES {
            let text = format!("a record of {bytes} bytes is too long for a journal of {}", self.end);
            return Err(io::Error::new(io::ErrorKind::FileTooLarge, text));
        }
        let unreadable = |problem| io::Error::other(format!("the record couldn't be read again: {problem}"));
        record.check().map_err(unreadable)?;
        parse::<R>(&self.line).map(drop).map_err(unreadable)
    }

    fn write_line(&mut self, durability: Durability) -> io::Result<()> {
        self.file.write_all(&self.line)?;
        match durability {
            Durability::Full => self.file.sync_data(),
            Durability::Fast => Ok(()),
        }
    }

    pub(super) fn damaged(&self, offset: u64, problem: String) -> JournalError {
        JournalError::Damaged { path: self.path.clone(), offset, problem }
    }
}

impl<R: Logged> JournalRecords<R> {
    /// Returns the journal for appending, after it was read to its end. Cuts off an incomplete last line.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn go_on(self) -> Result<Journal<R>, JournalError> {
        let path = &self.path;
        let file = files::open_to_append(path).map_err(failed(path))?;
        // the last record may not be synced yet: sync before appending
        file.set_len(self.offset).and_then(|()| file.sync_data()).map_err(failed(path))?;
        Ok(Journal::at_end(file, path, self.next, self.offset))
    }

    /// Returns the record that begins at a byte stated by the journal. The next record is then the one after it.
    ///
    /// # Errors
    /// Damage since then, or an error of the operating system.
    pub fn at(&mut self, offset: u64) -> Result<R, JournalError> {
        // keeps what has been read ahead: in the order of the journal nothing is read twice
        let way = offset as i64 - self.offset as i64;
        self.reader.seek_relative(way).map_err(failed(&self.path))?;
        self.offset = offset;
        self.read_line()?;
        let (sequence, record) = parse(&self.line).map_err(|problem| self.damaged(offset, problem))?;
        self.pass(sequence);
        Ok(record)
    }

    fn advance(&mut self) -> Result<Option<(u64, R)>, JournalError> {
        if self.is_over {
            return Ok(None);
        }
        let offset = self.offset;
        self.read_line()?;
        if offset == 0
            && let Some(error) = self.misfit()
        {
            self.is_over = true;
            return Err(error);
        }
        let parsed = parse(&self.line).and_then(|(sequence, record)| {
            let wrong = || format!("sequence number {sequence}, expected {}", self.next);
            if sequence == self.next { Ok(record) } else { Err(wrong()) }
        });
        match parsed {
            Ok(record) => {
                self.pass(self.next);
                Ok(Some((offset, record)))
            }
            // an incomplete last line was never acknowledged; a complete one with a wrong end is damage
            Err(_) if self.is_torn && !self.is_whole_but_for_its_end() => Ok(None),
            Err(problem) => {
                self.is_over = true;
                Err(self.damaged(offset, problem))
            }
        }
    }

    /// Reads the next line; an empty one at the end.
    fn read_line(&mut self) -> Result<(), JournalError> {
        self.line.clear();
        let mut rest = self.reader.by_ref().take(RECORD_MAX_BYTES);
        let read = rest.read_until(b'\n', &mut self.line).map_err(failed(&self.path))?;
        self.is_torn = (read as u64) < RECORD_MAX_BYTES && self.line.last() != Some(&b'\n');
        Ok(())
    }

    fn is_whole_but_for_its_end(&self) -> bool {
        let Some((_, text)) = self.line.split_last() else { return false };
        parse::<R>(&[text, b"\n"].concat()).is_ok()
    }

    /// Returns the error of a first line that is sound but of another kind of journal, or of another format.
    fn misfit(&self) -> Option<JournalError> {
        let (_, json) = checked(&self.line).ok()?;
        let first: serde_json::Map<String, serde_json::Value> = serde_json::from_str(json).ok()?;
        let path = self.path.clone();
        let Some(facts) = first.get(R::FIRST) else {
            let found = FIRSTS.into_iter().find(|kind| first.contains_key(*kind))?.to_owned();
            return Some(JournalError::Kind { path, found, expected: R::FIRST });
        };
        let found = facts.get("format").map_or(Some(1), serde_json::Value::as_u64)?;
        let found = u32::try_from(found).ok()?;
        (found != R::FORMAT).then_some(JournalError::Format { path, found, reads: R::FORMAT })
    }

    fn pass(&mut self, sequence: u64) {
        self.next = sequence + 1;
        self.offset += self.line.len() as u64;
    }

    pub(super) fn damaged(&self, offset: u64, problem: String) -> JournalError {
        JournalError::Damaged { path: self.path.clone(), offset, problem }
    }
}

impl<R: Logged> Iterator for JournalRecords<R> {
    type Item = Result<(u64, R), JournalError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.advance().transpose()
    }
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> JournalError {
    let path = path.to_owned();
    move |why| JournalError::Io { path, why }
}

/// Returns a line's sequence number and record.
fn parse<R: Logged>(line: &[u8]) -> Result<(u64, R), String> {
    let (sequence, json) = checked(line)?;
    Ok((sequence, serde_json::from_str(json).map_err(|error| error.to_string())?))
}

/// Returns a line's sequence number and text, if its checksum matches.
fn checked(line: &[u8]) -> Result<(u64, &str), String> {
    let text = std::str::from_utf8(line).map_err(|_| "not text")?;
    let text = text.strip_suffix('\n').ok_or("no line end")?;
    let mut parts = text.splitn(3, ' ');
    let (Some(sequence), Some(sum), Some(json)) = (parts.next(), parts.next(), parts.next()) else {
        return Err("not of the form `sequence checksum json`".to_owned());
    };
    let sequence = sequence.parse().map_err(|_| format!("sequence number {sequence}"))?;
    if u32::from_str_radix(sum, 16) != Ok(checksum(sequence, json)) {
        return Err("the checksum is wrong".to_owned());
    }
    Ok((sequence, json))
}

fn checksum(sequence: u64, text: &str) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&sequence.to_le_bytes());
    hasher.update(text.as_bytes());
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(path: &Path, accept: impl FnMut(u64, &Record) -> Result<(), String>) -> Result<Journal, JournalError> {
        Journal::read(path, accept)?.go_on()
    }
    use crate::dataset::RecordedContact;
    use crate::dataset::press::example;

    fn contact(press: u64) -> Record {
        Record::Contact(RecordedContact {
            press,
            levels: vec![example(press, 0).rounded()],
            ..RecordedContact::default()
        })
    }

    fn three_records(path: &Path) -> Vec<u8> {
        let mut journal = Journal::create(path).unwrap();
        for press in 0..3 {
            journal.append(&contact(press)).unwrap();
        }
        std::fs::read(path).unwrap()
    }

    #[test]
    fn journal_cut_at_any_byte_keeps_complete_records_and_continues() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let whole = three_records(&path);
        for cut in 0..=whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let complete = whole[..cut].iter().filter(|&&byte| byte == b'\n').count();
            let mut records = Vec::new();
            let keep = |offset, record: &Record| {
                records.push((offset, record.clone()));
                Ok(())
            };
            let mut journal = open(&path, keep).unwrap();
            let kept: Vec<&Record> = records.iter().map(|(_, record)| record).collect();
            assert_eq!(kept, (0..complete as u64).map(contact).collect::<Vec<_>>().iter().collect::<Vec<_>>());
            records.push((journal.append(&contact(9)).unwrap(), contact(9)));
            assert_eq!(Journal::<Record>::records(&path).unwrap().map(Result::unwrap).collect::<Vec<_>>(), records);
            // and each is found again by its place, in any order
            let mut reader = Journal::<Record>::records(&path).unwrap();
            records.iter().rev().for_each(|(offset, record)| assert_eq!(reader.at(*offset).unwrap(), *record));
        }
    }

    #[test]
    fn damage_before_the_tail_is_named_with_its_offset() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let mut bytes = three_records(&path);
        let second = bytes.iter().position(|&byte| byte == b'\n').unwrap() + 1;
        bytes[second + 40] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        let records = Journal::<Record>::records(&path).unwrap();
        match records.collect::<Result<Vec<_>, _>>().unwrap_err() {
            JournalError::Damaged { offset, .. } => assert_eq!(offset, second as u64),
            other => panic!("{other}"),
        }
        assert!(open(&path, |_, _| Ok(())).is_err());
        // a line with a changed end isn't cut off either
        bytes[second + 40] ^= 1;
        *bytes.last_mut().unwrap() = 0x0b;
        std::fs::write(&path, &bytes).unwrap();
        assert!(open(&path, |_, _| Ok(())).unwrap_err().to_string().contains("no line end"));
        *bytes.last_mut().unwrap() = b'\n';
        bytes[second + 40] ^= 1;
        // the last one was complete, so it may have been acknowledged: it isn't cut off silently
        let last = bytes.len() - 40;
        bytes[second + 40] ^= 1;
        bytes[last] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        assert!(open(&path, |_, _| Ok(())).unwrap_err().to_string().contains("the checksum is wrong"));
        assert_eq!(std::fs::read(&path).unwrap(), bytes, "and nothing is changed");
    }

    #[test]
    fn lines_after_damage_are_not_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let mut bytes = three_records(&path);
        bytes.extend_from_slice(&[b'\n'; 1000]);
        std::fs::write(&path, &bytes).unwrap();
        let text: Vec<bool> = Journal::<Record>::records(&path).unwrap().map(|record| record.is_ok()).collect();
        assert_eq!(text, [true, true, true, false]);
    }

    #[test]
    fn table_that_cannot_be_read_back_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let bytes = three_records(&path);
        let mut journal = open(&path, |_, _| Ok(())).unwrap();
        let mut row = example(3, 0);
        row.force_n = Some(f64::NAN);
        let bad = Record::Contact(RecordedContact { press: 3, levels: vec![row], ..RecordedContact::default() });
        assert!(journal.append(&bad).unwrap_err().to_string().contains("couldn't be read again"));
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
        journal.append(&contact(3)).unwrap();
        assert_eq!(Journal::<Record>::records(&path).unwrap().filter(Result::is_ok).count(), 4, "and it goes on");
    }

    #[test]
    fn complete_line_out_of_sequence_or_refused_is_damage() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let bytes = three_records(&path);
        let refused = open(&path, |offset, _| if offset > 0 { Err("no".to_owned()) } else { Ok(()) });
        assert!(refused.unwrap_err().to_string().ends_with("is damaged: no"));
        let second = bytes.iter().position(|&byte| byte == b'\n').unwrap() + 1;
        std::fs::write(&path, &bytes[second..]).unwrap();
        let text = Journal::<Record>::records(&path).unwrap().next().unwrap().unwrap_err().to_string();
        assert!(text.ends_with("the record at byte 0 is damaged: sequence number 1, expected 0"), "{text}");
    }
}
