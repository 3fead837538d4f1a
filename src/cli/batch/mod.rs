//! `palpate batch`: sensors of one design, calibrated one after another at one bench.

mod big;
mod check;
mod desk;
mod item;
mod marks;
mod material;
mod report;
mod run;
mod status;
mod typed;

use crate::api::Failure;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate batch check batch
  palpate batch run batch
  printf 'REF-1\\nA-01\\nA-02\\n' | palpate batch run batch --out runs/piped
  palpate batch status runs/first-batch
  palpate batch report runs/first-batch
  palpate batch retry runs/first-batch A-02";

/// Calibrate a batch of sensors, one after another, with a person or a scanner that types serial numbers
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct BatchArgs {
    #[command(subcommand)]
    command: BatchCommand,
}

#[derive(Debug, clap::Subcommand)]
enum BatchCommand {
    Check(check::BatchCheckArgs),
    Run(run::BatchRunArgs),
    Status(status::StatusArgs),
    Report(report::BatchReportArgs),
    Add(marks::AddArgs),
    Retry(marks::RetryArgs),
    Skip(marks::SkipArgs),
    Note(marks::NoteArgs),
}

/// Carries a command out.
pub(super) fn batch(args: &BatchArgs) -> Result<ExitCode, Failure> {
    match &args.command {
        BatchCommand::Check(args) => check::check(args),
        BatchCommand::Run(args) => run::run(args),
        BatchCommand::Status(args) => status::status(args),
        BatchCommand::Report(args) => report::report(args),
        BatchCommand::Add(args) => marks::add(args),
        BatchCommand::Retry(args) => marks::retry(args),
        BatchCommand::Skip(args) => marks::skip(args),
        BatchCommand::Note(args) => marks::note(args),
    }
}
