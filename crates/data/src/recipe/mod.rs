//! Tasks of a run: a TOML recipe, which is read with all its problems at once, and the plan that follows from it.
//!
//! A [`Recipe`] is a parsed text. A [`Plan`] is its list of presses on a given rig with a given seed. A plan can be printed
//! before anything moves. A recipe that requests more than the rig can do or may do has no plan.

mod accept;
mod drags;
mod keys;
mod load;
mod over_time;
mod parse;
mod plan;
mod step;
mod training;

pub use accept::{Accept, parse_rule};
pub use drags::PlannedDrag;
pub use parse::parse;
pub use plan::{Ground, Plan};
pub use step::UnitChoice;
pub use step::{Checks, GridOrder, Manner, OnMiss, PRESSES_CEILING, Phase, Places, SeriesScope, Step, StepLoad};
pub use training::Entry;

use crate::acceptance::AcceptanceRule;
use palpate_control::Strategy;
use palpate_document::Keys;

/// All keys that a recipe may have.
pub const KEYS: Keys = keys::root::KEYS;

/// All keys that an acceptance file may have.
pub const RULE_KEYS: Keys = accept::accept::KEYS;

/// Largest number of presses of one recipe unless more are [allowed](Recipe::with_presses_max). A night of 10 hours is enough for
/// some 20,000.
pub const PRESSES_MAX: usize = 100_000;

/// Largest number of entries of any plan: the recipe's presses, and the presses that teach.
pub(crate) const ENTRIES_MAX: usize = PRESSES_CEILING + training::TRAINING_PRESSES;

/// A recipe, parsed but not yet checked against a rig.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// Name of the recipe; a run folder is named after it.
    pub name: String,
    /// Steps, in the order of execution.
    pub steps: Vec<Step>,
    /// Solvers that evaluate the run when it is done; empty: no evaluation.
    pub solvers: Vec<String>,
    /// Rig that the recipe names: a file relative to it, or a shipped rig.
    pub rig: Option<String>,
    /// When places are checked.
    pub checks: Checks,
    /// What becomes of a press with a missed reading.
    pub on_miss: OnMiss,
    /// Which readings are kept.
    pub series: SeriesScope,
    /// Acceptance rule; `None`: no verdict.
    pub accept: Option<Accept>,
    /// Largest number of presses.
    pub presses_max: usize,
    pub(super) file: String,
    pub(super) text: String,
    /// Name and text of the file that contains the acceptance rule, if `accept` names one.
    pub(super) rule_file: Option<(String, String)>,
}

impl Recipe {
    /// Creates a recipe that isn't in a file. It has no checks and keeps no readings.
    pub fn new(name: &str, steps: Vec<Step>) -> Recipe {
        let name = name.to_owned();
        let (file, text) = (name.clone(), name.clone()); // the text that a problem shows
        let (solvers, checks, series) = (Vec::new(), Checks::None, SeriesScope::None);
        Recipe {
            name,
            steps,
            solvers,
            rig: None,
            checks,
            on_miss: OnMiss::default(),
            series,
            accept: None,
            presses_max: PRESSES_MAX,
            file,
            text,
            rule_file: None,
        }
    }

    /// Returns the acceptance rule, once a file named in the recipe has been read.
    pub fn rule(&self) -> Option<&AcceptanceRule> {
        match &self.accept {
            Some(Accept::Rule(rule)) => Some(rule),
            Some(Accept::File(_)) | None => None,
        }
    }

    /// Returns the recipe with an acceptance rule that was read from a file of this name and text.
    #[must_use]
    pub fn with_rule(self, rule: AcceptanceRule, file: &str, text: &str) -> Recipe {
        Recipe { accept: Some(Accept::Rule(rule)), rule_file: Some((file.to_owned(), text.to_owned())), ..self }
    }

    /// Returns the recipe with one strategy for every press instead of the strategies of its steps.
    #[must_use]
    pub fn with_strategy(mut self, strategy: Strategy) -> Recipe {
        self.steps.iter_mut().for_each(|step| step.manner.strategy = strategy);
        self
    }

    /// Returns the recipe with this number of presses allowed, at most [`PRESSES_CEILING`].
    #[must_use]
    pub fn with_presses_max(self, presses_max: usize) -> Recipe {
        Recipe { presses_max: presses_max.min(PRESSES_CEILING), ..self }
    }
}

#[cfg(test)]
mod tests;
