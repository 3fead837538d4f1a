//! The press on stiff specimens, where one step of the stage is a force.

use super::*;
use crate::press::state::Rested;
use crate::trip::SafetyRule;
use palpate_core::quantity::FINEST_STEP_MM;

/// Stiffness of a specimen, N/mm.
const STIFFNESSES: [f64; 7] = [1.0, 5.0, 20.0, 50.0, 100.0, 200.0, 500.0];

/// Places of the surface between two steps of the stage, mm.
const SURFACES: usize = 20;

/// Force limit, and forces of the presses, N.
const LIMIT_N: f64 = 2.0;
const FORCES_N: [f64; 6] = [0.1, 0.25, 0.5, 0.85, 1.3, 1.9];

/// Distance below the force at which a press may end on a stage without steps, N: four sd of a mean of four readings, and a tenth of the tolerance.
const LET_OFF_N: f64 = 0.011;

/// A bench whose stage has the smallest step, over a specimen as stiff as declared.
fn stiff(stiffness_n_mm: f64, force_n: f64, surface_mm: f64) -> PressBench {
    PressBench {
        limits: Limits { force_n: LIMIT_N, depth_mm: 3.0, stiffness_n_mm },
        map: ContactMap::new(0.02),
        step_mm: FINEST_STEP_MM,
        ..bench(PressTask::press(force_n), surface_mm)
    }
}

/// Makes presses of each force at each stiffness, on a specimen of this curve: its force by stiffness and depth.
fn press_each(force_at: impl Fn(f64, f64) -> f64, check: impl Fn(f64, f64, f64, PressScript)) {
    for stiffness_n_mm in STIFFNESSES {
        for force_n in FORCES_N {
            for nth in 0..SURFACES {
                let surface_mm = FINEST_STEP_MM * nth as f64 / SURFACES as f64;
                let (_, execute) =
                    stiff(stiffness_n_mm, force_n, surface_mm).execute(|mm| force_at(stiffness_n_mm, mm));
                check(stiffness_n_mm, force_n, force_at(stiffness_n_mm, execute.deepest_mm - surface_mm), execute);
            }
        }
    }
}

#[test]
fn a_press_is_complete_at_each_stiffness_and_ends_within_a_step() {
    press_each(
        |n_mm, depth_mm| n_mm * depth_mm.max(0.0),
        |n_mm, force_n, most_n, execute| {
            assert_eq!(execute.end, LoopCommand::Done, "{n_mm} N/mm, {force_n} N");
            let (step_n, at_n) = (n_mm * FINEST_STEP_MM, execute.forces[0]);
            assert!(most_n <= force_n + step_n, "{n_mm} N/mm: {most_n} N over {force_n} N");
            // nothing is nearer than half a step, of which the rounding of a target takes as much; soft ones are let off
            assert!(at_n >= force_n - step_n - LET_OFF_N, "{n_mm} N/mm: {at_n} N of {force_n} N");
        },
    );
}

/// A round tip: the force grows with the square of the depth until the stiffness is the declared one.
#[test]
fn a_tip_that_becomes_full_late_exceeds_the_force_by_at_most_a_step() {
    const TOE_MM: f64 = 0.01;
    let toe_n = |n_mm: f64, mm: f64| {
        let mm = mm.max(0.0);
        n_mm * if mm < TOE_MM { mm * mm / (2.0 * TOE_MM) } else { mm - TOE_MM / 2.0 }
    };
    press_each(toe_n, |n_mm, force_n, most_n, execute| {
        assert_eq!(execute.end, LoopCommand::Done, "{n_mm} N/mm, {force_n} N");
        assert!(most_n <= force_n + n_mm * FINEST_STEP_MM, "{n_mm} N/mm: {most_n} N over {force_n} N");
    });
}

#[test]
fn a_stage_that_creeps_on_after_each_motion_trips_at_each_stiffness() {
    for stiffness_n_mm in STIFFNESSES {
        // 0.2 N/s, in a mean of the window ten times what its noise explains
        let creeping = PressBench { creep_mm_s: 0.2 / stiffness_n_mm, ..stiff(stiffness_n_mm, 1.0, 0.0) };
        let (_, execute) = creeping.execute(|depth_mm| stiffness_n_mm * depth_mm.max(0.0));
        let rises = matches!(&execute.end, LoopCommand::Trip(trip) if trip.rule == SafetyRule::RisesAtRest);
        assert!(rises, "{stiffness_n_mm} N/mm: {:?}", execute.end);
    }
}

/// One step away from a light contact on steel takes most of its force, which is no fall.
#[test]
fn unloading_by_one_step_is_no_fall() {
    const STEEL_N_MM: f64 = 500.0;
    let level = |force_n, branch| PressLevel { set: SetPoint::Force(force_n), branch };
    let levels: Arc<[PressLevel]> = [level(0.07, Branch::Loading), level(0.03, Branch::Unloading)].into();
    for nth in 0..SURFACES {
        let surface_mm = FINEST_STEP_MM * nth as f64 / SURFACES as f64;
        let unloading = PressBench { levels: levels.clone(), ..stiff(STEEL_N_MM, 0.1, surface_mm) };
        let (_, execute) = unloading.execute(|depth_mm| STEEL_N_MM * depth_mm.max(0.0));
        assert_eq!(execute.end, LoopCommand::Done, "{surface_mm} mm");
    }
}

/// What a rest has shown says nothing of another place.
#[test]
fn every_motion_ends_a_rest() {
    let mut press = stiff(500.0, 1.0, 0.0).press();
    let rested = Rested { force_n: 1.0, sigma_n: 0.001, now_s: 0.0, is_long: true };
    press.moment.age_s = 0.0;
    for target_mm in [press.z_mm + FINEST_STEP_MM, press.z_mm - FINEST_STEP_MM] {
        press.rested = Some(rested);
        let moved = if target_mm > press.z_mm { press.grant(target_mm, 0.1) } else { press.retract_to(target_mm) };
        assert!(moved.is_ok() && press.rested.is_none(), "{target_mm} mm");
    }
}

#[test]
fn a_gap_of_half_a_step_is_closed_by_a_step_and_a_smaller_one_is_left() {
    let press = stiff(500.0, 1.0, 0.0).press();
    assert_eq!(press.way_mm(0.49 * FINEST_STEP_MM), None);
    assert_eq!(press.way_mm(0.51 * FINEST_STEP_MM), Some(FINEST_STEP_MM));
    assert_eq!(press.way_mm(2.3 * FINEST_STEP_MM), Some(2.3 * FINEST_STEP_MM));
}

/// A stage rounds its targets: the end of a motion is within the limit wherever the nearest step is.
#[test]
fn a_force_equal_to_the_limit_is_not_exceeded_by_the_rounding_of_a_target() {
    for stiffness_n_mm in STIFFNESSES {
        for nth in 0..SURFACES {
            let surface_mm = FINEST_STEP_MM * nth as f64 / SURFACES as f64;
            let (_, execute) =
                stiff(stiffness_n_mm, LIMIT_N, surface_mm).execute(|depth_mm| stiffness_n_mm * depth_mm.max(0.0));
            let most_n = stiffness_n_mm * (execute.deepest_mm - surface_mm);
            assert!(most_n <= LIMIT_N, "{stiffness_n_mm} N/mm: {most_n} N, {:?}", execute.end);
            assert_eq!(execute.end, LoopCommand::Done, "{stiffness_n_mm} N/mm");
        }
    }
}
