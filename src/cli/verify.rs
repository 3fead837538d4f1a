//! `palpate verify`.

use super::exit::Failure;
use super::recorded::rig_of;
use super::summary;
use crate::dataset::{DatasetError, JournalError, Loss, Texts, verify};
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate verify runs/paper

Exit code 1 where something isn't as it was written.";

/// Compare a run's files with its journal and their SHA-256
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct VerifyArgs {
    /// The run folder
    run: PathBuf,
}

/// Reports what isn't as it was written.
pub fn verify_run(args: &VerifyArgs) -> Result<ExitCode, Failure> {
    let layout = match Texts::read(&args.run) {
        Ok((_, texts)) if texts.rig().is_empty() => None,
        Ok((_, texts)) => Some(rig_of(&args.run, &texts)?.array.layout),
        Err(DatasetError::Journal(JournalError::Damaged { .. })) => None,
        Err(error) => return Err(Failure::dataset(error)),
    };
    let verified = verify(&args.run, layout.as_ref()).map_err(Failure::dataset)?;
    let whole = format!("{} records in the journal, {} files as they were written", verified.records, verified.sound);
    if verified.problems.is_empty() {
        let state = match (verified.is_under_way, verified.has_ended) {
            (true, _) => "; the run is under way: its tables weren't compared",
            (false, false) => "; the run hasn't ended: `palpate resume` goes on",
            (false, true) => "",
        };
        let losses = |loss: &Loss| format!("{}: presses were lost, accepted {}\n", args.run.display(), loss.accepted);
        let losses: String = verified.losses.iter().map(losses).collect();
        summary::print(&format!("{}: {whole}{state}\n{losses}", args.run.display()))?;
        return Ok(ExitCode::SUCCESS);
    }
    let help = "`palpate rebuild` regenerates tables and manifest; restore a damaged journal from a copy";
    let problems = verified.problems.join("\n");
    Err(Failure::not_accepted(miette::miette!(help = help, "{}: {whole}, but\n{problems}", args.run.display())))
}
