//! Pages about a sensor's runs, or about many sensors side by side, and their figures as files.

use super::accept::{AcceptOptions, rule_of};
use super::figure_files::FigureFiles;
use super::method::{check_solver, solvers};
use super::recorded::read_run;
use super::{Failure, Note};
use palpate_data::acceptance::{Judgement, SensorVerdict};
use palpate_data::dataset::{Recorded, check_run, files};
use palpate_report::report::{
    Compared, MARK, Page, ReportError, SensorResults, Subject, ToCompare, comparison, counted, page,
};
use palpate_run::batch::ByDesign;
use palpate_run::rig::Bench;
use palpate_solver::{BEST, Evaluation};
use serde_json::{Value, json};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Method that a comparison shows in addition to `pearson`.
const COMPARED: &str = "surrogate";

/// Runs of a page, and where it is written.
#[derive(Clone, Debug, clap::Args)]
pub struct ReportOptions {
    /// The run folders
    #[arg(required = true)]
    pub runs: Vec<PathBuf>,
    /// Compare runs: sensors of a batch, or one sensor over time
    #[arg(long)]
    pub compare: bool,
    /// Output file [default: report.html in the first run's folder, or comparison.html]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Folder for the figures, each as SVG with its numbers as CSV
    #[arg(long, value_name = "DIR")]
    pub figures: Option<PathBuf>,
    /// Treat runs without a sensor ID as runs of the same sensor
    #[arg(long, conflicts_with = "compare")]
    pub same_sensor: bool,
    /// The rule, if it isn't that of the recipe.
    #[command(flatten)]
    pub accept: AcceptOptions,
    /// The method shown in addition to pearson in a comparison; best is the slowest
    #[arg(long, value_name = "NAME", default_value = COMPARED, requires = "compare", value_parser = solvers([BEST]))]
    pub solver: String,
}

impl ReportOptions {
    /// A page about runs of one sensor.
    pub fn of(runs: Vec<PathBuf>) -> Self {
        let (compare, same_sensor, accept) = (false, false, AcceptOptions::default());
        ReportOptions { runs, compare, out: None, figures: None, same_sensor, accept, solver: COMPARED.to_owned() }
    }
}

/// A page that isn't written yet.
pub struct ReportPage {
    /// Path of the page.
    pub out: PathBuf,
    /// The page, a complete HTML file.
    pub html: String,
    /// Its results in a line.
    pub summary: String,
    /// Its results as an object.
    pub result: Value,
    /// Verdict on the sensor of the page, if there is a rule; `None` for a comparison.
    pub judgement: Option<Judgement>,
    figures: Option<FigureFiles>,
}

/// Makes the page, like `palpate report`. Nothing is written before [`ReportPage::write`].
///
/// # Errors
/// Bad input, or a path at which something else is.
pub fn report(options: &ReportOptions, note: Note<'_>) -> Result<ReportPage, Failure> {
    check_solver(&options.solver, &[BEST])?;
    let first = options.runs.first().ok_or_else(|| Failure::usage(miette::miette!("no run is named")))?;
    let default = || if options.compare { "comparison.html".into() } else { first.join("report.html") };
    let out = options.out.clone().unwrap_or_else(default);
    check_free(&out)?;
    let runs = options.runs.iter().map(|run| read_run(run, note)).collect::<Result<Vec<_>, Failure>>()?;
    let report = if options.compare { compare(options, runs, note)? } else { one(options, runs, note)? };
    report.figures.iter().try_for_each(FigureFiles::check)?;
    Ok(ReportPage { out, ..report })
}

impl ReportPage {
    fn new(options: &ReportOptions, page: Page, summary: String, result: Value) -> Self {
        let figures = options.figures.clone().map(|folder| FigureFiles::new(folder, page.figures));
        ReportPage { out: PathBuf::new(), html: page.html, summary, result, judgement: None, figures }
    }

    /// Writes the page and its figures.
    ///
    /// # Errors
    /// A file can't be written.
    pub fn write(&self) -> Result<(), Failure> {
        self.write_page()?;
        self.write_figures().map(drop)
    }

    /// Writes the page.
    pub(crate) fn write_page(&self) -> Result<(), Failure> {
        write(&self.out, &self.html)
    }

    /// Writes the figures, if a folder is named for them, and returns a line about them.
    pub(crate) fn write_figures(&self) -> Result<Option<String>, Failure> {
        self.figures.as_ref().map(FigureFiles::write).transpose()
    }
}

fn one(options: &ReportOptions, runs: Vec<(Recorded, Bench)>, note: Note<'_>) -> Result<ReportPage, Failure> {
    for (run, _) in runs.iter().filter(|(run, _)| run.contacts.is_empty()) {
        let newer = newest_after(&run.path).map(|newer| format!("; a newer run is {}", newer.display()));
        note(&format!("note: {} has no presses{}", run.path.display(), newer.unwrap_or_default()));
    }
    let (subject, judged) = judged(runs, options.same_sensor, &options.accept, note)?;
    let verdict = judged.verdict().map_or("no verdict", SensorVerdict::text);
    let decisive = judged.decisive();
    let errors = decisive.map_or(", not evaluated".to_owned(), |evaluation| {
        let Evaluation { solver, location_error_mm, force_error_n, depth_error_mm, .. } = evaluation;
        let force = force_error_n.map(|error| format!(" and {:.4} N", error.mean)).unwrap_or_default();
        let depth = depth_error_mm.map(|error| format!(" and {:.3} mm of depth", error.mean)).unwrap_or_default();
        format!(", {:.3} mm{force}{depth} by {solver}", location_error_mm.mean)
    });
    let summary = format!("{}: {verdict}{errors}", subject.title());
    let result = json!({
        "sensor": subject.title(), "verdict": judged.verdict(), "solver": decisive.map(|evaluation| &evaluation.solver),
        "location_error_mm": decisive.map(|evaluation| evaluation.location_error_mm.mean),
        "force_error_n": decisive.and_then(|evaluation| evaluation.force_error_n).map(|error| error.mean),
    });
    let page = page(&subject, &judged);
    Ok(ReportPage { judgement: judged.judgement, ..ReportPage::new(options, page, summary, result) })
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
pub(crate) fn judged(
    runs: Vec<(Recorded, Bench)>,
    same_sensor: bool,
    accept: &AcceptOptions,
    note: Note<'_>,
) -> Result<(Subject, SensorResults), Failure> {
    let rule = accept.rule_of(runs.iter().map(|(run, _)| run), note)?;
    let paths: Vec<&Path> = runs.iter().map(|(run, _)| run.path.as_path()).collect();
    let design = ByDesign::of_runs(&paths).map_err(Failure::usage)?;
    let subject = Subject::of(runs, same_sensor).map_err(failure)?;
    let judged = SensorResults::of(&subject, rule.as_ref(), design);
    Ok((subject, judged))
}

fn compare(options: &ReportOptions, runs: Vec<(Recorded, Bench)>, note: Note<'_>) -> Result<ReportPage, Failure> {
    let named = options.accept.rule()?;
    let to_compare = |(run, bench): (Recorded, Bench)| {
        let rule = if named.is_some() { named.clone() } else { rule_of(&run, note) };
        ToCompare { run, bench, rule }
    };
    let runs: Vec<ToCompare> = runs.into_iter().map(to_compare).collect();
    let compared = Compared::all(&runs, &options.solver);
    let counted_as = |verdict: Option<SensorVerdict>| compared.iter().filter(|run| run.verdict() == verdict).count();
    let each = [Some(SensorVerdict::Accepted), Some(SensorVerdict::NotAccepted), Some(SensorVerdict::NotDecided), None];
    let text: String = each
        .into_iter()
        .filter(|verdict| counted_as(*verdict) > 0)
        .map(|verdict| format!(", {} {}", counted_as(verdict), verdict.map_or("without a rule", SensorVerdict::text)))
        .collect();
    let summary = format!("{} compared{text}", counted(compared.len(), "run"));
    let verdicts: Vec<Option<SensorVerdict>> = compared.iter().map(Compared::verdict).collect();
    let result = json!({ "runs": options.runs, "verdicts": verdicts });
    Ok(ReportPage::new(options, comparison(&compared, &options.solver), summary, result))
}

/// Checks that the path is free, or contains a page of this program of the same kind, which may be replaced. No other file is
/// replaced. Only a regular file is read, because a pipe may never end.
pub(crate) fn check_free(out: &Path) -> Result<(), Failure> {
    let is_ours = || {
        let is_file = fs::metadata(out).is_ok_and(|at| at.is_file());
        is_file
            && fs::read_to_string(out)
                .is_ok_and(|text| text.starts_with(BEGINNING) && text.contains(MARK) && !text.contains(CERTIFICATE))
    };
    // in a run folder a link may be planted; elsewhere a person wants it
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
pub(crate) fn write(out: &Path, html: &str) -> Result<(), Failure> {
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
