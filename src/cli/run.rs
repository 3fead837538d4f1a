//! `palpate run`.

use super::check::check_recipe;
use super::exit::Failure;
use super::labels::LabelArgs;
use super::output::OutputArgs;
use super::provenance::session;
use super::session::{SessionArgs, carry_out};
use super::signals::is_attended;
use super::sources::{RigArgs, Sources};
use super::summary::{print, tell};
use super::which_rig::Chosen;
use palpate_data::dataset::{RunFacts, RunFolder};
use palpate_data::recipe::Plan;
use palpate_run::rig::RigSpec;
use std::path::PathBuf;
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
    /// The recipe
    recipe: PathBuf,
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    labels: LabelArgs,
    /// Output folder [default: runs/NAME, runs/NAME-2, ...]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print the plan, like `palpate check`; nothing moves
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    pub session: SessionArgs,
}

/// A run whose folder is made. Nothing has moved.
pub(super) struct Begun {
    /// Recipe and rig.
    pub sources: Sources,
    /// The presses.
    pub plan: Plan,
    /// The folder.
    pub folder: RunFolder,
}

/// Prints the plan, or makes the run's folder and walks the plan.
pub(super) fn run(args: &RunArgs) -> Result<ExitCode, Failure> {
    if args.dry_run {
        return check_recipe(&args.recipe, &args.rig, OutputArgs { json: args.session.json });
    }
    recorded(args).map(|(_, code)| code)
}

/// Makes the run's folder and walks its plan. Returns the folder and the exit code.
pub(super) fn recorded(args: &RunArgs) -> Result<(RunFolder, ExitCode), Failure> {
    let show = if args.session.json { tell } else { print };
    let Begun { sources, plan, mut folder } = begin(args, &|chosen, rig| {
        show(&chosen.line(rig))?;
        chosen.confirm(rig, is_attended())
    })?;
    let code = carry_out(&plan, &sources.rig, &mut folder, &sources.recipe, &args.session)?;
    Ok((folder, code))
}

/// Makes the run's folder, once `confirm` agrees to the rig.
pub(super) fn begin(
    args: &RunArgs,
    confirm: &dyn Fn(&Chosen, &RigSpec) -> Result<(), Failure>,
) -> Result<Begun, Failure> {
    let sources = Sources::read(&args.recipe, &args.rig)?;
    let plan = sources.plan(args.rig.seed)?;
    args.session.manner.check(&sources.rig)?;
    confirm(&sources.chosen, &sources.rig)?;
    let facts = RunFacts {
        labels: args.labels.labels(),
        strategy: args.rig.strategy,
        presses_max: args.rig.presses_max,
        ..RunFacts::new(&plan, sources.rig.is_simulated())
    };
    let session = session(args.session.manner.durability.into());
    let layout = &sources.rig.array.layout;
    let folder =
        RunFolder::create(args.out.as_deref(), &sources.origins, facts, session, layout).map_err(Failure::unmade)?;
    Ok(Begun { sources, plan, folder })
}
