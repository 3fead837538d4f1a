//! Whether the name of a journal still leads to the file that is being written.

use super::super::{files, lock};
use super::{Journal, JournalError, Logged, failed};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, Write};

impl<R: Logged> Journal<R> {
    /// Checks that the name of the journal leads to the open file. If an equal copy has the name, recording continues in the copy.
    ///
    /// # Errors
    /// The journal was removed, moved or replaced, or an error of the operating system.
    pub(in crate::dataset) fn keep_place(&mut self) -> Result<(), JournalError> {
        let is_there = files::is_at(&self.path, &self.file).map_err(failed(&self.path))?;
        let what = match is_there {
            Some(true) => return Ok(()),
            None => Err("was removed, or its folder was moved"),
            Some(false) => self.follow().map_err(failed(&self.path))?,
        };
        what.map_err(|what| JournalError::Displaced { path: self.path.clone(), what })?;
        if self.warnings.is_empty() {
            self.warnings.push(format!(
                "{} was replaced by an equal copy while it was written, and the record continues there: keep other programs away \
                 from the folder of a run until it ends",
                self.path.display()
            ));
        }
        Ok(())
    }

    /// Continues in the file that has the journal's name now, if it is an equal copy. The copy may lack the last record, which was
    /// written to the other file. Otherwise returns what happened to the journal.
    fn follow(&mut self) -> io::Result<Result<(), &'static str>> {
        let mut copy = files::open_to_append(&self.path)?;
        let (begun, end) = (self.end - self.line.len() as u64, self.end);
        if !lock::follow(&copy)? {
            return Ok(Err("was replaced by a file that another program writes"));
        }
        let bytes = copy.metadata()?.len();
        if bytes != begun && bytes != end || !is_equal(&mut self.file, &mut copy, bytes)? {
            return Ok(Err("was replaced by another file"));
        }
        self.file = copy;
        if bytes == begun {
            self.file.write_all(&self.line)?;
        }
        self.file.sync_data().map(Ok)
    }
}

/// Whether two files have the same bytes up to `most_bytes`. They are read piece by piece.
fn is_equal(one: &mut File, other: &mut File, most_bytes: u64) -> io::Result<bool> {
    one.rewind()?;
    other.rewind()?;
    let (mut one, mut other) = (BufReader::new(one.take(most_bytes)), BufReader::new(other.take(most_bytes)));
    loop {
        let (left, right) = (one.fill_buf()?, other.fill_buf()?);
        let bytes = left.len().min(right.len());
        if left[..bytes] != right[..bytes] {
            return Ok(false);
        }
        if bytes == 0 {
            return Ok(left.is_empty() && right.is_empty());
        }
        one.consume(bytes);
        other.consume(bytes);
    }
}
