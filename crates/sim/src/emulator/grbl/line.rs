//! The serial line byte by byte.

/// Longest line without blanks and comments (80 with the zero that ends it in GRBL's memory).
const LINE_MOST: usize = 79;

/// Reads GRBL's serial line byte by byte. Real-time bytes are taken out at any position. The other bytes are joined to lines,
/// without blanks and comments and in capitals.
#[derive(Default)]
pub(super) struct LineReader {
    text: Vec<u8>,
    overlong: bool,
    /// Character that ends the comment being skipped.
    comment: Option<u8>,
}

/// Complete input.
#[derive(Debug, PartialEq)]
pub(super) enum GrblInput {
    /// A byte that acts at once and belongs to no line.
    RealTime(u8),
    /// A line; `None` if it had more than [`LINE_MOST`] characters.
    Line(Option<String>),
}

impl LineReader {
    /// Takes bytes from the front of the inbox until an input is complete. No incomplete input stays in the inbox, and at most
    /// one line stays in this reader.
    pub(super) fn take(&mut self, inbox: &mut Vec<u8>) -> Option<GrblInput> {
        for taken in 0..inbox.len() {
            if let Some(input) = self.read(inbox[taken]) {
                inbox.drain(..=taken);
                return Some(input);
            }
        }
        inbox.clear();
        None
    }

    /// Discards the incomplete line.
    pub(super) fn clear(&mut self) {
        *self = LineReader::default();
    }

    fn read(&mut self, byte: u8) -> Option<GrblInput> {
        match byte {
            b'?' | b'!' | b'~' | 0x18 | 0x80.. => return Some(GrblInput::RealTime(byte)),
            b'\r' | b'\n' => {
                let reader = std::mem::take(self);
                let text = String::from_utf8_lossy(&reader.text).into_owned();
                return Some(GrblInput::Line((!reader.overlong).then_some(text)));
            }
            _ => {}
        }
        match (self.comment, byte) {
            (Some(end), _) if end == byte => self.comment = None,
            (Some(_), _) | (None, ..=b' ' | b'/') => {}
            (None, b'(') => self.comment = Some(b')'),
            // only the end of the line ends it, which is found earlier
            (None, b';') => self.comment = Some(b'\n'),
            (None, _) if self.text.len() == LINE_MOST => self.overlong = true,
            (None, _) => self.text.push(byte.to_ascii_uppercase()),
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(bytes: &[u8]) -> Vec<GrblInput> {
        let mut inbox = bytes.to_vec();
        let mut reader = LineReader::default();
        std::iter::from_fn(|| reader.take(&mut inbox)).collect()
    }

    fn line(text: &str) -> GrblInput {
        GrblInput::Line(Some(text.into()))
    }

    #[test]
    fn a_line_ends_with_cr_or_lf_and_its_blanks_and_comments_mean_nothing() {
        let found = read(b" g1 x2.5 (up (there) /y1 ; the rest\rG4\n\r");
        assert_eq!(found, [line("G1X2.5Y1"), line("G4"), line("")]);
    }

    #[test]
    fn real_time_bytes_act_in_the_midst_of_a_line_and_of_a_comment() {
        let found = read(b"G1?X\x852(!\n\x18");
        let bytes = [b'?', 0x85, b'!'].map(GrblInput::RealTime);
        assert_eq!(found[..3], bytes);
        assert_eq!(found[3..], [line("G1X2"), GrblInput::RealTime(0x18)]);
    }

    #[test]
    fn line_that_is_too_long_is_discarded_and_the_next_is_read() {
        assert_eq!(read(&[&b"X".repeat(LINE_MOST)[..], b"\nG0\n"].concat()), [line(&"X".repeat(79)), line("G0")]);
        assert_eq!(read(&[&b"X".repeat(5000)[..], b"\nG0\n"].concat()), [GrblInput::Line(None), line("G0")]);
    }

    proptest! {
        #[test]
        fn emulator_survives_arbitrary_bytes_in_bounded_memory(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let mut reader = LineReader::default();
            let mut inbox = bytes;
            while reader.take(&mut inbox).is_some() {}
            prop_assert!(inbox.is_empty() && reader.text.len() <= LINE_MOST);
        }
    }
}
