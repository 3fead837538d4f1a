//! `palpate study`: measures the force loop in simulation and draws what was found.

use super::exit::Failure;
use super::summary::print;
use crate::control::Strategy;
use crate::dataset::DatasetError;
use crate::study::{Findings, Outcome, Part, Size, StudyError, control, figures};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::fs;
use std::io::IsTerminal;
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
    let bar = bar();
    let told = |done: usize, of: usize| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
    };
    let findings = control(size, args.seed, &told).map_err(failure)?;
    bar.finish_and_clear();
    let rows = findings.ndjson();
    let figures = figures(&findings);
    let files = figures.iter().map(|(name, svg)| (*name, svg.as_str())).chain([("rows.ndjson", rows.as_str())]);
    write(&args.out, files).map_err(Failure::dataset)?;
    print(&if args.json { rows.clone() } else { summary(&findings, &args.out) })?;
    Ok(ExitCode::SUCCESS)
}

/// What was found, in at most 80 columns.
fn summary(findings: &Findings, out: &Path) -> String {
    let size = findings.size;
    let mut text =
        format!("1 N at {0} x {0} places 0.5 mm apart: time, and error of the force, by tolerance\n\n", size.main);
    let mut line = |told: String| text += &(told.trim_end().to_owned() + "\n");
    line(format!(
        "{:<9} {:<9}{:>6}{:>8}{:>7}{:>6}{:>9}{:>7}{:>7}{:>7}",
        "bench", "strategy", "mN", "median", "p95", "/min", "mean mN", "p95", "max", "peak"
    ));
    for outcome in findings.of(Part::Tolerance) {
        let best = if outcome.pareto == Some(true) { "*" } else { "" };
        line(format!(
            "{:<9} {:<9}{:>6}{:>8}{:>7}{:>6}{:>9}{:>7}{:>7}{:>7} {best}",
            outcome.rig,
            outcome.strategy.name(),
            1000.0 * outcome.tolerance_n,
            number(outcome.median_s, 2) + " s",
            number(outcome.p95_s, 2),
            number(outcome.ratio, 2),
            number(outcome.error_mean_mn, 1),
            number(outcome.error_p95_mn, 1),
            number(outcome.error_max_mn, 1),
            number(outcome.peak_over_mn, 0),
        ));
        if let Some(rule) = &outcome.rule {
            line(format!("{:19}ends after {} of {}: {rule}", "", outcome.done, outcome.points));
        }
    }
    line(String::new());
    line("/min: median over the least time there is; peak: over the set force;".to_owned());
    line("*: none of its bench is both faster and nearer".to_owned());
    line(String::new());

    let cell = |outcome: &Outcome| match &outcome.rule {
        Some(rule) => format!("{rule} @{}", outcome.done),
        None => format!(
            "{} {:>5} {:>5}",
            number(outcome.median_s, 2),
            number(outcome.error_p95_mn, 1),
            number(outcome.peak_over_mn, 0)
        ),
    };
    let mut table = |title: String, first: &str, part: Part, name: &dyn Fn(&Outcome) -> Option<String>| {
        line(title);
        line(format!("{first:<24}{:>18}{:>18}{:>18}", "guarded", "velocity", "map"));
        let mut rows: Vec<(String, Vec<&Outcome>)> = Vec::new();
        for outcome in findings.of(part) {
            let Some(name) = name(outcome) else { continue };
            match rows.iter_mut().find(|(row, _)| *row == name) {
                Some((_, outcomes)) => outcomes.push(outcome),
                None => rows.push((name, vec![outcome])),
            }
        }
        for (name, outcomes) in rows {
            let of =
                |strategy| outcomes.iter().find(|outcome| outcome.strategy == strategy).map(|outcome| cell(outcome));
            let cells = Strategy::ALL.map(|strategy| format!("{:>18}", of(strategy).unwrap_or_default())).concat();
            line(format!("{name:<24}{cells}"));
        }
        line(String::new());
    };
    for (rig, side) in [("XPS-like", size.scene), ("ESP301", size.small)] {
        let title = format!("scenes, {rig}, {side} x {side} (steel 5 x 5): s, p95, peak over mN; or rule @presses");
        table(title, "", Part::Scenes, &|outcome| (outcome.rig == rig).then(|| outcome.scene.clone()));
    }
    let title = "the declared stiffness, on the nominal specimen".to_owned();
    table(title, "", Part::Caution, &|outcome| Some(format!("{} N/mm", outcome.declared_n_mm)));

    line("velocity on a stiffness other than declared: s, p95 mN, peak over mN".to_owned());
    for outcome in findings.of(Part::Mismatch) {
        line(format!(
            "{:<24}{:>18}",
            format!("{:<9}{}", outcome.rig, outcome.scene.replace("stiffness ", "")),
            cell(outcome)
        ));
    }
    line(String::new());
    line(format!("a calibration of {0} x {0} places and its test of {1}, XPS-like", size.main, size.tests));
    for outcome in findings.of(Part::Tolerance).filter(|outcome| outcome.location_error_mm.is_some()) {
        line(format!(
            "{:<9}{:>6} mN{:>8} min{:>8} mm location error, mean",
            outcome.strategy.name(),
            1000.0 * outcome.tolerance_n,
            number(outcome.minutes, 1),
            number(outcome.location_error_mm, 3)
        ));
    }
    line(format!("\nfigures and rows: {}", out.display()));
    text
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}

/// How far the study is, for a person who watches.
fn bar() -> ProgressBar {
    let is_watched = std::io::stderr().is_terminal();
    let target = if is_watched { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(None, target);
    match ProgressStyle::with_template("[{bar:22}] {pos:>5}/{len} conditions, {elapsed}") {
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
        StudyError::System(_) => Failure::unwritten(error),
    }
}
