//! What a stage can do in a motion.

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
