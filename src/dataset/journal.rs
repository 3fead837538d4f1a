use super::Record;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Largest journal that is read, bytes: a hundred thousand presses of 64 units are some 150 MB.
const JOURNAL_MAX_BYTES: u64 = 1 << 30;

/// The append-only record of a run: one line a record, `sequence checksum json`.
///
/// The checksum is CRC-32 over the sequence number and the text. A torn last line, left by a power cut, is cut off; anything
/// else that doesn't fit is damage and named with its offset.
#[derive(Debug)]
pub struct Journal {
    file: File,
    path: PathBuf,
    next: u64,
    line: Vec<u8>,
}

/// A journal that can't be relied on.
#[derive(Debug, Error)]
pub enum JournalError {
    /// A record that isn't what was written.
    #[error("{}: the record at byte {offset} is damaged: {problem}", path.display())]
    Damaged {
        /// The journal.
        path: PathBuf,
        /// Where the record begins.
        offset: usize,
        /// What is wrong with it.
        problem: String,
    },
    /// It couldn't be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The journal.
        path: PathBuf,
        /// What came back.
        source: io::Error,
    },
}

impl Journal {
    /// An empty journal at a path where nothing is yet.
    ///
    /// # Errors
    /// The operating system's.
    pub fn create(path: &Path) -> Result<Journal, JournalError> {
        let file = OpenOptions::new().append(true).create_new(true).open(path).map_err(failed(path))?;
        Ok(Journal { file, path: path.to_owned(), next: 0, line: Vec::new() })
    }

    /// Opens a journal to go on with it: its records, and itself with a torn tail cut off.
    ///
    /// # Errors
    /// Damage before the last line, or the operating system's.
    pub fn open(path: &Path) -> Result<(Journal, Vec<Record>), JournalError> {
        let (records, sound_bytes) = read(path)?;
        let file = OpenOptions::new().append(true).open(path).map_err(failed(path))?;
        file.set_len(sound_bytes as u64).map_err(failed(path))?;
        Ok((Journal { file, path: path.to_owned(), next: records.len() as u64, line: Vec::new() }, records))
    }

    /// The records of a journal, without a torn tail.
    ///
    /// # Errors
    /// Damage before the last line, or the operating system's.
    pub fn records(path: &Path) -> Result<Vec<Record>, JournalError> {
        Ok(read(path)?.0)
    }

    /// Adds a record. When this returns it is on the disk.
    ///
    /// # Errors
    /// The operating system's.
    pub fn append(&mut self, record: &Record) -> Result<(), JournalError> {
        let text = serde_json::to_string(record).map_err(|error| failed(&self.path)(error.into()))?;
        self.line.clear();
        // writing to memory can't fail
        let _ = writeln!(self.line, "{} {:08x} {text}", self.next, checksum(self.next, &text));
        self.file.write_all(&self.line).and_then(|()| self.file.sync_data()).map_err(failed(&self.path))?;
        self.next += 1;
        Ok(())
    }
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> JournalError {
    let path = path.to_owned();
    move |source| JournalError::Io { path, source }
}

/// The records and the bytes they take.
fn read(path: &Path) -> Result<(Vec<Record>, usize), JournalError> {
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(failed(path))?;
    file.take(JOURNAL_MAX_BYTES + 1).read_to_end(&mut bytes).map_err(failed(path))?;
    if bytes.len() as u64 > JOURNAL_MAX_BYTES {
        let too_large = io::Error::new(io::ErrorKind::FileTooLarge, format!("over {JOURNAL_MAX_BYTES} bytes"));
        return Err(failed(path)(too_large));
    }
    let mut records = Vec::new();
    let mut offset = 0;
    for line in bytes.split_inclusive(|&byte| byte == b'\n') {
        let is_last = offset + line.len() == bytes.len();
        match parse(line, records.len() as u64) {
            Ok(record) => records.push(record),
            Err(_) if is_last => break, // torn: it was never acknowledged
            Err(problem) => return Err(JournalError::Damaged { path: path.to_owned(), offset, problem }),
        }
        offset += line.len();
    }
    Ok((records, offset))
}

fn parse(line: &[u8], expected: u64) -> Result<Record, String> {
    let text = std::str::from_utf8(line).map_err(|_| "not text")?;
    let text = text.strip_suffix('\n').ok_or("no line end")?;
    let mut parts = text.splitn(3, ' ');
    let (Some(sequence), Some(sum), Some(json)) = (parts.next(), parts.next(), parts.next()) else {
        return Err("not `sequence checksum json`".to_owned());
    };
    if sequence.parse() != Ok(expected) {
        return Err(format!("sequence number {sequence}, expected {expected}"));
    }
    if u32::from_str_radix(sum, 16) != Ok(checksum(expected, json)) {
        return Err("the checksum doesn't fit".to_owned());
    }
    serde_json::from_str(json).map_err(|error| error.to_string())
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
    use crate::dataset::Contact;
    use crate::dataset::record::example;

    fn contact(press: u64) -> Record {
        Record::Contact(Contact { press, rows: vec![example(press, 0).rounded()], truth: vec![], lesson: None })
    }

    fn three_records(path: &Path) -> Vec<u8> {
        let mut journal = Journal::create(path).unwrap();
        for press in 0..3 {
            journal.append(&contact(press)).unwrap();
        }
        std::fs::read(path).unwrap()
    }

    #[test]
    fn a_journal_cut_at_any_byte_keeps_every_whole_record_and_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let whole = three_records(&path);
        for cut in 0..=whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let complete = whole[..cut].iter().filter(|&&byte| byte == b'\n').count();
            let (mut journal, records) = Journal::open(&path).unwrap();
            assert_eq!(records, (0..complete as u64).map(contact).collect::<Vec<_>>());
            journal.append(&contact(9)).unwrap();
            assert_eq!(Journal::records(&path).unwrap().len(), complete + 1);
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
        match Journal::records(&path).unwrap_err() {
            JournalError::Damaged { offset, .. } => assert_eq!(offset, second),
            other => panic!("{other}"),
        }
    }
}
