//! Study of the terms that a scene needs. Each physical or measurement term is tried off and on; everything else is as in the
//! scene supplied for the paper's rig.
//!
//! A [`SceneTerm`] is tried on what it can affect: the methods and Table 1 on skins read without a rig (`readings`), and the press in
//! the force loop (`presses`). Both tries of a seed use the same contacts and the same noise, so an [`Effect`] is the mean of
//! paired differences. The rule then states for which [`Question`] a scene needs the term. The cost of each term is measured
//! separately, when nothing else of the study runs.

mod cost;
mod effect;
mod presses;
mod readings;
mod rule;
mod size;
mod terms;

pub use cost::{ALL_TERMS, Cost, PER_PRESS, PER_READING, cost_of_all_terms};
pub use effect::Effect;
pub use rule::{Needed, QUESTIONS, Question, SHARE, needed};
pub use size::AblationSize;
pub use terms::{SceneTerm, TERMS, TermModel, Touches};

use super::{OnProgress, StudyError, carried_out, ndjson};
use palpate_run::rig::RigSpec;
use serde::Serialize;

/// Effect of a term on one question.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TermRow {
    /// "ablation".
    pub study: &'static str,
    /// Name of the term.
    pub term: &'static str,
    /// Size of the term, and what it can't affect by construction.
    pub text: &'static str,
    /// Whether the base contains the term.
    pub in_base: bool,
    /// Name of the question.
    pub question: &'static str,
    /// Unit of all numbers of the row.
    pub unit: &'static str,
    /// Result of the base itself, mean over seeds.
    pub base: f64,
    /// Results with the term off and on, and their difference.
    #[serde(flatten)]
    pub effect: Effect,
    /// Limit that a difference must exceed to count.
    pub counts_from: f64,
    /// Whether a scene needs the term for this question.
    pub needed: Needed,
}

/// All results of the study.
#[derive(Clone, Debug, PartialEq)]
pub struct AblationFindings {
    /// Amount of measurement.
    pub size: AblationSize,
    /// Rows, one for each term and question that the term can affect.
    pub rows: Vec<TermRow>,
    /// Costs of the terms, measured by a clock.
    pub costs: Vec<Cost>,
}

impl AblationFindings {
    /// Returns one JSON object per line.
    pub fn ndjson(&self) -> String {
        ndjson(&self.rows) + &ndjson(&self.costs)
    }

    /// Returns the effect of a term on a question. `None` if the term can't affect the question, or if no two tries gave a
    /// number.
    pub fn row(&self, term: &str, question: &Question) -> Option<&TermRow> {
        self.rows.iter().find(|row| row.term == term && row.question == question.name)
    }

    /// Returns whether a scene needs a term for any question.
    pub fn verdict(&self, term: &str) -> Needed {
        let verdicts = || self.rows.iter().filter(|row| row.term == term).map(|row| row.needed);
        [Needed::Yes, Needed::Undecided]
            .into_iter()
            .find(|verdict| verdicts().any(|its| its == *verdict))
            .unwrap_or(Needed::No)
    }
}

/// Results of one try, in the order of the questions. `None` if the question wasn't asked or has no answer.
type TryResults = [Option<f64>; QUESTIONS.len()];

/// One try on one subject with one seed. At most one term differs from the base.
#[derive(Clone, Copy)]
struct TermTry {
    term: Option<usize>,
    on: Touches,
    seed: usize,
}

/// Tries every term. `on_progress` is called with the number of finished tries and the total number.
///
/// # Errors
/// A scene can't be pressed. This doesn't occur in practice: a test checks that the supplied scene is valid.
pub fn ablation(size: AblationSize, seed: u64, on_progress: OnProgress<'_>) -> Result<AblationFindings, StudyError> {
    let (base, rig) = TermModel::base()?;
    let jobs = jobs(size);
    let tried = carried_out(&jobs, on_progress, |job| {
        let model = job.term.map_or_else(|| base.clone(), |term| TERMS[term].other_than(&base));
        answers(&model, &rig, job.on, size, seed.wrapping_add(job.seed as u64))
    })?;
    // the answers to a question in the order of the seeds, of the base or with one term other than there
    let of = |term: Option<usize>, question: usize| -> Vec<Option<f64>> {
        let its = jobs.iter().zip(&tried).filter(|(job, _)| job.term == term && job.on == QUESTIONS[question].of);
        its.map(|(_, answers)| answers[question]).collect()
    };
    let mut rows = Vec::new();
    for (index, term) in TERMS.iter().enumerate() {
        for (at, question) in QUESTIONS.iter().enumerate().filter(|(_, question)| term.touches(question.of)) {
            rows.extend(row(term, question, &of(None, at), &of(Some(index), at)));
        }
    }
    let costs = cost::costs(&base, &rig, size, seed)?;
    Ok(AblationFindings { size, rows, costs })
}

/// Returns the jobs, the longest first, so that no processor has to wait for another at the end.
fn jobs(size: AblationSize) -> Vec<TermTry> {
    let tried = |on| {
        let terms = TERMS.iter().enumerate().filter(move |(_, term)| term.touches(on)).map(|(index, _)| Some(index));
        [None]
            .into_iter()
            .chain(terms)
            .flat_map(move |term| (0..size.seeds).map(move |seed| TermTry { term, on, seed }))
    };
    Touches::ALL.into_iter().flat_map(tried).collect()
}

fn answers(
    model: &TermModel,
    rig: &RigSpec,
    on: Touches,
    size: AblationSize,
    seed: u64,
) -> Result<TryResults, StudyError> {
    let mut answers = TryResults::default();
    let found: Vec<Option<f64>> = match on {
        Touches::Methods => readings::methods(model, rig, size, seed)?.to_vec(),
        Touches::Table1 => readings::table_1(model, rig, seed).to_vec(),
        Touches::Press => presses::press(model, rig, size, seed)?.to_vec(),
    };
    let asked = QUESTIONS.iter().zip(&mut answers).filter(|(question, _)| question.of == on);
    asked.zip(found).for_each(|((_, answer), found)| *answer = found);
    Ok(answers)
}

fn row(term: &SceneTerm, question: &Question, base: &[Option<f64>], other: &[Option<f64>]) -> Option<TermRow> {
    let pair = |(base, other): (&Option<f64>, &Option<f64>)| {
        let (base, other) = ((*base)?, (*other)?);
        Some(if term.in_base { (other, base) } else { (base, other) })
    };
    let pairs: Vec<(f64, f64)> = base.iter().zip(other).filter_map(pair).collect();
    let effect = Effect::of(&pairs)?;
    let base = if term.in_base { effect.on } else { effect.off };
    Some(TermRow {
        study: "ablation",
        term: term.name,
        text: term.text,
        in_base: term.in_base,
        question: question.name,
        unit: question.unit,
        base,
        effect,
        counts_from: question.counts_from(base),
        needed: needed(&effect, question.counts_from(base)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn difference_is_on_minus_off_for_either_base() {
        let (lower, higher) = ([Some(1.0), Some(3.0), None], [Some(3.0), Some(5.5), Some(9.0)]);
        let of = |in_base: bool| {
            let term = TERMS.iter().find(|term| term.in_base == in_base).unwrap();
            row(term, &QUESTIONS[0], &lower, &higher).unwrap()
        };
        let (off_in_base, on_in_base) = (of(false), of(true));
        assert_eq!((off_in_base.effect.difference, off_in_base.base), (2.25, 2.0));
        assert_eq!((on_in_base.effect.difference, on_in_base.base), (-2.25, 2.0));
        assert_eq!(off_in_base.effect.seeds, 2, "a seed without both is no pair");
    }

    #[test]
    fn every_trial_has_its_pair() {
        let jobs = jobs(AblationSize { seeds: 4, ..AblationSize::QUICK });
        for job in &jobs {
            let is_pair = |other: &&TermTry| other.term.is_none() && (other.on, other.seed) == (job.on, job.seed);
            assert_eq!(jobs.iter().filter(is_pair).count(), 1);
        }
    }
}
