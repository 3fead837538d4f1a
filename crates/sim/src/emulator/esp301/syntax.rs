//! Lines, and the commands in them.

use super::errors::{EspError, General};
use palpate_core::quantity::Axis;

/// Longest line that the controller accepts, without its end. The manual gives a limit only for the ESP302.
const LINE_MOST: usize = 80;

/// Commands that delay the rest of their line, and everything that is sent later.
const WAIT: [u8; 2] = *b"WS";

/// One command of a line: `[axis]CC[parameter]` (manual, syntax).
#[derive(Debug, PartialEq)]
pub(super) struct EspCommand {
    /// Number before the letters, as sent.
    axis: Option<u32>,
    /// The two letters, in capitals.
    pub name: [u8; 2],
    /// Argument after the letters.
    pub argument: Argument,
}

/// Argument after a command's letters.
#[derive(Debug, PartialEq)]
pub(super) enum Argument {
    /// No argument.
    None,
    /// A question mark.
    Query,
    /// A parameter, not parsed yet.
    Value(String),
}

/// Takes the next line, or the part of it up to a wait. CR ends a line; an LF after it has no meaning. Of a line that is too
/// long, enough is kept to show that it is too long.
pub(super) fn take_line(inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
    loop {
        let Some(end) = inbox.iter().position(|&byte| byte == b'\r') else {
            inbox.truncate(LINE_MOST + 2); // an LF may lead it
            return None;
        };
        let part = end_of_wait(&inbox[..end]).unwrap_or(end + 1);
        let line: Vec<u8> = inbox.drain(..part).filter(|&byte| byte != b'\r' && byte != b'\n').collect();
        if !line.trim_ascii().is_empty() {
            return Some(line);
        }
    }
}

/// Returns the commands of a line, in order. They are separated by `;`, and blanks have no meaning. A line that is too long
/// contains no commands.
pub(super) fn commands(line: &[u8]) -> Vec<Result<EspCommand, EspError>> {
    if line.len() > LINE_MOST {
        return vec![Err(General::UNKNOWN_COMMAND.into())];
    }
    let bare: Vec<u8> = line.iter().filter(|byte| !b" \t".contains(byte)).map(u8::to_ascii_uppercase).collect();
    bare.split(|&byte| byte == b';').filter(|text| !text.is_empty()).map(command).collect()
}

impl EspCommand {
    /// Returns the axis of a command that needs one.
    pub(super) fn axis(&self) -> Result<Axis, EspError> {
        match self.axis {
            None => Err(General::AXIS_MISSING.into()),
            Some(number @ 1..=3) => Ok(Axis::ALL[number as usize - 1]),
            Some(_) => Err(General::AXIS_OUT_OF_RANGE.into()),
        }
    }

    /// Returns the axis of a command that can concern all axes; `None` means all (no number, or 0).
    pub(super) fn axis_or_all(&self) -> Result<Option<Axis>, EspError> {
        match self.axis {
            None | Some(0) => Ok(None),
            Some(_) => self.axis().map(Some),
        }
    }
}

impl Argument {
    /// Whether the command is a query, or a bare `T` command (report).
    pub(super) fn tells(&self) -> bool {
        !matches!(self, Argument::Value(_))
    }

    /// Returns the number of a command that needs one: digits, a sign, a point. Returns `out_of_range` if the text isn't a
    /// number. An exponent isn't among the forms seen on real controllers.
    pub(super) fn number(&self, out_of_range: EspError) -> Result<f64, EspError> {
        match self {
            Argument::Value(text) if text.bytes().all(|byte| byte.is_ascii_digit() || b"+-.".contains(&byte)) => {
                text.parse().map_err(|_| out_of_range)
            }
            Argument::Value(_) => Err(out_of_range),
            _ => Err(General::PARAMETER_MISSING.into()),
        }
    }

    /// Returns the number, or a default if there is no argument.
    pub(super) fn number_or(&self, default: f64, out_of_range: EspError) -> Result<f64, EspError> {
        if *self == Argument::None { Ok(default) } else { self.number(out_of_range) }
    }
}

fn command(text: &[u8]) -> Result<EspCommand, EspError> {
    let unknown = || EspError::from(General::UNKNOWN_COMMAND);
    let digits = text.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let (number, text) = text.split_at(digits);
    let (&name, parameter) = text.split_first_chunk::<2>().ok_or_else(unknown)?;
    if !name.iter().all(u8::is_ascii_alphabetic) || !parameter.is_ascii() {
        return Err(unknown());
    }
    let number = std::str::from_utf8(number).unwrap_or_default();
    // a number that is too long is an axis that doesn't exist
    let axis = (!number.is_empty()).then(|| number.parse().unwrap_or(u32::MAX));
    let argument = match parameter {
        b"" => Argument::None,
        b"?" => Argument::Query,
        _ => Argument::Value(String::from_utf8_lossy(parameter).into_owned()),
    };
    Ok(EspCommand { axis, name, argument })
}

/// Returns the end of the part of a line up to its first wait, if more text follows.
fn end_of_wait(line: &[u8]) -> Option<usize> {
    if line.len() > LINE_MOST {
        return None;
    }
    let mut end = 0;
    for text in line.split(|&byte| byte == b';') {
        end += text.len() + 1;
        let letters = text.iter().filter(|byte| byte.is_ascii_alphabetic()).map(u8::to_ascii_uppercase);
        let waits = letters.take(2).eq(WAIT);
        if waits && end < line.len() {
            return Some(end);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lines(bytes: &[u8]) -> Vec<String> {
        let mut inbox = bytes.to_vec();
        std::iter::from_fn(|| take_line(&mut inbox)).map(|line| String::from_utf8_lossy(&line).into_owned()).collect()
    }

    #[test]
    fn a_line_ends_with_cr_and_lf_means_nothing() {
        assert_eq!(lines(b"1TP?\r1MD?\r\n\r\n2TP\r\n3T"), ["1TP?", "1MD?", "2TP"]);
        assert_eq!(lines(b"1TP?\n"), [""; 0]);
    }

    #[test]
    fn a_line_is_taken_in_parts_up_to_each_wait() {
        assert_eq!(lines(b"1PA1;1WS0;1TP?;WS5; 2ID\r"), ["1PA1;1WS0;", "1TP?;WS5;", " 2ID"]);
        assert_eq!(lines(b"1WS0;\r1WS0\r"), ["1WS0;", "1WS0"]);
    }

    #[test]
    fn line_that_is_too_long_is_discarded_whole() {
        let mut inbox = b"1MO;".repeat(30);
        assert_eq!(take_line(&mut inbox), None);
        assert!(inbox.len() <= LINE_MOST + 2);
        inbox.extend_from_slice(b"1PA5\r1TP?\r");
        let line = take_line(&mut inbox).expect("a line");
        assert_eq!(commands(&line), [Err(General::UNKNOWN_COMMAND.into())]);
        assert_eq!(take_line(&mut inbox).as_deref(), Some(&b"1TP?"[..]));
    }

    #[test]
    fn the_forms_seen_in_the_field_are_understood() {
        let read = |text: &str| commands(text.as_bytes()).into_iter().map(Result::unwrap).collect::<Vec<_>>();
        let one = |axis, name: &[u8; 2], argument| vec![EspCommand { axis, name: *name, argument }];
        let value = |text: &str| Argument::Value(text.into());
        assert_eq!(read("1 ID?"), one(Some(1), b"ID", Argument::Query));
        assert_eq!(read("01tp"), one(Some(1), b"TP", Argument::None));
        assert_eq!(read("1PA+3.00000"), one(Some(1), b"PA", value("+3.00000")));
        assert_eq!(read(" 1 PA -3 ; ;"), one(Some(1), b"PA", value("-3")));
        assert_eq!(read("VA1;AC2;AG3;PA4").len(), 4);
        assert_eq!(commands(b"*IDN?"), [Err(General::UNKNOWN_COMMAND.into())]);
    }

    #[test]
    fn numbers_are_plain_decimals() {
        let bad = EspError::from(General::PARAMETER_OUT_OF_RANGE);
        let number = |text: &str| Argument::Value(text.into()).number(bad);
        assert_eq!((number("+3.5"), number("-2"), number("7.")), (Ok(3.5), Ok(-2.0), Ok(7.0)));
        for text in ["1E3", "INF", "NAN", "--1", ".", "1,2", "?"] {
            assert_eq!(number(text), Err(bad), "{text}");
        }
        assert_eq!(Argument::None.number(bad), Err(General::PARAMETER_MISSING.into()));
    }

    proptest! {
        #[test]
        fn emulator_survives_arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let mut inbox = bytes;
            while let Some(line) = take_line(&mut inbox) {
                for command in commands(&line).into_iter().flatten() {
                    let _ = (command.axis(), command.axis_or_all());
                    let _ = command.argument.number(General::NOT_ALLOWED.into());
                }
            }
        }
    }
}
