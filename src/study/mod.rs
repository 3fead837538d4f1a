//! Studies: many conditions, rows of what came of each, and figures.
//!
//! Of the force loop, [`control`]: a [`Condition`] is walked as any run is, on the shipped benches with one thing changed, and
//! judged by the scene's truth. Of the methods that solve, [`methods`]: how near and how fast each of them is, how many presses it
//! needs, and where it fails. Of arrays, [`curves`]: the paper's numerical study, for its lines of units and for any array. Of the
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
use crate::solver::CalibrationError;
use miette::Diagnostic;
use thiserror::Error;

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
    #[error("the protocol broke off with seed {seed}: {why}")]
    Broken {
        /// The seed.
        seed: u64,
        /// Why.
        why: String,
    },
    /// The operating system refused.
    #[error("the study can't be carried out: {0}")]
    System(#[from] std::io::Error),
}
