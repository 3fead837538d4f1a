//! The acceptance rule of runs: the one that an option names, or that of their recipes.

use super::sources::{parse_kept_recipe, read};
use super::{Failure, Note};
use palpate_data::acceptance::AcceptanceRule;
use palpate_data::dataset::Recorded;
use palpate_data::recipe::parse_rule;
use std::path::PathBuf;

/// Rule that replaces the rule of the run's recipe.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct AcceptOptions {
    /// Use the acceptance rule of this file instead of the recipe's
    #[arg(long, value_name = "FILE")]
    pub accept: Option<PathBuf>,
}

impl AcceptOptions {
    /// The rule that was named.
    pub(crate) fn rule(&self) -> Result<Option<AcceptanceRule>, Failure> {
        let Some(path) = &self.accept else { return Ok(None) };
        let file = path.display().to_string();
        let rule = parse_rule(&file, &read(path)?).map_err(Failure::usage)?;
        Ok(Some(AcceptanceRule { afterwards_by: Some(file), ..rule }))
    }

    /// The rule that was named; else the one that the runs' recipes agree on.
    pub(crate) fn rule_of<'a>(
        &self,
        runs: impl IntoIterator<Item = &'a Recorded>,
        note: Note<'_>,
    ) -> Result<Option<AcceptanceRule>, Failure> {
        if let Some(rule) = self.rule()? {
            return Ok(Some(rule));
        }
        let mut agreed: Option<AcceptanceRule> = None;
        for run in runs {
            match (&agreed, rule_of(run, note)) {
                (Some(first), Some(rule)) if *first != rule => {
                    let help = "select one with --accept FILE";
                    return Err(Failure::usage(miette::miette!(
                        help = help,
                        "the runs have different acceptance rules"
                    )));
                }
                (None, rule) => agreed = rule,
                _ => {}
            }
        }
        Ok(agreed)
    }
}

/// The rule of a run's own recipe. A recipe that today's program can't read gives none, and a warning.
pub(crate) fn rule_of(run: &Recorded, note: Note<'_>) -> Option<AcceptanceRule> {
    if run.manifest.facts.imported.is_some() {
        return None;
    }
    match parse_kept_recipe(&run.path, &run.texts, note) {
        Ok(read) => read.recipe.rule().cloned(),
        Err(_) => {
            note(&format!("warning: {}: its recipe can't be read, so it gives no verdict", run.path.display()));
            None
        }
    }
}
