//! Following a level over time after its window, at rest or with the force restored.

use super::ForceLoop;
use super::dialogue::LoopCommand;
use super::state::PressState;
use crate::trip::{SafetyRule, Trip};

/// Time after which a force is restored, s. Within it a specimen loses a small part of its force.
const RESTORE_S: f64 = 1.0;

/// Shortest time that is followed, s.
const FOLLOW_LEAST_S: f64 = 1e-3;

impl ForceLoop {
    /// Follows the present level for as long as its task says, then goes to the next one.
    pub(super) fn follow(&mut self) -> Result<LoopCommand, Trip> {
        let all_s = self.task.follow_s(self.level);
        let left_s = self.follow_until_s.map_or(all_s, |until_s| until_s - self.moment.now_s);
        // written as the positive condition, so NaN ends it
        let remains = left_s >= FOLLOW_LEAST_S;
        if !remains {
            self.level += 1;
            self.steps = 0;
            (self.dwelt, self.follow_until_s) = (false, None);
            return self.next_level();
        }
        self.follow_until_s.get_or_insert(self.moment.now_s + all_s);
        let part_s = if self.restores_force() { left_s.min(RESTORE_S) } else { left_s };
        self.go(PressState::Following, LoopCommand::Follow(part_s))
    }

    /// Ends a time for which the level was followed. A force may relax by any part, but it doesn't disappear. To restore it, the
    /// loop reads it as after each motion: the rules for a cell that doesn't follow bound how much deeper the tip goes.
    pub(super) fn followed(&mut self, force_n: f64) -> Result<LoopCommand, Trip> {
        let least_n = self.context.zero.detect_n();
        if self.in_contact && force_n < least_n {
            return Err(Trip::new(SafetyRule::Fallen, force_n, least_n, "N"));
        }
        if self.restores_force() {
            self.steps = 0;
            return self.average(PressState::Reading);
        }
        // before the next level, a force without load is contact, or a zero that drifted too far to count from
        if !self.in_contact && force_n.abs() >= least_n && self.level + 1 < self.task.levels.len() {
            return Err(Trip::new(SafetyRule::StillTouching, force_n, least_n, "N"));
        }
        (self.force_n, self.rested) = (force_n, None);
        self.follow()
    }

    fn restores_force(&self) -> bool {
        self.in_contact && self.task.holds_force()
    }
}
