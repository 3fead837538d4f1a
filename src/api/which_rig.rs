//! The rig of a recipe: the one place that chooses it, and knows which real rig a person must confirm.

use super::Failure;
use super::shipped::{self, RECIPES, RIGS};
use super::sources::{bounded, read_named_in, read_rig_text};
use palpate_data::dataset::JOURNAL;
use palpate_run::rig::{self, RigSpec, SIM_RIG};
use std::path::{Path, PathBuf};

/// Name of a rig file that belongs to the recipes of its folder, and of the shipped rig of shipped recipes.
const BESIDE: &str = "rig.toml";
const SHIPPED: &str = "sim.toml";

/// What names a file, for a message.
pub(crate) const THE_BATCH: &str = "the batch";
const THE_RECIPE: &str = "`rig` of the recipe";

/// The rig of a recipe.
pub(crate) struct ChosenRig {
    /// Its file, or the name of a shipped rig.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
    by: By,
}

/// Reason for the choice.
#[derive(Clone, Copy, PartialEq, Eq)]
enum By {
    /// `--rig` names it.
    Option,
    /// The recipe's key `rig` names it.
    Key,
    /// The batch file names it.
    Batch,
    /// The run that is continued has it.
    Run,
    /// It is `rig.toml` in the recipe's folder.
    Folder,
    /// The recipe is a shipped one.
    Shipped,
}

impl ChosenRig {
    /// Chooses the rig of a recipe that has a text and perhaps a key `rig`. `option` is the value of `--rig`.
    pub(crate) fn of(
        recipe: &Path,
        text: &str,
        key: Option<&str>,
        option: Option<&Path>,
    ) -> Result<ChosenRig, Failure> {
        let name = recipe.display();
        if recipe.with_file_name(JOURNAL).symlink_metadata().is_ok() {
            let folder = recipe.parent().unwrap_or(Path::new("")).display();
            let help = format!("continue the run: `palpate resume {folder}`; or copy the recipe to another folder");
            return Err(Failure::usage(miette::miette!(help = help, "{name} is the recipe of a run, in its folder")));
        }
        if let Some(path) = option {
            return Ok(ChosenRig { path: path.to_owned(), text: read_rig_text(path)?, by: By::Option });
        }
        if let Some(key) = key {
            let (path, text) = read_named_in(recipe, key, RIGS, "rigs", THE_RECIPE)?;
            return Ok(ChosenRig { path, text, by: By::Key });
        }
        let is_file = shipped::named(RECIPES, "recipes", recipe).is_none();
        let beside = recipe.with_file_name(BESIDE);
        if is_file && beside.symlink_metadata().is_ok() {
            return Ok(ChosenRig { text: read_rig_text(&beside)?, path: beside, by: By::Folder });
        }
        if RECIPES.iter().any(|shipped| shipped.text == text) {
            return Ok(ChosenRig { path: SHIPPED.into(), text: SIM_RIG.to_owned(), by: By::Shipped });
        }
        let help = format!(
            "add --rig RIG, put the rig into the recipe's folder as {}, or name it in the recipe: rig = \"RIG\". RIG is a file, or a \
             shipped rig: {}",
            beside.display(),
            shipped::names(RIGS).join(", ")
        );
        Err(Failure::usage(miette::miette!(help = help, "{name}: no rig is named, and none is in the recipe's folder")))
    }

    /// Returns the rig that a batch file names: it is that of all its recipes.
    pub(crate) fn of_batch(batch: &Path, name: &str) -> Result<ChosenRig, Failure> {
        let (path, text) = read_named_in(batch, name, RIGS, "rigs", THE_BATCH)?;
        Ok(ChosenRig { path, text, by: By::Batch })
    }

    /// Returns the rig with which a run is continued.
    pub(crate) fn of_run(path: PathBuf, text: String) -> ChosenRig {
        ChosenRig { path, text, by: By::Run }
    }

    /// Refuses a recipe of a batch that names another rig.
    pub(crate) fn check_same(&self, recipe: &Path, key: &str) -> Result<(), Failure> {
        let (path, text) = read_named_in(recipe, key, RIGS, "rigs", THE_RECIPE)?;
        if text == self.text {
            return Ok(());
        }
        let (recipe, own, rig) = (recipe.display(), path.display(), self.path.display());
        let help = "remove `rig` from the recipe, or name the same rig in both";
        Err(Failure::usage(miette::miette!(help = help, "{recipe}: `rig` is {own}, but the rig of the batch is {rig}")))
    }

    /// Returns the content of the rig.
    pub(crate) fn read(&self) -> Result<RigSpec, Failure> {
        let beside = |name: &str| bounded(&self.path.with_file_name(name));
        rig::parse(&self.path.display().to_string(), &self.text, &beside).map_err(Failure::usage)
    }

    /// Returns the first line that a command prints. `rig` is the chosen one, simulated if this was asked for.
    pub(crate) fn line(&self, rig: &RigSpec) -> String {
        let kind = if rig.is_simulated() { "simulated" } else { "real" };
        let why = match self.by {
            By::Option => "named by --rig",
            By::Key => "named by the recipe",
            By::Batch => "named by the batch",
            By::Run => "of the run",
            By::Folder => "in the recipe's folder",
            By::Shipped => "shipped with palpate",
        };
        format!("rig {}: {kind}, {why}\n", self.path.display())
    }

    /// Whether a person must confirm the rig before it moves: a real rig that `--rig` doesn't name.
    pub(crate) fn is_to_confirm(&self, rig: &RigSpec) -> bool {
        !rig.is_simulated() && self.by != By::Option
    }

    /// Returns the refusal of a rig that a person must confirm, where there is no person.
    pub(crate) fn unconfirmed(&self) -> Failure {
        let path = self.path.display();
        let help = format!("add --rig {path}");
        Failure::usage(miette::miette!(
            help = help,
            "{path} is a real rig that --rig doesn't name, and there is no terminal to confirm it at: nothing was moved"
        ))
    }
}
