//! What can be wrong with a press.

use serde::{Deserialize, Serialize};

/// What can be wrong with a press that is kept all the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Flag {
    /// The force in the window missed the set force by more than the tolerance.
    OutOfTolerance,
    /// An output stood at the end of its range at some time in the window: the load may have been larger.
    Saturated,
    /// The outputs weren't read through the window, or no channel has moved where the load was another.
    Stale,
    /// A table from elsewhere flags the row, with a word of its own.
    Other,
}

impl Flag {
    /// Every flag.
    pub const ALL: [Flag; 4] = [Flag::OutOfTolerance, Flag::Saturated, Flag::Stale, Flag::Other];

    /// The flag as it stands in files.
    pub fn name(self) -> &'static str {
        match self {
            Flag::OutOfTolerance => "out-of-tolerance",
            Flag::Saturated => "saturated",
            Flag::Stale => "stale",
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
