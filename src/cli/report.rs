//! `palpate report`: writes a page about a sensor's runs, or about many sensors side by side.

use super::exit::Failure;
use super::figure_files::FigureFiles;
use super::method::solvers;
use super::output::OutputArgs;
use super::recorded::read_run;
use super::summary::tell;
use super::verdict::{AcceptArgs, rule_of, verdict_code};
use palpate_data::acceptance::Verdict;
use palpate_data::dataset::{Recorded, check_run, files};
use palpate_report::report::{
    Compared, Judged, MARK, Page, ReportError, Subject, ToCompare, comparison, counted, page,
};
use palpate_run::batch::ByDesign;
use palpate_run::rig::Bench;
use palpate_solver::{BEST, Evaluation};
use serde_json::{Value, json};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate report runs/paper
  palpate report runs/characterise runs/calibrate runs/test --out A-017.html
  palpate report runs/calibrate runs/test --same-sensor --accept example/accept.toml
  palpate report --compare runs/batch-* --out batch.html
  palpate report runs/paper --figures figures

The files of example/ are written by `palpate init example --from example`.

All runs of a page must be of one sensor, with each phase in one run. The page is one
self-contained file: it opens without a network and can be printed. --figures
also saves each figure as an SVG file in light colours, and its numbers
as a CSV file of the same name.";

/// Write a page about one run, or a comparison of many
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ReportArgs {
    /// The run folders
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Compare runs: sensors of a batch, or one sensor over time
    #[arg(long)]
    compare: bool,
    /// Output file [default: report.html in the first run's folder, or comparison.html]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Folder for the figures, each as SVG with its numbers as CSV
    #[arg(long, value_name = "DIR")]
    figures: Option<PathBuf>,
    /// Treat runs without a sensor ID as runs of the same sensor
    #[arg(long, conflicts_with = "compare")]
    same_sensor: bool,
    #[command(flatten)]
    accept: AcceptArgs,
    /// The method shown in addition to pearson in a comparison; best is the slowest
    #[arg(long, value_name = "NAME", default_value = "surrogate", requires = "compare", value_parser = solvers([BEST]))]
    solver: String,
    #[command(flatten)]
    output: OutputArgs,
}

/// Writes the page, and prints a line with its results. The exit code is the verdict's; that of a comparison is 0.
pub(super) fn report(args: &ReportArgs) -> Result<ExitCode, Failure> {
    let default = || if args.compare { "comparison.html".into() } else { args.runs[0].join("report.html") };
    let out = args.out.clone().unwrap_or_else(default);
    check_free(&out)?;
    let runs: Vec<(Recorded, Bench)> = args.runs.iter().map(|run| read_run(run)).collect::<Result<_, Failure>>()?;
    let (page, told, result, code) = if args.compare { compare(args, runs)? } else { one(args, runs)? };
    // before anything is written
    let files = args.figures.as_deref().map(|folder| FigureFiles::new(folder, &page.figures)).transpose()?;
    write(&out, &page.html)?;
    args.output.text(&format!("{told}\n{}: {:.0} kB\n", out.display(), page.html.len() as f64 / 1000.0))?;
    if let Some(files) = files {
        args.output.text(&files.write()?)?;
    }
    args.output.object(&json!({ "page": out, "figures": args.figures, "result": result }))?;
    Ok(code)
}

fn one(args: &ReportArgs, runs: Vec<(Recorded, Bench)>) -> Result<(Page, String, Value, ExitCode), Failure> {
    for (run, _) in runs.iter().filter(|(run, _)| run.contacts.is_empty()) {
        let newer = newest_after(&run.path).map(|newer| format!("; a newer run is {}", newer.display()));
        tell(&format!("note: {} has no presses{}\n", run.path.display(), newer.unwrap_or_default()))?;
    }
    let (subject, judged) = judged(runs, args.same_sensor, &args.accept)?;
    let verdict = judged.verdict().map_or("no verdict", Verdict::told);
    let decisive = judged.decisive();
    let errors = decisive.map_or(", not evaluated".to_owned(), |evaluation| {
        let Evaluation { solver, location_error_mm, force_error_n, .. } = evaluation;
        let force = force_error_n.map(|error| format!(" and {:.4} N", error.mean)).unwrap_or_default();
        format!(", {:.3} mm{force} by {solver}", location_error_mm.mean)
    });
    let told = format!("{}: {verdict}{errors}", subject.title());
    let result = json!({
        "sensor": subject.title(), "verdict": judged.verdict(), "solver": decisive.map(|evaluation| &evaluation.solver),
        "location_error_mm": decisive.map(|evaluation| evaluation.location_error_mm.mean),
        "force_error_n": decisive.and_then(|evaluation| evaluation.force_error_n).map(|error| error.mean),
    });
    Ok((page(&subject, &judged), told, result, verdict_code(judged.judgement.as_ref())))
}

/// Returns the last of the runs that were made after this one under the same name: `paper-2` and `paper-3` after `paper`.
fn newest_after(run: &Path) -> Option<PathBuf> {
    let name = run.file_name()?.to_str()?;
    let number = |name: &str| {
        name.rsplit_once('-').and_then(|(stem, number)| Some((stem.to_owned(), number.parse::<u64>().ok()?)))
    };
    let (stem, own) = number(name).unwrap_or((name.to_owned(), 1));
    let others = (own + 1..).map(|number| run.with_file_name(format!("{stem}-{number}")));
    others.take_while(|other| check_run(other).is_ok()).last()
}

/// Returns the sensor of some runs, judged by the named rule or by the common rule of their recipes.
pub(super) fn judged(
    runs: Vec<(Recorded, Bench)>,
    same_sensor: bool,
    accept: &AcceptArgs,
) -> Result<(Subject, Judged), Failure> {
    let rule = accept.rule_of(runs.iter().map(|(run, _)| run))?;
    let paths: Vec<&Path> = runs.iter().map(|(run, _)| run.path.as_path()).collect();
    let design = ByDesign::of_runs(&paths).map_err(Failure::usage)?;
    let subject = Subject::of(runs, same_sensor).map_err(failure)?;
    let judged = Judged::of(&subject, rule.as_ref(), design);
    Ok((subject, judged))
}

fn compare(args: &ReportArgs, runs: Vec<(Recorded, Bench)>) -> Result<(Page, String, Value, ExitCode), Failure> {
    let named = args.accept.rule()?;
    let to_compare = |(run, bench): (Recorded, Bench)| {
        let rule = if named.is_some() { named.clone() } else { rule_of(&run)? };
        Ok(ToCompare { run, bench, rule })
    };
    let runs: Vec<ToCompare> = runs.into_iter().map(to_compare).collect::<Result<_, Failure>>()?;
    let compared = Compared::all(&runs, &args.solver);
    let counted_as = |verdict: Option<Verdict>| compared.iter().filter(|run| run.verdict() == verdict).count();
    let each = [Some(Verdict::Accepted), Some(Verdict::NotAccepted), Some(Verdict::NotDecided), None];
    let told: String = each
        .into_iter()
        .filter(|verdict| counted_as(*verdict) > 0)
        .map(|verdict| format!(", {} {}", counted_as(verdict), verdict.map_or("without a rule", Verdict::told)))
        .collect();
    let told = format!("{} compared{told}", counted(compared.len(), "run"));
    let verdicts: Vec<Option<Verdict>> = compared.iter().map(Compared::verdict).collect();
    let result = json!({ "runs": args.runs, "verdicts": verdicts });
    Ok((comparison(&compared, &args.solver), told, result, ExitCode::SUCCESS))
}

/// Checks that the path is free, or contains a page of this program of the same kind, which may be replaced. No other file is
/// replaced. Only a regular file is read, because a pipe may never end.
pub(super) fn check_free(out: &Path) -> Result<(), Failure> {
    let is_ours = || {
        let is_file = fs::metadata(out).is_ok_and(|at| at.is_file());
        is_file
            && fs::read_to_string(out)
                .is_ok_and(|text| text.starts_with(BEGINNING) && text.contains(MARK) && !text.contains(CERTIFICATE))
    };
    // in a run folder a link is somebody's trap; elsewhere it is a person's wish
    if let Err(why) = if is_in_run(out) { files::check_replaceable(out) } else { Ok(()) } {
        let help = "remove it, or choose another --out";
        return Err(Failure::usage(miette::miette!(help = help, "{}: {why}", out.display())));
    }
    if out.symlink_metadata().is_ok() && !is_ours() {
        let help = "choose another --out: only a page that palpate wrote is replaced";
        return Err(Failure::usage(miette::miette!(help = help, "{} already exists", out.display())));
    }
    if out.file_name().is_none() {
        return Err(Failure::usage(miette::miette!("{} is not a file name", out.display())));
    }
    Ok(())
}

/// Title of a certificate, which no report replaces.
const CERTIFICATE: &str = "<title>Calibration certificate ";

/// Beginning of every page.
const BEGINNING: &str = "<!DOCTYPE html>";

/// Writes the page to its path, completely or not at all.
pub(super) fn write(out: &Path, html: &str) -> Result<(), Failure> {
    put(out, html).map_err(|why| {
        let help = "no page was written; choose another --out, or free disk space and check the permissions";
        Failure::unwritten(miette::miette!(help = help, "writing the page {}: {why}", out.display()))
    })
}

fn put(out: &Path, html: &str) -> io::Result<()> {
    if let Some(parent) = out.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        fs::create_dir_all(parent)?;
    }
    let linked = if is_in_run(out) { None } else { fs::canonicalize(out).ok() }; // a link stays one
    files::place(linked.as_deref().unwrap_or(out), html)
}

fn is_in_run(out: &Path) -> bool {
    out.parent().is_some_and(|folder| check_run(folder).is_ok())
}

fn failure(error: ReportError) -> Failure {
    match error {
        ReportError::Dataset(error) => Failure::dataset(error),
        other => Failure::usage(other),
    }
}
