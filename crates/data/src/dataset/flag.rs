//! Faults of a press.

use serde::{Deserialize, Serialize};

/// Fault of a press that is nevertheless kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Flag {
    /// The force in the window differed from the set force by more than the tolerance.
    OutOfTolerance,
    /// An output was at the end of its range at some time in the window, so the load may have been larger.
    Saturated,
    /// The outputs weren't read throughout the window, or no channel changed although the load changed.
    Stale,
    /// Readings of the array or of a monitor were missed, each time that the press was made.
    Missed,
    /// A safety rule stopped the press, and a person called it sound.
    CalledSound,
    /// An external table flags the row with its own word.
    Other,
}

impl Flag {
    /// Every flag.
    pub const ALL: [Flag; 6] =
        [Flag::OutOfTolerance, Flag::Saturated, Flag::Stale, Flag::Missed, Flag::CalledSound, Flag::Other];

    /// Returns the name of the flag in files.
    pub fn name(self) -> &'static str {
        match self {
            Flag::OutOfTolerance => "out-of-tolerance",
            Flag::Saturated => "saturated",
            Flag::Stale => "stale",
            Flag::Missed => "missed",
            Flag::CalledSound => "called-sound",
            Flag::Other => "other",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flag_has_a_name_of_its_own_in_both_texts() {
        for flag in Flag::ALL {
            assert_eq!(serde_json::to_string(&flag).unwrap(), format!("\"{}\"", flag.name()));
        }
    }
}
