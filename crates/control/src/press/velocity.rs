//! The velocity press: one finite, permitted motion toward the force. Its speed is proportional to the missing force, and it
//! stops when little is missing. If the host fails, the motion still ends at its safe point. The guarded press does the rest.

use super::state::{ForceLoop, PressState, Push, STEP_LEAST_MM};
use super::{LoopCommand, Steer, Trip};

/// Gain times dead time. There is no overshoot up to 1/e; this value leaves room for a dead time longer than measured (CONTROL
/// 3.1).
pub const GAIN_TIMES_DEAD_TIME: f64 = 0.30;
/// Slowest speed that is ordered, mm/s. Below it, steps are quicker.
const SLOWEST_MM_S: f64 = 0.05;
/// Shortest time between two orders, s. The second constant is the least number of longest exchanges that it spans.
const PERIOD_LEAST_S: f64 = 0.010;
const PERIOD_EXCHANGES: f64 = 2.0;
/// Ratio of a speed to the last ordered speed at or below which a new order is sent.
const SLOWER: f64 = 0.9;
/// Distance of the target below the set force, in sd of a mean.
const BELOW_SIGMAS: f64 = 4.0;

impl ForceLoop {
    /// Moves toward the force, at a speed that is safe for the dead time of the rig.
    pub(super) fn push(&mut self) -> Result<LoopCommand, Trip> {
        if self.level().is_none() {
            return self.leave_contact();
        }
        let goal_n = self.level_n().min(self.context.limits.force_n) - BELOW_SIGMAS * self.sigma_n;
        let speed_mm_s = self.speed_for(goal_n - self.force_n).min(self.context.speed_mm_s);
        let target_mm = self.in_steps_mm(self.context.permit.deepest_mm(&self.context()));
        if speed_mm_s < SLOWEST_MM_S || target_mm - self.z_mm < STEP_LEAST_MM {
            return self.pursue();
        }
        self.push = Push { goal_n, speed_mm_s, ordered_s: self.moment.now_s, sum_n: 0.0, count: 0.0 };
        self.advance(PressState::Pushing, target_mm, speed_mm_s)
    }

    /// Decides how the motion continues after a reading.
    pub(super) fn steer(&mut self, force_n: f64, now_s: f64) -> Steer {
        self.push.sum_n += force_n;
        self.push.count += 1.0;
        if now_s - self.push.ordered_s < self.period_s() {
            return Steer::On;
        }
        let mean_n = self.push.sum_n / self.push.count;
        (self.push.sum_n, self.push.count, self.push.ordered_s) = (0.0, 0.0, now_s);
        let speed_mm_s = self.speed_for(self.push.goal_n - mean_n);
        if speed_mm_s < SLOWEST_MM_S {
            return Steer::Stop;
        }
        if speed_mm_s > SLOWER * self.push.speed_mm_s {
            return Steer::On;
        }
        self.push.speed_mm_s = speed_mm_s;
        Steer::Speed(speed_mm_s)
    }

    /// Returns the speed for a missing force. It uses the declared stiffness, which the specimen never exceeds, so the loop is
    /// never faster than allowed.
    fn speed_for(&self, missing_n: f64) -> f64 {
        let dead_time_s = self.context.timing.reaction_s + self.period_s() / 2.0;
        GAIN_TIMES_DEAD_TIME / dead_time_s * missing_n.max(0.0) / self.context.limits.stiffness_n_mm
    }

    fn period_s(&self) -> f64 {
        (PERIOD_EXCHANGES * self.context.timing.exchange_s).max(PERIOD_LEAST_S)
    }
}
