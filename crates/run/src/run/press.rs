//! Execution of one press.

use super::Halt;
use super::execute::Runner;
use super::rig_control::KnownOutputs;
use super::window::MeasuredWindow;
use palpate_control::{
    Averaged, Context, ForceLoop, LearnedContact, LoopCommand, LoopEvent, MeasuredContact, Moment, NoLoadReadings,
    Permit, PressTask, SafetyRule, SetPoint, Softest, Strategy, TOUCH_SIGMA_MM, UncertaintyBudget, Zero,
};
use palpate_core::quantity::{Place, round};
use palpate_data::dataset::{self, Flag, FollowedTime, Left, NoLoad, PressTruth, RecordedContact};
use palpate_data::recipe::Entry;
use palpate_link::device::Stage;
use palpate_link::time::Instant;

/// Margin of the controller's guard for noise, in sd of one reading. The guard checks each reading separately, thousands in each
/// press.
const GUARD_SIGMAS: f64 = 8.0;

/// Least decrease of the reading without load after a press, N, and margin in sd of a mean, that indicates a cell that sticks to the
/// specimen. The third constant is the additional distance at which the cell is read again, mm.
const STICKS_N: f64 = 0.010;
const STICKS_SIGMAS: f64 = 5.0;
const FARTHER_MM: f64 = 0.5;

/// Largest age of the reading without load while the first descent continues, s. In this time the zero of a cell that drifts by 30 mN/min
/// moves by 0.5 mN.
const NO_LOAD_FRESH_S: f64 = 1.0;

/// Least recorded way of a drag, mm: a way of 0 is that of a window before a drag.
const WAY_LEAST_MM: f64 = 1e-6;

/// Contact that has ended.
pub(super) struct Pressed {
    levels: Vec<MeasuredLevel>,
    no_load: NoLoad,
    /// Time of that air by the press' clock, s.
    no_load_s: f64,
    pub touched_mm: Option<f64>,
    learned_contact: Option<LearnedContact>,
    /// Times in which all devices were read after the last level.
    followed: Vec<FollowedTime>,
}

impl Pressed {
    /// Returns what the array felt at the first level.
    pub(super) fn felt(&self, place: Place) -> Option<MeasuredContact> {
        let window = &self.levels.first()?.window;
        Some(MeasuredContact { place, force_n: window.force_n, outputs: window.outputs.clone(), sigmas: [0.0; 2] })
    }

    /// Returns the force of the first level, N, and its depth, mm.
    pub(super) fn first_loaded(&self) -> Option<(f64, f64)> {
        let level = self.levels.first()?;
        Some((level.window.force_n, level.z_mm - self.touched_mm?))
    }
}

/// One level that was held.
struct MeasuredLevel {
    /// Way in contact to its place, mm, and slips on it; `None` before a drag.
    dragged: Option<(f64, u64)>,
    window: MeasuredWindow,
    /// Place where it was held; on a stage with steps, as read back.
    place: Place,
    z_mm: f64,
    truth: Option<PressTruth>,
}

/// Move of the load cell's zero from before a press to after it, by the press' clock.
struct ZeroMoved {
    from_s: f64,
    to_s: f64,
    by_n: f64,
    /// Move of the zeros along x and y.
    side_by_n: Option<[f64; 2]>,
}

impl ZeroMoved {
    /// Move of the zero up to a time, N, proportional to the time.
    fn at_n(&self, at_s: f64) -> f64 {
        self.by_n * self.share(at_s)
    }

    /// Removes the move of the zero from the forces of a window.
    fn correct(&self, window: &mut MeasuredWindow) {
        window.force_n -= self.at_n(window.middle_s);
        let share = self.share(window.middle_s);
        if let (Some(side_n), Some(by_n)) = (&mut window.side_n, self.side_by_n) {
            *side_n = [side_n[0] - by_n[0] * share, side_n[1] - by_n[1] * share];
        }
    }

    /// Fraction of the time that has passed at `at_s`.
    fn share(&self, at_s: f64) -> f64 {
        ((at_s - self.from_s) / (self.to_s - self.from_s)).clamp(0.0, 1.0)
    }
}

impl Runner<'_> {
    /// Executes one entry of the plan, from the clear to the clear above the `next` place.
    pub(super) async fn press(&mut self, entry: &Entry, next: Option<Place>) -> Result<RecordedContact, Halt> {
        let pressed = self.undoubted_contact(entry, next.unwrap_or(entry.place)).await?;
        if let Some(next) = next {
            self.go_to(next).await?; // a staircase that ended without load hasn't moved
        }
        let after = self.no_load_after().await?;
        self.rig_control.cell.watch.pause();
        let Pressed { levels: mut held, no_load: before, no_load_s, touched_mm, learned_contact, followed } = pressed;
        let moved = ZeroMoved {
            from_s: no_load_s,
            to_s: self.rig_control.cell.now_s() - after.force.age_s,
            by_n: after.force.mean_n - self.rig_control.cell.watch.zero().at_n(after.force.at_s),
            side_by_n: after
                .force
                .side_mean_n
                .zip(before.force.side_mean_n)
                .map(|(to, from)| [to[0] - from[0], to[1] - from[1]]),
        };
        held.iter_mut().for_each(|held| moved.correct(&mut held.window));
        let along_normal = 1.0 / self.rig_control.frame.tilt.cosine();
        let budget = |held: &MeasuredLevel| self.budget(held, [&before, &after], &moved).times(along_normal);
        let budgets: Vec<UncertaintyBudget> = held.iter().map(budget).collect();
        let sides: Vec<[Option<f64>; 2]> =
            held.iter().map(|held| self.side_u_n(held, [&before, &after], &moved)).collect();
        let level = |((level, held), budget): ((usize, &MeasuredLevel), &UncertaintyBudget)| dataset::Press {
            u_force_n: budget.u_n(),
            u_force_x_n: sides[level][0],
            u_force_y_n: sides[level][1],
            air_before_n: Some(before.force.mean_n),
            air_after_n: Some(after.force.mean_n),
            ..self.row(entry, level, held, touched_mm)
        };
        let levels = held.iter().enumerate().zip(&budgets).map(level).map(dataset::Press::rounded).collect();
        let truth = held.iter().filter_map(|held| held.truth.map(PressTruth::rounded)).collect();
        let left = next.map(|_| Left { z_mm: self.rig_control.z_mm });
        let budgets = budgets.into_iter().map(UncertaintyBudget::rounded).collect();
        Ok(RecordedContact {
            press: entry.press,
            levels,
            budgets,
            truth,
            learned_contact,
            no_load_before: before,
            no_load_after: after,
            left,
            monitors: self.monitors.values(),
            followed,
            series: None,
        })
    }

    /// Returns the uncertainty budget of a level's force.
    fn budget(&self, held: &MeasuredLevel, no_loads: [&NoLoad; 2], moved: &ZeroMoved) -> UncertaintyBudget {
        let MeasuredWindow { force_n, middle_s, forces, seconds, .. } = held.window;
        let share = moved.share(middle_s);
        let no_loads = no_loads.map(|no_load| no_load.force);
        let averaged = Averaged { readings: forces, seconds, no_loads, moved_n: moved.by_n, share };
        let cell = &self.conditions.spec.load_cell;
        let cell_n = match held.window.side_n {
            Some([x_n, y_n]) => cell.axes_uncertainty_n([x_n, y_n, force_n]).map(|u_n| u_n[2]),
            None => cell.standard_uncertainty_n(force_n),
        };
        let budget = UncertaintyBudget::of(&averaged, self.rig_control.cell.watch.zero(), cell_n);
        UncertaintyBudget { temperature_n: self.temperature_n(force_n), ..budget }
    }

    /// Returns the standard uncertainty of a force by the temperature of the load cell, N; `None` if its certificate states no effect, or no
    /// monitor reads the temperature.
    fn temperature_n(&self, force_n: f64) -> Option<f64> {
        let effect = self.conditions.spec.load_cell.certificate.as_ref()?.temperature?;
        Some(effect.standard_uncertainty_n(force_n, self.monitors.temperature_c()?))
    }

    /// Returns the standard uncertainties of a level's forces along x and y, N: those of the cell, of the noise and of the zero.
    fn side_u_n(&self, held: &MeasuredLevel, no_loads: [&NoLoad; 2], moved: &ZeroMoved) -> [Option<f64>; 2] {
        let MeasuredWindow { force_n, middle_s, forces: readings, seconds, side_n, .. } = held.window;
        let (Some([x_n, y_n]), Some(side)) = (side_n, self.rig_control.cell.watch.zero().side) else {
            return [None; 2];
        };
        let cell_n = self.conditions.spec.load_cell.axes_uncertainty_n([x_n, y_n, force_n]);
        [0, 1].map(|axis| {
            let mean_n = |no_load: &NoLoad| no_load.force.side_mean_n.map_or(0.0, |mean_n| mean_n[axis]);
            let no_loads = no_loads.map(|no_load| NoLoadReadings { mean_n: mean_n(no_load), ..no_load.force });
            let moved_n = no_loads[1].mean_n - no_loads[0].mean_n;
            let averaged = Averaged { readings, seconds, no_loads, moved_n, share: moved.share(middle_s) };
            let zero = Zero::with_noise(side.sigma_n[axis]);
            let budget = UncertaintyBudget::of(&averaged, &zero, cell_n.map(|u_n| u_n[axis]));
            UncertaintyBudget { temperature_n: self.temperature_n([x_n, y_n][axis]), ..budget }.u_n()
        })
    }

    /// Reads the load cell without load after a press. If the specimen seems to pull at the cell, the cell may stick to it, so it is read
    /// again from farther away.
    async fn no_load_after(&mut self) -> Result<NoLoad, Halt> {
        let no_load = self.rig_control.end_no_load().await?;
        let zero = self.rig_control.cell.watch.zero();
        let sigma_n = zero.sigma_mean_n(no_load.force.readings);
        if zero.at_n(no_load.force.at_s) - no_load.force.mean_n <= STICKS_N + STICKS_SIGMAS * sigma_n {
            return Ok(no_load);
        }
        let (from_mm, speed_mm_s) = (self.rig_control.z_mm, self.rig_control.usage.speed_mm_s);
        let farther_mm = (from_mm - FARTHER_MM).max(self.conditions.spec.clear_mm()).min(from_mm);
        self.rig_control.cell.watch.pause();
        let granted = self.permit.retract(from_mm, farther_mm, speed_mm_s)?;
        self.rig_control.move_z(granted, None).await?;
        self.rig_control.cell.settle().await?;
        self.rig_control.begin_no_load();
        self.rig_control.end_no_load().await
    }

    /// Makes a contact at a place. In a simulated contact, all random values follow from its number. So the contact is the same
    /// right after the one before or on another day.
    pub(super) async fn contact(
        &mut self,
        number: u64,
        place: Place,
        task: &PressTask,
        next: Place,
    ) -> Result<Pressed, Halt> {
        self.go_to(place).await?;
        self.rig_control.stage.forget_timing();
        self.rig_control.cell.begin().await;
        self.rig_control.truth.begin_press(number);
        let mut no_load = self.no_load().await?;
        let mut no_load_s = -no_load.force.age_s;
        // after a drag the tip leaves another place
        let end = task.drag().map_or(place, |drag| drag.end(place));
        let first_mm = self.map.first_on_way_mm(place, next).min(self.map.first_on_way_mm(end, next));
        let mut press = ForceLoop::new(task.clone(), self.context(place, task, first_mm));
        self.rig_control.count_from(&mut no_load);
        self.zeroed = Instant::now();
        self.rig_control.stage.guard(Some(self.guard_n())).await?; // some exchanges, in which no force is read
        self.rig_control.cell.watch.pause();
        self.rig_control.cell.force_n().await?;
        let mut levels: Vec<MeasuredLevel> = Vec::with_capacity(task.levels.len());
        let mut followed = Vec::new();
        let mut went: Option<([f64; 2], u64)> = None;
        let mut known = KnownOutputs { outputs: no_load.outputs.clone(), light_n: None };
        let mut event = LoopEvent::Begin { z_mm: self.rig_control.z_mm, no_load: no_load.force };
        loop {
            let moment = Moment { now_s: self.rig_control.cell.now_s(), age_s: self.rig_control.cell.age_s() };
            event = match press.next(event, moment) {
                LoopCommand::Average(readings) => {
                    LoopEvent::Averaged { force_n: self.rig_control.cell.mean_n(readings).await? }
                }
                LoopCommand::Move(granted) => {
                    if press.is_first_descent() {
                        self.rig_control.check_outputs_rest(&mut known, &self.conditions.spec.array).await?;
                        // after a light touch the readings aren't without load
                        if known.light_n.is_none() {
                            self.freshen(&mut no_load, &mut no_load_s).await?;
                        }
                        self.rig_control.cell.renew().await?;
                    }
                    self.rig_control.move_z(granted, Some(&mut press)).await?;
                    LoopEvent::Moved { z_mm: self.rig_control.z_mm }
                }
                LoopCommand::AverageAxes(readings) => {
                    let (force_n, side_n) = self.rig_control.cell.mean_axes_n(readings).await?;
                    LoopEvent::AxesAveraged { force_n, side_n }
                }
                LoopCommand::Drag(granted) => {
                    let ([x_mm, y_mm], slips) = self.rig_control.drag(granted).await?;
                    went = Some(([x_mm, y_mm], slips));
                    LoopEvent::Dragged { x_mm, y_mm }
                }
                LoopCommand::LeaveContact(granted) => {
                    self.rig_control.leave_contact(granted, next, &self.permit, first_mm).await?;
                    LoopEvent::Moved { z_mm: self.rig_control.z_mm }
                }
                LoopCommand::Dwell(seconds) => {
                    self.rig_control.dwell(seconds).await?;
                    LoopEvent::Dwelt
                }
                LoopCommand::Sample(seconds) => {
                    let window = self.rig_control.sample(seconds, self.conditions.spec.array.range_v).await?;
                    let force_n = window.force_n;
                    let (place, z_mm) = (self.rig_control.pressed, self.rig_control.z_mm);
                    let truth = self.rig_control.press_truth();
                    let before_n = levels.last().and_then(|level| level.window.side_n);
                    if let (Some((way, _)), Some(before_n), Some(after_n)) = (went, before_n, window.side_n) {
                        self.drag_responses.add(way, [after_n[0] - before_n[0], after_n[1] - before_n[1]])?;
                    }
                    let dragged = went.map(|([x_mm, y_mm], slips)| (x_mm.hypot(y_mm).max(WAY_LEAST_MM), slips));
                    levels.push(MeasuredLevel { dragged, window, place, z_mm, truth });
                    LoopEvent::Sampled { force_n }
                }
                LoopCommand::Follow(seconds) => {
                    let from_s = self.conditions.clock.now_s();
                    let force_n = self.rig_control.follow(seconds).await?;
                    let part = self.followed(from_s, None, task.holds_force());
                    match followed.last_mut() {
                        // parts and levels at rest are one time
                        Some(FollowedTime { to_s, speed_mm_s: None, .. }) => *to_s = part.to_s,
                        _ => followed.push(part),
                    }
                    LoopEvent::Followed { force_n }
                }
                LoopCommand::Ramp(granted) => {
                    let (from_s, from_mm) = (self.conditions.clock.now_s(), self.rig_control.z_mm);
                    let speed_mm_s = granted.speed_mm_s() * (granted.z_mm() - from_mm).signum();
                    self.rig_control.ramp_z(granted, &mut press).await?;
                    followed.push(self.followed(from_s, Some(speed_mm_s), false));
                    LoopEvent::Moved { z_mm: self.rig_control.z_mm }
                }
                LoopCommand::Done => break,
                LoopCommand::Doubt(trip) => {
                    self.doubt = Some(trip.clone());
                    return Err(trip.into());
                }
                LoopCommand::Trip(trip) => {
                    if trip.rule == SafetyRule::NoContact {
                        // the array may have felt it
                        self.rig_control.check_outputs_rest(&mut known, &self.conditions.spec.array).await?;
                    }
                    let trip = self.rig_control.as_array_feels(trip, self.conditions.spec.array.range_v).await;
                    return Err(self.rig_control.cell.at_first_touch(trip).await.into());
                }
            };
        }
        self.rig_control.stage.guard(None).await?;
        let last = levels.last_mut().and_then(|held| held.truth.as_mut());
        if let (Some(last), Some(after)) = (last, self.rig_control.press_truth()) {
            last.force_peak_n = last.force_peak_n.max(after.force_peak_n);
            last.depth_peak_mm = last.depth_peak_mm.max(after.depth_peak_mm);
        }
        Ok(Pressed {
            levels,
            no_load,
            no_load_s,
            touched_mm: press.touched_mm(),
            learned_contact: press.learned_contact(),
            followed,
        })
    }

    /// Time in which all devices were read, from `from_s` until now.
    fn followed(&self, from_s: f64, speed_mm_s: Option<f64>, holds_force: bool) -> FollowedTime {
        let to_s = round(self.conditions.clock.now_s(), 4);
        FollowedTime { from_s: round(from_s, 4), to_s, speed_mm_s, holds_force }
    }

    /// Reads the load cell without load again during the descent before the first touch. Without this, a drifting zero would look like a
    /// touch. A move larger than a drift may be a touch, so in that case the older air remains valid.
    async fn freshen(&mut self, no_load: &mut NoLoad, no_load_s: &mut f64) -> Result<(), Halt> {
        let age_s = self.rig_control.cell.now_s() - *no_load_s;
        if age_s < NO_LOAD_FRESH_S {
            return Ok(());
        }
        self.rig_control.cell.settle().await?;
        self.rig_control.begin_no_load();
        let mut newer = self.rig_control.end_no_load().await?;
        let zero = self.rig_control.cell.watch.zero();
        let sigma_n = zero.sigma_mean_n(newer.force.readings);
        let moved_n = (newer.force.mean_n - zero.at_n(newer.force.at_s)).abs() - zero.rounding_n();
        if Permit::is_drift(moved_n.max(0.0), sigma_n, age_s, zero.drift) {
            *no_load_s = self.rig_control.cell.now_s() - newer.force.age_s;
            self.rig_control.count_from(&mut newer);
            *no_load = newer;
        }
        Ok(())
    }

    /// Moves to a place in the clear.
    pub(super) async fn go_to(&mut self, place: Place) -> Result<(), Halt> {
        let first_mm = self.map.first_on_way_mm(self.rig_control.place, place);
        self.rig_control.travel(place, &self.permit, first_mm).await
    }

    /// Returns the readings without load from clearance height: those from the way here, or new ones.
    async fn no_load(&mut self) -> Result<NoLoad, Halt> {
        match self.standby.take().and_then(|standby| standby.no_load) {
            Some(no_load) => Ok(no_load),
            None => {
                self.rig_control.cell.watch.pause();
                self.rig_control.begin_no_load();
                self.rig_control.end_no_load().await
            }
        }
    }

    /// Reading at which the controller's own guard ends a motion, N: slightly above the force at which the watch trips.
    fn guard_n(&self) -> f64 {
        let zero = self.rig_control.cell.watch.zero();
        let reading_n =
            zero.at_n(self.rig_control.cell.read_s) + self.conditions.spec.limits.force_n + GUARD_SIGMAS * zero.sigma_n;
        reading_n * self.conditions.spec.load_cell.divisor() // the controller knows the cell's own readings
    }

    fn context(&self, place: Place, task: &PressTask, first_mm: f64) -> Context {
        let (force_set_n, limits) = (task.most_n(), self.conditions.spec.limits);
        let asks = task.strategy == Strategy::Map && task.levels.len() == 1;
        Context {
            place,
            limits,
            permit: self.permit,
            zero: *self.rig_control.cell.watch.zero(),
            zero_age_s: self.zeroed.elapsed().as_secs_f64(),
            expected: self.map.expect(place),
            shot: asks.then(|| self.map.shot(place, force_set_n, &limits)).flatten(),
            softest: Softest {
                declared_n_mm: self.conditions.spec.stiffness_least_n_mm,
                learned_curve: self.map.learned_curve(place),
                doubted: self.doubted(place, force_set_n),
            },
            clear_mm: self.permit.travel_mm(first_mm),
            approach_mm_s: self.conditions.spec.stage.approach_mm_s,
            speed_mm_s: self.rig_control.usage.speed_mm_s,
            timing: self.rig_control.timing,
        }
    }

    /// Returns the row of a level. Its force and depth are along the surface's normal; the loop and its flags go by those along z.
    fn row(&mut self, entry: &Entry, level: usize, held: &MeasuredLevel, touched_mm: Option<f64>) -> dataset::Press {
        let MeasuredLevel { window, z_mm, .. } = held;
        let set = entry.task.level_set(level);
        let along_z_mm = touched_mm.filter(|_| set.is_loaded()).map_or(0.0, |touched_mm| z_mm - touched_mm);
        let flags = self.flags(entry, level, held, along_z_mm);
        let tilt = self.rig_control.frame.tilt;
        dataset::Press {
            press: entry.press,
            level: level as u64,
            phase: Some(entry.phase),
            x_mm: held.place.x_mm,
            y_mm: held.place.y_mm,
            force_set_n: set.force_n(),
            depth_set_mm: set.depth_mm(),
            force_n: Some(tilt.normal_n(window.force_n)),
            force_x_n: window.side_n.map(|side_n| side_n[0]),
            force_y_n: window.side_n.map(|side_n| side_n[1]),
            drag_mm: window.side_n.map(|_| held.dragged.map_or(0.0, |(way_mm, _)| way_mm)),
            slips: window.side_n.map(|_| held.dragged.map_or(0.0, |(_, slips)| slips as f64)),
            depth_mm: Some(tilt.normal_mm(along_z_mm)),
            u_depth_mm: set.depth_mm().and_then(|_| self.conditions.spec.u_depth_mm(TOUCH_SIGMA_MM, window.force_n)),
            t_s: Some(self.conditions.clock.at_s(window.began)),
            outputs: window.outputs.clone(),
            flags,
            z_mm: Some(self.rig_control.frame.to_stage(entry.place, *z_mm).z_mm),
            ..dataset::Press::default()
        }
    }

    /// Returns the problems of a level that was held.
    fn flags(&mut self, entry: &Entry, level: usize, held: &MeasuredLevel, along_z_mm: f64) -> Vec<Flag> {
        let (window, set) = (&held.window, entry.task.level_set(level));
        let drag = held.dragged.and(entry.task.drag());
        let missed = match (drag, set) {
            // the pressing force isn't controlled in a drag
            (Some(drag), _) => drag.shear_n.is_some_and(|shear_n| {
                let shear = window.side_n.map_or(0.0, |[x_n, y_n]| x_n.hypot(y_n));
                (shear - shear_n).abs() > entry.task.force_tolerance_n
            }),
            (None, SetPoint::Force(force_n)) => (window.force_n - force_n).abs() > entry.task.force_tolerance_n,
            (None, SetPoint::Depth(depth_mm)) => (along_z_mm - depth_mm).abs() > entry.task.depth_tolerance_mm,
        };
        let felt = (entry.place, set);
        // the same load may give the same reading twice
        let before = self.felt.as_ref().filter(|(load, _)| *load != felt).map(|(_, outputs)| outputs.as_slice());
        let frozen = set.is_loaded() && window.is_frozen(before);
        if set.is_loaded() {
            self.felt = Some((felt, window.outputs.clone()));
        }
        let all =
            [(Flag::OutOfTolerance, missed), (Flag::Saturated, window.saturated), (Flag::Stale, window.late || frozen)];
        all.into_iter().filter(|(_, is_so)| *is_so).map(|(flag, _)| flag).collect()
    }
}
