//! Commands: a letter, a number and words (Marlin's parser.cpp).

/// A command.
#[derive(Debug, PartialEq)]
pub(super) struct MarlinCommand<'a> {
    /// Letter and number, such as G 1.
    pub code: (char, u32),
    /// The command as it is quoted when it is unknown.
    pub text: &'a str,
    /// Words by letter, A first; a word may have no value.
    words: [Option<Option<f64>>; 26],
}

impl<'a> MarlinCommand<'a> {
    /// Parses a line: perhaps its number, then the command, then perhaps a checksum. A line without a letter and a number in front
    /// has the code of no command.
    pub(super) fn parse(line: &'a str) -> MarlinCommand<'a> {
        let mut text = line.trim_start_matches(' ');
        if let Some(numbered) = text.strip_prefix('N') {
            let number = |char: char| char.is_ascii_digit() || char == '-';
            text = numbered.trim_start_matches(number).trim_start_matches(' ');
        }
        let text = text.split('*').next().unwrap_or(text).trim_end_matches(' ');
        let mut command = MarlinCommand { code: ('?', 0), text, words: [None; 26] };
        let letter = text.chars().next().unwrap_or('?');
        let Some((Some(number), mut rest)) = text.get(1..).map(value).filter(|_| letter.is_ascii_uppercase()) else {
            return command;
        };
        if number < 0.0 || number.fract() != 0.0 {
            return command; // G92.1 and the like are no commands of this build
        }
        command.code = (letter, number as u32);
        while let Some(letter) = rest.bytes().next() {
            (_, rest) = rest.split_at(rest.chars().next().map_or(0, char::len_utf8));
            if letter.is_ascii_uppercase() {
                let (found, left) = value(rest);
                command.words[usize::from(letter - b'A')] = Some(found);
                rest = left;
            }
        }
        command
    }

    /// Whether a word is there, with a value or without.
    pub(super) fn has(&self, letter: char) -> bool {
        self.word(letter).is_some()
    }

    /// Value of a word.
    pub(super) fn value(&self, letter: char) -> Option<f64> {
        self.word(letter).flatten()
    }

    /// Whether a word switches something on: it has no value or one that isn't zero. `None` without the word.
    pub(super) fn switch(&self, letter: char) -> Option<bool> {
        self.word(letter).map(|value| value.unwrap_or(1.0) != 0.0)
    }

    /// Values of X, Y and Z.
    pub(super) fn axes(&self) -> [Option<f64>; 3] {
        ['X', 'Y', 'Z'].map(|letter| self.value(letter))
    }

    /// The axes that are named, or all if none is, the extruder included.
    pub(super) fn named_axes(&self) -> [bool; 3] {
        let named = ['X', 'Y', 'Z'].map(|letter| self.has(letter));
        if named == [false; 3] && !self.has('E') { [true; 3] } else { named }
    }

    fn word(&self, letter: char) -> Option<Option<f64>> {
        self.words[letter as usize - 'A' as usize]
    }
}

/// Takes a number from the front, and blanks before it.
fn value(text: &str) -> (Option<f64>, &str) {
    let text = text.trim_start_matches(' ');
    let sign = usize::from(text.starts_with(['-', '+']));
    let length = text[sign..].bytes().take_while(|byte| byte.is_ascii_digit() || *byte == b'.').count();
    match text[..sign + length].parse() {
        Ok(number) => (Some(number), &text[sign + length..]),
        Err(_) => (None, text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_a_command_and_words() {
        let command = MarlinCommand::parse(" N12 G1 X1.5Y-2 Z F600*71");
        assert_eq!((command.code, command.text), (('G', 1), "G1 X1.5Y-2 Z F600"));
        assert_eq!(command.axes(), [Some(1.5), Some(-2.0), None]);
        assert_eq!((command.has('Z'), command.value('F'), command.switch('S')), (true, Some(600.0), None));
        assert_eq!(MarlinCommand::parse("M420 S0").switch('S'), Some(false));
        assert_eq!(MarlinCommand::parse("G28").named_axes(), [true; 3]);
        assert_eq!(MarlinCommand::parse("G28 Z").named_axes(), [false, false, true]);
    }

    #[test]
    fn what_is_no_command_has_the_code_of_none() {
        for line in ["", "g1 X1", "X", "12", "N5", "\u{e9}1", "G92.1", "G-1"] {
            assert_eq!(MarlinCommand::parse(line).code, ('?', 0), "{line}");
        }
    }
}
