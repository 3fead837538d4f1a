//! `palpate evaluate`: solves the test presses of a run, or of two plain tables, and prints how far off the answers
//! are.

use super::exit::{Failure, accepted};
use super::sources::read_rig;
use super::summary::print;
use super::tables::{characteristics_table, evaluation_table};
use crate::dataset::RunFolder;
use crate::dataset::characteristics::{Repeatability, Staircases};
use crate::dataset::evaluate::{evaluate_run, evaluate_tables, is_to_evaluate};
use crate::dataset::table::Table;
use crate::solver::SOLVERS;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use miette::IntoDiagnostic as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate evaluate runs/paper
  palpate evaluate runs/paper --solver pearson-lsq --json
  palpate evaluate --calibration grid.csv --test random.csv

Tables have the columns x_mm, y_mm and out_1..out_n, optionally force_n.
Exit code: 0 accepted (mean errors under 1 mm and 0.1 N), 1 not accepted, 2 bad input.";

/// Solve the test presses of a run, or of two tables, and print how far off the answers are
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// A run folder: its calibration presses against its test presses
    #[arg(required_unless_present_any = ["calibration", "test"])]
    run: Option<PathBuf>,
    /// A table of presses to calibrate on; without force_n, 1 N each
    #[arg(long, value_name = "CSV", requires = "test", conflicts_with = "run")]
    calibration: Option<PathBuf>,
    /// A table of presses to solve; without force_n, location only
    #[arg(long, value_name = "CSV", requires = "calibration", conflicts_with = "run")]
    test: Option<PathBuf>,
    /// The method
    #[arg(long, value_name = "NAME", default_value = SOLVERS[0], value_parser = PossibleValuesParser::new(SOLVERS))]
    solver: String,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    /// What repeatability means in a run's Table 1
    #[arg(long, value_name = "DEFINITION", default_value = Repeatability::NAMES[0], value_parser =
        PossibleValuesParser::new(Repeatability::NAMES).try_map(|name| name.parse::<Repeatability>()))]
    repeatability: Repeatability,
}

/// Evaluates and prints; accepted or not is the exit code. A run that was only characterised prints its Table 1.
pub fn evaluate(args: &Args) -> Result<ExitCode, Failure> {
    let (evaluation, table_1) = match (&args.run, &args.calibration, &args.test) {
        (Some(run), ..) => {
            let table = read_presses(run)?;
            let layout = read_rig(&run.join("rig.toml"))?.1.array.layout;
            let staircases = Staircases::of_run(&table, &layout);
            let table_1 = staircases.map(|staircases| characteristics_table(&staircases, args.repeatability));
            if let Some(table_1) = table_1.as_ref().filter(|_| !args.json && !table.rows.iter().any(is_to_evaluate)) {
                print(table_1)?;
                return Ok(ExitCode::SUCCESS);
            }
            (evaluate_run(&table, Some(&layout), &args.solver), table_1)
        }
        (None, Some(calibration), Some(test)) => {
            let calibration = Table::read(calibration).map_err(Failure::usage)?;
            let test = Table::read(test).map_err(Failure::usage)?;
            (evaluate_tables(&calibration, &test, &args.solver), None)
        }
        // the command line asks for one of the two; a caller that builds the arguments itself may not
        _ => return Err(Failure::usage(miette::miette!("evaluate needs a run folder, or two tables"))),
    };
    let evaluation = evaluation.map_err(Failure::usage)?;
    if args.json {
        let object = serde_json::to_string(&evaluation).into_diagnostic().map_err(Failure::usage)?;
        print(&format!("{object}\n"))?;
    } else {
        let table_1 = table_1.map(|table| format!("\n{table}")).unwrap_or_default();
        print(&(evaluation_table(std::slice::from_ref(&evaluation)) + &table_1))?;
    }
    Ok(accepted(std::slice::from_ref(&evaluation)))
}

/// The presses of a run folder.
fn read_presses(run: &Path) -> Result<Table, Failure> {
    RunFolder::read_manifest(run).map_err(Failure::usage)?; // says best that this is no run
    RunFolder::read_presses(run).map_err(Failure::usage)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct CommandLine {
        #[command(flatten)]
        args: Args,
    }

    fn arguments(line: &str) -> Result<Args, String> {
        let words = std::iter::once("evaluate").chain(line.split_whitespace());
        CommandLine::try_parse_from(words).map(|line| line.args).map_err(|error| error.to_string())
    }

    #[test]
    fn the_command_line_takes_a_run_or_two_tables() {
        assert_eq!(arguments("runs/paper --repeatability t95").unwrap().repeatability, Repeatability::T95);
        assert_eq!(arguments("--calibration a.csv --test b.csv").unwrap().solver, "pearson");
        for line in
            ["", "--calibration a.csv", "runs/paper --test b.csv", "runs/paper --calibration a.csv --test b.csv"]
        {
            assert!(arguments(line).is_err(), "{line}");
        }
        let refusal = arguments("runs/paper --solver pearson-lsd").unwrap_err();
        assert!(refusal.contains("'pearson-lsq'"), "{refusal}");
    }
}
