//! A few presses in the force loop. Driver and control core work as in any run, in virtual time.

use super::{AblationSize, TermModel};
use crate::{LoopCondition, StudyError, StudyPart};
use palpate_control::Strategy;
use palpate_run::rig::RigSpec;

/// Calibration force of the paper, and tolerance of its loop, N.
const FORCE_N: f64 = 1.0;
const TOLERANCE_N: f64 = 0.05;

/// Returns mean force error in the window (mN), peak above the set force (mN), and time from one press to the next (s).
pub(super) fn press(
    model: &TermModel,
    rig: &RigSpec,
    size: AblationSize,
    seed: u64,
) -> Result<[Option<f64>; 3], StudyError> {
    let outcome = condition(model, rig, size, seed).measure()?;
    // a run that ends early has pressed other places
    let is_whole = outcome.rule.is_none();
    let found = [outcome.error_mean_mn, outcome.peak_over_mn, outcome.median_s];
    Ok(found.map(|number| number.filter(|_| is_whole)))
}

/// Returns a square of presses around the origin, with the default strategy of a recipe.
pub(super) fn condition(model: &TermModel, rig: &RigSpec, size: AblationSize, seed: u64) -> LoopCondition {
    LoopCondition {
        part: StudyPart::Scenes,
        bench: "the paper's rig",
        scene: "ablation".to_owned(),
        spec: RigSpec { scene: model.scene.clone(), ..rig.clone() },
        strategy: Strategy::default(),
        force_n: FORCE_N,
        tolerance_n: TOLERANCE_N,
        side: size.presses,
        tests: 0,
        seed,
    }
}
