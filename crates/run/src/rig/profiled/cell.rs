//! What an emulated load cell measures, and whether its numbers can hold it.

use crate::rig::axes::CellAxes;
use crate::rig::spec::RigSpec;
use palpate_core::quantity::Range;
use palpate_sim::emulator::lines::{STRAIGHT, read_axes};
use palpate_sim::scene::Scene;

/// Ratio of an emulated load cell's range to the force for which it is designed.
pub(in crate::rig) const RANGE_OVER_LIMIT: f64 = 2.5;

/// Steps of 1 in a message about a number: more digits would be those of a division.
const SHOWN_STEPS: f64 = 1000.0;

/// A load cell with one axis or three.
#[derive(Clone, Copy, Debug)]
pub(in crate::rig) struct ProfiledCell {
    /// Matrix from the forces of the tip along x, y and the press to those along the cell's axes; `None` for one axis.
    mounting: Option<[[f64; 3]; 3]>,
    range_n: f64,
    limit_n: f64,
}

impl ProfiledCell {
    /// Creates the load cell of a rig. `range_n` is the largest force that its profile admits.
    pub(in crate::rig) fn new(rig: &RigSpec, has_axes: bool, range_n: Option<f64>) -> Self {
        let mounting = has_axes.then(|| rig.load_cell.axes.as_ref().map_or(STRAIGHT, CellAxes::to_device));
        let range_n = range_n.unwrap_or(f64::INFINITY).min(most_n(rig));
        ProfiledCell { mounting, range_n, limit_n: rig.limits.force_n }
    }

    /// Largest force that it measures, N.
    pub(in crate::rig) fn range_n(&self) -> f64 {
        self.range_n
    }

    /// Returns the forces along its axes, N; of one axis the first. Also returns whether one is beyond its range.
    pub(super) fn read(&self, scene: &mut Scene, now_s: f64) -> ([f64; 3], bool) {
        match &self.mounting {
            Some(mounting) => read_axes(scene, now_s, mounting, self.range_n),
            None => {
                let force_n = scene.load_cell_n(now_s);
                ([force_n.clamp(-self.range_n, self.range_n), 0.0, 0.0], force_n.abs() > self.range_n)
            }
        }
    }

    /// Checks that numbers within a range can hold the forces of a run.
    ///
    /// # Errors
    /// What they can't hold, in words.
    pub(in crate::rig) fn check(&self, number: impl Fn(f64) -> f64, range: Option<Range>) -> Result<(), String> {
        let Some(range) = range else { return Ok(()) };
        // a push is along either direction of an axis
        let forces_n = [0.0, self.limit_n, if self.mounting.is_some() { -self.limit_n } else { 0.0 }];
        let beyond = forces_n.into_iter().find(|force_n| !range.contains(number(*force_n)));
        beyond.map_or(Ok(()), |force_n| {
            let text = format!(
                "{force_n} N is the number {}, but its numbers go from {} to {}: correct `newton_per_unit` or `offset`",
                (number(force_n) * SHOWN_STEPS).round() / SHOWN_STEPS,
                range.min,
                range.max
            );
            Err(text)
        })
    }
}

/// Returns the largest force that an emulated load cell of a rig measures, N.
pub(in crate::rig) fn most_n(rig: &RigSpec) -> f64 {
    RANGE_OVER_LIMIT * rig.full_scale_n.unwrap_or(rig.limits.force_n)
}
