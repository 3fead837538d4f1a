use super::exit::Failure;
use super::sources::read_rig;
use super::summary;
use crate::dataset::{check_run, verify};
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate verify runs/paper

Exit code 1 where something isn't as it was written.";

/// Hold a run's files against its journal and their SHA-256
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// The run folder
    run: PathBuf,
}

/// Tells what isn't as it was written.
pub fn verify_run(args: &Args) -> Result<ExitCode, Failure> {
    check_run(&args.run).map_err(Failure::dataset)?; // says best that this is none
    let layout = read_rig(&args.run.join("rig.toml"))?.1.array.layout;
    let verified = verify(&args.run, &layout).map_err(Failure::dataset)?;
    let whole = format!("{} records in the journal, {} files as they were written", verified.records, verified.sound);
    if verified.problems.is_empty() {
        let ended = if verified.has_ended { "" } else { "; the run hasn't ended: its tables aren't looked at" };
        summary::print(&format!("{}: {whole}{ended}\n", args.run.display()))?;
        return Ok(ExitCode::SUCCESS);
    }
    let help = "views are made anew by `palpate rebuild`; a journal, a recipe and a rig come from a copy only";
    let problems = verified.problems.join("\n");
    Err(Failure::not_accepted(miette::miette!(help = help, "{}: {whole}, but\n{problems}", args.run.display())))
}
