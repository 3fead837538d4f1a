use super::exit::Failure;
use super::provenance::session;
use super::session::{SessionArgs, carry_out};
use super::sources::{RigArgs, Sources};
use super::summary;
use crate::dataset::{RunFolder, Status};
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate resume runs/paper
  palpate resume runs/paper-3 --after-trip

The devices are identified again, and three places touched again: the run goes
on only if they are where they were. A staircase that was interrupted is
repeated whole. A complete run is left alone.";

/// Go on with a run that was stopped
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// The run folder
    run: PathBuf,
    /// Go on although a safety rule was broken: a person has found the cause
    #[arg(long)]
    after_trip: bool,
    #[command(flatten)]
    session: SessionArgs,
}

/// Goes on from the journal.
pub fn resume(args: &Args) -> Result<ExitCode, Failure> {
    let facts = RunFolder::recall_manifest(&args.run).map_err(Failure::dataset)?.facts;
    let rig = RigArgs {
        rig: args.run.join("rig.toml"),
        simulate: facts.simulated,
        seed: facts.seed,
        strategy: facts.strategy,
        presses_max: facts.presses_max,
    };
    let sources = Sources::read(&args.run.join("recipe.toml"), &rig)?;
    let plan = sources.plan(facts.seed)?;
    args.session.check(&sources.rig)?;
    let mut folder = RunFolder::open(&args.run, &sources.rig.array.layout).map_err(Failure::dataset)?;
    if folder.manifest().status == Status::Tripped && !args.after_trip {
        let trip = folder.manifest().trip.as_ref().map(|trip| trip.to_string()).unwrap_or_default();
        let help = "find the cause; then say --after-trip";
        return Err(Failure::usage(miette::miette!(help = help, "the run ended with a safety trip: {trip}")));
    }
    if folder.manifest().status == Status::Complete {
        let is_finished = folder.is_finished().map_err(Failure::dataset)?;
        if !is_finished {
            folder.rebuild().map_err(Failure::dataset)?;
        }
        let told = if is_finished { "nothing to do" } else { "its tables were made anew" };
        summary::tell(&format!("{} is complete: {told}\n", args.run.display()))?;
        return Ok(ExitCode::SUCCESS);
    }
    folder.go_on(session(args.session.durability)).map_err(Failure::dataset)?;
    carry_out(&plan, &sources.rig, &mut folder, &sources.recipe.solvers, &args.session)
}
