//! The way out: stops the stage, sees that it rests, and retracts from the specimen, whether the load cell can be trusted or not.

use super::Halt;
use super::last_resort::{unless_given_up, unless_it_presses_on};
use super::rig_control::RigControl;
use super::watched_cell::WatchedLoadCell;
use palpate_control::{MotionProfile, SafetyRule, Timing, Trip, check_sound, safe_speed_mm_s};
use palpate_core::quantity::{Axis, ForceReading, Limits, Steps, seconds};
use palpate_link::device::{AxisWay, DeviceError, DeviceProblem, LoadCell, MotionOrders, SensorArray, Stage};
use palpate_link::time::{Instant, sleep, timeout};
use std::time::Duration;
use tokio::sync::Notify;

/// Number of attempts for a retraction. An unreliable link mostly answers the second time, and a guard left by an earlier program
/// triggers once. A third attempt costs only seconds.
const RETRACT_TRIES: usize = 3;

/// Longest end of a run that was halted, beyond the motion under way and the way up.
const END_DEADLINE: Duration = Duration::from_secs(5);
/// Slowest way out, mm/s: a stiffer specimen isn't left any slower.
const LEAVES_LEAST_MM_S: f64 = 1.0;
/// Longest wait for the last stop of a stage that couldn't be parked.
const LAST_STOP_DEADLINE: Duration = Duration::from_secs(1);

/// Number of successive readings that must show a rise of the force before the rise stops a retraction.
const RISE_READINGS: usize = 5;
/// Longest wait for the reading in progress at the end of a retraction.
pub(super) const LAST_READING_DEADLINE: Duration = Duration::from_millis(250);

/// Times after which a stage is asked again that answered with a complaint.
const COMPLAINT_PAUSES: [Duration; 5] =
    [Duration::ZERO, Duration::from_millis(500), Duration::from_secs(2), Duration::from_secs(5), Duration::ZERO];

/// Time between two read-backs of a stage that was stopped, and the longest wait until two of them agree.
const REST_LOOK: Duration = Duration::from_millis(50);
const REST_DEADLINE: Duration = Duration::from_secs(2);

/// First piece of the way out of a contact, mm, and how much longer each next one is: the first adds little if it goes the wrong way.
const FIRST_PIECE_MM: f64 = 0.05;
const NEXT_PIECE: f64 = 2.0;
/// Number of pieces: together they are longer than any contact is deep.
const PIECES_MAX: usize = 8;
/// Number of readings of the force between two pieces, and the part of it that must be gone for the way to lead out.
const PIECE_READINGS: usize = 5;
const PIECE_SHARE: f64 = 0.02;
/// Way from the point at which a contact ended, mm, if the place of the stage is lost.
const FREED_MM: f64 = 1.0;

/// Number of rises against which a retraction continues while position and outputs show that z moves away.
const RISES_MAX: usize = 50;
/// Fraction of the outputs' change against air that must remain at most for the outputs to have fallen.
const FALLEN_SHARE: f64 = 0.98;
/// Change of the outputs against air that shows a contact, in sd of one reading.
const SHOWN_SIGMAS: f64 = 8.0;
/// Retract against a rise that is allowed once where the array shows nothing, mm.
const SPARE_MM: f64 = 0.5;

/// Longest wait for the array on the way out.
const ARRAY_DEADLINE: Duration = Duration::from_millis(500);

/// Wait before the remaining force is read: a specimen that rose may still be rising.
const LEFT_AFTER: Duration = Duration::from_secs(1);
/// Number of readings of the force that remains, and least force that is reported, N.
const LEFT_READINGS: usize = 20;
const LEFT_LEAST_N: f64 = 0.05;

/// What the instruments show of the specimen after the way out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Remaining {
    /// The load cell reads air.
    Nothing,
    /// This force is left on the specimen, N.
    Force(f64),
    /// The load cell is in doubt, or has no zero: the force can't be known.
    Unknown,
    /// There is no load cell.
    NoLoadCell,
}

/// Largest force that was read in a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LargestForce {
    /// The force, N from the zero.
    pub force_n: f64,
    /// Whether the load cell was at the end of its range, so that the force was at least this.
    pub is_least: bool,
    /// What the declared stiffness gives at the depth where z was stopped, N, if z was deeper than the force shows.
    pub by_depth_n: Option<f64>,
}

impl LargestForce {
    /// Returns a sentence about the force.
    pub fn text(&self) -> String {
        let force_n = self.force_n;
        match (self.is_least, self.by_depth_n) {
            (false, _) => format!("the largest force was {force_n:.2} N"),
            (true, None) => format!("the largest force was at least {force_n:.2} N, the end of the load cell's range"),
            (true, Some(by_depth_n)) => format!(
                "the largest force was at least {force_n:.2} N, the end of the load cell's range; by the depth at the stop and the declared \
                 stiffness up to {by_depth_n:.2} N"
            ),
        }
    }
}

impl Remaining {
    /// Returns a sentence about the force; `None` if there is none.
    pub fn text(&self) -> Option<String> {
        match self {
            Remaining::Nothing => None,
            Remaining::Force(force_n) => Some(format!("{force_n:.2} N remain on the specimen")),
            Remaining::Unknown => Some("the remaining force can't be known from the load cell".to_owned()),
            Remaining::NoLoadCell => Some("there is no load cell, so the remaining force isn't known".to_owned()),
        }
    }
}

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Parks the stage at the end of a run. After a halt this takes no longer than the motion under way, the way up at the rig's speed and
    /// [`END_DEADLINE`]. After a trip or a failure, the specimen may have risen, and z may move the wrong way: the stage is stopped and read
    /// back until it rests, and goes no faster than a rise of the force can stop it within the limit.
    ///
    /// # Errors
    /// The stage isn't parked.
    pub(super) async fn leave(&mut self, halt: Option<&Halt>, z_mm: f64, limits: &Limits) -> Result<(), Halt> {
        let Some(halt) = halt else { return self.retract_from(z_mm, true).await };
        let way = |speed_mm_s: f64| seconds(self.usage.travel.along(Axis::Z).width() / speed_mm_s);
        let out_mm_s = if halt.is_fault() { self.risen_mm_s(limits) } else { f64::INFINITY };
        let out_mm_s = out_mm_s.min(self.usage.speed_mm_s);
        let most = END_DEADLINE + way(self.usage.speed_mm_s) + way(out_mm_s);
        self.usage.speed_mm_s = out_mm_s;
        let halted = self.cell.halted.map_or(Duration::ZERO, |halted| halted.elapsed());
        let leaving = async {
            if halt.is_fault() {
                match self.stop_or_abort().await {
                    // a controller that restarts didn't hear the question: the way out asks again
                    Err(Halt::Device(DeviceError { problem: DeviceProblem::Link(_), .. })) => {}
                    seen => self.note_depth(halt, seen?, limits),
                }
            }
            // maybe in contact: the way out depends on no place
            self.retract_from(z_mm, true).await
        };
        if let Ok(left) = timeout(most.saturating_sub(halted), leaving).await {
            return left;
        }
        let _ = timeout(LAST_STOP_DEADLINE, self.stage.stop()).await;
        let text =
            format!("it isn't parked after {:.0} s: press the emergency stop, and free the tip", most.as_secs_f64());
        let (device, doing) = ("stage".to_owned(), "parking it".to_owned());
        Err(DeviceError { device, doing, problem: DeviceProblem::Motion(text) }.into())
    }

    /// Returns the speed at which a rise of the force stops z within the limit, mm/s.
    fn risen_mm_s(&self, limits: &Limits) -> f64 {
        let Timing { reaction_s, conversion_s, exchange_s, acceleration_mm_s2, .. } = self.timing;
        let reaction_s = reaction_s + RISE_READINGS as f64 * (conversion_s + exchange_s);
        let room_n = limits.force_n - self.cell.watch.rise_most_n();
        safe_speed_mm_s(room_n, limits.stiffness_n_mm, reaction_s, acceleration_mm_s2).max(LEAVES_LEAST_MM_S)
    }

    /// Stops all axes and retracts to the clear, whether the load cell answers or not. It is used to park, and also at the very
    /// start, because an earlier program may have left the axes in contact.
    pub(super) async fn retract(&mut self, z_mm: f64) -> Result<(), Halt> {
        self.retract_from(z_mm, false).await
    }

    async fn retract_from(&mut self, z_mm: f64, may_press: bool) -> Result<(), Halt> {
        let mut retracted = Ok(());
        for _ in 0..RETRACT_TRIES {
            retracted = self.stop_and_retract(z_mm, may_press).await;
            // a direction in which the force rose isn't tried again
            if matches!(retracted, Ok(()) | Err(Halt::Tripped(_))) {
                break;
            }
        }
        retracted
    }

    /// Notes what the depth says of the force, where a trip stopped z. A place that isn't known says nothing.
    fn note_depth(&mut self, halt: &Halt, rest_mm: Option<[f64; 3]>, limits: &Limits) {
        if let (Halt::Tripped(_), Some(rest_mm)) = (halt, rest_mm) {
            let depth_mm = self.frame.z_from_stage(rest_mm[Axis::Z.index()]) + self.frame.uncertainty_mm;
            self.by_depth_n = Some(limits.stiffness_n_mm * depth_mm);
        }
    }

    /// Stops all axes and sees that they rest. If the force continues to rise beyond the limit meanwhile, the stage takes its last resort.
    /// Returns where they rest, unless the stage complained of a lost place before.
    pub(super) async fn stop_or_abort(&mut self) -> Result<Option<[f64; 3]>, Halt> {
        let RigControl { stage, cell, usage, .. } = self;
        if !cell.presses_on
            && let Some(seen) = unless_it_presses_on(cell, stop_and_see(stage, &usage.steps)).await
        {
            return seen;
        }
        self.abort().await?;
        stop_and_see(&mut self.stage, &self.usage.steps).await
    }

    async fn abort(&mut self) -> Result<(), Halt> {
        self.cell.presses_on = false;
        Ok(self.stage.abort().await?)
    }

    /// Returns the largest force that was read; `None` if nothing was pressed.
    pub(super) fn largest(&self) -> Option<LargestForce> {
        let (reading_n, is_least) = self.cell.cell.largest.reading?;
        let force_n = reading_n - self.cell.watch.zero().at_n(self.cell.cell.largest.at_s);
        let by_depth_n = self.by_depth_n.filter(|by_depth_n| *by_depth_n > force_n);
        (force_n >= LEFT_LEAST_N).then_some(LargestForce { force_n, is_least, by_depth_n })
    }

    /// Returns the force that is left on the specimen. After this halt, the load cell may be in doubt.
    pub(super) async fn remaining(&mut self, halt: Option<&Halt>) -> Remaining {
        let is_doubtful = match halt {
            Some(Halt::Tripped(trip)) => trip.rule.doubts_load_cell(),
            Some(Halt::Device(error)) => matches!(error.device.as_str(), "load cell" | "load_cell"),
            _ => false,
        };
        if is_doubtful {
            return Remaining::Unknown;
        }
        sleep(LEFT_AFTER + seconds(self.timing.settle_s)).await;
        let mut sum_n = 0.0;
        for _ in 0..LEFT_READINGS {
            sleep(self.cell.cell.conversion()).await;
            match self.cell.cell.read().await {
                Ok(reading) if check_sound(&reading).is_ok() => sum_n += self.cell.watch.zero().from_zero_n(&reading),
                _ => return Remaining::Unknown,
            }
        }
        let force_n = sum_n / LEFT_READINGS as f64;
        if force_n.abs() < LEFT_LEAST_N { Remaining::Nothing } else { Remaining::Force(force_n) }
    }

    /// Stops the stage and retracts z. An axis that still brakes takes no target, so it is at rest before it is sent away. A
    /// repetition is safe, because the position is asked each time and the target is the same position at clearance height.
    async fn stop_and_retract(&mut self, z_mm: f64, may_press: bool) -> Result<(), Halt> {
        let RigControl { stage, cell, .. } = self;
        let stopping = async {
            stage.stop().await?;
            // retract at any force, even if the controller's guard can't be cleared
            let _ = stage.guard(None).await;
            stage.follow(&Axis::ALL, Duration::ZERO, &MotionOrders::default()).await.map(drop)
        };
        let stopped = if may_press { unless_it_presses_on(cell, stopping).await } else { Some(stopping.await) };
        match stopped {
            Some(stopped) => stopped?,
            None => self.abort().await?,
        }
        self.retract_at_any_force(z_mm, may_press).await
    }

    /// Retracts at any force, whether or not the load cell answers. It is used for parking, when the load cell may have failed.
    ///
    /// A force that rises stops the motion, because z may move the wrong way. It continues if z was read back going deeper, which was
    /// somebody else, or going away while the outputs fall: then the load cell shows an old rise. Where the array shows nothing, z goes a short distance farther and stops.
    async fn retract_at_any_force(&mut self, z_mm: f64, may_press: bool) -> Result<(), Halt> {
        let is_freed = may_press && self.free_the_tip().await?;
        self.see_z().await?;
        if is_freed && self.z_mm <= z_mm {
            // the place is lost: it counts above the specimen where the tip pressed
            return self.retract_against_rises(self.z_mm - FREED_MM).await;
        }
        self.retract_against_rises(z_mm).await
    }

    /// Reads z back. A printer answers at the end of a motion, of anybody's: if the force continues to rise beyond the limit meanwhile, the stage
    /// takes its last resort.
    async fn see_z(&mut self) -> Result<(), Halt> {
        let (RigControl { stage, cell, .. }, orders) = (&mut *self, MotionOrders::default());
        let at_mm = match unless_it_presses_on(cell, stage.position_mm(Axis::Z, &orders)).await {
            Some(at_mm) => at_mm?,
            None => {
                self.abort().await?;
                self.stage.position_mm(Axis::Z, &orders).await?
            }
        };
        self.z_mm = self.frame.z_from_stage(at_mm);
        Ok(())
    }

    async fn retract_against_rises(&mut self, z_mm: f64) -> Result<(), Halt> {
        let mut felt = self.felt().await;
        for _ in 0..RISES_MAX {
            if self.z_mm <= z_mm {
                return Ok(());
            }
            let from_mm = self.z_mm;
            let Err(halt) = self.retract_once(z_mm, true).await else { return Ok(()) };
            if !matches!(&halt, Halt::Tripped(trip) if trip.rule == SafetyRule::ForceRose) {
                return Err(halt);
            }
            self.stop_or_abort().await?;
            self.see_z().await?;
            let most_mm = self.usage.steps.in_position_mm(Axis::Z);
            let (is_away, is_deeper) = (from_mm - self.z_mm > most_mm, self.z_mm - from_mm > most_mm);
            let now = self.felt().await;
            match (felt, now) {
                // somebody else moved it, and the force agrees with its count
                _ if is_deeper => {}
                (Some(before), Some(now)) if is_away && now < FALLEN_SHARE * before => {}
                (None, None) if is_away => {
                    self.retract_once((self.z_mm - SPARE_MM).max(z_mm), false).await?;
                    self.stage.stop().await?;
                    return Err(halt);
                }
                _ => return Err(halt),
            }
            felt = now;
        }
        self.retract_once(z_mm, true).await
    }

    /// Moves z away from the specimen in pieces, as long as the load cell shows a contact and the force falls. Returns whether a contact
    /// ended. The pieces depend on no place, because a stage that restarted has lost its own.
    async fn free_the_tip(&mut self) -> Result<bool, Halt> {
        let Some(mut before_n) = self.cell.at_rest_n().await.filter(|force_n| *force_n > LEFT_LEAST_N) else {
            return Ok(false);
        };
        let mut piece_mm = FIRST_PIECE_MM;
        for _ in 0..PIECES_MAX {
            self.see_z().await?;
            match self.retract_against_rises(self.z_mm - piece_mm).await {
                // z is read back before each piece, so its end needn't be exact
                Err(Halt::Device(DeviceError { problem: DeviceProblem::Coarse(_), .. })) => {}
                retracted => retracted?,
            }
            let Some(now_n) = self.cell.at_rest_n().await else { return Ok(false) };
            if now_n < LEFT_LEAST_N {
                return Ok(true);
            }
            if now_n > (1.0 - PIECE_SHARE) * before_n {
                return Ok(false); // a reading that has nothing to do with the way
            }
            (before_n, piece_mm) = (now_n, NEXT_PIECE * piece_mm);
        }
        Ok(false)
    }

    async fn retract_once(&mut self, z_mm: f64, is_watched: bool) -> Result<(), Halt> {
        let (target_mm, from_mm) = (self.stage_z_mm(z_mm), self.stage_z_mm(self.z_mm));
        let speed_mm_s = self.usage.speed_mm_s;
        let way = AxisWay::between(Axis::Z, from_mm, target_mm);
        let profile = MotionProfile::new(way.by_mm, speed_mm_s, self.usage.acceleration_mm_s2);
        let orders = MotionOrders::default();
        let RigControl { stage, cell, .. } = self;
        let motion = async {
            stage.begin(&[way], speed_mm_s, &orders).await?;
            Ok(stage.follow(&[Axis::Z], seconds(profile.duration_s()), &orders).await?)
        };
        let places_mm =
            if is_watched { unless_it_rises(cell, motion, &orders, speed_mm_s).await? } else { motion.await? };
        sleep(seconds(self.timing.settle_s)).await;
        self.arrived_z(places_mm.first().copied(), target_mm).await
    }

    /// Returns how far the outputs are from those without load, in sd of one reading; `None` if they show no contact, or aren't known. An
    /// array that didn't answer isn't asked again: it would delay the way out.
    async fn felt(&mut self) -> Option<f64> {
        let mut now = vec![0.0; self.array.units()];
        self.array_answers =
            self.array_answers && matches!(timeout(ARRAY_DEADLINE, self.array.read(&mut now)).await, Ok(Ok(())));
        if !self.array_answers {
            return None;
        }
        let sigma = self.output_sigma();
        let change =
            now.iter().zip(&self.no_load).map(|(now, no_load)| (now - no_load).powi(2)).sum::<f64>().sqrt() / sigma;
        (change.is_finite() && change > SHOWN_SIGMAS * (now.len() as f64).sqrt()).then_some(change)
    }
}

/// Stops all axes and reads their positions back until they rest. Returns these, mm, unless the stage complained before.
///
/// A stage that answers with a complaint is asked again: a lost place is stated once, and a controller that restarts takes its time.
///
/// # Errors
/// The stage moves on, or doesn't answer.
async fn stop_and_see<S: Stage>(stage: &mut S, steps: &Steps) -> Result<Option<[f64; 3]>, Halt> {
    let (mut pauses, mut complained) = (COMPLAINT_PAUSES.into_iter(), false);
    loop {
        let seen = async {
            stage.stop().await?;
            rests(stage, steps).await
        };
        match (seen.await, pauses.next()) {
            (Err(Halt::Device(error)), Some(pause)) if !matches!(error.problem, DeviceProblem::Link(_)) => {
                complained = true;
                sleep(pause).await;
            }
            (seen, _) => return seen.map(|rest_mm| Some(rest_mm).filter(|_| !complained)),
        }
    }
}

/// Reads the positions of all axes back until they rest, and returns them, mm.
async fn rests<S: Stage>(stage: &mut S, steps: &Steps) -> Result<[f64; 3], Halt> {
    let until = Instant::now() + REST_DEADLINE;
    let mut before = positions(stage).await?;
    loop {
        sleep(REST_LOOK).await;
        let now = positions(stage).await?;
        // two read-backs of a stage at rest differ by no more than a motion from its target
        let moved =
            Axis::ALL.map(|axis| ((now[axis.index()] - before[axis.index()]).abs(), steps.in_position_mm(axis)));
        let Some((moved_mm, most_mm)) = moved.into_iter().find(|(moved_mm, most_mm)| moved_mm > most_mm) else {
            return Ok(now);
        };
        if Instant::now() > until {
            return Err(Trip::new(SafetyRule::NotStopped, moved_mm, most_mm, "mm").into());
        }
        before = now;
    }
}

async fn positions<S: Stage>(stage: &mut S) -> Result<[f64; 3], Halt> {
    let mut at_mm = [0.0; 3];
    for axis in Axis::ALL {
        at_mm[axis.index()] = stage.position_mm(axis, &MotionOrders::default()).await?;
    }
    Ok(at_mm)
}

/// Runs a motion away from the specimen until it ends or the force rises. A cell that doesn't answer doesn't delay the motion.
pub(super) async fn unless_it_rises<C: LoadCell, T>(
    watched_cell: &mut WatchedLoadCell<'_, C>,
    motion: impl Future<Output = Result<T, Halt>>,
    orders: &MotionOrders,
    speed_mm_s: f64,
) -> Result<T, Halt> {
    let (over, given_up) = (Notify::new(), Notify::new());
    let motion = then_notify(unless_given_up(motion, &given_up), &over);
    let watch = async {
        let risen = watched_cell.rises(&over, speed_mm_s).await;
        if risen.is_err() {
            orders.stop();
            if watched_cell.rises_beyond(&over).await {
                given_up.notify_one();
            }
        }
        risen
    };
    let (moved, risen) = tokio::join!(motion, watch);
    risen?;
    moved.unwrap_or(Err(Halt::Cancelled)) // given up only where the force rose
}

/// Awaits a motion, and notifies that it is over.
pub(super) async fn then_notify<T>(motion: impl Future<Output = T>, over: &Notify) -> T {
    let moved = motion.await;
    over.notify_one();
    moved
}

impl<C: LoadCell> WatchedLoadCell<'_, C> {
    /// Returns the force of some readings at rest, N from the zero; `None` if the cell doesn't answer.
    async fn at_rest_n(&mut self) -> Option<f64> {
        let mut sum_n = 0.0;
        for _ in 0..PIECE_READINGS {
            sleep(self.cell.conversion()).await;
            let reading = timeout(LAST_READING_DEADLINE, self.cell.read()).await.ok()?.ok();
            let reading = reading.filter(|reading| check_sound(reading).is_ok())?;
            sum_n += self.watch.zero().from_zero_n(&reading);
        }
        Some(sum_n / PIECE_READINGS as f64)
    }

    /// Reads until a retraction is over, or the force rises above its lowest value and above zero, because z then moves the wrong way. A cell
    /// that reads pushes as pulls rises to zero on the way out, and a count that turned around jumps once. A cell that doesn't answer or gives no
    /// number doesn't stop the retraction.
    async fn rises(&mut self, over: &Notify, speed_mm_s: f64) -> Result<(), Trip> {
        let most_n = self.watch.rise_most_n();
        let (mut last, mut lowest_n) = ([f64::NEG_INFINITY; RISE_READINGS], f64::INFINITY);
        let (mut before, mut jumped_n) = (None::<ForceReading>, None);
        while let Some(read) = self.reading_until(over).await {
            let Some(read) = read.ok().filter(|read| check_sound(read).is_ok()) else { continue };
            if let (Some(before), Some(believed), None) = (&before, &self.believed, jumped_n)
                && believed.jumps(before, &read, speed_mm_s, self.watch.zero())
            {
                jumped_n = Some(read.force_n - before.force_n);
            }
            before = Some(read);
            last.rotate_left(1);
            let force_n = self.watch.zero().from_zero_n(&read) - jumped_n.unwrap_or(0.0);
            last[RISE_READINGS - 1] = force_n;
            lowest_n = lowest_n.min(force_n);
            // all of the last readings: a single spike doesn't stop the retraction
            let rise_n = last.iter().copied().fold(f64::INFINITY, f64::min) - lowest_n.max(0.0);
            if rise_n > most_n {
                return Err(Trip::new(SafetyRule::ForceRose, rise_n, most_n, "N"));
            }
        }
        Ok(())
    }
}
