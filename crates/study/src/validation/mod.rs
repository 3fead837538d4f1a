//! Repetition of the paper's validation: its complete protocol on its own rig, simulated, with one specimen for each seed, and
//! the claims of its numerical study. [`Validation::markdown`] is the content of `docs/explanation/validation.md`.

mod page;

use super::bench::{executed, papers_rig};
use super::curves::{PaperClaim, curves};
use super::{OnProgress, StudyError, carried_out, ndjson};
use palpate_data::dataset::Presses;
use palpate_data::dataset::characteristics::{Repeatability, Staircases, UnitCharacteristics, characterise};
use palpate_data::dataset::evaluate::Trial;
use palpate_data::recipe::{self, Plan};
use palpate_solver::{BEST, Evaluation, SOLVERS};
use serde::Serialize;

/// Recipe that is executed.
const RECIPE: (&str, &str) = ("recipes/paper.toml", include_str!("../../../../recipes/paper.toml"));

/// Number of repetitions of the complete protocol, with consecutive seeds.
pub const SEEDS: usize = 10;
/// Number of repetitions for a first look.
pub const QUICK_SEEDS: usize = 2;

/// Results of one specimen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ValidationOutcome {
    /// "validation".
    pub study: &'static str,
    /// Random seed of the specimen's places, its noise and everything else.
    pub seed: u64,
    /// Number of presses made.
    pub presses: usize,
    /// Duration of the presses, virtual time, h.
    pub hours: f64,
    /// Evaluation of the paper's method.
    pub papers: Evaluation,
    /// Evaluation of the method that cross-validation chooses.
    pub best: Evaluation,
    /// Repeatability (3 sd) and hysteresis of every unit.
    #[serde(skip)]
    pub table_1: Vec<UnitCharacteristics>,
}

/// All results of the validation.
#[derive(Clone, Debug, PartialEq)]
pub struct Validation {
    /// First seed.
    pub seed: u64,
    /// Outcomes, one for each seed.
    pub outcomes: Vec<ValidationOutcome>,
    /// Claims of the numerical study, with verdicts.
    pub claims: Vec<PaperClaim>,
}

/// Executes the protocol `seeds` times, in virtual time and without files.
///
/// # Errors
/// A recipe or a rig is invalid. This doesn't occur in practice: tests check that both are valid.
pub fn validation(seeds: usize, seed: u64, on_progress: OnProgress<'_>) -> Result<Validation, StudyError> {
    let each: Vec<u64> = (0..seeds as u64).map(|index| seed.wrapping_add(index)).collect();
    let outcomes = carried_out(&each, on_progress, |&seed| protocol(seed))?;
    Ok(Validation { seed, outcomes, claims: curves().claims })
}

/// Executes the complete protocol once.
fn protocol(seed: u64) -> Result<ValidationOutcome, StudyError> {
    let rig = papers_rig()?;
    let (file, text) = RECIPE;
    let plan = Plan::new(&recipe::parse(file, text)?, &rig.ground(), seed)?;
    let (contacts, ending) = executed(&plan, &rig)?;
    let broken = |why: String| StudyError::Broken { seed, why };
    if let Some(why) = ending.text() {
        return Err(broken(why));
    }
    let layout = &rig.array.layout;
    let presses = Presses::of_contacts("the study", &contacts);
    let trial = Trial::of_run(&presses, Some(layout)).map_err(|error| broken(error.to_string()))?;
    let evaluated = |solver| trial.evaluate(solver).map_err(|error| broken(error.to_string()));
    let staircases = Staircases::of_run(&presses, layout);
    let last_s = presses.presses.iter().filter_map(|press| press.t_s).fold(0.0, f64::max);
    Ok(ValidationOutcome {
        study: "validation",
        seed,
        presses: contacts.len(),
        hours: last_s / 3600.0,
        papers: evaluated(SOLVERS[0])?,
        best: evaluated(BEST)?,
        table_1: staircases.map_or_else(Vec::new, |staircases| characterise(&staircases, Repeatability::ThreeSd)),
    })
}

impl Validation {
    /// Returns one JSON object per line: the specimens, then the claims.
    pub fn ndjson(&self) -> String {
        ndjson(&self.outcomes) + &ndjson(&self.claims)
    }
}
