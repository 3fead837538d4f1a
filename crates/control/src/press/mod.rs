//! One contact, as a state machine. The common part of all presses is here. Each strategy for finding the force has its own file:
//! `guarded`, `velocity`, `shot` (the map's).

mod dialogue;
mod dragged;
mod followed;
mod follows;
mod guarded;
mod ramp;
mod shot;
mod soft;
mod state;
mod velocity;

use super::drift::Drift;
use super::map::LearnedContact;
use super::permit::{DEPTH_MARGIN_MM, MotionContext, Permitted};
use super::profile::MotionProfile;
use super::task::{Branch, PressLevel, PressTask, SetPoint, Strategy};
use super::trip::{SafetyRule, Trip};
pub use dialogue::{Context, LoopCommand, LoopEvent, Moment, NoLoadReadings, Steer};
use dragged::DragProgress;
pub use guarded::{FIRST_APPROACH_MM_S, TOUCH_MOST_N};
use ramp::RampProgress;
pub use soft::Softest;
pub use velocity::GAIN_TIMES_DEAD_TIME;

pub use state::ForceLoop;
use state::{MotionInProgress, PressState, Push, SEARCH_MM, STEP_LEAST_MM, TELL_SIGMAS};

/// Number of readings without load that are checked before a press.
pub const NO_LOAD_READINGS: u32 = 8;
/// Fewest readings averaged between two motions. The second constant holds where the force is near the limit.
const READINGS_LEAST: u32 = 4;
const LIMIT_READINGS: u32 = 16;
/// Fraction of the limit from which a force counts as near the limit.
const NEAR_LIMIT: f64 = 0.85;
/// Wanted sd of a mean, as a fraction of the tolerance. The second constant is the longest time that is spent to reach it, s.
const MEAN_SHARE: f64 = 0.02;
const READ_S: f64 = 0.020;
/// Required sd of a mean, as a fraction of the tolerance. The second constant is the longest time that is spent to reach it, s.
const MEAN_SHARE_MOST: f64 = 0.15;
const READ_MOST_S: f64 = 0.200;
/// Distance that a depth limit must leave for that search beyond the surface's uncertainty, mm.
pub const SEARCH_ROOM_MM: f64 = SEARCH_MM + DEPTH_MARGIN_MM;
/// Fraction of a force that must remain at the next look if nothing was retracted.
const LEFT_SHARE: f64 = 0.5;
/// Largest number of stored points of a loading path.
const PATH_MAX: usize = 12;

impl ForceLoop {
    /// Creates a press that hasn't begun.
    pub fn new(task: PressTask, context: Context) -> Self {
        ForceLoop {
            task,
            context,
            state: PressState::Idle,
            level: 0,
            z_mm: 0.0,
            force_n: 0.0,
            peak_n: 0.0,
            sigma_n: 0.0,
            moment: Moment { now_s: 0.0, age_s: f64::INFINITY },
            first_mm: context.expected.first_mm,
            in_contact: false,
            dwelt: false,
            follow_until_s: None,
            ramped: RampProgress::default(),
            steps: 0,
            last_look: None,
            motion: None,
            broken: None,
            contact_s: None,
            anchor: (0.0, 0.0),
            answered: (0.0, 0.0),
            shown: (0.0, 0.0),
            met: (0.0, 0.0),
            rested: None,
            before_mm: 0.0,
            stiffness_n_mm: None,
            path: Vec::new(),
            push: Push::default(),
            landing: None,
            dragged: DragProgress::default(),
        }
    }

    /// Returns the level that is being reached, held or sampled, with its number.
    pub fn level(&self) -> Option<(usize, PressLevel)> {
        self.task.levels.get(self.level).map(|level| (self.level, *level))
    }

    /// Largest force of the present level, N: the set force or, at a set depth, what the declared stiffness allows there.
    fn level_n(&self) -> f64 {
        let limits = &self.context.limits;
        self.level().map_or(0.0, |(_, level)| match level.set {
            SetPoint::Force(force_n) => force_n,
            SetPoint::Depth(depth_mm) => (limits.stiffness_n_mm * depth_mm).min(limits.force_n),
        })
    }

    /// Whether the press is on its way to the first touch of a specimen.
    pub fn is_first_descent(&self) -> bool {
        !self.context.expected.touched && matches!(self.state, PressState::Descending | PressState::Approaching)
    }

    /// Position where contact began, mm. It comes from the loading path extrapolated to zero force, or from the map's surface.
    /// `None` before contact.
    pub fn touched_mm(&self) -> Option<f64> {
        match (self.landing, self.context.shot) {
            (Some(_), Some(shot)) => Some(shot.surface_mm()),
            _ => guarded::root_of(&self.path, self.context.limits.stiffness_n_mm),
        }
    }

    /// Returns the information from this press for later presses; `None` if the press never touched the specimen.
    pub fn learned_contact(&self) -> Option<LearnedContact> {
        let place = self.context.place;
        match self.landing {
            Some(landing) => landing.learned_contact(place),
            None => {
                let z_mm = self.touched_mm()?;
                Some(LearnedContact::Touch { place, z_mm, path: self.path.clone() })
            }
        }
    }

    /// Takes a reading that arrived during a motion and decides how the motion continues.
    pub fn see(&mut self, force_n: f64, now_s: f64) -> Steer {
        if force_n >= self.context.zero.detect_n() && self.contact_s.is_none() {
            self.contact_s = Some(now_s);
        }
        if let Some(trip) = self.harder_than_declared(force_n, now_s) {
            self.broken.get_or_insert(trip);
            return Steer::Stop;
        }
        match self.state {
            PressState::Descending | PressState::Approaching if force_n >= self.context.zero.detect_n() => Steer::Stop,
            PressState::Shooting | PressState::Stepping | PressState::Trimming => self.hold_below(force_n),
            PressState::Pushing => self.steer(force_n, now_s),
            _ => Steer::On,
        }
    }

    /// Returns the next command. An event that doesn't fit the state ends the press with a trip.
    pub fn next(&mut self, event: LoopEvent, moment: Moment) -> LoopCommand {
        self.moment = moment;
        let command = match self.broken.take() {
            Some(trip) => LoopCommand::Trip(trip),
            None => self.answer(event).unwrap_or_else(LoopCommand::Trip),
        };
        if matches!(command, LoopCommand::Done | LoopCommand::Doubt(_) | LoopCommand::Trip(_)) {
            self.state = PressState::Over; // no further motion
        }
        command
    }

    fn answer(&mut self, event: LoopEvent) -> Result<LoopCommand, Trip> {
        event.check_finite()?;
        self.peak_n = event.force_n().map_or(self.peak_n, |force_n| self.peak_n.max(force_n));
        match (self.state, event) {
            (PressState::Idle, LoopEvent::Begin { z_mm, no_load }) => {
                self.z_mm = z_mm;
                self.begin(no_load)
            }
            (PressState::Descending | PressState::Approaching, LoopEvent::Moved { z_mm }) => {
                let descended = self.state == PressState::Descending && z_mm < self.first_mm;
                self.z_mm = z_mm;
                if descended { self.approach() } else { self.average(PressState::Touching) }
            }
            (PressState::Touching, LoopEvent::Averaged { force_n }) => self.touched(force_n),
            (PressState::Shooting, LoopEvent::Moved { z_mm }) => {
                self.z_mm = z_mm;
                self.average(PressState::Landing)
            }
            (PressState::Landing, LoopEvent::Averaged { force_n }) => self.landed(force_n),
            (PressState::Pushing | PressState::Stepping, LoopEvent::Moved { z_mm }) => {
                self.before_mm = self.z_mm;
                self.z_mm = z_mm;
                self.average(PressState::Reading)
            }
            (PressState::Trimming, LoopEvent::Moved { z_mm }) => {
                self.z_mm = z_mm;
                self.reached()
            }
            (PressState::Reading, LoopEvent::Averaged { force_n }) => self.read(force_n),
            (PressState::Dwelling | PressState::Lingering, LoopEvent::Dwelt) => self.average(PressState::Reading),
            (PressState::Waiting, LoopEvent::Dwelt) => self.sample(),
            (PressState::Sampling, LoopEvent::Sampled { force_n }) => self.sampled(force_n),
            (PressState::Ramping, LoopEvent::Moved { z_mm }) => {
                self.z_mm = z_mm;
                self.average(PressState::Ramped)
            }
            (PressState::Ramped, LoopEvent::Averaged { force_n }) => self.ramp_ended(force_n),
            (PressState::Following, LoopEvent::Followed { force_n }) => self.followed(force_n),
            (PressState::Bracing, LoopEvent::AxesAveraged { force_n, side_n }) => self.brace(force_n, side_n),
            (PressState::Dragging, LoopEvent::Dragged { x_mm, y_mm }) => self.drag_went([x_mm, y_mm]),
            (PressState::Dragged, LoopEvent::AxesAveraged { force_n, side_n }) => self.drag_ended(force_n, side_n),
            (PressState::Retracting, LoopEvent::Moved { z_mm }) => {
                self.z_mm = z_mm;
                self.average(PressState::Leaving)
            }
            (PressState::Leaving, LoopEvent::Averaged { force_n }) => self.left(force_n),
            (PressState::LeavingContact, LoopEvent::Moved { .. }) => Ok(LoopCommand::Done),
            _ => Err(Trip::new(SafetyRule::NotPermitted, 0.0, 0.0, "event out of turn")),
        }
    }

    /// Takes the newest air reading as the zero of the forces, if the permit accepts it as air.
    fn begin(&mut self, no_load: NoLoadReadings) -> Result<LoopCommand, Trip> {
        let noise_n = self.context.zero.noise_most_n();
        // written as the positive condition, so NaN fails
        let is_quiet = no_load.sigma_n <= noise_n && no_load.readings >= NO_LOAD_READINGS;
        if !is_quiet {
            return Err(Trip::new(SafetyRule::Noisy, no_load.sigma_n, noise_n, "N"));
        }
        let moved_n = no_load.mean_n - self.context.zero.at_n(no_load.at_s);
        let sigma_n = self.context.zero.sigma_mean_n(no_load.readings);
        let (age_s, drift) = (self.context.zero_age_s, self.context.zero.drift);
        self.context.permit.zero_holds(moved_n, sigma_n, age_s, drift)?;
        if let (Some(side), Some(mean_n)) = (self.context.zero.side, no_load.side_mean_n) {
            for (moved_n, axis_sigma_n) in side.from_zero(mean_n).into_iter().zip(side.sigma_n) {
                let sigma_n = axis_sigma_n / f64::from(no_load.readings).sqrt();
                self.context.permit.zero_holds(moved_n, sigma_n, age_s, Drift::default())?;
            }
        }
        self.context.zero = self.context.zero.counted_from(&no_load);
        self.sigma_n = self.context.zero.sigma_mean_n(no_load.readings);
        (self.force_n, self.peak_n) = (0.0, 0.0);
        self.next_level()
    }

    /// Returns the earliest z at which a motion from here can meet the specimen, mm. Before the first touch, contact is possible
    /// anywhere below the heights that were measured to be free.
    fn earliest_mm(&self, from_mm: f64) -> f64 {
        if self.context.expected.touched || self.in_contact { self.first_mm } else { self.first_mm.min(from_mm) }
    }

    fn next_level(&mut self) -> Result<LoopCommand, Trip> {
        match self.level() {
            None if self.ramp_ahead() => self.ramp(),
            None if self.drag_ahead().is_some() => self.average_axes(PressState::Bracing),
            None if self.in_contact || self.z_mm > self.context.clear_mm + STEP_LEAST_MM => self.leave_contact(),
            None => Ok(LoopCommand::Done),
            Some((_, level)) if !level.set.is_loaded() && self.in_contact => self.retract(),
            Some((_, level)) if !level.set.is_loaded() => self.sample(),
            Some(_) if self.in_contact => self.average(PressState::Reading),
            Some((_, level)) => match (self.context.shot, level.set) {
                (Some(shot), SetPoint::Force(force_n))
                    if self.task.strategy == Strategy::Map && level.branch == Branch::Loading =>
                {
                    self.shoot(shot, force_n)
                }
                _ => self.descend(),
            },
        }
    }

    /// Evaluates a mean after a step. It checks that the force responded and didn't fall by itself, and then continues.
    fn read(&mut self, force_n: f64) -> Result<LoopCommand, Trip> {
        self.check_hardness(force_n)?;
        self.check_fall(force_n)?;
        self.check_rest(force_n)?;
        self.force_n = force_n;
        self.check_answer()?;
        if self.follow_until_s.is_some() {
            return self.pursue();
        }
        if self.landing.is_some() {
            return self.correct();
        }
        self.check_softness()?;
        self.learn();
        self.pursue()
    }

    /// Checks for a force that disappeared although nothing was retracted. The specimen slipped, or the cell no longer measures.
    fn check_fall(&self, force_n: f64) -> Result<(), Trip> {
        // on steel one step takes most of a small force away
        let retracted = self.before_mm > self.z_mm + self.step_mm() / 2.0;
        let least_n = LEFT_SHARE * self.force_n - TELL_SIGMAS * self.sigma_n;
        if self.in_contact && !retracted && force_n < least_n {
            return Err(Trip::new(SafetyRule::Fallen, force_n, least_n, "N"));
        }
        Ok(())
    }

    fn reached(&mut self) -> Result<LoopCommand, Trip> {
        if self.follow_until_s.is_some() {
            return self.follow();
        }
        if self.task.hold_s > 0.0 && !self.dwelt {
            self.dwelt = true;
            return self.go(PressState::Dwelling, LoopCommand::Dwell(self.task.hold_s));
        }
        if let Some(wait_s) = self.wait_s().filter(|wait_s| *wait_s > 0.0) {
            return self.go(PressState::Waiting, LoopCommand::Dwell(wait_s));
        }
        self.sample()
    }

    /// Time that remains until the first level's window, s. All presses are sampled at the same time after contact.
    fn wait_s(&self) -> Option<f64> {
        let shot = self.landing.and(self.context.shot);
        let contact_s = self.contact_s?;
        if self.level != self.first_loaded() {
            return None;
        }
        let after_s = self.task.sample_after_s.or_else(|| Some(self.after_shot_s(shot?, self.level_n())))?;
        Some(contact_s + after_s - self.moment.now_s)
    }

    fn sample(&mut self) -> Result<LoopCommand, Trip> {
        self.go(PressState::Sampling, LoopCommand::Sample(self.task.sample_s))
    }

    fn sampled(&mut self, force_n: f64) -> Result<LoopCommand, Trip> {
        self.check_fall(force_n)?;
        if self.dragged == DragProgress::Over {
            return self.leave_contact();
        }
        self.check_rest(force_n)?;
        self.check_trim(force_n)?;
        let force_set_n = self.level_n();
        if let Some(landing) = self.landing.as_mut() {
            landing.sampled(force_n, force_set_n);
        }
        self.force_n = force_n;
        self.check_stiffness()?;
        self.follow()
    }

    fn retract(&mut self) -> Result<LoopCommand, Trip> {
        let granted = self.retract_to(self.context.clear_mm)?;
        self.go(PressState::Retracting, LoopCommand::Move(granted))
    }

    fn leave_contact(&mut self) -> Result<LoopCommand, Trip> {
        let granted = self.retract_to(self.context.clear_mm)?;
        self.go(PressState::LeavingContact, LoopCommand::LeaveContact(granted))
    }

    /// Checks that the force shows no contact any more. Then the next level follows, without load.
    fn left(&mut self, force_n: f64) -> Result<LoopCommand, Trip> {
        let most_n = self.context.zero.detect_n();
        if force_n.abs() >= most_n {
            return Err(Trip::new(SafetyRule::StillTouching, force_n, most_n, "N"));
        }
        self.in_contact = false;
        self.force_n = 0.0;
        self.before_mm = self.z_mm;
        self.next_level()
    }

    fn advance(&mut self, state: PressState, z_mm: f64, speed_mm_s: f64) -> Result<LoopCommand, Trip> {
        let granted = self.grant(z_mm, speed_mm_s)?;
        self.go(state, LoopCommand::Move(granted))
    }

    /// Permits a motion toward the specimen, which begins now.
    fn grant(&mut self, z_mm: f64, speed_mm_s: f64) -> Result<Permitted, Trip> {
        let z_mm = self.in_steps_mm(z_mm);
        let granted = self.context.permit.advance(&self.context(), z_mm, speed_mm_s)?;
        self.rested = None;
        let profile =
            MotionProfile::new(z_mm - self.z_mm, granted.speed_mm_s(), self.context.timing.acceleration_mm_s2);
        self.motion =
            Some(MotionInProgress { from_mm: self.z_mm, from_n: self.force_n, began_s: self.moment.now_s, profile });
        Ok(granted)
    }

    /// Returns a trip if a contact is harder than declared. The limit comes from the declared stiffness and the deepest position
    /// that the stage can have reached (E+).
    fn harder_than_declared(&self, force_n: f64, now_s: f64) -> Option<Trip> {
        let MotionInProgress { from_mm, began_s, profile, .. } = self.motion?;
        self.harder_at(force_n, from_mm + profile.at_mm(now_s - began_s), self.earliest_mm(from_mm))
    }

    /// Checks the hardness at rest after a motion. This covers contact that was met while the motion was being stopped.
    fn check_hardness(&self, force_n: f64) -> Result<(), Trip> {
        self.harder_at(force_n, self.z_mm, self.first_mm).map_or(Ok(()), Err)
    }

    fn harder_at(&self, force_n: f64, z_mm: f64, first_mm: f64) -> Option<Trip> {
        let MotionInProgress { from_mm, from_n, .. } = self.motion?;
        let most_n = self.context.permit.most_n((from_mm, from_n), first_mm, z_mm);
        (force_n > most_n).then(|| Trip::new(SafetyRule::HardContact, force_n, most_n, "N"))
    }

    /// Retracts from the specimen. No force rule has to limit this motion.
    fn retract_to(&mut self, z_mm: f64) -> Result<Permitted, Trip> {
        (self.motion, self.rested) = (None, None);
        let z_mm = self.in_steps_mm(z_mm);
        self.context.permit.retract(self.z_mm, z_mm, self.context.speed_mm_s)
    }

    fn go(&mut self, state: PressState, command: LoopCommand) -> Result<LoopCommand, Trip> {
        self.state = state;
        Ok(command)
    }

    fn average(&mut self, state: PressState) -> Result<LoopCommand, Trip> {
        let readings = self.readings();
        self.sigma_n = self.context.zero.sigma_mean_n(readings);
        self.go(state, LoopCommand::Average(readings))
    }

    /// Number of readings for the next look at the force. It depends on the tolerance and on the available time.
    pub(super) fn readings(&self) -> u32 {
        let most_n = self.force_n.max(self.level_n());
        let least = if most_n > NEAR_LIMIT * self.context.limits.force_n { LIMIT_READINGS } else { READINGS_LEAST };
        let conversion_s = self.context.timing.conversion_s;
        let within = |share: f64, most_s: f64| {
            let wanted = (self.context.zero.noise_n / (share * self.task.force_tolerance_n)).powi(2);
            wanted.min(most_s / conversion_s) as u32
        };
        within(MEAN_SHARE, READ_S).max(within(MEAN_SHARE_MOST, READ_MOST_S)).max(least)
    }

    fn first_loaded(&self) -> usize {
        self.task.levels.iter().position(|level| level.set.is_loaded()).unwrap_or(0)
    }

    /// Adds a point to the loading path of the first level.
    fn note_path(&mut self) {
        let is_deeper = self.path.last().is_none_or(|last| self.z_mm > last.0);
        if self.level == self.first_loaded() && is_deeper && self.path.len() < PATH_MAX {
            self.path.push((self.z_mm, self.force_n));
        }
    }

    fn context(&self) -> MotionContext {
        MotionContext {
            z_mm: self.z_mm,
            force_n: self.force_n,
            sigma_n: self.sigma_n,
            age_s: self.moment.age_s,
            first_mm: self.earliest_mm(self.z_mm),
            most_mm: self.most_mm(),
        }
    }
}

#[cfg(test)]
mod tests;
