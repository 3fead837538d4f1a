//! Text from a device, prepared for display.

/// Largest number of characters of a device's text that are shown or stored (docs/process.md), so that a message stays readable.
pub const SHOWN_MAX_CHARS: usize = 300;

/// Replacement for a character that would control a terminal.
const UNSHOWN: char = '\u{fffd}';

/// Returns a device's text without control characters, which a terminal would execute, and shortened.
pub fn shown(said: &str) -> String {
    let visible = |c: char| match c {
        '\t' | '\n' | '\r' => ' ',
        c if c.is_control() || turns_text(c) => UNSHOWN,
        c => c,
    };
    shortened(said).chars().map(visible).collect()
}

/// Returns the beginning of a device's message, for a message that shows the text with its escape sequences.
pub(super) fn shortened(said: &str) -> String {
    let mut text: String = said.chars().take(SHOWN_MAX_CHARS).collect();
    if text.len() < said.len() {
        text.push('…');
    }
    text
}

/// Whether a character changes the direction of the text after it, which would make a text look like another one.
fn turns_text(c: char) -> bool {
    matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{DeviceError, DeviceProblem, Identity};

    #[test]
    fn what_a_device_says_does_nothing_to_a_terminal_and_is_short() {
        assert_eq!(shown("mine, SN 7\r\n°µ"), "mine, SN 7  °µ");
        assert_eq!(shown("\u{1b}[2J\u{7}\u{9b}1m\u{202e}\0"), "\u{fffd}[2J\u{fffd}\u{fffd}1m\u{fffd}\u{fffd}");
        let long = "é".repeat(SHOWN_MAX_CHARS);
        assert_eq!(shown(&long), long);
        assert_eq!(shown(&format!("{long}é")), format!("{long}…"));
    }

    #[test]
    fn errors_and_identities_are_shown_so() {
        let rude = format!("\u{1b}]0;title\u{7}{}", "x".repeat(10 * SHOWN_MAX_CHARS));
        let problems: [fn(String) -> DeviceProblem; 6] = [
            DeviceProblem::Link,
            DeviceProblem::Claim,
            DeviceProblem::Refused,
            DeviceProblem::Mismatch,
            DeviceProblem::Motion,
            |answer| DeviceProblem::Misfit { answer, expected: "a number".to_owned() },
        ];
        for problem in problems {
            let (device, doing) = ("stage".to_owned(), "moving".to_owned());
            let told = DeviceError { device, doing, problem: problem(rude.clone()) }.to_string();
            assert!(!told.contains(char::is_control) && told.chars().count() < SHOWN_MAX_CHARS + 100, "{told}");
        }
        let (role, link) = ("stage".to_owned(), "link".to_owned());
        let identity = Identity { role, identity: rude.clone(), link, warnings: vec![rude] }.shown();
        for text in [&identity.identity, &identity.warnings[0]] {
            assert!(!text.contains(char::is_control) && text.chars().count() == SHOWN_MAX_CHARS + 1, "{text}");
        }
    }
}
