//! The curves of the paper's Figures 3 to 5.

use super::array::StudiedArray;
use super::turning::PathSearch;
use palpate_core::mechanics::lambda;
use palpate_core::quantity::Place;
use std::f64::consts::PI;

/// Largest distance of the second contact in Figure 4, depths.
pub(super) const FIGURE_4_TO: f64 = 2.0;
/// Length of the line in Figure 5, depths.
pub(super) const FIGURE_5_TO: f64 = 8.0;
/// Units of Figures 4b and 5.
pub(super) const UNITS: usize = 9;
/// Distance between points of a curve, depths.
const STEP: f64 = 0.025;
/// Step along a path that misses no turn, depths.
const WALK_STEP: f64 = 0.02;
/// End of Figure 3, depths.
const FIGURE_3_TO: f64 = 3.0;

/// r of two contacts on a line of units, as a function of the second contact's position; all in depths H.
#[derive(Clone, Debug, PartialEq)]
pub struct LineCurve {
    /// Figure of the paper that contains the curve. Figure 4a varies the number of units, 4b their spacing, 5 the position of the
    /// first contact.
    pub figure: &'static str,
    /// Number of units in the line, the first at 0.
    pub n: usize,
    /// Distance from one unit to the next.
    pub s: f64,
    /// Position of the first contact.
    pub d1: f64,
    /// Position of the second contact, and r; `None` if r is 0/0.
    pub points: Vec<(f64, Option<f64>)>,
}

/// Returns Figure 3: k and lambda.
pub(super) fn lambda_curve() -> Vec<(f64, f64)> {
    let last = (FIGURE_3_TO / STEP).round() as usize;
    (0..=last).map(|index| index as f64 * STEP).map(|k| (k, lambda(k))).collect()
}

/// Returns Figures 4a, 4b and 5.
pub(super) fn curves() -> Vec<LineCurve> {
    let of_units = (2..=15).map(|n| curve("4a", n, 1.0, 0.0, FIGURE_4_TO));
    let of_spacing = (1..=10).map(|k| curve("4b", UNITS, 0.2 * f64::from(k), 0.0, FIGURE_4_TO));
    let of_start = (0..6).map(|k| curve("5", UNITS, 1.0, 1.5 * f64::from(k), FIGURE_5_TO));
    of_units.chain(of_spacing).chain(of_start).collect()
}

fn curve(figure: &'static str, n: usize, s: f64, d1: f64, to: f64) -> LineCurve {
    let array = StudiedArray::line(n, s);
    let last = (to / STEP).round() as usize;
    let point = |d2: f64| (d2, array.r(on_line(d1), on_line(d2)));
    LineCurve { figure, n, s, d1, points: (0..=last).map(|index| point(index as f64 * STEP)).collect() }
}

impl LineCurve {
    /// Returns the distances from the first contact at which r turns, to the left and to the right.
    pub(crate) fn turnings(&self) -> [Option<f64>; 2] {
        let array = StudiedArray::line(self.n, self.s);
        let to = self.points.last().map_or(0.0, |(d2, _)| *d2);
        [follow_left(&array, self.d1), follow_right(&array, self.d1, to)].map(|follow| follow.turning_mm)
    }
}

/// Returns a place on the line.
pub(super) fn on_line(d: f64) -> Place {
    Place::new(d, 0.0)
}

/// Follows the line from d1 to the right, up to `to`.
pub(super) fn follow_right(array: &StudiedArray, d1: f64, to: f64) -> PathSearch {
    array.follow(on_line(d1), 0.0, to - d1, WALK_STEP)
}

/// Follows the line from d1 to the left, down to 0.
pub(super) fn follow_left(array: &StudiedArray, d1: f64) -> PathSearch {
    array.follow(on_line(d1), PI, d1, WALK_STEP)
}
