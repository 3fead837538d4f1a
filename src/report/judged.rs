//! The methods that a page shows.

use crate::dataset::Presses;
use crate::dataset::evaluate::{EvaluateError, Trial};
use crate::parallel::in_parallel;
use crate::quantity::ArrayLayout;
use crate::recipe::Phase;
use crate::solver::{BEST, Evaluation, Fitted, SOLVERS, Solver};

/// The paper's own method.
pub const PAPERS: &str = SOLVERS[0];

/// How far off the paper's method and ours are on a sensor's test, as `evaluate` has it.
pub struct Judged {
    /// The paper's method, then the best, where that is another; empty where there is nothing to evaluate.
    pub evaluations: Vec<Evaluation>,
    /// A method that knows how near it is expected to come.
    pub expecting: Option<Fitted>,
    /// Why there is no evaluation, or not by both.
    pub why_not: Option<String>,
}

impl Judged {
    /// Evaluates a sensor's presses.
    pub fn of(presses: &Presses, layout: &ArrayLayout) -> Judged {
        let none =
            |why: EvaluateError| Judged { evaluations: Vec::new(), expecting: None, why_not: Some(with_cause(&why)) };
        let trial = match Trial::of_run(presses, Some(layout)) {
            Ok(trial) => trial,
            Err(why) => return none(why),
        };
        let judged = in_parallel(&[BEST, PAPERS], |solver| trial.evaluate_fitted(solver));
        let why_not = judged.iter().find_map(|judged| judged.as_ref().err().map(with_cause));
        let mut judged: Vec<(Evaluation, Fitted)> = judged.into_iter().flatten().collect();
        judged.reverse(); // the one that takes longest began first
        if judged.iter().all(|(evaluation, _)| evaluation.solver == PAPERS) {
            judged.truncate(1);
        }
        let (evaluations, fitted): (Vec<Evaluation>, Vec<Fitted>) = judged.into_iter().unzip();
        let calibrated = || presses.presses.iter().filter(|press| press.is_of(Phase::Calibration));
        let expects = |fitted: &Fitted| calibrated().any(|press| fitted.expected(press.place(), 1.0).is_some());
        let surrogate = || trial.evaluate_fitted("surrogate").ok().map(|(_, fitted)| fitted);
        let expecting = fitted.into_iter().find(expects).or_else(surrogate);
        Judged { evaluations, expecting, why_not }
    }

    /// The evaluation that decides: the best's.
    pub fn decisive(&self) -> Option<&Evaluation> {
        self.evaluations.last()
    }
}

/// Why there is no evaluation: the cause is what tells, the sentence before it says that it can't be.
pub fn with_cause(why: &EvaluateError) -> String {
    let cause = std::error::Error::source(why).map(|cause| format!(": {cause}")).unwrap_or_default();
    format!("{why}{cause}")
}
