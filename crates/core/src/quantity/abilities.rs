//! What a stage can do in a motion, and where its motions end.

use super::Steps;

/// What a stage can do in a motion, declared by its driver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageAbilities {
    /// Whether a motion under way is stopped in time. If not, the stage finishes each motion, and no motion may need a stop.
    pub stops: bool,
    /// Whether the speed of a motion under way can change.
    pub changes_speed: bool,
    /// Whether it reports where it is during a motion, while it accepts another one.
    pub reports: bool,
    /// How late a motion begins, s.
    pub late_s: f64,
    /// Least number of steps of a motion. A shorter way needs two motions.
    pub least_steps: u32,
}

impl StageAbilities {
    /// A stage that can do everything.
    pub const FULL: StageAbilities =
        StageAbilities { stops: true, changes_speed: true, reports: true, late_s: 0.0, least_steps: 1 };

    /// A stage that finishes each motion unchanged.
    pub const FINISHES: StageAbilities =
        StageAbilities { stops: false, changes_speed: false, reports: false, late_s: 0.0, least_steps: 1 };

    /// Whether it finishes each motion, so that a stop only means that no further motion is sent.
    pub fn finishes(&self) -> bool {
        !self.stops
    }
}

/// What decides where a motion of a stage ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageBounds {
    /// Steps of the axes: a motion may end a part of a step beyond its target.
    pub steps: Steps,
    /// Whether the stage finishes every motion that it accepted.
    pub finishes: bool,
    /// Deceleration of a stop, mm/s^2.
    pub acceleration_mm_s2: f64,
}

impl StageBounds {
    /// A stage without steps that can be stopped.
    pub const fn fine(acceleration_mm_s2: f64) -> StageBounds {
        StageBounds { steps: Steps::FINE, finishes: false, acceleration_mm_s2 }
    }
}
