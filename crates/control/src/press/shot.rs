//! The map's press. One motion goes to the position where nearly the full force is expected from earlier presses. A correction
//! from below follows. A late trim allows for the force that will fade until the sampling.

use super::guarded::LEARN_SHARE;
use super::state::{ForceLoop, Landing, PressState, STEP_LEAST_MM, STEPS_MAX, TELL_SIGMAS};
use super::{Branch, LoopCommand, SafetyRule, Steer, Trip};
use crate::map::{LearnedContact, Shot};
use crate::profile::MotionProfile;
use palpate_core::quantity::Place;

/// Distance below the set force at which a correction before the last one ends. It is at least this fraction of the force, and of
/// the gap to be closed.
const SHORT_OF_FORCE: f64 = 0.01;
const SHORT_OF_GAP: f64 = 0.05;
/// Largest gap that the last trim closes, in tolerances. The stiffness is known to a twentieth.
const TRIM_TOLERANCES: f64 = 3.0;
/// Assumed rise of the trim for which time is reserved, as a fraction of the set force.
const TRIM_SHARE: f64 = 0.03;
/// Assumed rise of the correction before the trim, as a fraction of the set force.
const CORRECTION_SHARE: f64 = 0.1;
/// Wait before the last trim that is too short for another look at the force, s.
const SHORT_WAIT_S: f64 = 0.005;
/// Clearance from which a shot is assumed to start, mm.
const START_MM: f64 = 0.1;
/// Step to which the time from contact to the window is rounded up, s.
const GRAIN_S: f64 = 0.01;
/// Number of exchanges assumed for a motion, each as long as the longest exchange seen. They start the motion and report its end.
const EXCHANGES: f64 = 1.2;
/// Excess over the set force that stops a motion in progress, as a fraction of the set force.
const OVER_SHARE: f64 = 0.02;
/// Least fraction of the expected force that a shot must meet, and additional allowance, N (E-).
const MET_SHARE: f64 = 0.4;
const MET_N: f64 = 0.05;

impl Landing {
    /// Records the end of the first level's window.
    pub(super) fn sampled(&mut self, force_n: f64, force_set_n: f64) {
        self.faded.get_or_insert((self.left_n - force_n) / force_set_n);
    }

    pub(super) fn learned_contact(&self, place: Place) -> Option<LearnedContact> {
        let Landing { z_mm, force_n, expected_n, faded, .. } = *self;
        Some(LearnedContact::Shot { place, z_mm, force_n, expected_n, faded: faded? })
    }
}

impl ForceLoop {
    /// Moves to the position where the aim will be met, or as far as permitted. If this position isn't inside the specimen, the
    /// press continues guarded.
    pub(super) fn shoot(&mut self, shot: Shot, force_set_n: f64) -> Result<LoopCommand, Trip> {
        let wanted_mm = shot.z_mm(shot.aim_n(force_set_n));
        let target_mm = wanted_mm.min(self.context.permit.deepest_mm(&self.context()));
        if shot.force_n(target_mm) < self.context.zero.detect_n() {
            return self.descend();
        }
        self.advance(PressState::Shooting, target_mm, self.context.speed_mm_s)
    }

    /// Evaluates the first look at the force after the shot.
    pub(super) fn landed(&mut self, force_n: f64) -> Result<LoopCommand, Trip> {
        let Some(shot) = self.context.shot else { return self.descend() };
        self.check_hardness(force_n)?;
        let expected_n = shot.force_n(self.z_mm);
        let least_n = MET_SHARE * expected_n - MET_N.max(TELL_SIGMAS * self.sigma_n);
        if force_n < least_n {
            return Err(Trip::new(SafetyRule::NoResponse, force_n, least_n, "N"));
        }
        self.force_n = force_n;
        self.check_shot_softness()?;
        if force_n < self.context.zero.detect_n() / 2.0 {
            return self.approach();
        }
        self.make_contact(force_n);
        (self.answered, self.before_mm) = ((self.z_mm, force_n), self.z_mm);
        self.note_path();
        self.landing = Some(Landing { z_mm: self.z_mm, force_n, expected_n, left_n: force_n, faded: None });
        self.correct()
    }

    /// Moves closer to the force from below. The last trim goes above the set force by the amount that the force will fade.
    pub(super) fn correct(&mut self) -> Result<LoopCommand, Trip> {
        let (Some(landing), Some(shot), Some(_)) = (self.landing, self.context.shot, self.level()) else {
            return self.pursue();
        };
        let set_n = self.level_n();
        let goal_n = set_n * (1.0 + shot.faded.max(0.0));
        let gap_n = goal_n - self.force_n;
        let declared = self.context.limits.stiffness_n_mm;
        // a large remaining gap isn't closed by the apparent result of the shot
        let stiffness = if gap_n > LEARN_SHARE * set_n {
            declared
        } else {
            shot.stiffness_n_mm(set_n, landing.z_mm, landing.force_n).min(declared)
        };
        self.leave(self.force_n);
        let Some(way_mm) = self.way_mm(gap_n / stiffness).filter(|_| gap_n >= STEP_LEAST_MM * stiffness) else {
            return self.reached();
        };
        self.steps += 1;
        if self.steps > STEPS_MAX {
            return Err(Trip::new(SafetyRule::NoConvergence, self.force_n, set_n, "N"));
        }
        let trim_most_n = TRIM_TOLERANCES * self.task.force_tolerance_n;
        if gap_n > trim_most_n {
            // short of it, but near enough for one last correction
            let short_n = (SHORT_OF_FORCE * set_n).max(SHORT_OF_GAP * gap_n).min(trim_most_n / 2.0);
            let short_mm = self.way_mm((gap_n - short_n) / stiffness).unwrap_or(way_mm);
            return self.step_to(PressState::Stepping, self.z_mm + short_mm);
        }
        // a late correction has less time to relax
        let trim_s = self.trim_s(gap_n / stiffness);
        let linger_s = self.wait_s().unwrap_or(0.0) - trim_s - self.reading_s();
        if linger_s > SHORT_WAIT_S {
            return self.go(PressState::Lingering, LoopCommand::Dwell(linger_s));
        }
        let before_mm = self.z_mm;
        let command = self.step_to(PressState::Trimming, before_mm + way_mm)?;
        if let LoopCommand::Move(granted) = &command {
            self.leave(self.force_n + stiffness * (granted.z_mm() - before_mm));
        }
        Ok(command)
    }

    /// Checks that the window's force isn't far above the force that the last trim aimed at.
    pub(super) fn check_trim(&self, force_n: f64) -> Result<(), Trip> {
        let Some(landing) = self.landing.filter(|landing| landing.faded.is_none()) else { return Ok(()) };
        let most_n = landing.left_n + TRIM_TOLERANCES * self.task.force_tolerance_n + TELL_SIGMAS * self.sigma_n;
        if force_n > most_n { Err(Trip::new(SafetyRule::RisesAtRest, force_n, most_n, "N")) } else { Ok(()) }
    }

    /// Stops a shot or a step that meets more force than it should.
    pub(super) fn hold_below(&self, force_n: f64) -> Steer {
        if !self.level().is_some_and(|(_, level)| level.branch == Branch::Loading) {
            return Steer::On; // coming from above, the force is higher
        }
        let most_n = self.level_n();
        let over_n = (OVER_SHARE * most_n).max(TELL_SIGMAS * self.context.zero.sigma_n);
        if force_n > most_n + over_n { Steer::Stop } else { Steer::On }
    }

    /// Returns the time from contact to the window for a press that begins with a shot, s. It depends on the curve and the rig's
    /// timing, not on the press. So every place is sampled after the same relaxation.
    pub(super) fn after_shot_s(&self, shot: Shot, force_set_n: f64) -> f64 {
        let (depth_mm, stiffness) = shot.on_curve(force_set_n);
        let timing = &self.context.timing;
        let whole = MotionProfile::new(START_MM + depth_mm, self.context.speed_mm_s, timing.acceleration_mm_s2);
        let shot_s = whole.duration_s() - whole.reaches_s(START_MM) + timing.settle_s;
        let look_and_trim_s = |share| self.reading_s() + self.trim_s(share * force_set_n / stiffness);
        // where mains interference makes readings long, a press with a correction would be sampled later than one without, and its force
        // would relax less: time is reserved for the correction
        let correction_s = self.context.zero.mains.map_or(0.0, |_| look_and_trim_s(CORRECTION_SHARE));
        let total_s = shot_s + correction_s + look_and_trim_s(TRIM_SHARE) + self.task.hold_s;
        (total_s / GRAIN_S).ceil() * GRAIN_S
    }

    /// Duration of a trim until the stage is at rest, s.
    fn trim_s(&self, way_mm: f64) -> f64 {
        let timing = &self.context.timing;
        let way = MotionProfile::new(way_mm, self.context.speed_mm_s, timing.acceleration_mm_s2);
        EXCHANGES * timing.exchange_s + way.duration_s() + timing.settle_s
    }

    /// Duration of a look at the force, s. If there is mains interference, it is a whole number of periods of the mains interference.
    fn reading_s(&self) -> f64 {
        self.context.zero.mean_s(f64::from(self.readings()) * self.context.timing.conversion_s)
    }

    fn leave(&mut self, force_n: f64) {
        if let Some(landing) = self.landing.as_mut() {
            landing.left_n = force_n;
        }
    }
}
