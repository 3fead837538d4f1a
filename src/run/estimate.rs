//! How long a plan takes.

use crate::control::{MotionProfile, Strategy};
use crate::recipe::Entry;
use crate::rig::RigSpec;

/// What a press takes beyond its travel, dwell and window on a stage that answers in some 12 ms: the look at the air, the
/// approach, the steps and the withdrawal, s.
fn press_s(strategy: Strategy) -> f64 {
    match strategy {
        Strategy::Guarded => 1.1,
        Strategy::Velocity => 1.6,
        Strategy::Map => 0.55,
    }
}

/// What each further level of a staircase takes beyond its dwell and window, s.
const LEVEL_S: f64 = 0.4;

/// How long some entries of a plan will take on a rig that is ready, s: within a third or so.
pub fn estimated_s(entries: &[Entry], spec: &RigSpec) -> f64 {
    let mut total_s = 0.0;
    let mut place = spec.frame.origin;
    for entry in entries {
        let way_mm = (entry.place.x_mm - place.x_mm).abs().max((entry.place.y_mm - place.y_mm).abs());
        let levels = entry.task.levels.len() as f64;
        total_s += MotionProfile::new(way_mm, spec.stage.speed_mm_s, spec.stage.acceleration_mm_s2).duration_s()
            + press_s(entry.task.strategy)
            + LEVEL_S * (levels - 1.0)
            + levels * (entry.task.hold_s + entry.task.sample_s)
            + entry.rest_after_s;
        place = entry.place;
    }
    total_s
}
