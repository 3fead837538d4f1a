//! Makes a rig ready: the stage clear and homed, links timed, the zero taken.

use super::clock::RunClock;
use super::hand::{Gauge, Hand};
use super::{Cancel, Halt};
use crate::control::{Reaction, Rule, Timing, Trip, Watch, Zero};
use crate::dataset::Record;
use crate::device::{DeviceError, Identity, Instruments, LoadCell, Reins, SensorArray, Stage};
use crate::quantity::Axis;
use crate::rig::{OpenRig, RigSpec};
use std::time::Duration;
use tokio::time::{Instant, sleep, timeout};

/// Exchanges that are timed to know how fast the rig reacts.
const TIMED: usize = 10;
/// Readings in air that make the zero, at least, and how long they take, at least, s.
const ZERO_READINGS: usize = 100;
const ZERO_S: f64 = 0.5;
/// Largest noise of one reading, as a share of the force limit: beyond it contact can't be told in time.
pub const NOISE_SHARE: f64 = 0.02;
/// Longest wait for a stage that was told to stop while it is prepared, and for the stop to be sent once more.
const STOPPED_DEADLINE: Duration = Duration::from_secs(2);
/// How far the zero may be from the first one of the run, as a share of the force limit.
const DRIFT_SHARE: f64 = 0.2;

/// A rig whose instruments are identified, homed, in the clear, timed and zeroed.
pub(super) struct Ready<'a, S, C, A> {
    pub hand: Hand<'a, S, C, A>,
    pub devices: Vec<Identity>,
    pub reaction: Reaction,
    pub zero: Record,
}

/// What a rig is made ready with, besides itself.
pub(super) struct Conditions<'a> {
    pub spec: &'a RigSpec,
    pub cancel: &'a Cancel,
    pub shown: &'a dyn Fn(f64),
    pub clock: RunClock,
    /// The load cell's zero when the run began, N, in a run that goes on.
    pub first_zero_n: Option<f64>,
}

/// Identifies each device, homes what isn't homed (z first, away), goes to the clear, times the links and takes the zero.
pub(super) async fn make_ready<'a>(
    rig: OpenRig,
    conditions: &Conditions<'a>,
) -> Result<Ready<'a, impl Stage + use<>, impl LoadCell + use<>, impl SensorArray + use<>>, Halt> {
    conditions.spec.load_cell.check_gain()?;
    conditions.cancel.preparing();
    let (mut hand, stage) = at_home(rig, conditions.spec, conditions.cancel, conditions.shown).await?;
    let stage_identity = stage?;
    let cell_identity = unless_stopped(conditions.cancel, hand.cell.cell.prepare()).await??;
    let array_identity = unless_stopped(conditions.cancel, hand.array.prepare()).await??;
    let reaction = time(&mut hand, conditions.spec.load_cell.lag_s).await?;
    hand.timing = Timing { exchange_s: reaction.stage_s, reaction_s: reaction.worst_s(), ..hand.timing };
    let zero = take_zero(&mut hand, conditions).await?;
    conditions.cancel.prepared();
    Ok(Ready { hand, devices: vec![stage_identity, cell_identity, array_identity], reaction, zero })
}

/// Brings the stage to rest, homes what isn't homed and goes to the clear, before any reader is asked: whatever they say, the
/// stage is away from the specimen. A stage that can't be prepared is handed over as it is, with the reason.
pub(super) async fn at_home<'a>(
    rig: OpenRig,
    spec: &RigSpec,
    cancel: &'a Cancel,
    shown: &'a dyn Fn(f64),
) -> Result<
    (Hand<'a, impl Stage + use<>, impl LoadCell + use<>, impl SensorArray + use<>>, Result<Identity, DeviceError>),
    Halt,
> {
    let OpenRig { instruments, stage_use, probe, claims } = rig;
    let Instruments { mut stage, load_cell, array } = instruments;
    let reins = Reins::default();
    let told_to_stop = async {
        cancel.wait().await;
        reins.stop();
        sleep(STOPPED_DEADLINE).await;
    };
    let prepared = tokio::select! {
        biased;
        prepared = stage.prepare(&stage_use, &reins) => prepared,
        () = told_to_stop => {
            // it may not have come to where it heeds the reins; what becomes of this one can't be told any more
            let _ = timeout(STOPPED_DEADLINE, stage.stop()).await;
            return Err(Halt::Cancelled);
        }
    };
    cancel.check()?;
    let zero = Zero::with_noise(0.0);
    let gauge = Gauge::new(load_cell, Watch::new(&spec.limits, zero), cancel, shown);
    let parts = Instruments { stage, load_cell: gauge, array };
    let mut hand = Hand::new(parts, spec.frame, stage_use, spec.unmeasured_timing(), probe, claims);
    if prepared.is_ok() {
        // an axis that was homed before may stand anywhere, and where the specimen is hasn't been measured
        hand.withdraw(spec.top_mm()).await?;
        hand.find_itself().await?;
    }
    Ok((hand, prepared))
}

/// What a reader says when it is prepared. One that hangs isn't waited for when a person says stop: nothing more is asked of it.
pub(super) async fn unless_stopped(
    cancel: &Cancel,
    prepared: impl Future<Output = Result<Identity, DeviceError>>,
) -> Result<Result<Identity, DeviceError>, Halt> {
    tokio::select! {
        biased;
        prepared = prepared => Ok(prepared),
        () = cancel.wait() => Err(Halt::Cancelled),
    }
}

async fn time<S: Stage, C: LoadCell, A: SensorArray>(
    hand: &mut Hand<'_, S, C, A>,
    lag_s: f64,
) -> Result<Reaction, Halt> {
    let (mut stage_s, mut load_cell_s) = (0.0f64, 0.0f64);
    for _ in 0..TIMED {
        let asked = Instant::now();
        hand.stage.position_mm(Axis::Z, &Reins::default()).await?;
        stage_s = stage_s.max(asked.elapsed().as_secs_f64());
        let asked = Instant::now();
        hand.cell.cell.read().await?;
        load_cell_s = load_cell_s.max(asked.elapsed().as_secs_f64());
    }
    Ok(Reaction { conversion_s: hand.cell.cell.conversion().as_secs_f64(), load_cell_s, stage_s, lag_s })
}

/// The zero, in air.
pub(super) async fn take_zero<S: Stage, C: LoadCell, A: SensorArray>(
    hand: &mut Hand<'_, S, C, A>,
    conditions: &Conditions<'_>,
) -> Result<Record, Halt> {
    let readings = hand.cell.sound_readings(ZERO_READINGS, ZERO_S).await?;
    let zero = Zero::of(&readings, hand.cell.cell.conversion().as_secs_f64());
    let most_n = NOISE_SHARE * conditions.spec.limits.force_n;
    if zero.sigma_n > most_n {
        return Err(Trip::new(Rule::Noisy, zero.sigma_n, most_n, "N").into());
    }
    if let Some(first_n) = conditions.first_zero_n {
        let (drift_n, most_n) = (zero.offset_n - first_n, DRIFT_SHARE * conditions.spec.limits.force_n);
        if drift_n.abs() > most_n {
            return Err(Trip::new(Rule::ZeroDrifted, drift_n, most_n, "N").into());
        }
    }
    hand.cell.watch = Watch::new(&conditions.spec.limits, zero);
    hand.open_air();
    let outputs = hand.close_air().await?.outputs;
    hand.air.clone_from(&outputs);
    let t_s = conditions.clock.now_s();
    Ok(Record::Zero { t_s, offset_n: zero.offset_n, sigma_n: zero.sigma_n, hum: zero.hum, outputs })
}
