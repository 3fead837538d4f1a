//! Studies: many conditions, rows of their results, and figures.
//!
//! [`control`] studies the force loop. A [`LoopCondition`] is executed like any run, on the supplied benches with one change. It is
//! judged by the scene's truth. [`methods`] studies the methods that solve: their accuracy, speed, required number of presses,
//! and conditions of failure. [`minutes`] studies both together: the accuracy of a calibration as a function of its time at the
//! bench. [`curves`] studies arrays: the paper's numerical study, for its lines of units and for any array. [`ablation`] studies
//! the scenes themselves: it finds which results each term of a scene affects. [`vector`] studies force vectors and two contacts.
//!
//! Everything except measured times follows from the seed, so the same study gives the same bytes.

#![forbid(unsafe_code)]

pub mod ablation;
mod bench;
mod bound;
mod condition;
mod control;
pub mod curves;
pub mod few;
mod figures;
pub mod methods;
pub mod minutes;
mod scenes;
mod stability;
pub mod validation;
pub mod vector;

pub use bench::StudyBench;
pub use bound::least_s;
pub use condition::{ConditionOutcome, LoopCondition, StudyPart};
pub use control::{LoopFindings, LoopSize, control};
pub use figures::figures;
pub use scenes::BenchChange;
pub use scenes::NOMINAL;
pub use stability::Onset;

use miette::Diagnostic;
use palpate_core::parallel::in_parallel;
use palpate_document::Problems;
use palpate_solver::CalibrationError;
use serde::Serialize;
use std::sync::atomic::{AtomicUsize, Ordering};
use thiserror::Error;

/// Callback with the number of finished parts of a study and the total number.
pub type OnProgress<'a> = &'a (dyn Fn(usize, usize) + Sync);

/// Returns the result of each job, in order. All processors work on the jobs, and `on_progress` is informed about each finished job.
fn carried_out<J: Sync, O: Send>(
    jobs: &[J],
    on_progress: OnProgress<'_>,
    work: impl Fn(&J) -> Result<O, StudyError> + Sync,
) -> Result<Vec<O>, StudyError> {
    let done = AtomicUsize::new(0);
    let outcomes = in_parallel(jobs, |job| {
        let outcome = work(job);
        on_progress(1 + done.fetch_add(1, Ordering::Relaxed), jobs.len());
        outcome
    });
    outcomes.into_iter().collect()
}

/// Returns for each try whether no other try of its kind beats it. A try beats another if it is neither slower nor less accurate,
/// and better in one of the two. A try without both numbers isn't compared.
fn pareto<K: PartialEq>(tries: &[(K, Option<(f64, f64)>)]) -> Vec<bool> {
    let is_best = |(kind, mark): &(K, Option<(f64, f64)>)| {
        let Some((time, error)) = *mark else { return false };
        let beats = |other: &(f64, f64)| other.0 <= time && other.1 <= error && *other != (time, error);
        !tries.iter().filter(|(its, _)| its == kind).filter_map(|(_, mark)| mark.as_ref()).any(beats)
    };
    tries.iter().map(is_best).collect()
}

/// Returns one JSON object per line.
pub fn ndjson<T: Serialize>(rows: impl IntoIterator<Item = T>) -> String {
    // numbers and text can't fail
    rows.into_iter().map(|row| serde_json::to_string(&row).unwrap_or_default() + "\n").collect()
}

/// Reason why a study failed.
#[derive(Debug, Error, Diagnostic)]
pub enum StudyError {
    /// A rig or a recipe of the study can't be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Problems(#[from] Problems),
    /// A press is unsuitable for calibration.
    #[error("the study can't calibrate: {0}")]
    Calibration(#[from] CalibrationError),
    /// A protocol stopped before its end.
    #[error("the protocol ended early with seed {seed}: {why}")]
    Broken {
        /// Seed of the protocol.
        seed: u64,
        /// Reason for the stop.
        why: String,
    },
    /// The operating system reported an error.
    #[error("the study can't run: {0}")]
    System(#[from] std::io::Error),
}
