//! What a press is to do.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Which way a level is reached: the sensor has hysteresis, so a level reached from the wrong side is another measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branch {
    /// Only from below.
    Loading,
    /// Only from above.
    Unloading,
}

/// How a press finds its force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Strategy {
    /// A slow approach that contact stops, then steps from below: never above the force that is set.
    #[default]
    Guarded,
    /// One permitted motion whose speed follows the force that is missing, and that is stopped when it is reached.
    Velocity,
    /// One motion to where the presses before say the force will be nearly reached, then corrections; guarded where they
    /// can't say.
    Map,
}

impl Strategy {
    /// All strategies.
    pub const ALL: [Strategy; 3] = [Strategy::Guarded, Strategy::Velocity, Strategy::Map];

    /// The strategy as it stands in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Strategy::Guarded => "guarded",
            Strategy::Velocity => "velocity",
            Strategy::Map => "map",
        }
    }
}

/// One force to hold and sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// The force, N; 0: sampled in air.
    pub force_set_n: f64,
    /// The side it is reached from.
    pub branch: Branch,
}

/// What one contact is to measure, in this order.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// The levels, as they are held; presses that measure the same share them.
    pub levels: Arc<[Level]>,
    /// Largest allowed difference of the force in the window from the set one, N.
    pub force_tolerance_n: f64,
    /// Dwell at each level before its window, s.
    pub hold_s: f64,
    /// Length of the window, s.
    pub sample_s: f64,
    /// How the force is found.
    pub strategy: Strategy,
    /// When the window of the first level begins, s from contact; none: when the level is reached and held.
    pub sample_after_s: Option<f64>,
}

impl Task {
    /// The levels of one plain press.
    pub fn press(force_n: f64) -> Arc<[Level]> {
        Arc::new([Level { force_set_n: force_n, branch: Branch::Loading }])
    }

    /// The levels of a staircase: 0, step, ..., top, ..., step, 0.
    pub fn staircase(to_n: f64, step_n: f64) -> Arc<[Level]> {
        let steps = (to_n / step_n).round().max(1.0) as usize;
        let force_n = |i: usize| to_n * i as f64 / steps as f64;
        let up = (0..=steps).map(|i| Level { force_set_n: force_n(i), branch: Branch::Loading });
        let down = (0..steps).rev().map(|i| Level { force_set_n: force_n(i), branch: Branch::Unloading });
        up.chain(down).collect()
    }

    /// The largest force it asks for, N.
    pub fn most_n(&self) -> f64 {
        self.levels.iter().map(|level| level.force_set_n).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_staircase_has_nine_levels() {
        let forces: Vec<f64> = Task::staircase(2.0, 0.5).iter().map(|level| level.force_set_n).collect();
        assert_eq!(forces, [0.0, 0.5, 1.0, 1.5, 2.0, 1.5, 1.0, 0.5, 0.0]);
        let last = Task::staircase(2.0, 0.5)[5];
        assert_eq!(last, Level { force_set_n: 1.5, branch: Branch::Unloading });
    }
}
