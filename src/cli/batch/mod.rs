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
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Check(check::CheckArgs),
    Run(run::RunArgs),
    Status(status::StatusArgs),
    Report(report::ReportArgs),
    Add(marks::AddArgs),
    Retry(marks::RetryArgs),
    Skip(marks::SkipArgs),
    Note(marks::NoteArgs),
}

/// Carries a command out.
pub(super) fn batch(args: &BatchArgs) -> Result<ExitCode, Failure> {
    match &args.command {
        Command::Check(args) => check::check(args),
        Command::Run(args) => run::run(args),
        Command::Status(args) => status::status(args),
        Command::Report(args) => report::report(args),
        Command::Add(args) => marks::add(args),
        Command::Retry(args) => marks::retry(args),
        Command::Skip(args) => marks::skip(args),
        Command::Note(args) => marks::note(args),
    }
}
