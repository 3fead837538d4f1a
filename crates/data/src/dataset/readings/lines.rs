//! Lines of a stream.

use super::{MAX_LINE_BYTES, ReadingError};
use std::io::{self, BufRead, BufReader, Read};

/// Number of bytes that are read at once.
const BUFFER_BYTES: usize = 64 << 10;

/// Takes one line after another from a stream; stores one at a time.
pub struct StreamLines<R> {
    file: String,
    input: BufReader<R>,
    line: Vec<u8>,
    /// Whether the line was too long, so that its rest is still to be read.
    is_cut: bool,
}

impl<R: Read> StreamLines<R> {
    /// Reads lines of a stream; `file` is its name in messages.
    pub fn new(file: &str, input: R) -> Self {
        let input = BufReader::with_capacity(BUFFER_BYTES, input);
        StreamLines { file: file.to_owned(), input, line: Vec::new(), is_cut: false }
    }

    /// Returns the next line; `None` at the end. For a line beyond [`MAX_LINE_BYTES`], returns its beginning, one byte longer
    /// than this limit.
    ///
    /// # Errors
    /// Reading the input failed.
    pub fn read_next(&mut self) -> Result<Option<&[u8]>, ReadingError> {
        match self.take() {
            Ok(0) => Ok(None),
            Ok(_) => Ok(Some(&self.line)),
            Err(source) => Err(ReadingError::Unreadable { file: self.file.clone(), source }),
        }
    }

    /// Whether the next line may have to be waited for, because no complete line has arrived yet.
    pub fn is_drained(&self) -> bool {
        self.is_cut || !self.input.buffer().contains(&b'\n')
    }

    /// Returns the number of bytes taken from the next line.
    fn take(&mut self) -> io::Result<usize> {
        if self.is_cut {
            self.input.skip_until(b'\n')?;
        }
        self.line.clear();
        let taken = (&mut self.input).take(MAX_LINE_BYTES as u64 + 1).read_until(b'\n', &mut self.line)?;
        self.is_cut = taken > MAX_LINE_BYTES && !self.line.ends_with(b"\n");
        Ok(taken)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn incomplete_line_waits_for_its_end() {
        let mut lines = StreamLines::new("stdin", "1,2\n3,4\n5,".as_bytes());
        let mut drained = Vec::new();
        while let Ok(Some(_)) = lines.read_next() {
            drained.push(lines.is_drained());
        }
        assert_eq!(drained, [false, true, true]);
    }

    #[test]
    fn rest_of_a_line_that_is_too_long_is_skipped() {
        let long = "1".repeat(3 * MAX_LINE_BYTES);
        let text = format!("1,2\n{long}\n3,4\n{long}");
        let mut lines = StreamLines::new("stdin", text.as_bytes());
        let mut lengths = Vec::new();
        while let Ok(Some(line)) = lines.read_next() {
            lengths.push(line.len());
        }
        assert_eq!(lengths, [4, MAX_LINE_BYTES + 1, 4, MAX_LINE_BYTES + 1]);
    }
}
