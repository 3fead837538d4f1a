//! The results of a run by its own recipe: evaluations, characteristics and verdict.

use super::Failure;
use super::choices::EvaluateChoice;
use palpate_data::acceptance::Judgement;
use palpate_data::dataset::characteristics::Staircases;
use palpate_data::dataset::evaluate::Trial;
use palpate_data::dataset::{Evidence, Recorded, RunFolder};
use palpate_data::recipe::Recipe;
use palpate_report::report::is_beside_paper;
use palpate_run::rig::RigSpec;
use palpate_solver::{BEST, Evaluation};

/// The result of a complete run by its own recipe.
pub struct RunResults {
    /// With each solver that `[evaluate]` names, and with the chosen one.
    pub evaluations: Vec<Evaluation>,
    /// Of its staircases.
    pub characteristics: Option<Staircases>,
    /// By the recipe's rule.
    pub judgement: Option<Judgement>,
    /// Whether the array and the protocol are like the paper's, whose numbers may be compared.
    pub is_beside_paper: bool,
}

impl RunResults {
    /// Evaluates and judges a run by its own recipe. [`EvaluateChoice::Best`] adds the best method, which is chosen by
    /// cross-validation.
    pub(crate) fn of(
        folder: &RunFolder,
        spec: &RigSpec,
        recipe: &Recipe,
        methods: EvaluateChoice,
    ) -> Result<RunResults, Failure> {
        let layout = &spec.array.layout;
        if recipe.solvers.is_empty() && recipe.rule().is_none() {
            // avoids reading a long run into memory
            let characteristics = folder.staircases().map_err(Failure::dataset)?;
            let is_beside_paper =
                characteristics.is_some() && is_beside_paper(layout, &folder.presses().map_err(Failure::dataset)?);
            return Ok(RunResults { evaluations: Vec::new(), characteristics, judgement: None, is_beside_paper });
        }
        let recorded = Recorded::read(folder.path()).map_err(Failure::dataset)?;
        let presses = recorded.presses();
        let characteristics = Staircases::of_run(&presses, layout);
        let trial = match Trial::of_run(&presses, Some(layout)) {
            Err(why) if !recipe.solvers.is_empty() => return Err(Failure::not_accepted(why)),
            trial => trial,
        };
        let evaluate = |trial: &Trial<'_>| -> Result<Vec<Evaluation>, Failure> {
            recipe.solvers.iter().map(|solver| trial.evaluate(solver).map_err(Failure::not_accepted)).collect()
        };
        let mut evaluations = trial.as_ref().map_or_else(|_| Ok(Vec::new()), evaluate)?;
        let has_best = recipe.solvers.iter().any(|solver| solver == BEST);
        if methods == EvaluateChoice::Best
            && !has_best
            && let Some(best) = trial.as_ref().ok().and_then(|trial| trial.evaluate(BEST).ok())
        {
            evaluations.retain(|evaluation| evaluation.solver != best.solver);
            evaluations.push(best);
        }
        let (runs, u_place_mm) = (vec![&recorded], spec.u_place_mm());
        let evidence = Evidence { presses: &presses, layout: Some(layout), runs, u_place_mm };
        let judgement = recipe.rule().map(|rule| evidence.judge(rule, &trial, &evaluations));
        let is_beside_paper = is_beside_paper(layout, &presses);
        Ok(RunResults { evaluations, characteristics, judgement, is_beside_paper })
    }
}
