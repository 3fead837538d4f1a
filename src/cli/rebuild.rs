//! `palpate rebuild`.

use super::output::OutputArgs;
use crate::api::Failure;
use crate::api::provenance::now;
use crate::api::recorded::bench_of;
use palpate_data::dataset::{Accepted, RunFolder, Texts};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate rebuild runs/paper

The journal doesn't change, except that an incomplete last record is removed.
If manifest or tables hold presses that the journal lacks, nothing is changed
(exit code 2): restore the journal from a copy. Without a copy, --accept-loss
regenerates everything from the journal, and records the loss. Likewise a
journal that isn't the one of the manifest is refused: --accept-journal takes
it, and records this.";

/// Regenerate a run's tables and manifest from its journal
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct RebuildArgs {
    /// The run folder
    run: PathBuf,
    /// Continue with the presses of the journal, although other files of the run hold more
    #[arg(long)]
    accept_loss: bool,
    /// Continue with this journal, although the manifest describes another one
    #[arg(long)]
    accept_journal: bool,
    #[command(flatten)]
    output: OutputArgs,
}

/// Writes every view of the journal.
pub(super) fn rebuild(args: &RebuildArgs) -> Result<ExitCode, Failure> {
    let (manifest, texts) = Texts::read_accepting(&args.run, args.accept_journal).map_err(Failure::dataset)?;
    let layout = bench_of(&args.run, &manifest.facts, &texts)?.layout;
    let accept = Accepted { loss: args.accept_loss, another_journal: args.accept_journal };
    let mut folder = RunFolder::open_accepting(&args.run, &layout, accept, now()).map_err(Failure::dataset)?;
    folder.rebuild().map_err(Failure::dataset)?;
    let manifest = folder.manifest();
    let (done, planned, files) = (manifest.presses_done, manifest.facts.presses_planned, manifest.files.len());
    let text = format!("{}: {done} of {planned} presses, {files} files regenerated or checked\n", args.run.display());
    let content = json!({ "run": args.run, "presses_done": done, "presses_planned": planned, "files": files });
    args.output.print(&text, &content)?;
    Ok(ExitCode::SUCCESS)
}
