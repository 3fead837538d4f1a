//! What to do: a TOML recipe, read with all its problems at once, and the plan that follows from it.
//!
//! A [`Recipe`] is a text understood; a [`Plan`] is its list of presses on a given rig with a given seed. A plan
//! can be printed before anything moves, and a recipe that asks for what the rig can't or mustn't do has no plan.

mod accept;
mod keys;
mod parse;
mod plan;
mod step;
mod teach;

pub use accept::{Accept, parse_rule};
pub use parse::parse;
pub use plan::{Ground, Plan};
pub use step::{Load, Manner, Order, PRESSES_CEILING, Phase, Places, Step, UnitChoice};
pub use teach::Entry;

use crate::acceptance::Rule;
use crate::control::Strategy;
use crate::document::Keys;

/// Every key that a recipe may have.
pub const KEYS: Keys = keys::root::KEYS;

/// Every key that an acceptance file may have.
pub const RULE_KEYS: Keys = accept::accept::KEYS;

/// Most presses of one recipe unless more are [allowed](Recipe::with_presses_max). A night of 10 hours holds some
/// 20,000.
pub const PRESSES_MAX: usize = 100_000;

/// Most entries any plan has: the recipe's presses, and those that teach.
pub const ENTRIES_MAX: usize = PRESSES_CEILING + teach::TEACHES;

/// A recipe, parsed but not yet checked against a rig.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// The recipe's name; a run folder is named after it.
    pub name: String,
    /// The steps, in the order they are done.
    pub steps: Vec<Step>,
    /// Solvers to evaluate the run with when it is done; empty: no evaluation.
    pub solvers: Vec<String>,
    /// The acceptance rule; none: no verdict.
    pub accept: Option<Accept>,
    /// Its most presses.
    pub presses_max: usize,
    pub(super) file: String,
    pub(super) text: String,
}

impl Recipe {
    /// A recipe that no file holds.
    pub fn new(name: &str, steps: Vec<Step>) -> Recipe {
        let name = name.to_owned();
        let (file, text) = (name.clone(), name.clone()); // what a problem is shown with
        Recipe { name, steps, solvers: Vec::new(), accept: None, presses_max: PRESSES_MAX, file, text }
    }

    /// The acceptance rule, once a file that the recipe names has been read.
    pub fn rule(&self) -> Option<&Rule> {
        match &self.accept {
            Some(Accept::Rule(rule)) => Some(rule),
            Some(Accept::File(_)) | None => None,
        }
    }

    /// The recipe with an acceptance rule.
    #[must_use]
    pub fn with_rule(self, rule: Rule) -> Recipe {
        Recipe { accept: Some(Accept::Rule(rule)), ..self }
    }

    /// The recipe with every press made by one strategy instead of those of its steps.
    #[must_use]
    pub fn with_strategy(mut self, strategy: Strategy) -> Recipe {
        self.steps.iter_mut().for_each(|step| step.manner.strategy = strategy);
        self
    }

    /// The recipe with so many presses allowed, at most [`PRESSES_CEILING`].
    #[must_use]
    pub fn with_presses_max(self, presses_max: usize) -> Recipe {
        Recipe { presses_max: presses_max.min(PRESSES_CEILING), ..self }
    }
}

#[cfg(test)]
mod tests;
