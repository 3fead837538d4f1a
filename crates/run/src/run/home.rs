//! Homing of the stage before there is a zero: identify it, confirm the direction of z, home it, move z to the top. The cell is
//! read all the time.

use super::causes::DRIFT_LOOK_S;
use super::motion::watched;
use super::no_load_outputs::NoLoadOutputs;
use super::retraction::unless_it_rises;
use super::rig_control::{AnyRigControl, RigControl};
use super::watched_cell::{OnDoubt, WatchedLoadCell};
use super::{Cancel, Halt};
use crate::rig::{Home, HomeSide, OpenRig, RigSpec};
use palpate_control::{MotionContext, Permit, Reaction, SafetyRule, Steer, Trip, Watch, Zero, safe_speed_mm_s};
use palpate_core::quantity::{Axis, seconds};
use palpate_link::device::{
    AxisWay, DeviceError, HomeSearch, Identity, Instruments, LoadCell, MotionOrders, SensorArray, Stage, StageUse,
};
use palpate_link::time::{Instant, sleep, timeout};
use std::cell::Cell;
use std::time::Duration;
use tokio::sync::Notify;

/// Least number of readings before anything moves, and least time for them, s.
const STILL_READINGS: usize = 20;
const STILL_S: f64 = 0.1;

/// Number of the cell's readings that are timed before the stage moves.
const TIMED: usize = 5;

/// Assumed time of an exchange with the stage before any is timed, s. An ESP301 takes up to 80 ms.
const STAGE_EXCHANGE_S: f64 = 0.1;

/// Fraction of the force limit that homing into an obstacle may use up, because the indenter may already be in contact.
const HOMING_SHARE: f64 = 0.5;

/// Slowest search for home, mm/s. With a specimen too stiff to stop in time, a safe search would take hours.
const HOMING_LEAST_MM_S: f64 = 0.5;

/// Distance that z moves to show its direction to the operator, mm.
const NUDGE_MM: f64 = 1.0;

/// Reason why z isn't retracted by a stage that would search for home toward the specimen first.
const NO_RETRACTION: &str = "this stage doesn't know its position, and homes z toward the specimen (`home_side`): nothing was moved. \
                             Bring z away from the specimen by hand";

/// Fall of the force, in sd of a reading, that shows that a contact ends.
const FALLEN_SIGMAS: f64 = 3.0;

/// Time between two looks at whether a stop was requested.
const STOP_LOOK: Duration = Duration::from_millis(20);

/// Longest time to see whether a stage that was stopped rests.
const SEEN_DEADLINE: Duration = Duration::from_secs(4);

/// Longest wait for a stage that was stopped during homing, and for the stop to be sent again.
const STOPPED_DEADLINE: Duration = Duration::from_secs(2);

/// Rig whose stage is home, with z at the top. If the stage or the load cell can't be used, nothing moves, because the force
/// couldn't be read.
pub(super) struct AtHome<'a> {
    pub rig_control: AnyRigControl<'a>,
    pub stage: Result<Identity, DeviceError>,
    pub load_cell: Result<Identity, DeviceError>,
    pub array: Result<Identity, DeviceError>,
}

/// Identifies all devices, brings the stage to rest, homes the axes that aren't homed (z first, away) and moves z to the top. Cell
/// and array are read during the motions.
pub(super) async fn at_home<'a>(
    rig: OpenRig,
    spec: &RigSpec,
    cancel: &'a Cancel,
    shown: &'a dyn Fn(f64),
) -> Result<AtHome<'a>, Halt> {
    let mut rig_control = rig_control_of(rig, spec, cancel, shown);
    let load_cell = unless_stopped(cancel, rig_control.cell.cell.prepare()).await?;
    let reaction = if load_cell.is_ok() { Some(rig_control.set_home_speed(spec).await?) } else { None };
    let stage = unless_stopped(cancel, rig_control.stage.identify(&rig_control.usage)).await?;
    let array = unless_stopped(cancel, rig_control.array.prepare()).await?;
    rig_control.array_answers = array.is_ok();
    let stage = match (stage, &reaction) {
        (Ok(identity), Some(reaction)) => match rig_control.come_home(spec, &identity, reaction).await {
            Ok(()) => Ok(identity),
            Err(Unmoved::Stage(error)) => Err(error),
            Err(Unmoved::Halted(Halt::Tripped(trip))) => {
                return Err(rig_control.cell.real_cause(trip).await.into());
            }
            Err(Unmoved::Halted(halt)) => return Err(halt),
        },
        (stage, _) => stage,
    };
    Ok(AtHome { rig_control, stage, load_cell, array })
}

/// Does the same on a rig without a load cell: z goes to its end away from the specimen before anything else. Nothing is read while it
/// moves, because every motion is one away from the specimen, or of x and y with z at that end.
pub(super) async fn at_home_without_cell<'a>(
    rig: OpenRig,
    spec: &RigSpec,
    cancel: &'a Cancel,
    shown: &'a dyn Fn(f64),
) -> Result<(AnyRigControl<'a>, Vec<Identity>), Halt> {
    let mut rig_control = rig_control_of(rig, spec, cancel, shown);
    let stage = unless_stopped(cancel, rig_control.stage.identify(&rig_control.usage)).await??;
    let array = unless_stopped(cancel, rig_control.array.prepare()).await??;
    rig_control.usage.home_speed_mm_s = HOMING_LEAST_MM_S.min(spec.stage.speed_mm_s);
    rig_control.confirm_zero(spec, &stage).await?;
    rig_control.confirm_away(spec, &stage, ReadingMode::Unread).await?;
    let is_alone =
        rig_control.moves(ReadingMode::Unread, async |stage, usage, orders| stage.home_z(usage, orders).await).await?;
    if is_alone {
        rig_control.retract(spec.top_mm()).await?;
    }
    rig_control.home_all(ReadingMode::Unread).await?;
    rig_control.find_itself().await?;
    rig_control.retract(spec.top_mm()).await?;
    Ok((rig_control, vec![stage, array]))
}

fn rig_control_of<'a>(rig: OpenRig, spec: &RigSpec, cancel: &'a Cancel, shown: &'a dyn Fn(f64)) -> AnyRigControl<'a> {
    let OpenRig { instruments, stage_use, truth, claims, .. } = rig;
    let Instruments { stage, load_cell, array } = instruments;
    let watched_cell = WatchedLoadCell::new(load_cell, Watch::new(&spec.limits, Zero::with_noise(0.0)), cancel, shown);
    let parts = Instruments { stage, load_cell: watched_cell, array };
    RigControl::new(parts, spec.frame, stage_use, spec.unmeasured_timing(), truth, claims)
}

/// Moves z away from the specimen and does nothing else. The load cell is read if it answers. A stage that can't move before
/// homing is homed.
///
/// # Errors
/// The stage doesn't work, the direction of z isn't confirmed, or the force rises.
pub async fn retract(spec: &RigSpec, seed: u64, cancel: &Cancel) -> Result<Retracted, Halt> {
    let mut rig_control = rig_control_of(spec.open(seed)?, spec, cancel, &|_| {});
    let load_cell = unless_stopped(cancel, rig_control.cell.cell.prepare()).await?;
    let identity = unless_stopped(cancel, rig_control.stage.identify(&rig_control.usage)).await??;
    if let Some(which_way) = spec.which_way().filter(|way| !way.is_known(&identity, spec.frame.down)) {
        which_way.announce(&identity, NUDGE_MM, HomeSearch::Away).map_err(Halt::Unconfirmed)?;
    }
    if spec.stage.home_side == HomeSide::Toward {
        if !rig_control.stage.is_homed().await? {
            return Err(Halt::Unconfirmed(NO_RETRACTION.to_owned()));
        }
        rig_control.usage.home_search = HomeSearch::Never;
    }
    rig_control.usage.home_speed_mm_s = HOMING_LEAST_MM_S.min(spec.stage.speed_mm_s);
    if load_cell.is_ok() {
        // a cell that doesn't answer doesn't delay the rest
        let _ = rig_control.set_home_speed(spec).await;
        let _ = rig_control.watch_from_rest(spec).await;
    }
    let reading = ReadingMode::IfItAnswers;
    let z = spec.stage.travel.along(Axis::Z);
    let by_hand = spec.stage.home == Home::ByHand;
    // without switches nothing stops z at the end of its travel
    let way_mm = if by_hand { spec.limits.depth_mm - spec.clear_mm() } else { z.max - z.min };
    let mut nudges = 0;
    while f64::from(nudges) * NUDGE_MM < way_mm && rig_control.nudge_away(reading).await? {
        nudges += 1;
    }
    if nudges == 0 && !by_hand {
        rig_control.home_all(reading).await?;
        let top_mm = spec.frame.to_stage(rig_control.place, spec.top_mm()).z_mm;
        rig_control
            .moves(reading, async |stage, usage, orders| {
                let longest = seconds((z.max - z.min) / usage.home_speed_mm_s);
                let at_mm = stage.position_mm(Axis::Z, orders).await?;
                if (top_mm - at_mm) * usage.away > 0.0 {
                    stage.begin(&[AxisWay::between(Axis::Z, at_mm, top_mm)], usage.home_speed_mm_s, orders).await?;
                    stage.follow(&[Axis::Z], longest, orders).await?;
                }
                Ok(())
            })
            .await?;
    }
    let z_mm = rig_control.stage.position_mm(Axis::Z, &MotionOrders::default()).await?;
    Ok(Retracted { z_mm, load_cell: load_cell.err().map(|error| error.to_string()) })
}

/// Reason why the stage didn't move as ordered.
enum Unmoved {
    /// The stage reported an error.
    Stage(DeviceError),
    /// Anything else prevented it.
    Halted(Halt),
}

impl From<Halt> for Unmoved {
    fn from(halt: Halt) -> Self {
        Unmoved::Halted(halt)
    }
}

impl From<Unmoved> for Halt {
    fn from(unmoved: Unmoved) -> Self {
        match unmoved {
            Unmoved::Stage(error) => error.into(),
            Unmoved::Halted(halt) => halt,
        }
    }
}

/// Way in which the load cell is read while the stage moves.
#[derive(Clone, Copy, Debug)]
enum ReadingMode {
    /// Every reading passes the watch. A cell that falls silent stops the stage.
    Watched,
    /// A rise of the force stops the stage. A cell that doesn't answer doesn't stop it.
    IfItAnswers,
    /// There is no load cell.
    Unread,
}

/// Result of the retraction of z.
#[derive(Clone, Debug)]
pub struct Retracted {
    /// Position of z in stage coordinates, mm.
    pub z_mm: f64,
    /// Reason why the load cell wasn't read on the way; `None` if it was read.
    pub load_cell: Option<String>,
}

/// Returns the device's description of itself. If the operator requests a stop, it doesn't wait for a device that hangs, and
/// sends no more questions.
pub(super) async fn unless_stopped(
    cancel: &Cancel,
    identified: impl Future<Output = Result<Identity, DeviceError>>,
) -> Result<Result<Identity, DeviceError>, Halt> {
    tokio::select! {
        biased;
        identified = identified => Ok(identified),
        () = cancel.wait() => Err(Halt::Cancelled),
    }
}

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Times the load cell and sets the speed of the search for home. At this speed, a search that runs into the declared
    /// specimen stops within the force limit.
    async fn set_home_speed(&mut self, spec: &RigSpec) -> Result<Reaction, Halt> {
        let mut load_cell_s = 0.0f64;
        for _ in 0..TIMED {
            let asked = Instant::now();
            self.cell.cell.read().await?;
            load_cell_s = load_cell_s.max(asked.elapsed().as_secs_f64());
        }
        let (conversion_s, lag_s) = (self.cell.cell.conversion().as_secs_f64(), spec.load_cell.lag_s);
        let reaction = Reaction { conversion_s, load_cell_s, stage_s: STAGE_EXCHANGE_S, lag_s };
        let (limits, acceleration_mm_s2) = (&spec.limits, spec.stage.acceleration_mm_s2);
        let room_n = HOMING_SHARE * limits.force_n - Watch::rise_n(limits, spec.air_n(), acceleration_mm_s2);
        let safe_mm_s = safe_speed_mm_s(room_n, limits.stiffness_n_mm, reaction.worst_s(), acceleration_mm_s2);
        self.usage.home_speed_mm_s = safe_mm_s.max(HOMING_LEAST_MM_S).min(spec.stage.speed_mm_s);
        Ok(reaction)
    }

    /// Homes the stage and moves z to the top.
    async fn come_home(&mut self, spec: &RigSpec, identity: &Identity, reaction: &Reaction) -> Result<(), Unmoved> {
        self.confirm_zero(spec, identity).await?;
        self.confirm_clear(spec, identity).await?;
        self.watch_from_rest(spec).await?;
        self.confirm_away(spec, identity, ReadingMode::Watched).await?;
        // x and y are homed once nothing touches
        let is_alone =
            self.moves(ReadingMode::Watched, async |stage, usage, orders| stage.home_z(usage, orders).await).await?;
        if is_alone {
            self.come_to_the_top(spec, reaction).await?;
        }
        self.home_all(ReadingMode::Watched).await?;
        match is_alone {
            true => self.find_itself().await?,
            false => self.come_to_the_top(spec, reaction).await?,
        }
        Ok(())
    }

    async fn home_all(&mut self, reading: ReadingMode) -> Result<(), Unmoved> {
        self.moves(reading, async |stage, usage, orders| stage.home(usage, orders).await).await?;
        self.usage.steps.noise_mm = self.stage.position_noise_mm();
        Ok(())
    }

    /// Moves z slightly away from the specimen. Returns whether z moved.
    async fn nudge_away(&mut self, reading: ReadingMode) -> Result<bool, Unmoved> {
        self.moves(reading, async |stage, usage, orders| stage.nudge_away(NUDGE_MM, usage, orders).await).await
    }

    /// Starts the watch: from now on the force mustn't rise above its present value at rest, and the outputs mustn't leave their
    /// noise.
    async fn watch_from_rest(&mut self, spec: &RigSpec) -> Result<(), Halt> {
        let RigControl { cell, array, array_answers, .. } = self;
        let outputs =
            async { if *array_answers { NoLoadOutputs::read(array, &spec.array).await.map(Some) } else { Ok(None) } };
        let (still, outputs) = tokio::join!(at_rest(cell), outputs);
        let (still, at_s) = still?;
        self.unzeroed = outputs?;
        self.cell.watch = Watch::before_zero(&spec.limits, still, spec.air_n(), spec.stage.acceleration_mm_s2);
        self.cell.believe(spec, at_s);
        Ok(())
    }

    /// Asks the operator to confirm the position of a stage without switches.
    async fn confirm_zero(&mut self, spec: &RigSpec, identity: &Identity) -> Result<(), Unmoved> {
        let Some(person) = spec.which_way().filter(|_| spec.stage.home == Home::ByHand) else { return Ok(()) };
        let mut at_mm = [0.0; 3];
        for axis in Axis::ALL {
            let position = self.stage.position_mm(axis, &MotionOrders::default()).await;
            at_mm[axis.index()] = position.map_err(Unmoved::Stage)?;
        }
        let cancel = self.cell.cancel;
        let confirmed = person.confirm_zero(identity, at_mm, &|| cancel.asked());
        cancel.check()?;
        Ok(confirmed.map_err(Halt::Unconfirmed)?)
    }

    /// Asks the operator to confirm that z may search for home on the specimen's side. A stage that knows its home doesn't search.
    async fn confirm_clear(&mut self, spec: &RigSpec, identity: &Identity) -> Result<(), Unmoved> {
        if spec.stage.home_side == HomeSide::Away {
            return Ok(());
        }
        self.usage.home_search = HomeSearch::Never;
        let Some(person) = spec.which_way() else { return Ok(()) };
        if self.stage.is_homed().await.map_err(Unmoved::Stage)? {
            return Ok(());
        }
        let cancel = self.cell.cancel;
        let confirmed = person.confirm_clear(identity, &|| cancel.asked());
        cancel.check()?;
        confirmed.map_err(Halt::Unconfirmed)?;
        self.usage.home_search = HomeSearch::Toward;
        Ok(())
    }

    /// Asks the operator to put back what was in the way of a search for home. Only then is the reading without load taken.
    async fn confirm_back(&mut self, spec: &RigSpec) -> Result<(), Halt> {
        let Some(person) = spec.which_way().filter(|_| self.usage.home_search == HomeSearch::Toward) else {
            return Ok(());
        };
        let cancel = self.cell.cancel;
        let confirmed = person.confirm_back(&|| cancel.asked());
        cancel.check()?;
        confirmed.map_err(Halt::Unconfirmed)?;
        self.watch_from_rest(spec).await
    }

    /// Asks the operator to confirm that z moves away from the specimen, when this stage is first moved along z in this
    /// direction. No measurement without load shows the direction.
    async fn confirm_away(&mut self, spec: &RigSpec, identity: &Identity, reading: ReadingMode) -> Result<(), Unmoved> {
        let down = spec.frame.down;
        let Some(which_way) = spec.which_way().filter(|way| !way.is_known(identity, down)) else { return Ok(()) };
        which_way.announce(identity, NUDGE_MM, self.usage.home_search).map_err(Halt::Unconfirmed)?;
        self.cell.watch.pause();
        if !self.nudge_away(reading).await? {
            // an axis that can't move a little before homing is watched while it homes
            self.home_all(reading).await?;
            if spec.stage.home_side == HomeSide::Toward {
                self.find_itself().await?;
                self.retract_slowly((self.z_mm - NUDGE_MM).max(spec.end_mm())).await?;
            }
        }
        let cancel = self.cell.cancel;
        let confirmed = which_way.confirm(identity, down, &|| cancel.asked());
        cancel.check()?;
        confirmed.map_err(Halt::Unconfirmed)?;
        self.cell.watch.pause();
        Ok(())
    }

    /// Moves the stage while cell and array are read. Some time after a stop was requested it leaves the stage alone, in any state.
    async fn moves<T>(
        &mut self,
        reading: ReadingMode,
        motion: impl AsyncFnOnce(&mut S, &StageUse, &MotionOrders) -> Result<T, DeviceError>,
    ) -> Result<T, Unmoved> {
        let (orders, cancel) = (MotionOrders::default(), self.cell.cancel);
        let asked_to_stop = async {
            tokio::select! {
                biased;
                () = cancel.wait() => orders.stop(),
                () = until_stopped(&orders) => {}
            }
            sleep(STOPPED_DEADLINE).await;
        };
        let RigControl { stage, cell, usage, array, unzeroed, .. } = self;
        let due = Cell::new(None); // its duration isn't known
        let (over, falls, speed_mm_s) = (Notify::new(), Cell::new(false), usage.home_speed_mm_s);
        // x and y home at their own speed, away from everything
        cell.moves(usage.speed_mm_s, OnDoubt::Continue);
        let motion = Box::pin(async {
            let moved = motion(stage, usage, &orders).await;
            over.notify_one();
            Ok(moved)
        });
        let motion = async {
            match reading {
                ReadingMode::Watched => {
                    let fallen_n = -FALLEN_SIGMAS * cell.watch.zero().sigma_n;
                    let steer = |watched_cell: &mut WatchedLoadCell<'_, C>, force_n: f64| {
                        falls.set(watched_cell.watch.mean_n().unwrap_or(force_n) < fallen_n);
                        Steer::On
                    };
                    let outputs = async {
                        match unzeroed {
                            Some(outputs) => outputs.watch(array, speed_mm_s, &falls, &over, &orders).await,
                            None => Ok(()),
                        }
                    };
                    let (moved, felt) = tokio::join!(watched(cell, motion, &orders, &due, steer), outputs);
                    felt.and(moved)
                }
                ReadingMode::IfItAnswers => unless_it_rises(cell, motion, &orders, speed_mm_s).await,
                ReadingMode::Unread => motion.await,
            }
        };
        let moved = tokio::select! {
            biased;
            moved = motion => Some(moved),
            () = asked_to_stop => None,
        };
        match moved {
            Some(moved) => {
                if cancel.asked() || matches!(moved, Err(Halt::Tripped(_))) {
                    self.must_rest().await?;
                }
                cancel.check()?;
                moved?.map_err(Unmoved::Stage)
            }
            None => {
                // it may not follow its orders yet, so its result can't be known
                let _ = timeout(STOPPED_DEADLINE, self.stage.stop()).await;
                self.must_rest().await?;
                cancel.check()?;
                let stopped_s = STOPPED_DEADLINE.as_secs_f64();
                Err(Halt::from(Trip::new(SafetyRule::StageSilent, stopped_s, stopped_s, "s")).into())
            }
        }
    }

    /// Stops a stage that was stopped already, and reads its positions back until they rest.
    ///
    /// # Errors
    /// The stage moves on. A stage that doesn't answer is another error's.
    async fn must_rest(&mut self) -> Result<(), Halt> {
        match timeout(SEEN_DEADLINE, self.stop_or_abort()).await {
            Ok(Err(Halt::Tripped(trip))) => Err(trip.into()),
            _ => Ok(()),
        }
    }

    /// Moves z to the top if z is deeper, and checks that the cell is without load there. Its reading must stay the same slightly
    /// farther away, or slightly nearer if z can't go farther.
    async fn come_to_the_top(&mut self, spec: &RigSpec, reaction: &Reaction) -> Result<(), Halt> {
        self.find_itself().await?;
        let top_mm = spec.top_mm();
        if self.z_mm > top_mm {
            // an axis that was homed before may be anywhere, and the place of the specimen hasn't been measured
            self.retract_slowly(top_mm).await?;
        }
        self.confirm_back(spec).await?;
        let (here, taken) = (at_rest(&mut self.cell).await?.0, Instant::now());
        let permit = Permit::new(spec.limits, self.usage.bounds(), reaction.worst_s(), &here);
        let (from_mm, way_mm, speed_mm_s) = (self.z_mm, permit.sounding_mm(), self.usage.home_speed_mm_s);
        let toward = |from_mm, to_mm| {
            let sigma_n = here.offset_sigma_n;
            let sensor_state = MotionContext {
                z_mm: from_mm,
                force_n: 0.0,
                sigma_n,
                age_s: 0.0,
                first_mm: from_mm,
                most_mm: f64::INFINITY,
            };
            permit.advance(&sensor_state, to_mm, speed_mm_s)
        };
        let is_farther = from_mm - way_mm >= spec.end_mm();
        let there = match is_farther {
            true => permit.retract(from_mm, from_mm - way_mm, speed_mm_s)?,
            false => toward(from_mm, from_mm + way_mm)?,
        };
        self.cell.watch.pause();
        self.move_z(there, None).await?;
        self.cell.settle().await?;
        let (there, _) = at_rest(&mut self.cell).await?;
        let sigma_n = here.offset_sigma_n.hypot(there.offset_sigma_n);
        let (moved_n, between_s) = (there.offset_n - here.offset_n, taken.elapsed().as_secs_f64());
        if let Err(trip) = permit.nothing_in_contact(moved_n, sigma_n, between_s) {
            // a fast drift moves it too, and is seen at rest
            let (Zero { drift, .. }, _) = self.cell.still(DRIFT_LOOK_S).await.ok_or(trip)?;
            let sigma_n = sigma_n.hypot(drift.sigma_n_s * between_s);
            permit.nothing_in_contact(moved_n - drift.rate_n_s * between_s, sigma_n, between_s)?;
        }
        let back = match is_farther {
            true => toward(self.z_mm, from_mm)?,
            false => permit.retract(self.z_mm, self.within_mm(from_mm, spec.end_mm()), speed_mm_s)?,
        };
        self.cell.watch.pause();
        self.move_z(back, None).await
    }

    /// Returns the end of z's travel for a place up to a step beyond it: an axis whose steps don't divide its travel rests there, but can't be
    /// sent there.
    fn within_mm(&self, z_mm: f64, end_mm: f64) -> f64 {
        if z_mm < end_mm && end_mm - z_mm <= self.usage.steps.along(Axis::Z) { end_mm } else { z_mm }
    }
}

/// Waits until a stop is requested.
async fn until_stopped(orders: &MotionOrders) {
    while !orders.stopped() {
        sleep(STOP_LOOK).await;
    }
}

/// Returns the cell's reading while the stage is at rest, and its time, s.
async fn at_rest<C: LoadCell>(watched_cell: &mut WatchedLoadCell<'_, C>) -> Result<(Zero, f64), Halt> {
    let readings = watched_cell.sound_readings(STILL_READINGS, STILL_S).await?;
    let at_s = readings.last().map_or(0.0, |reading| reading.at_s);
    Ok((Zero::of(&readings, watched_cell.cell.conversion().as_secs_f64()), at_s))
}
