use super::exit::Failure;
use super::session::{SessionArgs, carry_out};
use super::sources::{RigArgs, Sources};
use crate::dataset::{Manifest, RunFolder};
use jiff::Zoned;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate run recipes/paper.toml
  palpate run recipes/test.toml --seed 7 --out runs/seven
  palpate run recipes/calibrate.toml --rig rigs/esp301.toml --sensor A-017
  palpate run recipes/bench.toml --strategy guarded
  palpate run recipes/paper.toml --rig rigs/esp301.toml --simulate

Ctrl-C parks the stage and keeps what was measured; `palpate resume RUN` goes on.";

/// Carry out a recipe on a rig and keep every press
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// The recipe
    recipe: PathBuf,
    #[command(flatten)]
    rig: RigArgs,
    /// Who is pressed: kept with the run
    #[arg(long, value_name = "ID")]
    sensor: Option<String>,
    /// The folder to make; else runs/NAME, runs/NAME-2, ...
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    session: SessionArgs,
}

/// Makes the run's folder and walks its plan.
pub fn run(args: &Args) -> Result<ExitCode, Failure> {
    let sources = Sources::read(&args.recipe, &args.rig)?;
    let plan = sources.plan(args.rig.seed)?;
    args.session.check(&sources.rig)?;
    let started = Zoned::now().to_string();
    let mut manifest = Manifest::new(&plan, sources.rig.is_simulated(), args.sensor.clone(), started);
    manifest.strategy = args.rig.strategy;
    let layout = &sources.rig.array.layout;
    let mut folder =
        RunFolder::create(args.out.as_deref(), &sources.origins, manifest, layout).map_err(Failure::dataset)?;
    carry_out(&plan, &sources.rig, &mut folder, &sources.recipe.solvers, &args.session)
}
