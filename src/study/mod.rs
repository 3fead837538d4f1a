//! Studies: many conditions, rows of what came of each, and figures.
//!
//! Of the force loop, [`control`]: a [`Condition`] is walked as any run is, on the shipped benches with one thing changed, and
//! judged by the scene's truth. Of the methods that solve, [`methods`]: how near and how fast each of them is, how many presses it
//! needs, and where it fails. Of both together, [`minutes`]: what a calibration comes to against its time at the bench. Of arrays, [`curves`]: the paper's numerical study, for its lines of units and for any array. Of the
//! scenes themselves, [`ablation`]: what each of their terms is needed for. Everything but measured times follows from the seed:
//! the same study gives the same bytes.

pub mod ablation;
mod bench;
mod bound;
mod condition;
mod control;
pub mod curves;
mod figures;
pub mod methods;
pub mod minutes;
mod scenes;
mod stability;
pub mod validation;

pub use bench::Bench;
pub use bound::least_s;
pub use condition::{Condition, ConditionOutcome, Part};
pub use control::{DECLARED_N_MM, LoopFindings, LoopSize, MISMATCHES, TOLERANCES_N, control};
pub use figures::figures;
pub use scenes::{BenchChange, NOMINAL, SCENES};
pub use stability::Onset;

use crate::document::Problems;
use crate::parallel::in_parallel;
use crate::solver::CalibrationError;
use miette::Diagnostic;
use serde::Serialize;
use std::sync::atomic::{AtomicUsize, Ordering};
use thiserror::Error;

/// Hears how many parts of a study are done, and of how many.
pub type Told<'a> = &'a (dyn Fn(usize, usize) + Sync);

/// What comes of each job, in order, worked on by all processors; `told` hears of each that is done.
fn carried_out<J: Sync, O: Send>(
    jobs: &[J],
    told: Told<'_>,
    work: impl Fn(&J) -> Result<O, StudyError> + Sync,
) -> Result<Vec<O>, StudyError> {
    let done = AtomicUsize::new(0);
    let outcomes = in_parallel(jobs, |job| {
        let outcome = work(job);
        told(1 + done.fetch_add(1, Ordering::Relaxed), jobs.len());
        outcome
    });
    outcomes.into_iter().collect()
}

/// Which of some tries no other of its kind beats: one that is no slower and no farther off, and better in one of the two. A try
/// without both numbers has no part in it.
fn pareto<K: PartialEq>(tries: &[(K, Option<(f64, f64)>)]) -> Vec<bool> {
    let is_best = |(kind, mark): &(K, Option<(f64, f64)>)| {
        let Some((time, error)) = *mark else { return false };
        let beats = |other: &(f64, f64)| other.0 <= time && other.1 <= error && *other != (time, error);
        !tries.iter().filter(|(its, _)| its == kind).filter_map(|(_, mark)| mark.as_ref()).any(beats)
    };
    tries.iter().map(is_best).collect()
}

/// One JSON object a line.
pub fn ndjson<T: Serialize>(rows: impl IntoIterator<Item = T>) -> String {
    // numbers and text can't fail
    rows.into_iter().map(|row| serde_json::to_string(&row).unwrap_or_default() + "\n").collect()
}

/// Why there is no study.
#[derive(Debug, Error, Diagnostic)]
pub enum StudyError {
    /// A rig or a recipe of the study can't be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Problems(#[from] Problems),
    /// A press can't be calibrated on.
    #[error("the study can't calibrate: {0}")]
    Calibration(#[from] CalibrationError),
    /// A protocol that was to be carried out broke off.
    #[error("the protocol ended early with seed {seed}: {why}")]
    Broken {
        /// The seed.
        seed: u64,
        /// Why.
        why: String,
    },
    /// The operating system refused.
    #[error("the study can't run: {0}")]
    System(#[from] std::io::Error),
}
