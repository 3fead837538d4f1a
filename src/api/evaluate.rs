//! Evaluates test presses: of a run, of two tables, or held out of one; and judges them by a rule.

use super::accept::AcceptOptions;
use super::choices::{QuantityChoice, RepeatabilityChoice, quantity};
use super::columns::ColumnsOptions;
use super::design::{self, LeftOutSensors};
use super::forces::{self, ForcesEvaluated};
use super::history;
use super::holdout::HoldoutOptions;
use super::method::{check_solver, load, solvers};
use super::recorded::{read_presses, read_run, warn_of_units};
use super::stdin::is_stdin;
use super::vectors::{self, VectorEvaluation};
use super::{Failure, Note};
use palpate_core::quantity::ArrayLayout;
use palpate_data::acceptance::{AcceptanceRule, Judgement};
use palpate_data::dataset::calibration::{CalibrateError, Selection};
use palpate_data::dataset::characteristics::Staircases;
use palpate_data::dataset::evaluate::{self, EvaluateError, Trial, is_to_evaluate};
use palpate_data::dataset::{Evidence, Holdout, Presses};
use palpate_data::recipe::Phase;
use palpate_report::report::is_beside_paper;
use palpate_run::batch::ByDesign;
use palpate_solver::{BEST, Evaluation, HistoryEvaluation, SOLVERS, Solver as _, TriedMethod};
use std::error::Error;
use std::path::{Path, PathBuf};

/// Word that is used instead of a method's name for every method and the best.
pub(crate) const ALL: &str = "all";

/// What is evaluated, and by which method.
#[derive(Clone, Debug, clap::Args)]
pub struct EvaluateOptions {
    /// A run folder, or a table of calibration presses; a second table has test presses
    #[arg(value_name = "RUN", num_args = 0..)]
    pub run: Vec<PathBuf>,
    /// A table of calibration presses
    #[arg(long, value_name = "CSV", requires = "test", conflicts_with = "run")]
    pub calibration: Option<PathBuf>,
    /// A table of test presses
    #[arg(long, value_name = "CSV", requires = "calibration", conflicts_with = "run")]
    pub test: Option<PathBuf>,
    /// The method; best selects by cross-validation on the calibration
    #[arg(long, value_name = "NAME", default_value = BEST, value_parser = solvers([BEST, ALL]))]
    pub solver: String,
    /// Assume that every contact has the force of the calibration
    #[arg(long)]
    pub constant_load: bool,
    /// What to solve besides the place [default: force, or depth if only depths are known]
    #[arg(long, value_name = "QUANTITY", value_enum)]
    pub quantity: Option<QuantityChoice>,
    /// Definition of repeatability in the characteristics
    #[arg(long, value_name = "DEFINITION", value_enum, default_value_t)]
    pub repeatability: RepeatabilityChoice,
    /// Presses that are held out as the test.
    #[command(flatten)]
    pub holdout: HoldoutOptions,
    /// Solve force vectors without places, and leave out each value of this column
    #[arg(long, value_name = "COLUMN", conflicts_with_all = ["holdout", "calibration", "test", "accept", "solver", "constant_load", "quantity", "save"])]
    pub folds_by: Option<String>,
    /// Solve place and force vector, from presses and drags
    #[arg(long, conflicts_with_all = ["holdout", "folds_by", "accept", "solver", "quantity", "constant_load", "save"])]
    pub vector: bool,
    /// Test whether earlier readings of a series lower its force error
    #[arg(long, conflicts_with_all = ["vector", "holdout", "folds_by", "calibration", "test", "accept", "solver", "quantity", "constant_load", "save"])]
    pub history: bool,
    /// Solve each sensor of a design by the map of the others: a run's test presses, or else all presses
    #[arg(long, conflicts_with_all = ["history", "vector", "holdout", "folds_by", "calibration", "test", "accept", "quantity", "constant_load", "save"])]
    pub leave_one_sensor_out: bool,
    /// Meaning of the columns of tables.
    #[command(flatten)]
    pub columns: ColumnsOptions,
    /// The rule, if it isn't that of the recipe.
    #[command(flatten)]
    pub accept: AcceptOptions,
}

impl Default for EvaluateOptions {
    fn default() -> Self {
        EvaluateOptions {
            run: Vec::new(),
            calibration: None,
            test: None,
            solver: BEST.to_owned(),
            constant_load: false,
            quantity: None,
            repeatability: RepeatabilityChoice::default(),
            holdout: HoldoutOptions::default(),
            folds_by: None,
            vector: false,
            history: false,
            leave_one_sensor_out: false,
            columns: ColumnsOptions::default(),
            accept: AcceptOptions::default(),
        }
    }
}

/// Name of a method, and its evaluation or the reason why it has none.
pub type SolverOutcome = (String, Result<Evaluation, String>);

/// Errors, characteristics and verdict.
#[derive(Default)]
pub struct Evaluated {
    /// Result of each method.
    pub outcomes: Vec<SolverOutcome>,
    /// Errors on presses that were held out in turn, if there is no test.
    pub cross_validated: Option<Vec<TriedMethod>>,
    /// Staircases of a run.
    pub characteristics: Option<Staircases>,
    /// Verdict, if there is a rule.
    pub judgement: Option<Judgement>,
    /// Whether a run has neither a calibration nor a test.
    pub is_only_characterised: bool,
    /// Whether the array and the protocol are like the paper's, whose numbers may be compared.
    pub is_beside_paper: bool,
    /// What is known of the sensor's design, if its prior was used.
    pub design: Option<String>,
    /// Why depths aren't solved although they are known.
    pub unsolved_depth: Option<String>,
    /// Errors of force vectors without a place; then there is nothing else.
    pub forces: Option<ForcesEvaluated>,
    /// Errors of force vectors and places; then there is nothing else.
    pub vector: Option<VectorEvaluation>,
    /// Errors of a series with and without earlier readings; then there is nothing else.
    pub history: Option<HistoryEvaluation>,
    /// Errors of sensors by the map of the others; then there is nothing else.
    pub left_out_sensors: Option<LeftOutSensors>,
}

/// Evaluates and judges, like `palpate evaluate`. A rule without a test gives a verdict that isn't decided.
///
/// # Errors
/// Bad input. The reason why a single method has no evaluation is in [`Evaluated::outcomes`].
pub fn evaluate(options: &EvaluateOptions, note: Note<'_>) -> Result<Evaluated, Failure> {
    check_solver(&options.solver, &[BEST, ALL])?;
    if options.leave_one_sensor_out {
        return Ok(Evaluated { left_out_sensors: Some(design::evaluated(options, note)?), ..Evaluated::default() });
    }
    if options.run.len() > 2 {
        let help = "several sensors of a design: palpate evaluate A B C --leave-one-sensor-out";
        return Err(Failure::usage(miette::miette!(help = help, "`evaluate` takes one run folder, or two tables")));
    }
    if options.vector {
        let named =
            [options.run.first().or(options.calibration.as_ref()), options.run.get(1).or(options.test.as_ref())];
        let errors =
            vectors::evaluated(named.map(|path| path.map(PathBuf::as_path)), &options.columns.mapping()?, note)?;
        return Ok(Evaluated { vector: Some(errors), ..Evaluated::default() });
    }
    if options.history {
        let [source] = options.run.as_slice() else {
            let help = "palpate evaluate series.csv --history --columns t_s=time,force_n=Fz,outputs=ch0..ch15";
            return Err(Failure::usage(miette::miette!(help = help, "--history takes one table or run")));
        };
        let errors = history::evaluated(source, &options.columns, note)?;
        return Ok(Evaluated { history: Some(errors), ..Evaluated::default() });
    }
    if options.folds_by.is_some() && options.run.len() != 1 {
        let help = "name one table or run: palpate evaluate trials.csv --folds-by trial";
        return Err(Failure::usage(miette::miette!(help = help, "--folds-by leaves out groups of one table or run")));
    }
    if let ([source], []) = (options.run.as_slice(), options.holdout.holdout.as_slice())
        && (source.exists() || options.folds_by.is_some() && is_stdin(source))
        && let Some(forces) = forces::evaluated(source, options.folds_by.as_deref(), &options.columns, note)?
    {
        if options.accept.rule()?.is_some() {
            let help = "remove --accept: errors of force vectors have no rule";
            return Err(Failure::usage(miette::miette!(help = help, "--accept judges places and forces of presses")));
        }
        return Ok(Evaluated { forces: Some(forces), ..Evaluated::default() });
    }
    let accept = &options.accept;
    match (EvaluationInput::of(options)?, options.holdout.asked()?) {
        (EvaluationInput::Run(run), Some(holdout)) => {
            let (recorded, bench) = read_run(run, note)?;
            let all = recorded.presses();
            Selection::of_phase(&all, Phase::Calibration).map_err(Failure::usage)?;
            let mut presses = all.clone();
            if let Some(of) = presses.keep(Phase::Calibration) {
                let kept = presses.presses.len();
                note(&format!("note: {}: its {kept} calibration presses are used, of {of}", run.display()));
            }
            let (layout, u_place_mm) = (Some(&bench.layout), bench.u_place_mm());
            let evidence = Evidence { presses: &all, layout, runs: vec![&recorded], u_place_mm };
            let asked = accept.rule_of([&recorded], note)?.map(|rule| (rule, evidence));
            held_out(options, &holdout, &presses, bench.placed(), asked, note)
        }
        (EvaluationInput::Table(table), Some(holdout)) => {
            let mapping = options.columns.mapping()?;
            let presses = read_presses(table, &mapping, Some(Phase::Calibration), note)?;
            let asked = accept.rule()?.map(|rule| (rule, of_table(&presses)));
            held_out(options, &holdout, &presses, mapping.layout_of(presses.channels).as_ref(), asked, note)
        }
        (EvaluationInput::Tables(..), Some(_)) => {
            let help = "name one table or run: palpate evaluate grid.csv --holdout places 20%";
            Err(Failure::usage(miette::miette!(help = help, "--holdout splits one table or run")))
        }
        (EvaluationInput::Run(run), None) => of_run(options, run, note),
        (EvaluationInput::Table(table), None) => {
            let mapping = options.columns.mapping()?;
            let presses = read_presses(table, &mapping, Some(Phase::Calibration), note)?;
            let (source_name, rule) = (presses.source.clone(), accept.rule()?);
            let layout = mapping.layout_of(presses.channels);
            let cross_validated = cross_validated(options, &presses, layout.as_ref(), rule.is_some())?;
            let untested = CalibrateError::NoPresses { source_name, phase: Phase::Test.name(), flagged: 0 };
            let known = Evaluated { cross_validated, ..Evaluated::default() };
            known.tried(options, Err(untested.into()), rule.map(|rule| (rule, of_table(&presses))), None)
        }
        (EvaluationInput::Tables(calibration, test), None) => {
            let mapping = options.columns.mapping()?;
            let calibration = read_presses(calibration, &mapping, Some(Phase::Calibration), note)?;
            let test = read_presses(test, &mapping, Some(Phase::Test), note)?;
            warn_of_units(&calibration, &test, note);
            let layout = mapping.layout_of(calibration.channels);
            let trial = Trial::of_tables(&calibration, &test).map(|trial| trial.with_layout(layout.as_ref()));
            let asked = accept.rule()?.map(|rule| (rule, of_table(&calibration)));
            Evaluated::default().tried(options, trial, asked, None)
        }
    }
}

/// What the options name.
enum EvaluationInput<'a> {
    Run(&'a Path),
    Table(&'a Path),
    /// Calibration and test.
    Tables(&'a Path, &'a Path),
}

impl EvaluationInput<'_> {
    fn of(options: &EvaluateOptions) -> Result<EvaluationInput<'_>, Failure> {
        match (options.run.as_slice(), &options.calibration, &options.test) {
            ([], Some(calibration), Some(test)) => Ok(EvaluationInput::Tables(calibration, test)),
            ([run], None, None) if run.is_dir() || !(run.exists() || is_stdin(run)) => Ok(EvaluationInput::Run(run)),
            ([table], None, None) => Ok(EvaluationInput::Table(table)),
            ([first, second, ..], ..) if first.is_dir() || second.is_dir() => {
                let help = "one page about several runs of a sensor: palpate report RUN...";
                Err(Failure::usage(miette::miette!(help = help, "`evaluate` takes one run folder, or two tables")))
            }
            ([calibration, test], None, None) => Ok(EvaluationInput::Tables(calibration, test)),
            _ => {
                let help = "name a run folder, `palpate evaluate runs/paper`, or a table of calibration presses and one of test \
                            presses, `palpate evaluate calibration.csv test.csv`";
                Err(Failure::usage(miette::miette!(help = help, "`evaluate` needs a run or two tables")))
            }
        }
    }
}

/// A rule, and the evidence that it is applied to.
type RuleWithEvidence<'a> = Option<(AcceptanceRule, Evidence<'a>)>;

fn of_table(presses: &Presses) -> Evidence<'_> {
    Evidence { presses, layout: None, runs: Vec::new(), u_place_mm: None }
}

fn of_run(options: &EvaluateOptions, run: &Path, note: Note<'_>) -> Result<Evaluated, Failure> {
    let (recorded, bench) = read_run(run, note)?;
    let (presses, layout) = (recorded.presses(), &bench.layout);
    let rule = options.accept.rule_of([&recorded], note)?;
    let (runs, u_place_mm) = (vec![&recorded], bench.u_place_mm());
    let evidence = Evidence { presses: &presses, layout: Some(layout), runs, u_place_mm };
    let characteristics = Staircases::of_run(&presses, layout);
    let is_untested = !presses.presses.iter().any(|press| press.is_of(Phase::Test))
        && presses.sound(Phase::Calibration).next().is_some();
    let known = Evaluated {
        is_only_characterised: characteristics.is_some() && !presses.presses.iter().any(is_to_evaluate),
        is_beside_paper: is_beside_paper(layout, &presses),
        characteristics,
        cross_validated: match is_untested {
            true => cross_validated(options, &presses, bench.placed(), rule.is_some())?,
            false => None,
        },
        ..Evaluated::default()
    };
    let design = match options.solver.as_str() {
        BEST => ByDesign::of_runs(&[run]).map_err(Failure::usage)?,
        _ => None,
    };
    known.tried(options, Trial::of_run(&presses, bench.placed()), rule.map(|rule| (rule, evidence)), design.as_ref())
}

/// Evaluates presses that are held out of one table or of the calibration of a run.
fn held_out(
    options: &EvaluateOptions,
    holdout: &Holdout,
    presses: &Presses,
    layout: Option<&ArrayLayout>,
    asked: RuleWithEvidence<'_>,
    note: Note<'_>,
) -> Result<Evaluated, Failure> {
    let split = options.holdout.split(holdout, presses, layout, note)?;
    let trial = Trial::of_split(&split).map(|trial| trial.with_layout(layout));
    Evaluated::default().tried(options, trial, asked, None)
}

/// Returns the cross-validated errors of a calibration; `None` if there are none and a rule says what is missing.
fn cross_validated(
    options: &EvaluateOptions,
    presses: &Presses,
    layout: Option<&ArrayLayout>,
    has_rule: bool,
) -> Result<Option<Vec<TriedMethod>>, Failure> {
    let solver = if options.solver == ALL { BEST } else { &options.solver };
    let (load, quantity) = (load(options.constant_load), quantity(options.quantity));
    match evaluate::cross_validated(presses, layout, load, quantity, solver) {
        Err(_) if has_rule => Ok(None),
        found => found.map(Some).map_err(Failure::usage),
    }
}

impl Evaluated {
    /// Adds the evaluations of the requested methods and the verdict.
    fn tried(
        self,
        options: &EvaluateOptions,
        trial: Result<Trial<'_>, EvaluateError>,
        asked: RuleWithEvidence<'_>,
        design: Option<&ByDesign>,
    ) -> Result<Self, Failure> {
        let trial = match trial {
            // with a rule the verdict states what is missing
            Err(why) if !self.is_only_characterised && asked.is_none() && self.cross_validated.is_none() => {
                return Err(Failure::usage(why));
            }
            trial => trial
                .map(|trial| trial.with_load(load(options.constant_load)).with_quantity(quantity(options.quantity))),
        };
        let model = design.and_then(|design| design.model.as_ref());
        let outcomes = match (&trial, model) {
            (Err(_), _) => Vec::new(),
            (Ok(trial), Some(model)) => {
                let evaluation = trial.evaluate_with(model.fitted()).map_err(Failure::usage)?;
                vec![(model.fitted().name().to_owned(), Ok(evaluation))]
            }
            (Ok(trial), None) => outcomes(&options.solver, trial)?,
        };
        let known: Vec<Evaluation> = outcomes.iter().filter_map(|(_, outcome)| outcome.clone().ok()).collect();
        let judgement = asked.map(|(rule, evidence)| match design {
            Some(design) => design.judge(&rule, &evidence, &trial, &known),
            None => evidence.judge(&rule, &trial, &known),
        });
        let unsolved_depth = trial.as_ref().ok().and_then(Trial::unsolved_depth);
        Ok(Evaluated { outcomes, judgement, design: design.map(ByDesign::note), unsolved_depth, ..self })
    }
}

/// Returns the evaluations of the requested solvers.
fn outcomes(solver: &str, trial: &Trial<'_>) -> Result<Vec<SolverOutcome>, Failure> {
    let is_all = solver == ALL;
    let names = if is_all { [&SOLVERS, [BEST].as_slice()].concat() } else { vec![solver] };
    let mut outcomes = Vec::new();
    for name in names {
        let outcome = match trial.evaluate_timed(name) {
            Err(error) if !is_all || !error.is_of_solver() => return Err(Failure::usage(error)),
            // its cause is the difference between solvers
            outcome => {
                outcome.map_err(|error| error.source().map_or_else(|| error.to_string(), <dyn Error>::to_string))
            }
        };
        outcomes.push((name.to_owned(), outcome));
    }
    Ok(outcomes)
}
