//! Methods shown on a page, and the verdict.

use super::Subject;
use palpate_core::parallel::in_parallel;
use palpate_data::acceptance::{AcceptanceRule, Judgement, SensorVerdict};
use palpate_data::dataset::calibration::SolvedQuantity;
use palpate_data::dataset::evaluate::{EvaluateError, Trial, cross_validated};
use palpate_data::recipe::Phase;
use palpate_run::batch::ByDesign;
use palpate_solver::{BEST, Evaluation, Fitted, ForceKnown, Model, SOLVERS, Solver, TriedMethod};

/// The paper's own method.
pub(super) const PAPERS: &str = SOLVERS[0];

/// Errors of the methods on a sensor's test, like those of `evaluate`, and the verdict.
pub struct SensorResults {
    /// Evaluation of the paper's method, then of the rule's or the best method if it is another one. Empty if there is nothing to
    /// evaluate.
    pub evaluations: Vec<Evaluation>,
    /// A method that knows its expected error.
    pub expecting: Option<Fitted>,
    /// Mean errors of methods on presses that were held out of the calibration in turn, if there is no test.
    pub cross_validated: Vec<TriedMethod>,
    /// Reason why there is no evaluation, or only one.
    pub why_not: Option<String>,
    /// Standard uncertainty of the test's forces, N; `None` if it is unknown.
    pub u_force_n: Option<f64>,
    /// Verdict; `None` without a rule.
    pub judgement: Option<Judgement>,
}

impl SensorResults {
    /// Evaluates a sensor's presses and judges them by a rule.
    ///
    /// With a batch's conclusion by the design's prior, its model takes the place of the rule's method.
    pub fn of(subject: &Subject, rule: Option<&AcceptanceRule>, design: Option<ByDesign>) -> SensorResults {
        let trial = Trial::of_run(&subject.presses, subject.placed());
        let second = rule.map_or(BEST, |rule| rule.method.as_str());
        let second = if second == PAPERS { BEST } else { second };
        let model = design.as_ref().and_then(|design| design.model.as_ref());
        let (evaluations, expecting, why_not) = match (&trial, model) {
            (Ok(trial), Some(model)) => evaluated_with(trial, model.fitted()),
            (Ok(trial), None) => evaluated(trial, second, subject),
            (Err(why), _) => (Vec::new(), None, Some(why.text())),
        };
        let judgement = rule.map(|rule| match &design {
            Some(design) => design.judge(rule, &subject.evidence(), &trial, &evaluations),
            None => subject.evidence().judge(rule, &trial, &evaluations),
        });
        let is_untested = !subject.presses.presses.iter().any(|press| press.is_of(Phase::Test));
        let cross_validated = || {
            cross_validated(&subject.presses, subject.placed(), ForceKnown::default(), SolvedQuantity::Known, second)
                .ok()
        };
        let cross_validated = is_untested.then(cross_validated).flatten().unwrap_or_default();
        let u_force_n = trial.as_ref().ok().and_then(Trial::u_force_n);
        let of_design = design.and_then(|design| design.model).filter(|_| trial.is_ok()).map(Model::into_fitted);
        let expecting = of_design.or(expecting);
        SensorResults { evaluations, expecting, cross_validated, why_not, u_force_n, judgement }
    }

    /// Returns the verdict; `None` without a rule.
    pub fn verdict(&self) -> Option<SensorVerdict> {
        self.judgement.as_ref().map(|judgement| judgement.verdict)
    }

    /// Returns the evaluation on which the verdict is based; without a rule, that of the best method.
    pub fn decisive(&self) -> Option<&Evaluation> {
        match self.judgement.as_ref().map(|judgement| judgement.method.as_str()) {
            None | Some(BEST) => self.evaluations.last(),
            Some(method) => self.evaluations.iter().find(|evaluation| evaluation.solver == method),
        }
    }
}

/// Returns the evaluations by the paper's method alone and by a method that knows the design's prior.
fn evaluated_with(trial: &Trial<'_>, fitted: &Fitted) -> (Vec<Evaluation>, Option<Fitted>, Option<String>) {
    let both = [trial.evaluate(PAPERS), trial.evaluate_with(fitted)];
    let why_not = both.iter().find_map(|evaluated| evaluated.as_ref().err().map(EvaluateError::text));
    (both.into_iter().flatten().collect(), None, why_not)
}

/// Returns the evaluations by both methods, and the fitted method that states expected errors.
fn evaluated(trial: &Trial<'_>, second: &str, subject: &Subject) -> (Vec<Evaluation>, Option<Fitted>, Option<String>) {
    let judged = in_parallel(&[second, PAPERS], |solver| trial.evaluate_fitted(solver));
    let why_not = judged.iter().find_map(|judged| judged.as_ref().err().map(EvaluateError::text));
    let mut judged: Vec<(Evaluation, Fitted)> = judged.into_iter().flatten().collect();
    judged.reverse(); // the one that takes longest began first
    if judged.len() == 2 && judged.iter().all(|(evaluation, _)| evaluation.solver == PAPERS) {
        judged.truncate(1); // the best is the paper's: one column
    }
    let (evaluations, fitted): (Vec<Evaluation>, Vec<Fitted>) = judged.into_iter().unzip();
    let calibrated = || subject.presses.presses.iter().filter(|press| press.is_of(Phase::Calibration));
    let expects = |fitted: &Fitted| calibrated().any(|press| fitted.expected(press.place(), 1.0).is_some());
    let surrogate = || trial.evaluate_fitted("surrogate").ok().map(|(_, fitted)| fitted);
    let expecting = fitted.into_iter().find(expects).or_else(surrogate);
    (evaluations, expecting, why_not)
}
