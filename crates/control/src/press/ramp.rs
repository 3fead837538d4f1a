//! Ramps after the last level: at constant speeds away from the specimen, and back to where the level was held.
//!
//! The force there is known, and each motion toward it passes the permit from a force that was read at rest.

use super::dialogue::LoopCommand;
use super::state::{PressState, STEP_LEAST_MM};
use super::{ForceLoop, READINGS_LEAST};
use crate::permit::{MotionContext, Permitted};
use crate::trip::{SafetyRule, Trip};

/// Distance from the surface at which a ramp away from it ends, mm.
const CLEAR_MM: f64 = 0.05;

/// Part of the force that shows contact which may remain at the end of a ramp away.
const AIR_SHARE: f64 = 0.9;

/// Progress of the ramps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RampProgress {
    /// Number of motions so far: one away and one back for each speed.
    made: usize,
    /// z where the level was held, mm.
    held_mm: f64,
}

impl ForceLoop {
    /// Whether ramps remain to be made.
    pub(super) fn ramp_ahead(&self) -> bool {
        self.in_contact && self.ramped.made < 2 * self.task.ramps_mm_s().len()
    }

    /// Begins the next motion of the ramps, no faster than the rig allows.
    pub(super) fn ramp(&mut self) -> Result<LoopCommand, Trip> {
        let asked_mm_s = self.task.ramps_mm_s().get(self.ramped.made / 2).copied().unwrap_or_default();
        let speed_mm_s = asked_mm_s.min(self.context.speed_mm_s);
        let granted = match self.ramped.made.is_multiple_of(2) {
            true => self.ramp_away(speed_mm_s)?,
            false => self.grant(self.ramped.held_mm, speed_mm_s)?,
        };
        self.ramped.made += 1;
        self.go(PressState::Ramping, LoopCommand::Ramp(granted))
    }

    /// Permits a motion away from the specimen, only if the way back would be permitted.
    fn ramp_away(&mut self, speed_mm_s: f64) -> Result<Permitted, Trip> {
        let surface_mm = self.touched_mm().unwrap_or(self.first_mm).min(self.first_mm).min(self.z_mm);
        let clear_mm = self.in_steps_mm(surface_mm - CLEAR_MM);
        // without load, the force may be anything that doesn't show contact, of the fewest readings
        let (force_n, sigma_n) =
            (AIR_SHARE * self.context.zero.detect_n(), self.context.zero.sigma_mean_n(READINGS_LEAST));
        let there = MotionContext { z_mm: clear_mm, force_n, sigma_n, ..self.context() };
        let deepest_mm = self.context.permit.deepest_mm(&there);
        if self.z_mm > deepest_mm {
            return Err(Trip::new(SafetyRule::OutOfReach, self.z_mm, deepest_mm, "mm"));
        }
        (self.ramped.held_mm, self.motion) = (self.z_mm, None);
        self.context.permit.retract(self.z_mm, clear_mm, speed_mm_s)
    }

    /// Takes the force at rest at the end of a motion. A ramp that came back must show the contact again.
    pub(super) fn ramp_ended(&mut self, force_n: f64) -> Result<LoopCommand, Trip> {
        self.check_hardness(force_n)?;
        let (is_away, detect_n) = (!self.ramped.made.is_multiple_of(2), self.context.zero.detect_n());
        if is_away && force_n > AIR_SHARE * detect_n {
            return Err(Trip::new(SafetyRule::StillTouching, force_n, AIR_SHARE * detect_n, "N"));
        }
        let is_back = !is_away && self.z_mm >= self.ramped.held_mm - STEP_LEAST_MM;
        if is_back && force_n < detect_n / 2.0 {
            return Err(Trip::new(SafetyRule::Fallen, force_n, detect_n / 2.0, "N"));
        }
        (self.force_n, self.rested) = (force_n, None);
        self.next_level()
    }
}
