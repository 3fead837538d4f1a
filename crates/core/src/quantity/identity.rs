//! Identity of a device, and its text prepared for display.

use serde::{Deserialize, Serialize};

/// Largest number of characters of a device's text that are shown or stored (docs/reference/process.md), so that a message stays readable.
pub const SHOWN_MAX_CHARS: usize = 300;

/// Replacement for a character that would control a terminal.
const UNSHOWN: char = '\u{fffd}';

/// Identity that a device reports.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Role of the device: `stage`, `load_cell` or `array`.
    pub role: String,
    /// Identity in the device's own words, or its protocol if it can't report one.
    pub identity: String,
    /// Link of the device.
    pub link: String,
    /// Facts that a person should know before using the device.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

impl Identity {
    /// Returns the identity in a form that may be shown and stored.
    #[must_use]
    pub fn shown(self) -> Identity {
        let warnings = self.warnings.iter().map(|warning| shown(warning)).collect();
        Identity { identity: shown(&self.identity), warnings, ..self }
    }
}

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
pub fn shortened(said: &str) -> String {
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

    #[test]
    fn device_text_is_cut_and_has_no_control_characters() {
        assert_eq!(shown("mine, SN 7\r\n°µ"), "mine, SN 7  °µ");
        assert_eq!(shown("\u{1b}[2J\u{7}\u{9b}1m\u{202e}\0"), "\u{fffd}[2J\u{fffd}\u{fffd}1m\u{fffd}\u{fffd}");
        let long = "é".repeat(SHOWN_MAX_CHARS);
        assert_eq!(shown(&long), long);
        assert_eq!(shown(&format!("{long}é")), format!("{long}…"));
    }
}
