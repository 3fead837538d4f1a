//! `palpate solve`: reads readings of the array and prints contacts, one line for each line.

use super::exit::Failure;
use super::method::{FORCES_ARE_RELATIVE, MethodArgs, Source, fitted_to, tell_left_out};
use super::solutions::Solutions;
use super::summary::tell;
use super::tables::filled;
use crate::dataset::answers::{Answer, Answers, Unsolved};
use crate::dataset::readings::{Format, Lines, ReadingError, Readings};
use crate::dataset::sensor_file::{Card, read_sensor_file};
use crate::solver::{Broken, Session};
use miette::{IntoDiagnostic, WrapErr};
use std::collections::HashSet;
use std::io::{self, Read, Write};
use std::path::PathBuf;
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
calibrated: force_n is then relative to its typical press.

A missing channel is null or NaN, in CSV nan or an empty cell. Such a reading is
solved by the same method fitted without that channel; at most 16 such fits are
kept.

If more contacts than expected don't fit the calibration, a line on standard
error asks once to calibrate the sensor again.

An invalid line ends the program. With --keep-going, its answer is
unsolved, with the line number and the problem (error), and the next line is
solved. Every answer then has its line; CSV always has the columns line, id, t_s
and error. An invalid header still ends the program.

Exit code: 0 every line was answered, 2 bad input: the lines before it were
answered.";

/// Read outputs of the array line by line and print the contact for each
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct SolveArgs {
    /// A run folder, or a table of calibration presses
    #[arg(long, value_name = "RUN")]
    calibration: Option<PathBuf>,
    /// A sensor file, written by `palpate fit`
    #[arg(long, value_name = "FILE", conflicts_with_all = FITTED_BEFORE)]
    model: Option<PathBuf>,
    /// Input format [default: detected from the first character]
    #[arg(long, value_name = "FORMAT", value_enum)]
    input: Option<Format>,
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

/// Largest number of different reasons for readings without an answer that are printed.
const REASONS_MAX: usize = 10;

/// Options that a sensor file has already fixed.
const FITTED_BEFORE: [&str; 6] =
    ["calibration", "solver", "constant_load", "common_offset", "false_alarms", "forces_n"];

/// Fits the method or reads it, then answers each reading when it arrives.
pub fn solve(args: &SolveArgs) -> Result<ExitCode, Failure> {
    let model = match (&args.model, &args.calibration) {
        (Some(file), _) => {
            let (card, model) = read_sensor_file(file).map_err(Failure::usage)?;
            if !args.quiet {
                tell(&told(&card))?;
            }
            tell_left_out(file, model.fitted())?;
            model
        }
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
    let readings = Readings::new(SOURCE, model.validity().units, args.input, args.method.mapping()?);
    let mut answers = Answers::new(readings, Session::new(model));
    let is_told = !(args.quiet || args.json || args.keep_going);
    let mut solutions = Solutions::new(io::stdout().lock(), args.json, args.keep_going);
    match answer(&mut answers, &mut Lines::new(SOURCE, io::stdin().lock()), &mut solutions, args.keep_going, is_told) {
        Ok(Ok(())) => Ok(ExitCode::SUCCESS),
        Ok(Err(error)) => Err(Failure::usage(error)),
        // a reader that has seen enough is no error
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(ExitCode::SUCCESS),
        Err(error) => Err(error).into_diagnostic().wrap_err("can't write the contacts").map_err(Failure::unwritten),
    }
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

fn calibrate_again(line: u64) -> String {
    format!(
        "{SOURCE}, line {line}: too many of the last contacts don't fit the calibration; if each was at one place only, calibrate \
         the sensor again"
    )
}

/// Writes an answer for each line. When it ends for any reason, all earlier answers are written.
fn answer(
    answers: &mut Answers,
    lines: &mut Lines<impl Read>,
    solutions: &mut Solutions<impl Write>,
    keep_going: bool,
    is_told: bool,
) -> io::Result<Result<(), ReadingError>> {
    let mut reasons = HashSet::new();
    let end = loop {
        let answer = match lines.read_next() {
            Ok(Some(line)) => answers.answer(line),
            Ok(None) => break Ok(()),
            Err(error) => break Err(error),
        };
        match answer {
            Ok(Some(Answer { solved: Err(Unsolved::Bad(error)), .. })) if !keep_going => break Err(error),
            Ok(Some(answer)) => {
                solutions.write(answer.reading, &answer.solved)?;
                // CSV has no column for it
                if let Err(why) = &answer.solved
                    && is_told
                    && reasons.len() < REASONS_MAX
                    && reasons.insert(why.to_string())
                {
                    let line = answer.reading.line;
                    let told = filled(&format!("{SOURCE}, line {line}: unsolved, {why} (reported once)"), "  ");
                    io::stderr().write_all(told.as_bytes())?;
                }
                for Broken { unit, fault } in answer.broken {
                    let (line, unit, does) = (answer.reading.line, unit + 1, fault.told());
                    writeln!(io::stderr(), "{SOURCE}, line {line}: output {unit} {does}, excluded from here on")?;
                }
                if answer.is_out_of_date {
                    io::stderr().write_all(filled(&calibrate_again(answer.reading.line), "  ").as_bytes())?;
                }
            }
            Ok(None) => {}
            Err(error) => break Err(error),
        }
        if lines.is_drained() {
            solutions.flush()?;
        }
    };
    solutions.flush()?;
    Ok(end)
}
