//! `palpate solve`: reads readings of the array and prints contacts, one line for each line.

use super::choices::ReadingsChoice;
use super::exit::Failure;
use super::method::{FORCES_ARE_RELATIVE, MethodArgs, Source, fitted_to, tell_left_out};
use super::solutions::Solutions;
use super::stream::Stream;
use super::summary::tell;
use miette::{IntoDiagnostic, WrapErr};
use palpate_data::dataset::answers::Answers;
use palpate_data::dataset::readings::{Lines, Readings};
use palpate_data::dataset::sensor_file::{Card, read_sensor_file};
use palpate_solver::{Model, Session};
use std::io::{self, IsTerminal as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Name of the input in messages.
const SOURCE: &str = "stdin";

const EXAMPLES: &str = "\
Examples:
  palpate solve --calibration runs/paper < readings.csv > contacts.csv
  palpate solve --calibration grid.csv --solver pearson-lsq < readings.csv
  palpate solve --calibration runs/paper --json < readings.ndjson
  palpate solve --model sensor.palpate < readings.csv

Each line is a reading: CSV with a header that has out_1..out_n, or numbers
only; or NDJSON {\"outputs\": [0.1, 0.2, ...]}, or only the array. The columns id
and t_s, if present, are copied to the answer.

An answer has x_mm, y_mm, force_n, their standard deviations sd_..., the
half-widths half68_... and half95_... that contain 68 and 95 % of the errors,
other_x_mm and other_y_mm if another place fits nearly as well, misfit
(above 1: not a single contact) and verdict: ok, weak-signal,
outside-area, not-one-contact, channel-fault (unit: which output), or unsolved
if the reading has no answer. With a table without force_n, only proportions are
calibrated: force_n and its errors are then blank. relative_force is relative to
the typical press of the table, with half68_relative_force and
half95_relative_force, which are blank if the method has none. If a second
method is fitted, load shows which one answered: calibrated (it assumes the
load of the calibration, which the reading has), or any.

A missing channel is null or NaN, in CSV nan or an empty cell. Such a reading is
solved by the same method fitted without that channel; at most 16 such fits are
kept.

If more contacts than expected don't fit the calibration, a line on standard
error asks once to calibrate the sensor again.

An invalid line ends the program. With --keep-going, its answer is
unsolved, with the line number and the problem (error), and the next line is
solved. Every answer then has its line; CSV always has the columns line, id, t_s
and error. An invalid header still ends the program.";

/// Read outputs of the array line by line and print the contact for each
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct SolveArgs {
    /// A run folder, or a table of calibration presses
    #[arg(long, value_name = "RUN")]
    calibration: Option<PathBuf>,
    /// A sensor file, written by `palpate fit`
    #[arg(long, value_name = "FILE", conflicts_with_all = FITTED_BEFORE)]
    model: Option<PathBuf>,
    /// Input format [default: detected from the first character]
    #[arg(long, value_name = "FORMAT", value_enum)]
    input: Option<ReadingsChoice>,
    /// Print one JSON object per line instead of CSV
    #[arg(long)]
    json: bool,
    /// Answer an invalid line with its problem, and continue
    #[arg(long)]
    keep_going: bool,
    /// Don't print which method is used and why
    #[arg(long)]
    quiet: bool,
    #[command(flatten)]
    method: MethodArgs,
}

/// Options that a sensor file has already fixed.
const FITTED_BEFORE: [&str; 6] =
    ["calibration", "solver", "constant_load", "common_offset", "false_alarms", "forces_n"];

/// Fits the method or reads it, then answers each reading when it arrives.
pub(super) fn solve(args: &SolveArgs) -> Result<ExitCode, Failure> {
    let model = match (&args.model, &args.calibration) {
        (Some(file), _) => told_sensor_file(file, args.quiet)?,
        (None, Some(calibration)) => {
            let source = Source::read(calibration, &args.method)?;
            let model = args.method.fit(&source)?;
            if !args.quiet {
                args.method.tell(&source, &model)?;
            }
            tell_left_out(calibration, model.fitted())?;
            model
        }
        (None, None) => {
            let help =
                "add --model FILE, a sensor file of `palpate fit`, or --calibration RUN, a run folder or a table";
            return Err(Failure::usage(miette::miette!(help = help, "`solve` needs a calibrated sensor")));
        }
    };
    let readings = Readings::new(SOURCE, model.validity().units, args.input.map(Into::into), args.method.mapping()?);
    let stream = Stream {
        source: SOURCE,
        keep_going: args.keep_going,
        reasons_are_told: !(args.quiet || args.json || args.keep_going),
        is_refused: |_| false,
    };
    if io::stdin().is_terminal() && !args.quiet {
        tell("one reading a line; Ctrl-D ends\n")?;
    }
    let solutions = Solutions::new(io::stdout().lock(), args.json, args.keep_going, model.forces_are_known());
    let mut solutions = solutions.of_methods(model.fitted());
    let mut answers = Answers::new(readings, Session::new(model));
    match stream.answer(&mut answers, &mut Lines::new(SOURCE, io::stdin().lock()), &mut solutions) {
        Ok(Ok(())) => Ok(ExitCode::SUCCESS),
        Ok(Err(error)) => Err(Failure::usage(error)),
        // a reader that has seen enough is no error
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(ExitCode::SUCCESS),
        Err(error) => Err(error).into_diagnostic().wrap_err("can't write the contacts").map_err(Failure::unwritten),
    }
}

/// Reads a sensor file, and prints what it is.
pub(super) fn told_sensor_file(file: &Path, quiet: bool) -> Result<Model, Failure> {
    let (card, model) = read_sensor_file(file).map_err(Failure::usage)?;
    if !quiet {
        tell(&told(&card))?;
    }
    tell_left_out(file, model.fitted())?;
    Ok(model)
}

/// Describes a sensor file with its own data.
fn told(card: &Card) -> String {
    let of = card.sensor.as_ref().map_or(String::new(), |sensor| format!(" of sensor {sensor}"));
    let forces = match card.valid.force_n {
        None if !card.constant_load => FORCES_ARE_RELATIVE,
        _ => "",
    };
    format!("{}{of}\n{forces}", fitted_to(&card.method, &card.valid))
}
