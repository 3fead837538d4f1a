//! Task of a press.

use super::drag::Drag;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Direction from which a level is reached. The sensor has hysteresis, so a level reached from the wrong side is a different
/// measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branch {
    /// Only from below.
    Loading,
    /// Only from above.
    Unloading,
}

/// Method by which a press reaches its force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Strategy {
    /// A slow approach that contact stops, then steps from below. The force never exceeds the set force.
    #[default]
    Guarded,
    /// One permitted motion. Its speed follows the missing force, and it is stopped when the force is reached.
    Velocity,
    /// One motion to the position where earlier presses predict nearly the full force, then corrections. The press is guarded if
    /// they can't predict it.
    Map,
}

impl Strategy {
    /// All strategies.
    pub const ALL: [Strategy; 3] = [Strategy::Guarded, Strategy::Velocity, Strategy::Map];

    /// Name of the strategy in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Strategy::Guarded => "guarded",
            Strategy::Velocity => "velocity",
            Strategy::Map => "map",
        }
    }
}

/// What a level reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SetPoint {
    /// A force, N; 0 is sampled without load.
    Force(f64),
    /// A depth below the surface that the press touched, mm.
    Depth(f64),
}

impl SetPoint {
    /// The set force, N; `None` for a depth.
    pub fn force_n(self) -> Option<f64> {
        match self {
            SetPoint::Force(force_n) => Some(force_n),
            SetPoint::Depth(_) => None,
        }
    }

    /// The set depth, mm; `None` for a force.
    pub fn depth_mm(self) -> Option<f64> {
        match self {
            SetPoint::Force(_) => None,
            SetPoint::Depth(depth_mm) => Some(depth_mm),
        }
    }

    /// Whether the level is in contact.
    pub fn is_loaded(self) -> bool {
        self != SetPoint::Force(0.0)
    }
}

/// One force or depth to hold and sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressLevel {
    /// The force or the depth.
    pub set: SetPoint,
    /// Side from which the level is reached. A depth is only reached from above.
    pub branch: Branch,
}

/// What a press does over time after the windows of its levels, while all devices are read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OverTime {
    /// Times for which the levels are followed, s, in their order; 0 or none: not at all.
    pub follow_s: Vec<f64>,
    /// Whether the force is restored meanwhile; otherwise z rests.
    pub holds_force: bool,
    /// Speeds of ramps away from the specimen and back to where the level was held, mm/s.
    pub ramps_mm_s: Vec<f64>,
}

/// Measurements of one contact, in this order.
#[derive(Clone, Debug, PartialEq)]
pub struct PressTask {
    /// The levels, in the order they are held. Presses that measure the same use the same list.
    pub levels: Arc<[PressLevel]>,
    /// Largest allowed difference between the force in the window and the set force, N.
    pub force_tolerance_n: f64,
    /// Largest allowed difference between depth and set depth, mm.
    pub depth_tolerance_mm: f64,
    /// Dwell at each level before its window, s.
    pub hold_s: f64,
    /// Length of the window, s.
    pub sample_s: f64,
    /// Method by which the force is reached.
    pub strategy: Strategy,
    /// Time at which the window of the first level begins, s from contact. `None`: the window begins when the level is reached
    /// and held.
    pub sample_after_s: Option<f64>,
    /// What is followed over time; `None`: nothing. Presses with the same share it.
    pub over_time: Option<Arc<OverTime>>,
    /// Drag after the last level, which is sampled at its end; `None`: none. Presses with the same drag share it: a plan may have a
    /// million of them.
    pub drag: Option<Arc<Drag>>,
}

impl PressTask {
    /// Returns the levels of one plain press.
    pub fn press(force_n: f64) -> Arc<[PressLevel]> {
        Self::one(SetPoint::Force(force_n))
    }

    /// Returns the levels of one plain press to a force or a depth.
    pub fn one(set: SetPoint) -> Arc<[PressLevel]> {
        Arc::new([PressLevel { set, branch: Branch::Loading }])
    }

    /// Returns the levels of forces, one after another; each is reached from the force before.
    pub fn forces(forces_n: &[f64]) -> Arc<[PressLevel]> {
        let level = |(index, force_n): (usize, &f64)| {
            let before_n = index.checked_sub(1).map_or(0.0, |before| forces_n[before]);
            let branch = if *force_n < before_n { Branch::Unloading } else { Branch::Loading };
            PressLevel { set: SetPoint::Force(*force_n), branch }
        };
        forces_n.iter().enumerate().map(level).collect()
    }

    /// Returns the levels of a staircase: 0, step, ..., top, ..., step, 0.
    pub fn staircase(to_n: f64, step_n: f64) -> Arc<[PressLevel]> {
        let steps = (to_n / step_n).round().max(1.0) as usize;
        let force_n = |i: usize| to_n * i as f64 / steps as f64;
        let level = |i, branch| PressLevel { set: SetPoint::Force(force_n(i)), branch };
        let up = (0..=steps).map(|i| level(i, Branch::Loading));
        let down = (0..steps).rev().map(|i| level(i, Branch::Unloading));
        up.chain(down).collect()
    }

    /// Time for which a level is followed after its window, s.
    pub fn follow_s(&self, level: usize) -> f64 {
        self.over_time.as_ref().and_then(|over_time| over_time.follow_s.get(level).copied()).unwrap_or(0.0)
    }

    /// Time for which all levels are followed, s.
    pub fn followed_s(&self) -> f64 {
        self.over_time.as_ref().map_or(0.0, |over_time| over_time.follow_s.iter().sum())
    }

    /// Whether the force of a level that is followed is restored.
    pub fn holds_force(&self) -> bool {
        self.over_time.as_ref().is_some_and(|over_time| over_time.holds_force)
    }

    /// Speeds of the ramps after the last level, mm/s.
    pub fn ramps_mm_s(&self) -> &[f64] {
        self.over_time.as_ref().map_or(&[], |over_time| &over_time.ramps_mm_s)
    }

    /// The drag after the last level.
    pub fn drag(&self) -> Option<Drag> {
        self.drag.as_deref().copied()
    }

    /// What a sampled level was set to. The window after a drag belongs to the last level.
    pub fn level_set(&self, level: usize) -> SetPoint {
        self.levels.get(level).or(self.levels.last()).map_or(SetPoint::Force(0.0), |level| level.set)
    }

    /// Largest set force of the task, N; 0 for a press to a depth.
    pub fn most_n(&self) -> f64 {
        self.levels.iter().filter_map(|level| level.set.force_n()).fold(0.0, f64::max)
    }

    /// Largest set depth of the task, mm; 0 for a press to a force.
    pub fn most_mm(&self) -> f64 {
        self.levels.iter().filter_map(|level| level.set.depth_mm()).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn staircase_of_the_paper_has_nine_levels() {
        let forces: Vec<f64> = PressTask::staircase(2.0, 0.5).iter().filter_map(|level| level.set.force_n()).collect();
        assert_eq!(forces, [0.0, 0.5, 1.0, 1.5, 2.0, 1.5, 1.0, 0.5, 0.0]);
        let last = PressTask::staircase(2.0, 0.5)[5];
        assert_eq!(last, PressLevel { set: SetPoint::Force(1.5), branch: Branch::Unloading });
    }
}
