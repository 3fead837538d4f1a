//! `palpate solve`: readings of the array in, contacts out, a line for a line.

use super::exit::Failure;
use super::method::{load, solvers};
use super::recorded::{read_presses, read_run};
use super::solutions::Solutions;
use super::summary::tell;
use super::tables::chosen;
use crate::dataset::answers::{Answer, Answers, Unsolved};
use crate::dataset::calibration::{calibration_of_run, calibration_of_table};
use crate::dataset::readings::{Format, Lines, ReadingError, Readings};
use crate::quantity::ArrayLayout;
use crate::solver::{BEST, Broken, Calibration, ForceKnown, Session, Setting, Solver as _};
use miette::{IntoDiagnostic, WrapErr};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What messages call the input.
const SOURCE: &str = "stdin";

const EXAMPLES: &str = "\
Examples:
  palpate solve --calibration runs/paper < readings.csv > contacts.csv
  palpate solve --calibration grid.csv --solver pearson-lsq < readings.csv
  palpate solve --calibration runs/paper --json < readings.ndjson

A reading is a line: as CSV with a header that has out_1..out_n, or numbers
alone; as NDJSON {\"outputs\": [0.1, 0.2, ...]}, or the bare array. Its id and
t_s, if it has them, come back with its contact.

A contact is x_mm, y_mm, force_n, their standard deviations sd_..., the
half-widths half68_... and half95_... that 68 and 95 % of errors keep to,
other_x_mm and other_y_mm where another place fits nearly as well, misfit
(above 1: no single contact reads like this) and verdict: ok, weak-signal,
outside-area, not-one-contact, channel-fault (unit says which), or unsolved where
the reading has no answer at all. A table without force_n is calibrated on by
proportions: force_n is then in units of its typical press.

A missing channel is null or NaN, in CSV nan or an empty cell. The reading is
solved by the same method fitted without that channel; at most 16 such fits are
kept.

An invalid line ends the program. With --keep-going it is answered
unsolved, with its line and what is wrong with it (error), and the next one is
solved. Every answer then has its line; CSV always has the columns line, id, t_s
and error. A header that can't be used still ends the program.

Exit code: 0 every line was answered, 2 bad input: those before it were
answered.";

/// Read outputs of the array line by line and print the contact behind each
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct SolveArgs {
    /// A run folder, or a table of presses to calibrate on
    #[arg(long, value_name = "RUN")]
    calibration: PathBuf,
    /// The method; best is the one that cross-validation on the calibration finds best
    #[arg(long, value_name = "NAME", default_value = BEST, value_parser = solvers([BEST]))]
    solver: String,
    /// The format of the readings, if its first character isn't to tell it
    #[arg(long, value_name = "FORMAT", value_enum)]
    input: Option<Format>,
    /// Print one JSON object a line instead of CSV
    #[arg(long)]
    json: bool,
    /// Answer an invalid line with what is wrong with it, and go on
    #[arg(long)]
    keep_going: bool,
    /// Don't say which method is used and why
    #[arg(long)]
    quiet: bool,
    /// Every contact presses as hard as the calibration did
    #[arg(long)]
    constant_load: bool,
    /// All outputs may be off by one and the same amount: solve for it too
    #[arg(long)]
    common_offset: bool,
    /// The share of single contacts that a verdict may wrongly call something else
    #[arg(long, value_name = "SHARE", default_value_t = Setting::default().false_alarms, value_parser = share)]
    false_alarms: f64,
    /// The forces to come, N; else from a tenth of the calibration's to the calibration's
    #[arg(long, num_args = 2, value_names = ["MIN", "MAX"], value_parser = force, conflicts_with = "constant_load")]
    forces_n: Option<Vec<f64>>,
}

/// Fits the method, then answers as the readings come in.
pub fn solve(args: &SolveArgs) -> Result<ExitCode, Failure> {
    let source = Source::read(&args.calibration, load(args.constant_load))?;
    let setting = Setting {
        layout: source.layout.as_ref(),
        load: load(args.constant_load),
        common_offset: args.common_offset,
        false_alarms: args.false_alarms,
        forces_n: forces_n(args)?,
        ..Setting::default()
    };
    let calibration = &source.calibration;
    let name = args.calibration.display();
    let session = Session::new(&args.solver, calibration, setting).into_diagnostic();
    let session = session.wrap_err_with(|| format!("{name}: can't be calibrated on")).map_err(Failure::usage)?;
    if !args.quiet {
        let (presses, units) = (calibration.len(), calibration.units());
        tell(&format!("{}, fitted to {presses} presses of {units} units\n", session.fitted().name()))?;
        tell(&session.fitted().choice().map(chosen).unwrap_or_default())?;
        if source.is_relative && !args.constant_load {
            tell("no force_n in the calibration: forces are in units of its typical press\n")?;
        }
    }
    for Broken { unit, fault } in session.broken() {
        tell(&format!("{name}: unit {} {}, left out\n", unit + 1, fault.told()))?;
    }
    let mut answers = Answers::new(Readings::new(SOURCE, calibration.units(), args.input), session);
    let mut solutions = Solutions::new(io::stdout().lock(), args.json, args.keep_going);
    match answer(&mut answers, &mut Lines::new(SOURCE, io::stdin().lock()), &mut solutions, args.keep_going) {
        Ok(Ok(())) => Ok(ExitCode::SUCCESS),
        Ok(Err(error)) => Err(Failure::usage(error)),
        // a reader that has seen enough is no error
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(ExitCode::SUCCESS),
        Err(error) => Err(error).into_diagnostic().wrap_err("can't write the contacts").map_err(Failure::unwritten),
    }
}

/// An answer for each line; whatever the end is, what came before it is out.
fn answer(
    answers: &mut Answers<'_>,
    lines: &mut Lines<impl Read>,
    solutions: &mut Solutions<impl Write>,
    keep_going: bool,
) -> io::Result<Result<(), ReadingError>> {
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
                for Broken { unit, fault } in answer.broken {
                    let (line, unit, does) = (answer.reading.line, unit + 1, fault.told());
                    writeln!(io::stderr(), "{SOURCE}, line {line}: unit {unit} {does}, left out from here on")?;
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

/// What is calibrated on.
struct Source {
    calibration: Calibration,
    layout: Option<ArrayLayout>,
    /// Its forces aren't newtons.
    is_relative: bool,
}

impl Source {
    fn read(path: &Path, load: ForceKnown) -> Result<Source, Failure> {
        if path.is_dir() {
            let (recorded, rig) = read_run(path)?;
            let calibration = calibration_of_run(&recorded.presses(), load).map_err(Failure::usage)?;
            return Ok(Source { calibration, layout: Some(rig.array.layout), is_relative: false });
        }
        let table = read_presses(path)?;
        let calibration = calibration_of_table(&table, load).map_err(Failure::usage)?;
        let is_relative = table.presses.iter().any(|press| press.force_n.is_none());
        Ok(Source { calibration, layout: None, is_relative })
    }
}

fn forces_n(args: &SolveArgs) -> Result<Option<(f64, f64)>, Failure> {
    match args.forces_n.as_deref() {
        Some([least, most]) if least < most => Ok(Some((*least, *most))),
        None => Ok(None),
        Some(_) => Err(Failure::usage(miette::miette!("--forces-n takes the least force first, then the most"))),
    }
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if share > 0.0 && share < 1.0 => Ok(share),
        _ => Err("expected a share between 0 and 1: 0.01 is one in a hundred".to_owned()),
    }
}

fn force(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(force_n) if force_n.is_finite() && force_n > 0.0 => Ok(force_n),
        _ => Err("expected a force over 0 N".to_owned()),
    }
}
