//! The rule: for which question does a scene need a term?

use super::effect::Effect;
use super::terms::Touches;
use serde::Serialize;

/// What is asked of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Question {
    /// Mean location error of the paper's method.
    PaperLocation,
    /// Its mean force error.
    PaperForce,
    /// Mean location error of the surrogate.
    SurrogateLocation,
    /// Its mean force error.
    SurrogateForce,
    /// Mean location error of the physics solver.
    PhysicsLocation,
    /// Its mean force error.
    PhysicsForce,
    /// Table 1: repeatability while loading, mean over units.
    RepeatabilityLoading,
    /// Table 1: repeatability while unloading, mean over units.
    RepeatabilityUnloading,
    /// Table 1: hysteresis, mean over units.
    Hysteresis,
    /// Mean of |true force in the window - set force|.
    PressError,
    /// Largest true force over the set one.
    PressPeak,
    /// From one press to the next, median.
    PressTime,
}

impl Question {
    /// All, in the order of the tables.
    pub const ALL: [Question; 12] = [
        Question::PaperLocation,
        Question::PaperForce,
        Question::SurrogateLocation,
        Question::SurrogateForce,
        Question::PhysicsLocation,
        Question::PhysicsForce,
        Question::RepeatabilityLoading,
        Question::RepeatabilityUnloading,
        Question::Hysteresis,
        Question::PressError,
        Question::PressPeak,
        Question::PressTime,
    ];

    /// What it is asked of.
    pub fn of(self) -> Touches {
        match self as usize {
            0..=5 => Touches::Methods,
            6..=8 => Touches::Table1,
            _ => Touches::Press,
        }
    }

    /// The unit of its answer.
    pub fn unit(self) -> &'static str {
        match self {
            Question::PaperLocation | Question::SurrogateLocation | Question::PhysicsLocation => "mm",
            Question::PaperForce | Question::SurrogateForce | Question::PhysicsForce => "N",
            Question::RepeatabilityLoading | Question::RepeatabilityUnloading | Question::Hysteresis => "% FS",
            Question::PressError | Question::PressPeak => "mN",
            Question::PressTime => "s",
        }
    }

    /// A difference below this matters to nobody, however small the base's own number is: a hundredth of the paper's 1 mm and
    /// 0.1 N; a twentieth of a per cent of full scale; of a force what the paper's load cell can't see, which is 3 mN of one
    /// conversion (a peak) and a tenth of that of a window's hundred; 10 ms.
    pub fn floor(self) -> f64 {
        match self {
            Question::PaperLocation | Question::SurrogateLocation | Question::PhysicsLocation => 0.01,
            Question::PaperForce | Question::SurrogateForce | Question::PhysicsForce => 0.001,
            Question::RepeatabilityLoading | Question::RepeatabilityUnloading | Question::Hysteresis => 0.05,
            Question::PressError => 0.3,
            Question::PressPeak => 3.0,
            Question::PressTime => 0.01,
        }
    }

    /// What a difference must exceed to count where the base's own number is this.
    pub fn counts_from(self, base: f64) -> f64 {
        (SHARE * base.abs()).max(self.floor())
    }
}

/// A difference counts from this share of the base's own number on, 1.
pub const SHARE: f64 = 0.05;

/// Whether a scene needs a term.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Needed {
    /// The difference counts, and isn't chance.
    Yes,
    /// It doesn't count, wherever in its interval it lies.
    No,
    /// More seeds would tell.
    Undecided,
}

/// Whether a scene needs a term that changes so much, where a difference counts from so much on.
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

/// What the whole study found with seed 1: each term that a scene needs, and for what. Tests hold the shipped scenes against it,
/// and it against the study.
pub const NEEDED: [(&str, &[Question]); 9] = [
    (
        "taxel noise",
        &[
            Question::PaperLocation,
            Question::PaperForce,
            Question::SurrogateLocation,
            Question::SurrogateForce,
            Question::PhysicsLocation,
            Question::PhysicsForce,
            Question::RepeatabilityLoading,
            Question::RepeatabilityUnloading,
        ],
    ),
    ("noise of reading", &[Question::RepeatabilityLoading, Question::RepeatabilityUnloading]),
    ("hysteresis", &[Question::Hysteresis]),
    ("taxel disc", &[Question::PaperForce, Question::SurrogateForce]),
    (
        "bonded layer",
        &[
            Question::PaperForce,
            Question::SurrogateLocation,
            Question::SurrogateForce,
            Question::PhysicsLocation,
            Question::PhysicsForce,
        ],
    ),
    (
        "drift of zeros",
        &[
            Question::PaperLocation,
            Question::PaperForce,
            Question::SurrogateLocation,
            Question::SurrogateForce,
            Question::PhysicsLocation,
            Question::PhysicsForce,
            Question::RepeatabilityLoading,
            Question::RepeatabilityUnloading,
        ],
    ),
    ("force tolerance", &[Question::PaperForce, Question::SurrogateForce, Question::PhysicsForce]),
    ("load-cell noise", &[Question::PressError, Question::PressTime]),
    ("relaxation", &[Question::PressError]),
];

#[cfg(test)]
mod tests {
    use super::super::TERMS;
    use super::*;

    fn effect(difference: f64, within: f64) -> Effect {
        Effect { off: 1.0, on: 1.0 + difference, difference, within, seeds: 20 }
    }

    #[test]
    fn a_term_is_needed_if_its_effect_counts_and_waste_only_if_it_surely_does_not() {
        for (difference, within, expected) in [
            (0.2, 0.1, Needed::Yes),
            (-0.2, 0.1, Needed::Yes),
            (0.11, 0.105, Needed::Yes),     // may be less than counts, is not nothing
            (0.2, 0.25, Needed::Undecided), // may be nothing
            (0.08, 0.01, Needed::No),       // is something, and doesn't count
            (-0.08, 0.01, Needed::No),
            (0.08, 0.03, Needed::Undecided), // may count
            (0.0, 0.09, Needed::No),
            (0.0, 0.11, Needed::Undecided),
        ] {
            assert_eq!(needed(&effect(difference, within), 0.1), expected, "{difference} +- {within}");
        }
    }

    #[test]
    fn a_base_near_nothing_has_a_floor() {
        for (question, base, counts) in [
            (Question::PaperLocation, 0.4, 0.02),
            (Question::PaperLocation, 0.1, 0.01),
            (Question::PressPeak, -2.0, 3.0),
            (Question::PressPeak, -80.0, 4.0),
        ] {
            assert!((question.counts_from(base) - counts).abs() < 1e-12, "{question:?} of {base}");
        }
    }

    #[test]
    fn questions_stand_in_their_own_order_and_what_is_needed_is_a_term_that_can_touch_it() {
        for (index, question) in Question::ALL.into_iter().enumerate() {
            assert_eq!(question as usize, index);
        }
        for (name, questions) in NEEDED {
            let term =
                TERMS.iter().find(|term| term.name == name).unwrap_or_else(|| panic!("no term is called {name}"));
            assert!(!questions.is_empty() && questions.iter().all(|question| term.touches(question.of())), "{name}");
        }
    }
}
