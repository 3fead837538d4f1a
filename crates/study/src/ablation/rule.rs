//! Rule that states for which question a scene needs a term.

use super::effect::Effect;
use super::terms::Touches;
use serde::Serialize;

/// Question about a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Question {
    /// Name of the question in rows.
    pub name: &'static str,
    /// What the question is tried on.
    pub of: Touches,
    /// Unit of the answer.
    pub unit: &'static str,
    /// Difference below which the effect never matters, even if the base's own number is very small.
    floor: f64,
}

/// All questions, in the order of the tables. First come mean errors of three methods. Then comes Table 1, as means over units.
/// The last three are for a press. They are the mean of |true force in the window - set force|, the largest true force above the
/// set force, and the median press interval.
///
/// The floors are: a hundredth of the paper's 1 mm and 0.1 N; a twentieth of a per cent of full scale; for a force, the smallest
/// value that the paper's load cell can measure; 10 ms. The load cell's value is 3 mN for one conversion (a peak), and a tenth of
/// this for a window's hundred conversions.
pub const QUESTIONS: [Question; 12] = [
    question("paper-location", Touches::Methods, "mm", 0.01),
    question("paper-force", Touches::Methods, "N", 0.001),
    question("surrogate-location", Touches::Methods, "mm", 0.01),
    question("surrogate-force", Touches::Methods, "N", 0.001),
    question("physics-location", Touches::Methods, "mm", 0.01),
    question("physics-force", Touches::Methods, "N", 0.001),
    question("repeatability-loading", Touches::Table1, "% FS", 0.05),
    question("repeatability-unloading", Touches::Table1, "% FS", 0.05),
    question("hysteresis", Touches::Table1, "% FS", 0.05),
    question("press-error", Touches::Press, "mN", 0.3),
    question("press-peak", Touches::Press, "mN", 3.0),
    question("press-time", Touches::Press, "s", 0.01),
];

const fn question(name: &'static str, of: Touches, unit: &'static str, floor: f64) -> Question {
    Question { name, of, unit, floor }
}

impl Question {
    /// Returns the limit that a difference must exceed to count, for this number of the base.
    pub fn counts_from(&self, base: f64) -> f64 {
        (SHARE * base.abs()).max(self.floor)
    }
}

/// Fraction of the base's own number from which a difference counts, 1.
pub const SHARE: f64 = 0.05;

/// Whether a scene needs a term.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Needed {
    /// The difference counts and isn't due to chance.
    Yes,
    /// The difference doesn't count anywhere in its interval.
    No,
    /// More seeds are required.
    Undecided,
}

/// Returns whether a scene needs a term with this effect, if a difference must exceed `counts_from`.
pub fn needed(effect: &Effect, counts_from: f64) -> Needed {
    let size = effect.difference.abs();
    if size > counts_from && size > effect.within {
        Needed::Yes
    } else if size + effect.within <= counts_from {
        Needed::No
    } else {
        Needed::Undecided
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn effect(difference: f64, within: f64) -> Effect {
        Effect { off: 1.0, on: 1.0 + difference, difference, within, seeds: 20 }
    }

    #[test]
    fn term_is_needed_if_its_effect_counts_and_useless_only_if_surely_not() {
        for (difference, within, expected) in [
            (0.2, 0.1, Needed::Yes),
            (-0.2, 0.1, Needed::Yes),
            (0.11, 0.105, Needed::Yes),     // may be too small to count, isn't zero
            (0.2, 0.25, Needed::Undecided), // may be zero
            (0.08, 0.01, Needed::No),       // isn't zero, and doesn't count
            (-0.08, 0.01, Needed::No),
            (0.08, 0.03, Needed::Undecided), // may count
            (0.0, 0.09, Needed::No),
            (0.0, 0.11, Needed::Undecided),
        ] {
            assert_eq!(needed(&effect(difference, within), 0.1), expected, "{difference} +- {within}");
        }
    }

    #[test]
    fn base_near_zero_has_a_floor() {
        for (question, base, counts) in [
            ("paper-location", 0.4, 0.02),
            ("paper-location", 0.1, 0.01),
            ("press-peak", -2.0, 3.0),
            ("press-peak", -80.0, 4.0),
        ] {
            let of = QUESTIONS.iter().find(|its| its.name == question).unwrap();
            assert!((of.counts_from(base) - counts).abs() < 1e-12, "{question} of {base}");
        }
    }
}
