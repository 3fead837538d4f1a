//! Estimated duration of a plan.

use crate::rig::RigSpec;
use palpate_control::{MotionProfile, Strategy, TOUCH_MOST_N, safe_speed_mm_s};
use palpate_data::recipe::Entry;

/// Time of a press beyond its travel, dwell and window, s, on a stage that answers in some 12 ms. It covers the look without load,
/// the approach, the steps and the retraction.
fn press_s(strategy: Strategy) -> f64 {
    match strategy {
        Strategy::Guarded => 1.1,
        Strategy::Velocity => 1.6,
        Strategy::Map => 0.55,
    }
}

/// Time of a press without a load cell beyond its travel, its way down, dwell and window, s: two readings without load, and three motions
/// that are read back. z moves down from this height above the surface, mm.
const UNFORCED_S: f64 = 0.9;
const UNFORCED_ABOVE_MM: f64 = 0.2;

/// Time of each further level of a staircase beyond its dwell and window, s.
const LEVEL_S: f64 = 0.4;

/// Time of a look at the force between two steps of the first descent, s, and the rig's reaction delay during that time, s.
const LOOK_S: f64 = 0.1;
const REACTION_S: f64 = 0.05;

/// Assumed way of a ramp by force, mm.
const RAMP_MM: f64 = 1.0;

/// Motions of a press on a stage that finishes each motion, and conversions of the load cell that it waits for between them: counted on
/// printers with 10 and 80 conversions per second, and an arm.
const MOTIONS: f64 = 8.0;
const CONVERSIONS: f64 = 78.0;

/// Returns what a press takes longer on a stage that finishes each motion, s.
fn finishing_s(spec: &RigSpec) -> f64 {
    let abilities = spec.stage.driver.abilities();
    match abilities.finishes() && spec.has_load_cell() {
        true => MOTIONS * abilities.late_s + CONVERSIONS / spec.load_cell.conversions_hz,
        false => 0.0,
    }
}

/// Returns data on the first descent from home to the surface of the frame: the minimum number of steps, and the duration, s.
pub fn first_descent(spec: &RigSpec) -> (f64, f64) {
    let (way_mm, limits) = (-spec.top_mm(), spec.limits);
    let steps = (way_mm * limits.stiffness_n_mm / limits.force_n).ceil().max(1.0);
    let lag_s = spec.stage.settle_s + spec.load_cell.lag_s;
    let fastest =
        safe_speed_mm_s(TOUCH_MOST_N, limits.stiffness_n_mm, REACTION_S + lag_s, spec.stage.acceleration_mm_s2);
    let speed_mm_s = fastest.min(spec.stage.approach_mm_s).min(spec.stage.speed_mm_s);
    (steps, way_mm / speed_mm_s + steps * LOOK_S)
}

/// Time of a press without a load cell beyond its travel, dwell and window, s.
fn unforced_s(entry: &Entry, spec: &RigSpec) -> f64 {
    UNFORCED_S + (entry.task.most_mm() + UNFORCED_ABOVE_MM) / spec.stage.approach_mm_s
}

/// Estimates the duration of some entries of a plan on a rig that is ready, s. The error is about a third.
pub fn estimated_s(entries: &[Entry], spec: &RigSpec) -> f64 {
    let mut total_s = 0.0;
    let mut place = spec.frame.origin;
    for entry in entries {
        let way_mm = (entry.place.x_mm - place.x_mm).abs().max((entry.place.y_mm - place.y_mm).abs());
        let levels = entry.task.levels.len() as f64;
        let dragged_s = entry.task.drag().map_or(0.0, |drag| {
            drag.way_mm() / drag.speed_mm_s.min(spec.stage.speed_mm_s) + LEVEL_S + entry.task.sample_s
        });
        total_s += MotionProfile::new(way_mm, spec.stage.speed_mm_s, spec.stage.acceleration_mm_s2).duration_s()
            + if spec.has_load_cell() { press_s(entry.task.strategy) } else { unforced_s(entry, spec) }
            + finishing_s(spec)
            + LEVEL_S * (levels - 1.0)
            + levels * (entry.task.hold_s + entry.task.sample_s)
            + entry.task.followed_s()
            + entry.task.ramps_mm_s().iter().map(|speed_mm_s| 2.0 * RAMP_MM / speed_mm_s).sum::<f64>()
            + dragged_s
            + entry.rest_after_s;
        place = entry.place;
    }
    total_s
}
