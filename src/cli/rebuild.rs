use super::exit::Failure;
use super::sources::read_rig;
use super::summary;
use crate::dataset::{RunFolder, check_run};
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate rebuild runs/paper

The journal is left as it is, but for a last record that a power cut has torn.";

/// Make a run's tables and manifest anew from its journal
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// The run folder
    run: PathBuf,
}

/// Writes every view of the journal.
pub fn rebuild(args: &Args) -> Result<ExitCode, Failure> {
    check_run(&args.run).map_err(Failure::dataset)?; // says best that this is none
    let layout = read_rig(&args.run.join("rig.toml"))?.1.array.layout;
    let mut folder = RunFolder::open(&args.run, &layout).map_err(Failure::dataset)?;
    folder.rebuild().map_err(Failure::dataset)?;
    let manifest = folder.manifest();
    summary::print(&format!(
        "{}: {} of {} presses, {} files made anew or looked at\n",
        args.run.display(),
        manifest.presses_done,
        manifest.facts.presses_planned,
        manifest.files.len()
    ))?;
    Ok(ExitCode::SUCCESS)
}
