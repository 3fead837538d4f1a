//! Shortest possible time of a press, limited by the stage's acceleration, the distance to the next place and the window.

use palpate_run::rig::RigSpec;

/// Additional time of a motion compared with its trapezoid, because its jerk is limited, s.
const JERK_S: f64 = 0.005;
/// Time from the end of a motion until the stage is at rest, s.
const SETTLE_S: f64 = 0.008;
/// Clearance above the surface from which x and y may move, mm.
const CLEAR_MM: f64 = 0.030;

/// Returns the shortest time from one press to the next, s, as the study of the loop computes it. z rises from `depth_mm`, turns
/// above the surface and moves down to the same depth without a pause. x and y move by `way_mm` while z is clear of the surface.
///
/// Each of the two motions of z is a triangle over depth d and clearance c, and takes `2 sqrt((d + c) / a)` and its jerk time.
/// Then the stage settles and the window is sampled: `4 sqrt((d + c) / a) + 2 jerk + settle + window`. The clearance c is chosen
/// so that z is above 30 um exactly as long as x and y need. The deceleration into the contact and the controller's answers take
/// no time here, so no strategy reaches this bound.
pub fn least_s(depth_mm: f64, way_mm: f64, acceleration_mm_s2: f64, window_s: f64) -> f64 {
    let a = acceleration_mm_s2;
    let sideways_s = 2.0 * (way_mm / a).sqrt() + JERK_S;
    // both motions of z lose their jerk's time where they meet, at the turn
    let clear_s = (sideways_s - 2.0 * JERK_S).max(0.0);
    let way_mm = turning_way_mm(depth_mm, clear_s, a).max(depth_mm + CLEAR_MM);
    4.0 * (way_mm / a).sqrt() + 2.0 * JERK_S + SETTLE_S + window_s
}

/// Returns the same time for a rig that presses places `way_mm` apart with a force.
pub(crate) fn least_on_s(spec: &RigSpec, force_n: f64, way_mm: f64, window_s: f64) -> f64 {
    least_s(spec.scene.contact.depth_mm(force_n), way_mm, spec.stage.acceleration_mm_s2, window_s)
}

/// Sum of depth and clearance, mm, for which z spends `clear_s` above the least clearance on its way up and down.
fn turning_way_mm(depth_mm: f64, clear_s: f64, a: f64) -> f64 {
    // where z already brakes when it gets clear, it falls back as it rose
    let braking_mm = CLEAR_MM + a * clear_s * clear_s / 8.0 + depth_mm;
    if braking_mm / 2.0 <= depth_mm + CLEAR_MM {
        return braking_mm;
    }
    // else it is clear from while it still accelerates: sqrt(2 (d + 30 um) / a) of 2 sqrt(D / a) are lost either way
    let lost_s = (2.0 * (depth_mm + CLEAR_MM) / a).sqrt();
    a * ((clear_s / 2.0 + lost_s) / 2.0).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bound_equals_the_table_of_the_study() {
        for (depth_mm, study_s) in [(0.090, 0.349), (0.429, 0.452), (0.815, 0.534), (1.500, 0.650)] {
            let ours_s = least_s(depth_mm, 0.5, 100.0, 0.1);
            assert!((ours_s / study_s - 1.0).abs() < 0.015, "{depth_mm} mm: {ours_s} s, study {study_s} s");
        }
    }

    #[test]
    fn z_is_clear_for_just_as_long_as_x_and_y_need_it() {
        for (depth_mm, clear_s) in [(0.01, 0.136), (0.09, 0.136), (0.8, 0.136), (1.5, 0.05)] {
            let a = 100.0;
            let way_mm = turning_way_mm(depth_mm, clear_s, a);
            let triangle = palpate_control::MotionProfile::new(way_mm, 1e3, a);
            let above_s = 2.0 * (triangle.duration_s() - triangle.reaches_s(depth_mm + CLEAR_MM));
            assert!((above_s - clear_s).abs() < 1e-9, "{depth_mm} mm: {above_s} s");
        }
    }
}
