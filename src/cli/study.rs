//! `palpate study`: measures the force loop in simulation and draws what was found.

use super::exit::Failure;
use super::summary::print;
use crate::dataset::DatasetError;
use crate::study::{Size, StudyError, control};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate study control
  palpate study control --out study-2 --json
  palpate study control --quick";

/// Measure how fast and how near each strategy presses, in simulation
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, clap::Subcommand)]
enum Study {
    /// The force loop: every strategy under every condition, a minute or two
    #[command(after_help = EXAMPLES)]
    Control(ControlArgs),
}

#[derive(Debug, clap::Args)]
struct ControlArgs {
    /// The folder to make for figures and rows
    #[arg(long, value_name = "DIR", default_value = "study-control")]
    out: PathBuf,
    /// Print one JSON object for each strategy and condition, not a summary
    #[arg(long)]
    json: bool,
    /// A few presses each: a first look in seconds, whose numbers mean little
    #[arg(long)]
    quick: bool,
    /// What the specimen and all noise are drawn from
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Carries a study out, writes its figures and prints what was found.
pub fn study(args: &Args) -> Result<ExitCode, Failure> {
    let Study::Control(args) = &args.study;
    if args.out.symlink_metadata().is_ok() {
        return Err(Failure::dataset(DatasetError::Exists { path: args.out.clone() }));
    }
    let size = if args.quick { Size::QUICK } else { Size::WHOLE };
    let findings = control(size, args.seed, &|_, _| {}).map_err(failure)?;
    let rows = findings.ndjson();
    write(&args.out, &[("rows.ndjson", &rows)]).map_err(Failure::dataset)?;
    print(&rows)?;
    Ok(ExitCode::SUCCESS)
}

/// Makes the folder with its files.
fn write(folder: &Path, files: &[(&str, &str)]) -> Result<(), DatasetError> {
    let io = |doing, path: &Path| DatasetError::io(doing, path.to_owned());
    if let Some(parent) = folder.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        fs::create_dir_all(parent).map_err(io("making", parent))?;
    }
    fs::create_dir(folder).map_err(io("making", folder))?;
    for (name, text) in files {
        let path = folder.join(name);
        fs::write(&path, text).map_err(io("writing", &path))?;
    }
    Ok(())
}

fn failure(error: StudyError) -> Failure {
    match error {
        StudyError::Problems(problems) => Failure::usage(problems),
        StudyError::System(_) => Failure::unwritten(error),
    }
}
