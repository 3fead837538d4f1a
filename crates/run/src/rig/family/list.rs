//! Every family, and the possible values of `driver` for each role.

use super::{DeviceFamily, daqmx, esp301, grbl, klipper, lines, marlin, modbus, process, ur, xps};
use palpate_document::{Case, Keys, ValueKind};

/// Every family, in the order in which messages name them.
pub const FAMILIES: [&DeviceFamily; 10] = [
    &esp301::FAMILY,
    &grbl::FAMILY,
    &marlin::FAMILY,
    &klipper::FAMILY,
    &ur::FAMILY,
    &modbus::FAMILY,
    &lines::FAMILY,
    &xps::FAMILY,
    &daqmx::FAMILY,
    &process::FAMILY,
];

/// Possible values of a role's `driver`, from the families that support the role.
macro_rules! choice {
    ($role:ident) => {
        pub(in crate::rig) mod $role {
            use super::*;

            const fn counts() -> (usize, usize) {
                let (mut words, mut cases, mut i) = (0, 0, 0);
                while i < FAMILIES.len() {
                    if let Some(role) = &FAMILIES[i].$role {
                        words += role.words.len();
                        cases += !role.keys.is_empty() as usize;
                    }
                    i += 1;
                }
                (words, cases)
            }

            const WORDS: [&str; counts().0] = {
                let (mut words, mut next, mut i) = ([""; counts().0], 0, 0);
                while i < FAMILIES.len() {
                    if let Some(role) = &FAMILIES[i].$role {
                        let mut word = 0;
                        while word < role.words.len() {
                            words[next] = role.words[word];
                            (next, word) = (next + 1, word + 1);
                        }
                    }
                    i += 1;
                }
                words
            };

            const CASES: [Case; counts().1] = {
                let (mut cases, mut next, mut i) = ([Case { name: "", keys: &[] }; counts().1], 0, 0);
                while i < FAMILIES.len() {
                    if let Some(role) = &FAMILIES[i].$role
                        && !role.keys.is_empty()
                    {
                        cases[next] = Case { name: role.keys[0].name, keys: role.keys };
                        next += 1;
                    }
                    i += 1;
                }
                cases
            };

            const KEYS: Keys = Keys::one_of(&CASES);

            /// A word, a table, or either of the two.
            pub(in crate::rig) const KIND: ValueKind = match WORDS.len() {
                0 => ValueKind::Table(&KEYS),
                _ => ValueKind::Either(&[ValueKind::Word(&WORDS), ValueKind::Table(&KEYS)]),
            };
        }
    };
}

/// Possible values of `driver` for each role.
pub(in crate::rig) mod choices {
    use super::{Case, FAMILIES, Keys, ValueKind};

    choice!(stage);
    choice!(load_cell);
    choice!(array);
}
