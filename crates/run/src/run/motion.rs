//! Motions during which the force is read.

use super::Halt;
use super::last_resort::unless_given_up;
use super::retraction::then_notify;
use super::rig_control::{OUTPUTS_ON_THE_WAY, RigControl};
use super::watched_cell::{OnDoubt, WatchedLoadCell};
use super::window::OutputMeans;
use palpate_control::{ForceLoop, MotionProfile, Permit, Permitted, SafetyRule, Sideways, Steer, Trip};
use palpate_core::quantity::{Axis, Place, Range, seconds};
use palpate_link::device::{AxisWay, DeviceError, DeviceProblem, LoadCell, MotionOrders, SensorArray, Stage};
use palpate_link::time::{Instant, sleep, sleep_until, timeout};
use std::cell::Cell;
use std::pin::pin;
use std::time::Duration;
use tokio::sync::Notify;

/// Largest distance from the target, mm, without an error, that a stage with coarser steps than stated explains. At a larger
/// distance something blocks the axis.
const COARSE_MM: f64 = 0.05;

/// Number of readings averaged before x and y move from rest. Nothing moves sideways in contact.
const SIDEWAYS_READINGS: u32 = 2;

/// Longest duration of a sideways motion that can't be stopped, s.
const PIECE_S: f64 = 0.5;

/// Distance of a target from the end of z's travel at which a way out leads to this end, mm.
const TO_END_MM: f64 = 0.1;

/// Number of times that one motion is stopped because readings are doubted. Then it continues to its end, which is safe, and so many glitches end
/// the run.
const DOUBTS_MOST: u32 = 20;

/// Part of its expected duration by which a motion may be late. A controller on a busy computer is.
pub(super) const LATE_SHARE: f64 = 0.1;

/// Longest wait for the stage after a halt, beyond the time of its motion.
pub(super) const GIVEN_UP_AFTER: Duration = Duration::from_secs(1);

/// Longest time without an answer after a motion should have ended, s.
pub(super) const SILENT_S: f64 = 0.5;

/// Number of readings after which a cell has shown a contact that ended: two readings make a force, one was in progress, and so was its
/// conversion. They are counted as they come, because a link may be slower than the cell. A cell that doesn't answer any more ends the motion.
const READINGS_HEARD: u32 = 4;

/// Interval between looks at z during the retraction from a contact.
const LOOK_EVERY: Duration = Duration::from_millis(1);

/// Time before the expected end of a way to the next place from which on the stage is asked for it. Nobody knows which axis ends last.
const ASKED_BEFORE: Duration = Duration::from_secs(5);

/// Axes that move the indenter from place to place.
pub(super) const SIDEWAYS: [Axis; 2] = [Axis::X, Axis::Y];

/// Motion that has ended.
struct Driven {
    /// Positions of the axes, in the given order.
    places_mm: Vec<f64>,
    stopped: bool,
}

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Moves along z to a permitted end. The force is read meanwhile and passed to the press, which may change the speed or stop
    /// the motion.
    pub(super) async fn move_z(&mut self, granted: Permitted, press: Option<&mut ForceLoop>) -> Result<(), Halt> {
        self.move_along_z(granted, press, false).await
    }

    /// Does the same while the outputs are read too, and keeps the readings.
    pub(super) async fn ramp_z(&mut self, granted: Permitted, press: &mut ForceLoop) -> Result<(), Halt> {
        self.series.iter().for_each(|series| series.window(true));
        let moved = self.move_along_z(granted, Some(press), true).await;
        self.series.iter().for_each(|series| series.window(false));
        moved
    }

    async fn move_along_z(
        &mut self,
        granted: Permitted,
        mut press: Option<&mut ForceLoop>,
        reads_outputs: bool,
    ) -> Result<(), Halt> {
        let (target_mm, from_mm) = (self.stage_z_mm(granted.z_mm()), self.stage_z_mm(self.z_mm));
        let is_toward = granted.z_mm() > self.z_mm;
        // a ramp has one speed from its beginning to its end; outside a press nothing is near; from a stop near the end of the travel a rounding leads beyond it
        let Range { min, max } = self.usage.travel.along(Axis::Z);
        let is_to_end = (target_mm - min).min(max - target_mm) < TO_END_MM;
        let continues = reads_outputs || press.is_none() || (is_to_end && !is_toward);
        for doubts in 0..=DOUBTS_MOST {
            let steer = |force_n, now_s| press.as_mut().map_or(Steer::On, |press| press.see(force_n, now_s));
            let (targets, way_mm) = ([(Axis::Z, target_mm)], target_mm - self.stage_z_mm(self.z_mm));
            let on_doubt = if continues || doubts == DOUBTS_MOST { OnDoubt::Continue } else { OnDoubt::Stop };
            let driven = self.drive(&targets, (granted.speed_mm_s(), on_doubt), way_mm, reads_outputs, steer).await?;
            if !driven.stopped {
                self.arrived_z(driven.places_mm.first().copied(), target_mm).await?;
                break;
            }
            // it comes to rest after its controller reports the end
            self.cell.settle().await?;
            self.watch_z().await?;
            // the press continues from where it was stopped, the way out to its end
            if is_toward || !self.cell.is_stopped_by_doubt() {
                break;
            }
        }
        let at_mm = self.stage_z_mm(self.z_mm);
        let way = Range { min: from_mm.min(target_mm), max: from_mm.max(target_mm) };
        let way = way.widened(self.usage.steps.in_position_mm(Axis::Z));
        if !way.contains(at_mm) {
            let text = format!("z moved from {from_mm:.4} toward {target_mm:.4} mm but reports {at_mm:.4} mm");
            return Err(lost(DeviceProblem::Motion(text)));
        }
        Ok(())
    }

    /// Retracts from a contact for good, and continues sideways as soon as the z that was read back is clear. Later readings are
    /// without load. `first_mm` is the earliest z at which contact is possible, here and at the next place.
    pub(super) async fn leave_contact(
        &mut self,
        granted: Permitted,
        next: Place,
        permit: &Permit,
        first_mm: f64,
    ) -> Result<(), Halt> {
        if next == self.place || !self.usage.abilities.reports {
            return self.leave_first(granted, next, permit, first_mm).await;
        }
        let (target_mm, frame) = (self.stage_z_mm(granted.z_mm()), self.frame);
        let there = frame.to_stage(next, granted.z_mm());
        let sideways = SIDEWAYS.map(|axis| (axis, there.along(axis)));
        let retraction =
            MotionProfile::new(granted.z_mm() - self.z_mm, granted.speed_mm_s(), self.usage.acceleration_mm_s2);
        let clears_s = retraction.reaches_s(self.z_mm - permit.clear_mm(first_mm));
        let (way_mm, speed_mm_s) = (way_mm(self.place, next), self.usage.speed_mm_s);
        let travel_s = MotionProfile::new(way_mm, speed_mm_s, self.usage.acceleration_mm_s2).duration_s();
        let travel_due_after = self.due_after(travel_s);
        let due_after = self.due_after(retraction.duration_s()) + travel_due_after;
        let (orders, force_n, clear, due) =
            (MotionOrders::default(), Cell::new(f64::NAN), Cell::new(false), Cell::new(None));
        let touch_n = permit.detect_n();
        // a slow cell shows the contact long after z has left it
        let (heard, rests) = (Cell::new(0u32), Cell::new(None));
        let rests_after = seconds(retraction.duration_s() + self.timing.settle_s);
        let up = AxisWay::between(Axis::Z, self.stage_z_mm(self.z_mm), target_mm);
        let sideways_ways = self.ways_to(&sideways);
        let stage = &mut self.stage;
        // pinned where it is: it is large, and moving it into the next would copy it
        let motion = Box::pin(async {
            stage.begin(&[up], granted.speed_mm_s(), &orders).await?;
            let begun = Instant::now();
            due.set(Some(begun + due_after));
            rests.set(Some(begun + rests_after));
            let mut ends = begun + seconds(retraction.duration_s());
            tokio::select! {
                biased;
                () = orders.pulled().notified() => {}
                () = sleep_until(begun + seconds(clears_s)) => {}
            }
            let mut refused = None;
            while !orders.stopped() {
                let has_ended = heard.get() >= READINGS_HEARD;
                let z_mm = frame.z_from_stage(stage.position_mm(Axis::Z, &orders).await?);
                match permit.sideways(z_mm, first_mm, force_n.get()) {
                    Ok(leave) if !orders.stopped() => {
                        clear.set(true);
                        begin_sideways(stage, leave, &sideways_ways, speed_mm_s, &orders).await?;
                        due.set(Some(Instant::now() + travel_due_after));
                        ends = ends.max(Instant::now() + seconds(travel_s));
                        refused = None;
                        break;
                    }
                    Ok(_) => {}
                    Err(trip) => refused = Some(trip),
                }
                if has_ended {
                    break;
                }
                sleep(LOOK_EVERY).await;
            }
            let left = ends.duration_since(Instant::now()).saturating_sub(ASKED_BEFORE);
            let places_mm = stage.follow(&[Axis::X, Axis::Y, Axis::Z], left, &orders).await?;
            Ok((places_mm, refused))
        });
        self.no_load_outputs = OutputMeans::default();
        let motion = async {
            let moved = motion.await;
            due.set(None); // the array is still awaited
            moved
        };
        let on_the_way = |readings| readings < OUTPUTS_ON_THE_WAY;
        let motion = with_outputs(motion, &clear, on_the_way, &mut self.array, &mut self.no_load_outputs);
        let steer = |watched_cell: &mut WatchedLoadCell<'_, C>, now_n: f64| {
            // two readings make a force: a single outlier starts no sideways motion
            let mean_n = watched_cell.watch.mean_n().unwrap_or(now_n);
            force_n.set(mean_n);
            if rests.get().is_some_and(|rests| Instant::now() >= rests) {
                heard.set(heard.get() + 1);
            }
            // a tool that x and y accelerate is read sideways, which is no zero
            if clear.get() && watched_cell.side_n.is_none() && !watched_cell.is_no_load_open() {
                watched_cell.begin_no_load();
            }
            if clear.get() && mean_n.abs() >= touch_n { Steer::Stop } else { Steer::On }
        };
        self.cell.moves(speed_mm_s.max(granted.speed_mm_s()), OnDoubt::Stop);
        let (places_mm, refused) = watched(&mut self.cell, pin!(motion), &orders, &due, steer).await?;
        if self.cell.is_stopped_by_doubt() {
            self.find_itself().await?;
            let granted = permit.retract(self.z_mm, granted.z_mm().min(self.z_mm), granted.speed_mm_s())?;
            return self.leave_first(granted, next, permit, first_mm).await;
        }
        if let Some(trip) = refused {
            return Err(trip.into());
        }
        if orders.stopped() {
            return Err(self.touched_on_the_way(touch_n));
        }
        self.arrived_at(next, sideways, &places_mm).await?;
        self.arrived_z(places_mm.last().copied(), target_mm).await
    }

    /// Leaves a contact, and then goes to the next place.
    async fn leave_first(
        &mut self,
        granted: Permitted,
        next: Place,
        permit: &Permit,
        first_mm: f64,
    ) -> Result<(), Halt> {
        self.move_z(granted, None).await?;
        self.cell.settle().await?;
        self.begin_no_load();
        self.travel(next, permit, first_mm).await
    }

    /// Moves x and y from rest in the clear. A stage that can't be stopped moves in pieces, between which the force is read.
    pub(super) async fn travel(&mut self, place: Place, permit: &Permit, first_mm: f64) -> Result<(), Halt> {
        let (from, way_mm) = (self.place, way_mm(self.place, place));
        let pieces = if self.usage.abilities.finishes() {
            (way_mm / (PIECE_S * self.usage.speed_mm_s)).ceil().max(1.0)
        } else {
            1.0
        };
        for piece in 1..=pieces as u32 {
            let share = f64::from(piece) / pieces;
            let along = |from: f64, to: f64| if share < 1.0 { from + share * (to - from) } else { to };
            let end = Place::new(along(from.x_mm, place.x_mm), along(from.y_mm, place.y_mm));
            let mut doubts = 0;
            while !self.travel_once(end, permit, first_mm, doubts < DOUBTS_MOST).await? {
                doubts += 1;
            }
        }
        Ok(())
    }

    /// Moves x and y by one motion. Returns `false` if it was stopped because readings were doubted.
    async fn travel_once(
        &mut self,
        place: Place,
        permit: &Permit,
        first_mm: f64,
        stops_on_doubt: bool,
    ) -> Result<bool, Halt> {
        if place == self.place {
            return Ok(true);
        }
        self.cell.watch.pause();
        let force_n = self.cell.mean_n(SIDEWAYS_READINGS).await?;
        let Sideways { .. } = permit.sideways(self.z_mm, first_mm, force_n)?;
        self.begin_no_load();
        let target = self.frame.to_stage(place, self.z_mm);
        let targets = SIDEWAYS.map(|axis| (axis, target.along(axis)));
        let touch_n = permit.detect_n();
        let steer = |force_n: f64, _| if force_n.abs() >= touch_n { Steer::Stop } else { Steer::On };
        let on_doubt = if stops_on_doubt { OnDoubt::Stop } else { OnDoubt::Continue };
        let speed = (self.usage.speed_mm_s, on_doubt);
        let driven = self.drive(&targets, speed, way_mm(self.place, place), false, steer).await?;
        if driven.stopped && self.cell.is_stopped_by_doubt() {
            self.find_itself().await?;
            return Ok(false);
        }
        if driven.stopped {
            return Err(self.touched_on_the_way(touch_n));
        }
        self.arrived_at(place, targets, &driven.places_mm).await?;
        if self.cell.side_n.is_some() {
            self.cell.settle().await?;
            self.begin_no_load(); // what was read while x and y accelerated is no zero sideways
        }
        Ok(true)
    }

    /// Moves z slowly away from the specimen to a position; every force is checked.
    pub(super) async fn retract_slowly(&mut self, z_mm: f64) -> Result<(), Halt> {
        let (target_mm, from_mm) = (self.stage_z_mm(z_mm), self.stage_z_mm(self.z_mm));
        self.cell.watch.pause();
        let speed_mm_s = self.usage.home_speed_mm_s;
        let speed = (speed_mm_s, OnDoubt::Continue);
        let driven = self.drive(&[(Axis::Z, target_mm)], speed, target_mm - from_mm, false, |_, _| Steer::On).await?;
        self.arrived_z(driven.places_mm.first().copied(), target_mm).await
    }

    /// Reads back x, y and z at any position of the axes.
    pub(super) async fn find_itself(&mut self) -> Result<(), Halt> {
        let x_mm = self.stage.position_mm(Axis::X, &MotionOrders::default()).await?;
        let y_mm = self.stage.position_mm(Axis::Y, &MotionOrders::default()).await?;
        self.place = self.frame.place_from_stage(x_mm, y_mm);
        self.pressed = self.place;
        self.read_back_z().await
    }

    /// Moves axes toward targets until they are at rest. Every force is watched and passed to `steer`. With `reads_outputs`, the outputs are
    /// read meanwhile.
    async fn drive(
        &mut self,
        targets: &[(Axis, f64)],
        (speed_mm_s, on_doubt): (f64, OnDoubt),
        way_mm: f64,
        reads_outputs: bool,
        mut steer: impl FnMut(f64, f64) -> Steer,
    ) -> Result<Driven, Halt> {
        let expected = seconds(MotionProfile::new(way_mm, speed_mm_s, self.usage.acceleration_mm_s2).duration_s());
        let axes: Vec<Axis> = targets.iter().map(|(axis, _)| *axis).collect();
        let due_after = self.due_after(expected.as_secs_f64());
        let begun = Cell::new(Instant::now());
        let (orders, due) = (MotionOrders::default(), Cell::new(Some(begun.get() + due_after)));
        let (ends, ways) = (Cell::new(None), self.ways_to(targets));
        self.cell.moves(speed_mm_s, on_doubt);
        let stage = &mut self.stage;
        let motion = pin!(async {
            stage.begin(&ways, speed_mm_s, &orders).await?;
            ends.set(Some(Instant::now() + expected));
            begun.set(Instant::now());
            let places_mm = stage.follow(&axes, expected, &orders).await?;
            due.set(None); // the array is still awaited
            Ok(places_mm)
        });
        let steered = |watched_cell: &mut WatchedLoadCell<'_, C>, force_n: f64| {
            due.set(due.get().map(|_| begun.get() + due_after.mul_f64(orders.slowness())));
            steer(force_n, watched_cell.now_s())
        };
        let places_mm = if reads_outputs {
            let (clear, mut means) = (Cell::new(true), OutputMeans::default());
            let motion = with_outputs(motion, &clear, |_| true, &mut self.array, &mut means);
            watched(&mut self.cell, pin!(motion), &orders, &due, steered).await?
        } else {
            watched(&mut self.cell, motion, &orders, &due, steered).await?
        };
        let stopped = orders.stopped();
        // a complete motion ended with its profile, however late the report came; a printer begins later than it accepts, and a motion that
        // was slowed, which is due at no known time, ended within the exchange that reported it
        let now = Instant::now();
        let ended = match ends.get().filter(|_| !stopped && !self.usage.abilities.finishes()) {
            Some(profile) if due.get().is_some() => profile.min(now),
            Some(profile) => {
                let late = now.duration_since(profile);
                (profile + late.saturating_sub(seconds(self.timing.exchange_s))).min(now)
            }
            None => now,
        };
        self.cell.settled = ended + seconds(self.timing.settle_s);
        Ok(Driven { places_mm, stopped })
    }

    /// Returns the time after which a motion of some seconds is late.
    fn due_after(&self, expected_s: f64) -> Duration {
        seconds((1.0 + LATE_SHARE) * expected_s + self.usage.abilities.late_s)
    }

    /// Returns the halt for a force that appeared while x and y moved, so that nothing is dragged along.
    fn touched_on_the_way(&self, touch_n: f64) -> Halt {
        self.cell.without_load(Trip::new(SafetyRule::StillTouching, touch_n, touch_n, "N")).into()
    }

    /// Checks that x and y are at their targets.
    pub(super) async fn arrived_at(
        &mut self,
        place: Place,
        targets: [(Axis, f64); 2],
        at_mm: &[f64],
    ) -> Result<(), Halt> {
        for ((axis, target_mm), at_mm) in targets.into_iter().zip(at_mm) {
            self.check_arrival(axis, *at_mm, target_mm).await?;
        }
        self.place = place;
        self.pressed = match *at_mm {
            [x_mm, y_mm, ..] if !self.usage.steps.is_fine() => self.frame.place_from_stage(x_mm, y_mm),
            _ => place,
        };
        Ok(())
    }

    /// Checks that z is at its target. The read-back may still be short by the stage's settling distance, so it only counts where a
    /// stage with steps can't go to its target.
    pub(super) async fn arrived_z(&mut self, at_mm: Option<f64>, target_mm: f64) -> Result<(), Halt> {
        let at_mm = at_mm.unwrap_or(f64::NAN);
        self.check_arrival(Axis::Z, at_mm, target_mm).await?;
        let has_steps = self.usage.steps.along(Axis::Z) > 0.0;
        self.series.iter().for_each(|series| series.height(self.frame.z_from_stage(at_mm)));
        self.z_mm = self.frame.z_from_stage(if has_steps { at_mm } else { target_mm });
        Ok(())
    }

    /// Reads z back in contact while the force is read.
    pub(super) async fn watch_z(&mut self) -> Result<(), Halt> {
        let (orders, due) = (MotionOrders::default(), Cell::new(Some(Instant::now())));
        let stage = &mut self.stage;
        let look = pin!(async { Ok(stage.position_mm(Axis::Z, &orders).await?) });
        let at_mm = watched(&mut self.cell, look, &orders, &due, |_, _| Steer::On).await?;
        self.series.iter().for_each(|series| series.height(self.frame.z_from_stage(at_mm)));
        self.z_mm = self.frame.z_from_stage(at_mm);
        Ok(())
    }

    pub(super) async fn read_back_z(&mut self) -> Result<(), Halt> {
        self.z_mm = self.frame.z_from_stage(self.stage.position_mm(Axis::Z, &MotionOrders::default()).await?);
        Ok(())
    }

    /// Checks that an axis arrived. A controller that refused a motion is detected here, and its error queue states the reason.
    async fn check_arrival(&mut self, axis: Axis, position_mm: f64, target_mm: f64) -> Result<(), Halt> {
        let most_mm = self.usage.steps.in_position_mm(axis);
        if (position_mm - target_mm).abs() <= most_mm {
            return Ok(());
        }
        Err(lost(missed(axis, (position_mm, target_mm, most_mm), &self.stage.complaints().await?)))
    }

    /// Returns the ways of axes to their targets, from where the stage was sent or read back last, mm.
    pub(super) fn ways_to(&self, targets: &[(Axis, f64)]) -> Vec<AxisWay> {
        let here = self.frame.to_stage(self.place, self.z_mm);
        targets.iter().map(|(axis, target_mm)| AxisWay::between(*axis, here.along(*axis), *target_mm)).collect()
    }

    pub(super) fn stage_z_mm(&self, z_mm: f64) -> f64 {
        self.frame.to_stage(self.place, z_mm).z_mm
    }
}

/// Runs a motion to its end while every force is watched. Both run to their end, so that no exchange is dropped half-way. After a halt the
/// motion is given up if the force continues to rise beyond the limit, or if it doesn't end in its time. A motion that isn't reported done
/// long after its due time trips.
pub(super) async fn watched<C: LoadCell, T>(
    watched_cell: &mut WatchedLoadCell<'_, C>,
    motion: impl Future<Output = Result<T, Halt>>,
    orders: &MotionOrders,
    due: &Cell<Option<Instant>>,
    steer: impl FnMut(&mut WatchedLoadCell<'_, C>, f64) -> Steer,
) -> Result<T, Halt> {
    let (ended, over, given_up) = (Cell::new(false), Notify::new(), Notify::new());
    let motion = async {
        let moved = unless_given_up(motion, &given_up).await;
        ended.set(true);
        over.notify_one();
        moved
    };
    let watch = async {
        let watched = watch_until(watched_cell, &ended, orders, due, steer).await;
        if watched.is_err() {
            orders.stop();
            watched_cell.halted = Some(Instant::now());
            let left = due.get().map_or(Duration::ZERO, |due| due.duration_since(Instant::now()));
            if timeout(left + GIVEN_UP_AFTER, watched_cell.rises_beyond(&over)).await.unwrap_or(true) {
                given_up.notify_one();
            }
        }
        watched_cell.rests();
        watched
    };
    let (moved, watched) = tokio::join!(motion, watch);
    watched?;
    moved.unwrap_or(Err(Halt::Cancelled)) // given up only where the watch has halted
}

/// Reads the force until a motion has ended, and passes it to `steer`.
async fn watch_until<C: LoadCell>(
    watched_cell: &mut WatchedLoadCell<'_, C>,
    ended: &Cell<bool>,
    orders: &MotionOrders,
    due: &Cell<Option<Instant>>,
    mut steer: impl FnMut(&mut WatchedLoadCell<'_, C>, f64) -> Steer,
) -> Result<(), Halt> {
    while !ended.get() {
        let heard = {
            let silent_after = seconds(watched_cell.watch.zero().stale_s()) + watched_cell.cell.conversion();
            let heard = watched_cell.heard_n();
            tokio::pin!(heard);
            match timeout(silent_after, &mut heard).await {
                Ok(heard) => heard,
                Err(_) => {
                    orders.stop(); // no motion without monitoring
                    heard.await
                }
            }
        };
        let steered = heard?.map_or(Steer::On, |force_n| steer(watched_cell, force_n));
        match steered {
            Steer::On if watched_cell.is_stopped_by_doubt() => orders.stop(),
            Steer::On => {}
            Steer::Stop => orders.stop(),
            Steer::Speed(mm_s) => {
                due.set(None); // slower than calculated
                orders.speed(mm_s);
            }
        }
        // a motion that has ended meanwhile was reported: the reading took the time
        let silent_s = due.get().filter(|_| !ended.get()).map_or(0.0, |due| due.elapsed().as_secs_f64());
        if silent_s > SILENT_S {
            return Err(Trip::new(SafetyRule::StageSilent, silent_s, SILENT_S, "s").into());
        }
    }
    Ok(())
}

/// Runs a motion to its end. Averages the outputs during the motion, once z is clear of the specimen, and as long as `goes_on` for their
/// number.
async fn with_outputs<A: SensorArray, T>(
    motion: impl Future<Output = Result<T, Halt>>,
    clear: &Cell<bool>,
    goes_on: impl Fn(u32) -> bool,
    array: &mut A,
    means: &mut OutputMeans,
) -> Result<T, Halt> {
    let over = Notify::new();
    let motion = then_notify(motion, &over);
    let outputs = means.take_while(array, &over, || clear.get(), goes_on, |_, _| Ok(()));
    let (moved, read) = tokio::join!(motion, outputs);
    let moved = moved?;
    read.map(|()| moved)
}

/// Starts a motion of x and y. Consumes the permission.
async fn begin_sideways<S: Stage>(
    stage: &mut S,
    _leave: Sideways,
    ways: &[AxisWay],
    speed_mm_s: f64,
    orders: &MotionOrders,
) -> Result<(), DeviceError> {
    stage.begin(ways, speed_mm_s, orders).await
}

/// Longer of the distances in x and y, mm.
pub(super) fn way_mm(from: Place, to: Place) -> f64 {
    (to.x_mm - from.x_mm).abs().max((to.y_mm - from.y_mm).abs())
}

/// Returns why an axis isn't at its target within this distance. A small distance without an error indicates a coarse stage.
fn missed(axis: Axis, (position_mm, target_mm, most_mm): (f64, f64, f64), complaints: &[String]) -> DeviceProblem {
    let (off_mm, name) = ((position_mm - target_mm).abs(), axis.name());
    let text = format!("{name} was commanded to {target_mm:.4} mm but is at {position_mm:.4} mm");
    match complaints {
        [] if off_mm <= COARSE_MM => DeviceProblem::Coarse(format!(
            "{text}, {off_mm:.4} mm off without an error: the stage's steps are coarser than the {most_mm} mm that count as in \
             position"
        )),
        [] => DeviceProblem::Motion(format!("{text}; it reports no error")),
        _ => DeviceProblem::Motion(format!("{text}; {}", complaints.join("; "))),
    }
}

pub(super) fn lost(problem: DeviceProblem) -> Halt {
    let doing = "checking where a motion ended".to_owned();
    DeviceError { device: "stage".to_owned(), doing, problem }.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coarse_stage_is_distinguished_from_one_that_is_blocked() {
        let coarse = missed(Axis::X, (1.02, 1.0125, 0.003), &[]);
        assert_eq!(
            coarse.to_string(),
            "x was commanded to 1.0125 mm but is at 1.0200 mm, 0.0075 mm off without an error: the stage's steps are coarser \
             than the 0.003 mm that count as in position"
        );
        assert!(matches!(coarse, DeviceProblem::Coarse(_)));
        assert!(
            matches!(missed(Axis::X, (1.5, 1.0, 0.003), &[]), DeviceProblem::Motion(_)),
            "half a millimetre is no resolution"
        );
        let refused = missed(Axis::X, (1.02, 1.0125, 0.003), &["following error".to_owned()]);
        assert!(matches!(refused, DeviceProblem::Motion(_)) && refused.to_string().ends_with("; following error"));
    }
}
