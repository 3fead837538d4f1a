//! `palpate run`.

use super::exit::Failure;
use super::labels::LabelArgs;
use super::provenance::session;
use super::session::{SessionArgs, carry_out};
use super::sources::{RigArgs, Sources};
use palpate_data::dataset::{RunFacts, RunFolder};
use palpate_data::recipe::Plan;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate run recipes/paper.toml
  palpate run recipes/test.toml --seed 7 --out runs/seven
  palpate run recipes/calibrate.toml --rig rigs/esp301.toml --sensor A-017
  palpate run recipes/bench.toml --strategy guarded
  palpate run recipes/paper.toml --rig rigs/esp301.toml --simulate

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
    out: Option<PathBuf>,
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

/// Makes the run's folder and walks its plan.
pub(super) fn run(args: &RunArgs) -> Result<ExitCode, Failure> {
    let Begun { sources, plan, mut folder } = begin(args)?;
    carry_out(&plan, &sources.rig, &mut folder, &sources.recipe, &args.session)
}

/// Makes the run's folder.
pub(super) fn begin(args: &RunArgs) -> Result<Begun, Failure> {
    let sources = Sources::read(&args.recipe, &args.rig)?;
    let plan = sources.plan(args.rig.seed)?;
    args.session.manner.check(&sources.rig)?;
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
