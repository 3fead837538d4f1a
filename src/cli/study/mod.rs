//! `palpate study`: measures the force loop, or the methods that solve, in simulation, or computes what an array can tell, and
//! draws what was found.

mod ablation;
mod control;
mod curves;
mod methods;
mod validation;

use super::exit::Failure;
use super::summary::print;
use crate::dataset::DatasetError;
use crate::study::StudyError;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::fs;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate study control
  palpate study speed-accuracy runs/paper
  palpate study budget --out budget-2 --json
  palpate study failures --quick
  palpate study curves --rig rigs/sim.toml";

/// Measure strategies of the force loop, methods that solve, or an array's design, and draw what was found
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, clap::Subcommand)]
enum Study {
    /// The force loop: every strategy under every condition, a minute or two
    Control(Common),
    /// How near each method comes against the time of a solve, on a run or on the paper's array
    SpeedAccuracy(methods::SpeedAccuracy),
    /// How near each method comes against the number of calibration presses, a minute
    Budget(Common),
    /// Where each method fails, and whether it says so, a minute or two
    Failures(Common),
    /// How alike two contacts read: the paper's claims, or how good an array is, in less than a second
    Curves(curves::Args),
    /// Which physical and measurement terms a simulated scene needs, and for what, a minute
    Ablation(Common),
    /// The paper's protocol with ten specimens, and its numerical study, as a page; half a minute
    Validation(Common),
}

/// What every study is told that draws at random.
#[derive(Debug, clap::Args)]
struct Common {
    #[command(flatten)]
    output: Output,
    /// Little of each: a first look in seconds, whose numbers mean little
    #[arg(long)]
    quick: bool,
    /// What specimens, contacts and all noise are drawn from
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Where what was found goes.
#[derive(Debug, clap::Args)]
struct Output {
    /// The folder to make for figures and rows [default: study-NAME]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object for each row, not a summary
    #[arg(long)]
    json: bool,
}

/// Carries a study out, writes its figures and prints what was found.
pub fn study(args: &Args) -> Result<ExitCode, Failure> {
    match &args.study {
        Study::Control(args) => control::study(args),
        Study::SpeedAccuracy(args) => methods::speed_accuracy(args),
        Study::Budget(args) => methods::budget(args),
        Study::Failures(args) => methods::failures(args),
        Study::Curves(args) => curves::study(args),
        Study::Ablation(args) => ablation::study(args),
        Study::Validation(args) => validation::study(args),
    }
}

/// A study on its way.
struct Begun {
    out: PathBuf,
    json: bool,
    bar: ProgressBar,
}

impl Begun {
    /// Looks whether the folder is free, before anything is computed.
    fn new(args: &Output, name: &str) -> Result<Begun, Failure> {
        let out = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("study-{name}")));
        if out.symlink_metadata().is_ok() {
            return Err(Failure::dataset(DatasetError::Exists { path: out }));
        }
        Ok(Begun { out, json: args.json, bar: bar() })
    }

    /// Hears how far it is.
    fn told(&self) -> impl Fn(usize, usize) + Sync + '_ {
        |done, of| {
            self.bar.set_length(of as u64);
            self.bar.set_position(done as u64);
        }
    }

    /// What was found, or the exit code that says why nothing was.
    fn carried<T>(&self, found: Result<T, StudyError>) -> Result<T, Failure> {
        self.bar.finish_and_clear();
        found.map_err(failure)
    }

    /// Writes figures and rows, and prints rows or summary.
    fn end(
        &self,
        figures: Vec<(String, String)>,
        rows: String,
        summary: impl Fn(&Path) -> String,
    ) -> Result<ExitCode, Failure> {
        let files = figures.iter().map(|(name, svg)| (name.as_str(), svg.as_str()));
        write(&self.out, files.chain([("rows.ndjson", rows.as_str())])).map_err(Failure::dataset)?;
        print(&if self.json { rows } else { summary(&self.out) })?;
        Ok(ExitCode::SUCCESS)
    }
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}

/// How far the study is, for a person who watches.
fn bar() -> ProgressBar {
    let is_watched = std::io::stderr().is_terminal();
    let target = if is_watched { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(None, target);
    match ProgressStyle::with_template("[{bar:22}] {pos:>5}/{len} parts, {elapsed}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Makes the folder with its files.
fn write<'a>(folder: &Path, files: impl Iterator<Item = (&'a str, &'a str)>) -> Result<(), DatasetError> {
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
        StudyError::Calibration(_) | StudyError::Broken { .. } => Failure::usage(error),
        StudyError::System(_) => Failure::unwritten(error),
    }
}
