//! `palpate evaluate`: solves the test presses of a run, or of two plain tables, and prints how far off the answers
//! are.

use super::exit::{Failure, accepted};
use super::method::{load, solvers};
use super::recorded::{read_presses, read_run};
use super::summary::print;
use super::tables::{characteristics_table, evaluation_table, solvers_table};
use crate::dataset::characteristics::{Repeatability, Staircases};
use crate::dataset::evaluate::{Trial, is_to_evaluate};
use crate::report::is_beside_paper;
use crate::solver::{BEST, Evaluation, SOLVERS};
use miette::IntoDiagnostic as _;
use serde::Serialize;
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

/// In place of a method's name: every method, and the best.
const ALL: &str = "all";

const EXAMPLES: &str = "\
Examples:
  palpate evaluate runs/paper
  palpate evaluate runs/paper --solver pearson --json
  palpate evaluate runs/paper --solver all
  palpate evaluate --calibration grid.csv --test random.csv

Tables have the columns x_mm, y_mm and out_1..out_n, optionally force_n. Where the
calibration has no force_n, a press counts as long as its row of outputs is,
beside all others: its proportions are what counts, and of the test only the
location is evaluated. With --constant-load every press then counts as 1 N.

Exit code: 0 accepted (mean errors under 1 mm and 0.1 N), 1 not accepted, 2 bad
input. Of all solvers the best decides; it stands last.";

/// Solve the test presses of a run, or of two tables, and print how far off the answers are
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct EvaluateArgs {
    /// A run folder: its calibration presses against its test presses
    #[arg(required_unless_present_any = ["calibration", "test"])]
    run: Option<PathBuf>,
    /// A table of presses to calibrate on
    #[arg(long, value_name = "CSV", requires = "test", conflicts_with = "run")]
    calibration: Option<PathBuf>,
    /// A table of presses to solve; without force_n, location only
    #[arg(long, value_name = "CSV", requires = "calibration", conflicts_with = "run")]
    test: Option<PathBuf>,
    /// The method; best is the one that cross-validation on the calibration finds best
    #[arg(long, value_name = "NAME", default_value = BEST, value_parser = solvers([BEST, ALL]))]
    solver: String,
    /// Every contact presses as hard as the calibration did
    #[arg(long)]
    constant_load: bool,
    /// Print one JSON object for each solver, a line each, instead of tables
    #[arg(long)]
    json: bool,
    /// What repeatability means in the table of a run's units
    #[arg(long, value_name = "DEFINITION", value_enum, default_value_t)]
    repeatability: Repeatability,
}

/// A method that has no evaluation, as `--json` prints it.
#[derive(Serialize)]
struct Failed<'a> {
    solver: &'a str,
    error: &'a str,
}

/// Evaluates and prints; accepted or not is the exit code. A run that was only characterised prints repeatability and
/// hysteresis of its units.
pub fn evaluate(args: &EvaluateArgs) -> Result<ExitCode, Failure> {
    match (&args.run, &args.calibration, &args.test) {
        (Some(run), ..) => {
            let (recorded, rig) = read_run(run)?;
            let (presses, layout) = (recorded.presses(), rig.array.layout);
            let is_beside_paper = is_beside_paper(&layout, &presses);
            let staircases = Staircases::of_run(&presses, &layout);
            let characteristics =
                staircases.map(|found| characteristics_table(&found, args.repeatability, is_beside_paper));
            if let Some(characteristics) =
                characteristics.as_ref().filter(|_| !args.json && !presses.presses.iter().any(is_to_evaluate))
            {
                print(characteristics)?;
                return Ok(ExitCode::SUCCESS);
            }
            let trial = Trial::of_run(&presses, Some(&layout)).map_err(Failure::usage)?;
            evaluate_trial(args, trial, is_beside_paper, characteristics)
        }
        (None, Some(calibration), Some(test)) => {
            let (calibration, test) = (read_presses(calibration)?, read_presses(test)?);
            evaluate_trial(args, Trial::of_tables(&calibration, &test).map_err(Failure::usage)?, false, None)
        }
        // the command line asks for one of the two; a caller that builds the arguments itself may not
        _ => Err(Failure::usage(miette::miette!("evaluate needs a run folder, or two tables"))),
    }
}

fn evaluate_trial(
    args: &EvaluateArgs,
    trial: Trial<'_>,
    is_beside_paper: bool,
    characteristics: Option<String>,
) -> Result<ExitCode, Failure> {
    let trial = trial.with_load(load(args.constant_load));
    let names = if args.solver == ALL { [&SOLVERS, [BEST].as_slice()].concat() } else { vec![args.solver.as_str()] };
    let mut outcomes: Vec<(&str, Result<Evaluation, String>)> = Vec::new();
    for solver in names {
        let outcome = match trial.evaluate_timed(solver) {
            Err(error) if args.solver != ALL || !error.is_of_solver() => return Err(Failure::usage(error)),
            // its cause is what differs from one solver to another
            outcome => {
                outcome.map_err(|error| error.source().map_or_else(|| error.to_string(), <dyn Error>::to_string))
            }
        };
        outcomes.push((solver, outcome));
    }
    let text = match outcomes.as_slice() {
        outcomes if args.json => outcomes.iter().map(json).collect::<Result<String, _>>()?,
        [(_, Ok(evaluation))] => evaluation_table(std::slice::from_ref(evaluation), is_beside_paper),
        outcomes => solvers_table(outcomes, is_beside_paper),
    };
    let characteristics = characteristics.filter(|_| !args.json).map(|table| format!("\n{table}")).unwrap_or_default();
    print(&(text + &characteristics))?;
    match outcomes.pop() {
        Some((solver, Err(reason))) => Err(Failure::not_accepted(miette::miette!("{solver}: {reason}"))),
        decisive => Ok(accepted(decisive.and_then(|(_, evaluation)| evaluation.ok()).as_slice())),
    }
}

/// One line of `--json`.
fn json((solver, outcome): &(&str, Result<Evaluation, String>)) -> Result<String, Failure> {
    let object = match outcome {
        Ok(evaluation) => serde_json::to_string(evaluation),
        Err(error) => serde_json::to_string(&Failed { solver, error }),
    };
    Ok(object.into_diagnostic().map_err(Failure::usage)? + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct CommandLine {
        #[command(flatten)]
        args: EvaluateArgs,
    }

    fn arguments(line: &str) -> Result<EvaluateArgs, String> {
        let words = std::iter::once("evaluate").chain(line.split_whitespace());
        CommandLine::try_parse_from(words).map(|line| line.args).map_err(|error| error.to_string())
    }

    #[test]
    fn the_command_line_takes_a_run_or_two_tables() {
        assert_eq!(arguments("runs/paper --repeatability t95").unwrap().repeatability, Repeatability::T95);
        assert_eq!(arguments("--calibration a.csv --test b.csv").unwrap().solver, "best");
        for line in
            ["", "--calibration a.csv", "runs/paper --test b.csv", "runs/paper --calibration a.csv --test b.csv"]
        {
            assert!(arguments(line).is_err(), "{line}");
        }
        let refusal = arguments("runs/paper --solver pearson-lsd").unwrap_err();
        assert!(refusal.contains("'pearson-lsq'"), "{refusal}");
    }
}
