//! The serial line: bytes to lines, and the check of their numbers (Marlin's queue.cpp).

/// Longest line without its comment (MAX_CMD_SIZE without the zero that ends it). The rest of a longer line is lost.
const LINE_MOST: usize = 95;

/// Joins bytes to lines, without comments and without empty lines.
#[derive(Default)]
pub(super) struct SerialLines {
    text: Vec<u8>,
    /// Whether the rest of the line is a comment.
    comment: bool,
}

impl SerialLines {
    /// Takes bytes from the front of the inbox until a line is complete. At most one line stays in here, and nothing in the inbox.
    pub(super) fn take(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        for taken in 0..inbox.len() {
            match inbox[taken] {
                b'\r' | b'\n' => {
                    let text = std::mem::take(self).text;
                    if !text.is_empty() {
                        inbox.drain(..=taken);
                        return Some(text);
                    }
                }
                b';' => self.comment = true,
                byte if !self.comment && self.text.len() < LINE_MOST => self.text.push(byte),
                _ => {}
            }
        }
        inbox.clear();
        None
    }

    /// Discards the incomplete line.
    pub(super) fn clear(&mut self) {
        *self = SerialLines::default();
    }
}

/// Reason why a numbered line is refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum LineRefusal {
    Number,
    Checksum,
    NoChecksum,
}

impl LineRefusal {
    /// Marlin's words.
    pub(super) fn text(self) -> &'static str {
        match self {
            LineRefusal::Number => "Line Number is not Last Line Number+1",
            LineRefusal::Checksum => "checksum mismatch",
            LineRefusal::NoChecksum => "No Checksum with line number",
        }
    }
}

/// Checks a line's number and checksum, if it has a number, and returns the number of the last line that was accepted: this one.
/// An M110 may have any number, and its second N counts.
pub(super) fn check(line: &str, last: i64) -> Result<i64, LineRefusal> {
    let line = line.trim_start_matches(' ');
    let Some(mut text) = line.strip_prefix('N') else { return Ok(last) };
    let sets = line.contains("M110");
    if sets && let Some(second) = line.get(4..).and_then(|rest| rest.split_once('N')) {
        text = second.1;
    }
    let number = integer(text);
    if !sets && number != last.wrapping_add(1) {
        return Err(LineRefusal::Number);
    }
    let (checked, sum) = line.rsplit_once('*').ok_or(LineRefusal::NoChecksum)?;
    if integer(sum) != i64::from(checked.bytes().fold(0, |sum, byte| sum ^ byte)) {
        return Err(LineRefusal::Checksum);
    }
    Ok(number)
}

/// The whole number at the front, as C's `strtol` reads it: 0 if there is none.
fn integer(text: &str) -> i64 {
    let text = text.trim_start_matches(' ');
    let sign = usize::from(text.starts_with(['-', '+']));
    let digits = text[sign..].bytes().take_while(u8::is_ascii_digit).count();
    text[..sign + digits].parse().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_no_comments_and_are_never_empty() {
        let mut inbox = b"G1 X1 ; up\r\n\n;all\nM400\nG4".to_vec();
        let mut lines = SerialLines::default();
        let found: Vec<_> = std::iter::from_fn(|| lines.take(&mut inbox)).collect();
        assert_eq!(found, [b"G1 X1 ".to_vec(), b"M400".to_vec()]);
        assert!(inbox.is_empty());
        inbox.extend(b" S1\n");
        assert_eq!(lines.take(&mut inbox), Some(b"G4 S1".to_vec()));
    }

    #[test]
    fn a_long_line_is_cut() {
        let mut inbox = [&b"X".repeat(2000)[..], b"\n"].concat();
        assert_eq!(SerialLines::default().take(&mut inbox), Some(b"X".repeat(LINE_MOST)));
    }

    #[test]
    fn a_number_needs_its_checksum_and_follows_the_last() {
        assert_eq!(check("N3 T0*57", 2), Ok(3));
        assert_eq!(check("N3 T0*56", 2), Err(LineRefusal::Checksum));
        assert_eq!(check("N3 T0", 2), Err(LineRefusal::NoChecksum));
        assert_eq!(check("N3 T0*57", 1), Err(LineRefusal::Number));
        assert_eq!(check("G1 X1", 7), Ok(7));
        assert_eq!(check("N-1 M110*15", 7), Ok(-1));
        assert_eq!(check("N0 M110 N41*72", 7), Ok(41));
    }
}
