//! `palpate rebuild`.

use super::exit::Failure;
use super::provenance::now;
use super::recorded::bench_of;
use super::summary;
use palpate_data::dataset::{RunFolder, Texts};
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate rebuild runs/paper

The journal doesn't change, except that an incomplete last record is removed.
If manifest or tables hold presses that the journal lacks, nothing is changed
(exit code 2): restore the journal from a copy. Without a copy, --accept-loss
regenerates everything from the journal, and records the loss.";

/// Regenerate a run's tables and manifest from its journal
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct RebuildArgs {
    /// The run folder
    run: PathBuf,
    /// Continue with the presses of the journal, although other files of the run hold more
    #[arg(long)]
    accept_loss: bool,
}

/// Writes every view of the journal.
pub(super) fn rebuild(args: &RebuildArgs) -> Result<ExitCode, Failure> {
    let (manifest, texts) = Texts::read(&args.run).map_err(Failure::dataset)?;
    let layout = bench_of(&args.run, &manifest.facts, &texts)?.layout;
    let opened = match args.accept_loss {
        true => RunFolder::open_accepting_loss(&args.run, &layout, now()),
        false => RunFolder::open(&args.run, &layout),
    };
    let mut folder = opened.map_err(Failure::dataset)?;
    folder.rebuild().map_err(Failure::dataset)?;
    let manifest = folder.manifest();
    summary::print(&format!(
        "{}: {} of {} presses, {} files regenerated or checked\n",
        args.run.display(),
        manifest.presses_done,
        manifest.facts.presses_planned,
        manifest.files.len()
    ))?;
    Ok(ExitCode::SUCCESS)
}
