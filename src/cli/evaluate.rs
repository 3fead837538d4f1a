//! `palpate evaluate`: prints the errors of test presses, and the verdict.

use super::design::left_out_table;
use super::output::json_line;
use super::summary::{note, print};
use super::tables::{
    characteristics_table, cross_validated_table, definitions, evaluation_table, filled, forces_table, history_table,
    solvers_table, vector_table,
};
use super::verdict::{NO_RULE, verdict_code, verdict_table};
use crate::api::{self, EvaluateOptions, Evaluated, Failure};
use palpate_data::dataset::characteristics::Repeatability;
use palpate_solver::TriedMethod;
use serde::Serialize;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate evaluate runs/paper
  palpate evaluate runs/paper --solver all
  palpate evaluate grid.csv random.csv --accept example/accept.toml
  palpate evaluate A.csv B.csv C.csv --leave-one-sensor-out
  palpate evaluate grid.csv --holdout places 20% --seed 2 --save parts

The files of example/ are written by `palpate init example --from example`.

Tables have the columns x_mm, y_mm and out_1..out_n, optionally force_n or
depth_mm. Without force_n, depths are solved; without both, only places, from the
proportions of the outputs.

With --holdout, one table or calibration is split before the method is chosen. The
verdict is then not decided, unless the rule has `holdout = true`.

With three columns of forces and no places, force vectors are solved, without
each group of --folds-by or each fifth of the rows.

Without test presses and --holdout, errors are cross-validated: each press is
solved without its place.

The verdict uses the acceptance rule: [accept] of the run's recipe, or
--accept FILE.";

/// Solve the test presses of a run, of two tables, or held out of one, and print the errors
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct EvaluateArgs {
    #[command(flatten)]
    options: EvaluateOptions,
    /// Print one JSON object per solver and line instead of tables
    #[arg(long)]
    json: bool,
    /// Print what the characteristics mean
    #[arg(long)]
    definitions: bool,
}

/// Method without an evaluation, as printed by `--json`.
#[derive(Serialize)]
struct Failed<'a> {
    solver: &'a str,
    error: &'a str,
}

/// Errors of methods on a calibration without a test, as printed by `--json`.
#[derive(Serialize)]
struct CrossValidated<'a> {
    cross_validated: &'a [TriedMethod],
}

/// Evaluates, judges and prints; the verdict is the exit code. A run that was only characterised prints its characteristics.
pub(super) fn evaluate(args: &EvaluateArgs) -> Result<ExitCode, Failure> {
    let evaluated = api::evaluate(&args.options, &note)?;
    if let Some(errors) = &evaluated.vector {
        print(&if args.json { json_line(errors)? } else { vector_table(errors) })?;
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(errors) = &evaluated.history {
        print(&if args.json { json_line(errors)? } else { history_table(errors) })?;
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(errors) = &evaluated.left_out_sensors {
        print(&if args.json { json_line(errors)? } else { left_out_table(errors) })?;
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(forces) = &evaluated.forces {
        print(&if args.json { json_line(&forces.errors)? } else { forces_table(forces) })?;
        return Ok(ExitCode::SUCCESS);
    }
    print(&if args.json { lines(&evaluated)? } else { tables(&evaluated, args) })?;
    match evaluated.outcomes.as_slice() {
        [(solver, Err(reason))] => Err(Failure::not_accepted(miette::miette!("{solver}: {reason}"))),
        _ => Ok(verdict_code(evaluated.judgement.as_ref())),
    }
}

/// Returns the lines of `--json`.
fn lines(Evaluated { outcomes, cross_validated, judgement, .. }: &Evaluated) -> Result<String, Failure> {
    let mut lines = String::new();
    if let Some(cross_validated) = cross_validated {
        lines += &json_line(&CrossValidated { cross_validated })?;
    }
    for (solver, outcome) in outcomes {
        lines += &match outcome {
            Ok(evaluation) => json_line(evaluation)?,
            Err(error) => json_line(&Failed { solver, error })?,
        };
    }
    if let Some(judgement) = judgement {
        lines += &json_line(judgement)?;
    }
    Ok(lines)
}

/// Returns the tables for a person.
fn tables(evaluated: &Evaluated, args: &EvaluateArgs) -> String {
    let Evaluated { outcomes, is_beside_paper, .. } = evaluated;
    let repeatability: Repeatability = args.options.repeatability.into();
    let evaluation = match outcomes.as_slice() {
        [] => evaluated.cross_validated.as_deref().map(cross_validated_table),
        [(_, Ok(evaluation))] => Some(evaluation_table(std::slice::from_ref(evaluation), *is_beside_paper)),
        outcomes => Some(solvers_table(outcomes, *is_beside_paper)),
    };
    let characteristics = evaluated.characteristics.as_ref().map(|staircases| {
        let table = characteristics_table(staircases, repeatability, *is_beside_paper);
        if args.definitions { table + &definitions(repeatability) } else { table }
    });
    let verdict = match (&evaluated.judgement, &evaluated.design) {
        (Some(judgement), _) => Some(verdict_table(judgement)),
        (None, Some(design)) => Some(filled(&format!("{design}\n{NO_RULE}"), "  ")),
        (None, None) => (!evaluated.is_only_characterised).then(|| NO_RULE.to_owned()),
    };
    let unsolved_depth = evaluated.unsolved_depth.as_ref().map(|why| filled(why, "  "));
    [evaluation, unsolved_depth, characteristics, verdict].into_iter().flatten().collect::<Vec<String>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::RepeatabilityChoice;
    use clap::Parser;

    #[derive(Parser)]
    struct TestCommandLine {
        #[command(flatten)]
        args: EvaluateArgs,
    }

    fn arguments(line: &str) -> Result<EvaluateArgs, String> {
        let words = std::iter::once("evaluate").chain(line.split_whitespace());
        TestCommandLine::try_parse_from(words).map(|line| line.args).map_err(|error| error.to_string())
    }

    #[test]
    fn evaluate_accepts_a_run_or_two_tables() {
        assert_eq!(
            arguments("runs/paper --repeatability t95").unwrap().options.repeatability,
            RepeatabilityChoice::T95
        );
        assert_eq!(arguments("--calibration a.csv --test b.csv").unwrap().options.solver, "best");
        for line in ["--calibration a.csv", "runs/paper --test b.csv", "runs/paper --calibration a.csv --test b.csv"] {
            assert!(arguments(line).is_err(), "{line}");
        }
        let refusal = arguments("runs/paper --solver pearson-lsd").unwrap_err();
        assert!(refusal.contains("'pearson-lsq'"), "{refusal}");
    }
}
