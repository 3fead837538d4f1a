//! Prepares a rig: moves the stage to the clear, homes it, measures the time of the links, and measures the zero.

use super::clock::RunClock;
use super::findings::Finding;
use super::home::{AtHome, at_home};
use super::rig_control::AnyRigControl;
use super::{Cancel, Halt};
use crate::rig::{OpenRig, RigSpec};
use palpate_control::{Reaction, SafetyRule, ShownRate, Timing, Trip, Zero};
use palpate_core::quantity::{Axis, ForceReading, Range};
use palpate_data::dataset::Record;
use palpate_link::device::{Identity, LoadCell, MotionOrders, Stage};
use palpate_link::time::Instant;
use std::time::Duration;

/// Number of exchanges that are timed to measure the rig's reaction time.
const TIMED: usize = 10;
/// Least number of readings without load for the zero, and least time for them, s.
const ZERO_READINGS: usize = 100;
const ZERO_S: f64 = 0.5;
/// Largest noise of one reading, as a fraction of the force limit. With more noise, contact can't be detected in time.
pub const NOISE_SHARE: f64 = 0.02;
/// Longest time that is read to know the rate of a zero.
const DRIFT_READ_MOST: Duration = Duration::from_secs(10);
/// Largest distance of the zero from the run's first zero, as a fraction of the force limit.
const DRIFT_SHARE: f64 = 0.2;

/// Rig whose instruments are identified, homed, at clearance height, timed and zeroed.
pub(super) struct Ready<'a> {
    pub rig_control: AnyRigControl<'a>,
    pub devices: Vec<Identity>,
    pub reaction: Reaction,
    pub zero: Record,
}

/// Conditions for preparing a rig, in addition to the rig itself.
pub(super) struct Conditions<'a> {
    pub spec: &'a RigSpec,
    pub cancel: &'a Cancel,
    pub shown: &'a dyn Fn(f64),
    pub clock: RunClock,
    /// Load cell's zero when the run began, N, if this run continues an earlier one.
    pub first_zero_n: Option<f64>,
}

/// Identifies each device, homes the axes that aren't homed (z first, away), goes to clearance height, times the links and takes
/// the zero.
pub(super) async fn make_ready<'a>(rig: OpenRig, conditions: &Conditions<'a>) -> Result<Ready<'a>, Halt> {
    conditions.spec.load_cell.check_gain()?;
    conditions.cancel.preparing();
    let AtHome { mut rig_control, stage, load_cell, array } =
        at_home(rig, conditions.spec, conditions.cancel, conditions.shown).await?;
    let (stage_identity, cell_identity) = (stage?, load_cell?);
    let array_identity = array?;
    let reaction = time(&mut rig_control, conditions.spec.load_cell.lag_s).await?;
    rig_control.timing = Timing { exchange_s: reaction.stage_s, reaction_s: reaction.worst_s(), ..rig_control.timing };
    let mut readings = without_load(&mut rig_control).await?;
    let conversion_s = rig_control.cell.cell.conversion().as_secs_f64();
    // coarse steps may hide that the cell is slower than declared
    while ShownRate::of(&readings, conversion_s) == ShownRate::Unclear {
        readings.extend(rig_control.cell.sound_readings(ZERO_READINGS, ZERO_S).await?);
    }
    if let Some(finding) = Finding::of_rate(&readings, conditions.spec) {
        // the loop would count on forces that are older than it knows
        return Err(finding.error().into());
    }
    let zero = zero_of(&readings, &mut rig_control, conditions).await?;
    if let Some(first_n) = conditions.first_zero_n {
        let offset_n = rig_control.cell.watch.zero().offset_n;
        let (drift_n, most_n) = (offset_n - first_n, DRIFT_SHARE * conditions.spec.limits.force_n);
        if drift_n.abs() > most_n {
            return Err(Trip::new(SafetyRule::ZeroDrifted, drift_n, most_n, "N").into());
        }
    }
    conditions.cancel.prepared();
    Ok(Ready { rig_control, devices: vec![stage_identity, cell_identity, array_identity], reaction, zero })
}

async fn time(rig_control: &mut AnyRigControl<'_>, lag_s: f64) -> Result<Reaction, Halt> {
    let (mut stage_s, mut load_cell_s) = (0.0f64, 0.0f64);
    for _ in 0..TIMED {
        let asked = Instant::now();
        rig_control.stage.position_mm(Axis::Z, &MotionOrders::default()).await?;
        stage_s = stage_s.max(asked.elapsed().as_secs_f64());
        let asked = Instant::now();
        rig_control.cell.cell.read().await?;
        load_cell_s = load_cell_s.max(asked.elapsed().as_secs_f64());
    }
    Ok(Reaction { conversion_s: rig_control.cell.cell.conversion().as_secs_f64(), load_cell_s, stage_s, lag_s })
}

/// Takes the zero, without load.
pub(super) async fn take_zero(
    rig_control: &mut AnyRigControl<'_>,
    conditions: &Conditions<'_>,
) -> Result<Record, Halt> {
    let readings = without_load(rig_control).await?;
    zero_of(&readings, rig_control, conditions).await
}

/// Reads without load: as long as the zero needs, and longer if it drifts at a rate that isn't known well yet.
async fn without_load(rig_control: &mut AnyRigControl<'_>) -> Result<Vec<ForceReading>, Halt> {
    let began = Instant::now();
    let mut readings = rig_control.cell.sound_readings(ZERO_READINGS, ZERO_S).await?;
    while rig_control.cell.line(&readings).is_vague() && began.elapsed() < DRIFT_READ_MOST {
        readings.extend(rig_control.cell.sound_readings(ZERO_READINGS, ZERO_S).await?);
    }
    Ok(readings)
}

async fn zero_of(
    readings: &[ForceReading],
    rig_control: &mut AnyRigControl<'_>,
    conditions: &Conditions<'_>,
) -> Result<Record, Halt> {
    let zero = Zero::of(readings, rig_control.cell.cell.conversion().as_secs_f64());
    let most_n = NOISE_SHARE * conditions.spec.limits.force_n;
    if zero.sigma_n > most_n {
        return Err(Trip::new(SafetyRule::Noisy, zero.sigma_n, most_n, "N").into());
    }
    zero.drift.passes(conditions.spec.limits.force_n)?;
    check_no_load(&zero, conditions.spec).map_err(|trip| rig_control.cell.since_first_zero(trip, &zero))?;
    rig_control.cell.zero(&conditions.spec.limits, zero, readings);
    rig_control.begin_no_load();
    let outputs = rig_control.end_no_load().await?.outputs;
    rig_control.no_load.clone_from(&outputs);
    let t_s = conditions.clock.now_s();
    Ok(Record::Zero { t_s, offset_n: zero.offset_n, sigma_n: zero.sigma_n, mains: zero.mains, outputs })
}

/// Checks whether the cell may have this zero without load.
pub(super) fn check_no_load(zero: &Zero, spec: &RigSpec) -> Result<(), Trip> {
    let Range { min, max } = spec.air_n();
    let outside = |bound_n| Err(Trip::new(SafetyRule::ZeroOutside, zero.offset_n, bound_n, "N"));
    match zero.offset_n {
        offset_n if offset_n > max => outside(max),
        offset_n if offset_n < min => outside(min),
        _ => Ok(()),
    }
}
