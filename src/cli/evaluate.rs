//! `palpate evaluate`: solves the test presses of a run, of two plain tables, or held out of one, and prints the errors.

use super::choices::RepeatabilityChoice;
use super::columns::ColumnsArgs;
use super::exit::Failure;
use super::holdout::HoldoutArgs;
use super::method::{load, solvers};
use super::output::json_line;
use super::recorded::{read_presses, read_run, warn_of_units};
use super::stdin::is_stdin;
use super::summary::{print, tell};
use super::tables::{
    characteristics_table, cross_validated_table, definitions, evaluation_table, filled, solvers_table,
};
use super::verdict::{AcceptArgs, NO_RULE, verdict_code, verdict_table};
use palpate_core::quantity::ArrayLayout;
use palpate_data::acceptance::Rule;
use palpate_data::dataset::calibration::{CalibrateError, Selection};
use palpate_data::dataset::characteristics::Staircases;
use palpate_data::dataset::evaluate::{self, EvaluateError, Trial, is_to_evaluate};
use palpate_data::dataset::{Evidence, Holdout, Presses};
use palpate_data::recipe::Phase;
use palpate_report::report::is_beside_paper;
use palpate_run::batch::ByDesign;
use palpate_solver::{BEST, Candidate, Evaluation, Fitted, SOLVERS, Solver as _};
use serde::Serialize;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Word that is used instead of a method's name for every method and the best.
const ALL: &str = "all";

const EXAMPLES: &str = "\
Examples:
  palpate evaluate runs/paper
  palpate evaluate runs/paper --solver pearson --json
  palpate evaluate runs/paper --solver all
  palpate evaluate grid.csv random.csv --accept example/accept.toml
  palpate evaluate grid.csv --holdout places 20% --seed 2 --save parts

The files of example/ are written by `palpate init example --from example`.

Tables have the columns x_mm, y_mm and out_1..out_n, optionally force_n. If the
calibration has no force_n, the method uses only the proportions of the
outputs of each press, and evaluates only the location errors of the test.
With --constant-load, every press then counts as 1 N.

With --holdout, one table or the calibration of a run is split first. The method
is chosen and fitted with the calibration part only. A grid keeps its outermost
places in the calibration. The verdict is then not decided, unless the rule has
`holdout = true`. The saved parts give the same errors:
palpate evaluate parts/calibration.csv parts/test.csv, with --columns if the
folder has a columns file.

Without test presses and --holdout, the errors are cross-validated: each press
is solved by the method fitted without its place.

The verdict uses the acceptance rule: [accept] of the run's recipe, or
--accept FILE. Without a rule there is no verdict.";

/// Solve the test presses of a run, of two tables, or held out of one, and print the errors
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct EvaluateArgs {
    /// A run folder, or a table of calibration presses; a second table has test presses
    #[arg(value_name = "RUN", num_args = 0..=2)]
    run: Vec<PathBuf>,
    /// A table of calibration presses
    #[arg(long, value_name = "CSV", requires = "test", conflicts_with = "run")]
    calibration: Option<PathBuf>,
    /// A table of test presses; without force_n, only location is evaluated
    #[arg(long, value_name = "CSV", requires = "calibration", conflicts_with = "run")]
    test: Option<PathBuf>,
    /// The method; best selects by cross-validation on the calibration
    #[arg(long, value_name = "NAME", default_value = BEST, value_parser = solvers([BEST, ALL]))]
    solver: String,
    /// Assume that every contact has the force of the calibration
    #[arg(long)]
    constant_load: bool,
    /// Print one JSON object per solver and line instead of tables
    #[arg(long)]
    json: bool,
    /// Definition of repeatability in the characteristics
    #[arg(long, value_name = "DEFINITION", value_enum, default_value_t)]
    repeatability: RepeatabilityChoice,
    /// Print what the characteristics mean
    #[arg(long)]
    definitions: bool,
    #[command(flatten)]
    holdout: HoldoutArgs,
    #[command(flatten)]
    columns: ColumnsArgs,
    #[command(flatten)]
    accept: AcceptArgs,
}

/// Method without an evaluation, as printed by `--json`.
#[derive(Serialize)]
struct Failed<'a> {
    solver: &'a str,
    error: &'a str,
}

/// Errors of methods on a calibration without a test, as printed by `--json`.
#[derive(Serialize)]
struct CrossValidated {
    cross_validated: Vec<Candidate>,
}

/// Evaluates, judges and prints; the verdict is the exit code. A run that was only characterised prints its characteristics.
pub(super) fn evaluate(args: &EvaluateArgs) -> Result<ExitCode, Failure> {
    let (run, calibration, test) = match args.run.as_slice() {
        [] => (None, args.calibration.as_ref(), args.test.as_ref()),
        [run] => (Some(run), None, None),
        [first, second, ..] if first.is_dir() || second.is_dir() => {
            let help = "one page about several runs of a sensor: palpate report RUN...";
            return Err(Failure::usage(miette::miette!(help = help, "`evaluate` takes one run folder, or two tables")));
        }
        [calibration, test, ..] => (None, Some(calibration), Some(test)),
    };
    match (run, calibration, test, args.holdout.asked()?) {
        (Some(source), _, _, Some(holdout)) => held_out(args, source, &holdout),
        (None, .., Some(_)) => {
            let help = "name one table or run: palpate evaluate grid.csv --holdout places 20%";
            Err(Failure::usage(miette::miette!(help = help, "--holdout splits one table or run")))
        }
        (Some(run), ..) if run.is_dir() || !(run.exists() || is_stdin(run)) => {
            let (recorded, bench) = read_run(run)?;
            let (presses, layout) = (recorded.presses(), &bench.layout);
            let rule = args.accept.rule_of([&recorded])?;
            let (runs, u_place_mm) = (vec![&recorded], bench.u_place_mm());
            let evidence = Evidence { presses: &presses, layout: Some(layout), runs, u_place_mm };
            let is_beside_paper = is_beside_paper(layout, &presses);
            let characteristics = Staircases::of_run(&presses, layout)
                .map(|staircases| characteristics_table(&staircases, args.repeatability.into(), is_beside_paper))
                .map(|table| if args.definitions { table + &definitions(args.repeatability.into()) } else { table });
            let trial = Trial::of_run(&presses, bench.placed());
            let is_only_characterised = characteristics.is_some() && !presses.presses.iter().any(is_to_evaluate);
            let has_test = presses.presses.iter().any(|press| press.is_of(Phase::Test));
            let is_untested = !has_test && presses.sound(Phase::Calibration).next().is_some();
            let cross_validated = is_untested
                .then(|| cross_validated(args, &presses, bench.placed(), rule.is_some()))
                .transpose()?
                .flatten();
            let shown = Shown { is_only_characterised, is_beside_paper, characteristics, cross_validated };
            let design = match args.solver.as_str() {
                BEST => ByDesign::of_runs(&[run]).map_err(Failure::usage)?,
                _ => None,
            };
            report(args, trial, shown, rule.map(|rule| (rule, evidence)), design.as_ref())
        }
        (Some(table), ..) => {
            let mapping = args.columns.mapping()?;
            let presses = read_presses(table, &mapping, Phase::Calibration)?;
            let (source_name, rule) = (presses.source.clone(), args.accept.rule()?);
            let layout = mapping.layout_of(presses.channels);
            let cross_validated = cross_validated(args, &presses, layout.as_ref(), rule.is_some())?;
            let evidence = Evidence { presses: &presses, layout: None, runs: Vec::new(), u_place_mm: None };
            let untested = CalibrateError::NoPresses { source_name, phase: Phase::Test.name(), flagged: 0 };
            let shown = Shown { cross_validated, ..Shown::default() };
            report(args, Err(untested.into()), shown, rule.map(|rule| (rule, evidence)), None)
        }
        (None, Some(calibration), Some(test), None) => {
            let mapping = args.columns.mapping()?;
            let (calibration, test) =
                (read_presses(calibration, &mapping, Phase::Calibration)?, read_presses(test, &mapping, Phase::Test)?);
            warn_of_units(&calibration, &test)?;
            let evidence = Evidence { presses: &calibration, layout: None, runs: Vec::new(), u_place_mm: None };
            let layout = mapping.layout_of(calibration.channels);
            let trial = Trial::of_tables(&calibration, &test).map(|trial| trial.with_layout(layout.as_ref()));
            report(args, trial, Shown::default(), args.accept.rule()?.map(|rule| (rule, evidence)), None)
        }
        _ => {
            let help = "name a run folder, `palpate evaluate runs/paper`, or a table of calibration presses and one of test presses, \
                        `palpate evaluate calibration.csv test.csv`";
            Err(Failure::usage(miette::miette!(help = help, "`evaluate` needs a run or two tables")))
        }
    }
}

/// Evaluates presses that are held out of one table or of the calibration of a run.
fn held_out(args: &EvaluateArgs, source: &Path, holdout: &Holdout) -> Result<ExitCode, Failure> {
    let on = |presses: &Presses, layout: Option<&ArrayLayout>, asked: Option<(Rule, Evidence<'_>)>| {
        let split = args.holdout.split(holdout, presses, layout)?;
        let trial = Trial::of_split(&split).map(|trial| trial.with_layout(layout));
        report(args, trial, Shown::default(), asked, None)
    };
    if source.is_dir() {
        let (recorded, bench) = read_run(source)?;
        let all = recorded.presses();
        Selection::of_phase(&all, Phase::Calibration).map_err(Failure::usage)?;
        let mut presses = all.clone();
        if let Some(of) = presses.keep(Phase::Calibration) {
            let kept = presses.presses.len();
            tell(&format!("note: {}: its {kept} calibration presses are used, of {of}\n", source.display()))?;
        }
        let (runs, layout, u_place_mm) = (vec![&recorded], Some(&bench.layout), bench.u_place_mm());
        let evidence = Evidence { presses: &all, layout, runs, u_place_mm };
        on(&presses, bench.placed(), args.accept.rule_of([&recorded])?.map(|rule| (rule, evidence)))
    } else {
        let mapping = args.columns.mapping()?;
        let presses = read_presses(source, &mapping, Phase::Calibration)?;
        let evidence = Evidence { presses: &presses, layout: None, runs: Vec::new(), u_place_mm: None };
        let layout = mapping.layout_of(presses.channels);
        on(&presses, layout.as_ref(), args.accept.rule()?.map(|rule| (rule, evidence)))
    }
}

/// Returns the cross-validated errors of a calibration; `None` if there are none and a rule says what is missing.
fn cross_validated(
    args: &EvaluateArgs,
    presses: &Presses,
    layout: Option<&ArrayLayout>,
    has_rule: bool,
) -> Result<Option<Vec<Candidate>>, Failure> {
    let solver = if args.solver == ALL { BEST } else { &args.solver };
    match evaluate::cross_validated(presses, layout, load(args.constant_load), solver) {
        Err(_) if has_rule => Ok(None),
        found => found.map(Some).map_err(Failure::usage),
    }
}

/// Result of each solver, or the reason why it has no evaluation.
type Outcomes<'a> = Vec<(&'a str, Result<Evaluation, String>)>;

/// Data that are printed in addition to the evaluations.
#[derive(Default)]
struct Shown {
    /// Whether there is neither a calibration nor a test.
    is_only_characterised: bool,
    is_beside_paper: bool,
    characteristics: Option<String>,
    /// Errors on presses that were held out in turn, if there is no test.
    cross_validated: Option<Vec<Candidate>>,
}

fn report(
    args: &EvaluateArgs,
    trial: Result<Trial<'_>, EvaluateError>,
    Shown { is_only_characterised, is_beside_paper, characteristics, cross_validated }: Shown,
    asked: Option<(Rule, Evidence<'_>)>,
    design: Option<&ByDesign>,
) -> Result<ExitCode, Failure> {
    let trial = match trial {
        // with a rule the verdict says what is missing
        Err(why) if !is_only_characterised && asked.is_none() && cross_validated.is_none() => {
            return Err(Failure::usage(why));
        }
        trial => trial.map(|trial| trial.with_load(load(args.constant_load))),
    };
    let model = design.and_then(|design| design.model.as_ref());
    let outcomes = match (&trial, model) {
        (Err(_), _) => Vec::new(),
        (Ok(trial), Some(model)) => solved_by(model.fitted(), trial)?,
        (Ok(trial), None) => outcomes(args, trial)?,
    };
    let known: Vec<Evaluation> = outcomes.iter().filter_map(|(_, outcome)| outcome.clone().ok()).collect();
    let judgement = asked.map(|(rule, evidence)| match design {
        Some(design) => design.judge(&rule, &evidence, &trial, &known),
        None => evidence.judge(&rule, &trial, &known),
    });
    let text = if args.json {
        let candidates =
            cross_validated.map(|cross_validated| json_line(&CrossValidated { cross_validated })).transpose()?;
        let objects = candidates.into_iter().map(Ok).chain(outcomes.iter().map(json)).collect::<Result<String, _>>()?;
        objects + &judgement.as_ref().map(json_line).transpose()?.unwrap_or_default()
    } else {
        let evaluated = match outcomes.as_slice() {
            [] => cross_validated.as_deref().map(cross_validated_table),
            [(_, Ok(evaluation))] => Some(evaluation_table(std::slice::from_ref(evaluation), is_beside_paper)),
            outcomes => Some(solvers_table(outcomes, is_beside_paper)),
        };
        let verdict = match (&judgement, design) {
            (Some(judgement), _) => Some(verdict_table(judgement)),
            (None, Some(design)) => Some(filled(&format!("{}\n{NO_RULE}", design.note()), "  ")),
            (None, None) => (!is_only_characterised).then(|| NO_RULE.to_owned()),
        };
        [evaluated, characteristics, verdict].into_iter().flatten().collect::<Vec<String>>().join("\n")
    };
    print(&text)?;
    match outcomes.as_slice() {
        [(solver, Err(reason))] => Err(Failure::not_accepted(miette::miette!("{solver}: {reason}"))),
        _ => Ok(verdict_code(judgement.as_ref())),
    }
}

/// Returns the evaluation of a method that was fitted with the prior of the sensor's design.
fn solved_by<'a>(fitted: &'a Fitted, trial: &Trial<'_>) -> Result<Outcomes<'a>, Failure> {
    let evaluation = trial.evaluate_with(fitted).map_err(Failure::usage)?;
    Ok(vec![(fitted.name(), Ok(evaluation))])
}

/// Returns the evaluations of the requested solvers.
fn outcomes<'a>(args: &'a EvaluateArgs, trial: &Trial<'_>) -> Result<Outcomes<'a>, Failure> {
    let names = if args.solver == ALL { [&SOLVERS, [BEST].as_slice()].concat() } else { vec![args.solver.as_str()] };
    let mut outcomes = Vec::new();
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
    Ok(outcomes)
}

/// Returns one line of `--json`.
fn json((solver, outcome): &(&str, Result<Evaluation, String>)) -> Result<String, Failure> {
    match outcome {
        Ok(evaluation) => json_line(evaluation),
        Err(error) => json_line(&Failed { solver, error }),
    }
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
        assert_eq!(arguments("runs/paper --repeatability t95").unwrap().repeatability, RepeatabilityChoice::T95);
        assert_eq!(arguments("--calibration a.csv --test b.csv").unwrap().solver, "best");
        for line in ["--calibration a.csv", "runs/paper --test b.csv", "runs/paper --calibration a.csv --test b.csv"] {
            assert!(arguments(line).is_err(), "{line}");
        }
        let refusal = arguments("runs/paper --solver pearson-lsd").unwrap_err();
        assert!(refusal.contains("'pearson-lsq'"), "{refusal}");
    }
}
