//! What every study has: where its output goes, how far it is, and its end.

use crate::api::Failure;
use crate::cli::summary::print;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use palpate_data::dataset::DatasetError;
use palpate_study::StudyError;
use std::fs;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of every study that uses random numbers.
#[derive(Debug, clap::Args)]
pub(super) struct Common {
    #[command(flatten)]
    pub(super) output: Output,
    /// A quick preview in seconds with few samples; its numbers are rough
    #[arg(long)]
    pub(super) quick: bool,
    /// Random seed for specimens, contacts and all noise
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = crate::api::sources::seed, allow_negative_numbers = true)]
    pub(super) seed: u64,
}

/// Destination of the results.
#[derive(Debug, clap::Args)]
pub(super) struct Output {
    /// Output folder for figures and rows [default: study-NAME]
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Print one JSON object per row instead of a summary
    #[arg(long)]
    pub(super) json: bool,
}

/// Study in progress.
pub(super) struct StudyOutput {
    pub(super) out: PathBuf,
    pub(super) json: bool,
    bar: ProgressBar,
}

impl StudyOutput {
    /// Checks that the folder is free, before anything is computed.
    pub(super) fn new(args: &Output, name: &str) -> Result<StudyOutput, Failure> {
        let out = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("study-{name}")));
        if out.symlink_metadata().is_ok() {
            return Err(Failure::dataset(DatasetError::Exists { path: out }));
        }
        Ok(StudyOutput { out, json: args.json, bar: bar() })
    }

    /// Returns the function that is informed about the progress.
    pub(super) fn text(&self) -> impl Fn(usize, usize) + Sync + '_ {
        |done, of| {
            self.bar.set_length(of as u64);
            self.bar.set_position(done as u64);
        }
    }

    /// Returns the results, or the exit code that states why there are none.
    pub(super) fn carried<T>(&self, found: Result<T, StudyError>) -> Result<T, Failure> {
        self.bar.finish_and_clear();
        found.map_err(failure)
    }

    /// Writes figures and rows, and prints rows or summary.
    pub(super) fn end(
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

/// Returns the location of the files, as the last line of a summary.
pub(super) fn ended(out: &Path) -> String {
    format!("figures and rows: {}\n", out.display())
}

pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}

/// Returns the progress bar of the study, for a person who watches.
fn bar() -> ProgressBar {
    let is_watched = std::io::stderr().is_terminal();
    let target = if is_watched { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(None, target);
    match ProgressStyle::with_template("[{bar:22}] {pos:>5}/{len} parts, {elapsed}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Creates the folder with its files.
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
