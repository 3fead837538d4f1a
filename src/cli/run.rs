//! `palpate run`.

use super::check::check_recipe;
use super::output::OutputArgs;
use super::session::{SessionArgs, carry_out};
use super::summary::{print, tell};
use super::which_way::{asked_at, confirm_rig};
use crate::api::run::begin_with;
use crate::api::{Failure, RunOptions};
use palpate_data::dataset::RunFolder;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate run recipes/paper.toml
  palpate run recipes/paper.toml --dry-run
  palpate run recipes/test.toml --seed 7 --out runs/seven
  palpate run recipes/calibrate.toml --rig rigs/esp301.toml --sensor A-017
  palpate run recipes/bench.toml --strategy guarded
  palpate run recipes/paper.toml --rig rigs/esp301.toml --simulate

The first line names the rig. A real rig that --rig doesn't name is confirmed at
the terminal; without a terminal, --rig must name it.

Ctrl-C finishes the current press and pauses; a second Ctrl-C stops immediately.
Both park the stage and keep all presses. `palpate resume RUN` continues.";

/// Run a recipe on a rig and record every press
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct RunArgs {
    #[command(flatten)]
    pub options: RunOptions,
    /// Print the plan, like `palpate check`; nothing moves
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub session: SessionArgs,
}

/// Prints the plan, or makes the run's folder and executes the plan.
pub(super) fn run(args: &RunArgs) -> Result<ExitCode, Failure> {
    if args.dry_run {
        let RunOptions { recipe, rig, manner, .. } = &args.options;
        return check_recipe(recipe, rig, manner.confirm.is_touched(), OutputArgs { json: args.session.json });
    }
    recorded(args).map(|(_, code)| code)
}

/// Makes the run's folder and executes its plan. Returns the folder and the exit code.
pub(super) fn recorded(args: &RunArgs) -> Result<(RunFolder, ExitCode), Failure> {
    let show = if args.session.json { tell } else { print };
    let mut begun = begin_with(&args.options, &|chosen, rig| {
        show(&chosen.line(rig))?;
        confirm_rig(chosen, rig)
    })?;
    begun.rig = asked_at(&args.options.manner.confirm, begun.rig);
    let code = carry_out(&mut begun, &args.session)?;
    Ok((begun.folder, code))
}
