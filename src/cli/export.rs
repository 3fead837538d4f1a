//! `palpate export`: the tables of runs as files of other programs, or as a lake.

use super::output::OutputArgs;
use super::summary::note;
use crate::api::AcceptOptions;
use crate::api::ExportChoice;
use crate::api::Failure;
use crate::api::recorded::read_run;
use palpate_data::dataset::sensor_file::read_sensor_file;
use palpate_data::dataset::{DatasetError, Recorded, files, make_folder};
use palpate_report::export::{self, ExportFormat, frame};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate export runs/paper --format csv
  palpate export runs/paper --format npz --out paper.npz
  palpate export runs/a runs/b --format parquet --out tables
  palpate export runs/* --lake lake
  palpate export --model sensor.palpate --format c --out sensor.c

Tables: presses, calibration_matrix, test_matrix, characteristics, truth (of a
simulated run), monitors, series. Each column has its unit and definition, each
file the manifest of the run. csv, parquet and arrow: a folder with a file for each table.
npz, mat and h5: one file for each run. Nothing is overwritten.
A lake has a Parquet file for each run and table, in folders by design, batch and
sensor. A run that was exported before replaces its files.

c: a sensor file of `palpate fit` as one C99 file, for a controller: tables and
one function, single precision, no heap. Methods: pearson, pearson-lsq, surrogate,
physics.

All but csv and c need the feature `files`.";

/// Export runs to CSV, Parquet, Arrow, NumPy, MATLAB, HDF5 or C
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ExportArgs {
    /// The run folders
    #[arg(required_unless_present = "model")]
    runs: Vec<PathBuf>,
    /// The sensor file that becomes C
    #[arg(long, value_name = "FILE", conflicts_with_all = ["runs", "lake"])]
    model: Option<PathBuf>,
    /// Format of the files
    #[arg(long, value_name = "NAME", required_unless_present = "lake")]
    format: Option<ExportChoice>,
    /// Output file of one run as npz, mat or h5; otherwise a new folder [default: NAME.npz, NAME-csv, ...]
    #[arg(long, value_name = "PATH", conflicts_with = "lake")]
    out: Option<PathBuf>,
    /// Add the runs to this lake
    #[arg(long, value_name = "DIR", conflicts_with = "format")]
    lake: Option<PathBuf>,
    #[command(flatten)]
    accept: AcceptOptions,
    #[command(flatten)]
    output: OutputArgs,
}

/// Writes the files of all runs, or none.
pub(super) fn export(args: &ExportArgs) -> Result<ExitCode, Failure> {
    match (&args.model, &args.lake, args.format.map(ExportFormat::from)) {
        (Some(model), _, Some(ExportFormat::C)) => as_c(model, args),
        (Some(_), ..) => Err(Failure::usage(miette::miette!(help = C, "a sensor file has no other format than c"))),
        (None, _, Some(ExportFormat::C)) => Err(Failure::usage(miette::miette!(help = C, "C needs a fitted sensor"))),
        (None, Some(lake), _) => into_lake(lake, args),
        (None, None, format) => as_files(format.unwrap_or(ExportFormat::Csv), args),
    }
}

const C: &str = "palpate export --model sensor.palpate --format c --out sensor.c";

/// Writes the C file of a sensor file.
fn as_c(model: &Path, args: &ExportArgs) -> Result<ExitCode, Failure> {
    let out = args.out.clone().unwrap_or_else(|| model.with_extension("c"));
    check_free(&out)?;
    let (card, fitted) = read_sensor_file(model).map_err(Failure::usage)?;
    let name = model.file_name().unwrap_or_default().to_string_lossy();
    let title = card.sensor.map_or_else(|| name.into_owned(), |sensor| format!("sensor {sensor}"));
    let text = export::c_file(&fitted, &title).map_err(Failure::usage)?;
    files::place(&out, &text).map_err(|why| unwritten(DatasetError::io("writing", &out)(why)))?;
    let line = format!("{}: {:.0} kB\n", out.display(), text.len() as f64 / 1000.0);
    args.output.print(&line, &json!({ "written": out }))?;
    Ok(ExitCode::SUCCESS)
}

fn as_files(format: ExportFormat, args: &ExportArgs) -> Result<ExitCode, Failure> {
    format.check().map_err(Failure::usage)?;
    let names = names(&args.runs)?;
    let out = args.out.clone().unwrap_or_else(|| default_out(&names, format));
    check_free(&out)?;
    if let ([run], true) = (args.runs.as_slice(), format.is_one_file()) {
        let name = out.file_name().unwrap_or_default().to_string_lossy();
        let draft = out.with_file_name(format!(".{name}.{}.new", std::process::id()));
        let written = tables(run, format, &draft).and_then(|()| {
            check_free(&out)?;
            fs::rename(&draft, &out).map_err(|why| unwritten(DatasetError::io("renaming to", &out)(why)))
        });
        if written.is_err() {
            let _ = fs::remove_file(&draft); // the first error is the one to report
        }
        written?;
        args.output.print(&format!("{}\n", out.display()), &json!({ "written": out }))?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut failed = None;
    let made = make_folder(Some(&out), &names[0], |draft| {
        for (run, name) in args.runs.iter().zip(&names) {
            let place = match (args.runs.len(), format.is_one_file()) {
                (1, _) => draft.to_owned(),
                (_, true) => draft.join(format!("{name}.{}", format.name())),
                (_, false) => draft.join(name),
            };
            if let Err(failure) = tables(run, format, &place) {
                failed = Some(failure);
                return Err(DatasetError::NoRun { path: run.clone() });
            }
        }
        Ok(())
    });
    match (made, failed) {
        (_, Some(failure)) => return Err(failure),
        (Err(error), None) => return Err(unwritten(error)),
        (Ok(_), None) => {}
    }
    args.output.print(&format!("{}\n", out.display()), &json!({ "written": out }))?;
    Ok(ExitCode::SUCCESS)
}

/// Writes the tables of a run to a file, or to a folder that may exist.
fn tables(run: &Path, format: ExportFormat, place: &Path) -> Result<(), Failure> {
    let (recorded, bench) = read_run(run, &note)?;
    let (mut frames, manifest) = (frame::all(&recorded, &bench), &recorded.manifest);
    let is_one_file = format.is_one_file();
    let made = if is_one_file { Ok(()) } else { fs::create_dir_all(place) };
    made.map_err(|why| unwritten(DatasetError::io("making", place)(why)))?;
    add_series(&mut frames, &recorded, format, place)?;
    let written = match is_one_file {
        true => export::write_file(frames, manifest, format, place),
        false => export::write_tables(frames, manifest, format, place),
    };
    written.map_err(|why| unwritten(DatasetError::io("writing", place)(why)))
}

#[cfg(feature = "files")]
fn add_series(
    frames: &mut Vec<frame::ExportTable>,
    run: &Recorded,
    format: ExportFormat,
    folder: &Path,
) -> Result<(), Failure> {
    match export::add_series(frames, run, &frame::manifest(run), format, folder) {
        Err(error @ DatasetError::Series { .. }) => {
            note(&format!("note: {error}: the table `series` was left out"));
            Ok(())
        }
        added => added.map_err(unwritten),
    }
}

/// A run with readings was made by a program that was built with `files`: its other tables are exported by any.
#[cfg(not(feature = "files"))]
fn add_series(_: &mut Vec<frame::ExportTable>, run: &Recorded, _: ExportFormat, _: &Path) -> Result<(), Failure> {
    if run.series.is_some() {
        note(&format!("note: {}: the table `series` needs the feature `files`, and was left out", run.path.display()));
    }
    Ok(())
}

#[cfg(feature = "files")]
fn into_lake(folder: &Path, args: &ExportArgs) -> Result<ExitCode, Failure> {
    use palpate_report::export::lake::{Lake, LakeError};
    let failed = |error: LakeError| match error {
        LakeError::Dataset(error) => unwritten(error),
        LakeError::Bench(error) => crate::api::recorded::unknown_bench(error),
        error => Failure::usage(error),
    };
    let mut lake = Lake::open(folder).map_err(failed)?;
    let mut added = Vec::new();
    for run in &args.runs {
        let mut staged = lake.stage(run).map_err(failed)?;
        match args.accept.rule_of([staged.run()], &note)? {
            Some(rule) => staged.judge(&rule).map_err(failed)?,
            None => note(&format!(
                "note: {} has no acceptance rule: `errors` and `verdicts` have no rows of it (--accept FILE)",
                run.display()
            )),
        }
        let words = lake.publish(staged).map_err(failed)?;
        args.output.text(&format!("{}: {words}\n", run.display()))?;
        added.push(json!({ "run": run, "result": words.to_string() }));
    }
    args.output.object(&json!({ "lake": folder, "runs": added }))?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(not(feature = "files"))]
fn into_lake(_: &Path, _: &ExportArgs) -> Result<ExitCode, Failure> {
    Err(Failure::usage(export::NotBuilt { what: "a lake".to_owned() }))
}

/// Names of the runs' folders, which name their files. No two are the same.
fn names(runs: &[PathBuf]) -> Result<Vec<String>, Failure> {
    let name = |run: &PathBuf| {
        let whole = run.canonicalize().unwrap_or_else(|_| run.clone()); // a run that isn't there is reported when it is read
        whole.file_name().unwrap_or_default().to_string_lossy().into_owned()
    };
    let names: Vec<String> = runs.iter().map(name).collect();
    let twice = names.iter().enumerate().find(|(index, name)| names[..*index].contains(name));
    match twice {
        None => Ok(names),
        Some((_, name)) => {
            let help = "export them one by one, each with its own --out";
            Err(Failure::usage(miette::miette!(help = help, "two runs have the name {name}")))
        }
    }
}

fn default_out(names: &[String], format: ExportFormat) -> PathBuf {
    let name = if let [name] = names { name.as_str() } else { "export" };
    match (names.len(), format.is_one_file()) {
        (1, true) => format!("{name}.{}", format.name()).into(),
        _ => format!("{name}-{}", format.name()).into(),
    }
}

fn check_free(out: &Path) -> Result<(), Failure> {
    if out.symlink_metadata().is_err() {
        return Ok(());
    }
    let help = "choose another --out, or move it away: an export overwrites nothing";
    Err(Failure::usage(miette::miette!(help = help, "{} already exists", out.display())))
}

/// An export that couldn't be written.
fn unwritten(error: DatasetError) -> Failure {
    match error {
        DatasetError::Io { doing, path, why } => {
            let help =
                "nothing was exported of this run: free disk space and check the permissions, or choose another folder";
            Failure::unwritten(miette::miette!(help = help, "{doing} {}: {why}", path.display()))
        }
        error => Failure::dataset(error),
    }
}
