//! Depth that the presses so far needed for their force. The next press near them is compared with it.

use super::curve::CurveShape;
use palpate_core::quantity::Place;

/// Least number of presses for a comparison.
const PRESSES_LEAST: usize = 4;
/// Number of presses that are remembered. The second constant is the number of nearest presses for the comparison.
const PRESSES_MAX: usize = 2048;
const NEAREST: usize = 8;
/// Least rise of the force for a press to be remembered, as a fraction of its final force.
const ROSE_SHARE: f64 = 0.5;

/// Rise of the force that a press showed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rise {
    /// Force at the start and at the end, N.
    pub from_n: f64,
    pub to_n: f64,
    /// Distance that the rise took, mm.
    pub way_mm: f64,
}

/// Rises that the presses have shown.
#[derive(Clone, Debug, Default)]
pub(super) struct Rises {
    all: Vec<(Place, Rise)>,
}

/// Information from the presses around a place: the softest of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taught {
    shape: CurveShape,
    /// Ratio of the distance to that on the curve.
    softest: f64,
}

impl Rises {
    /// Adds a rise. If there is no room left, the new rise replaces the nearest one.
    pub(crate) fn learn(&mut self, place: Place, rise: Rise) {
        let tells = rise.to_n - rise.from_n >= ROSE_SHARE * rise.to_n && rise.way_mm > 0.0;
        if !tells {
            return;
        }
        if self.all.len() < PRESSES_MAX {
            self.all.push((place, rise));
            return;
        }
        let distance_mm = |at: &Place| at.distance_mm(place);
        let nearest = self.all.iter_mut().min_by(|(a, _), (b, _)| distance_mm(a).total_cmp(&distance_mm(b)));
        nearest.into_iter().for_each(|near| *near = (place, rise));
    }

    /// Returns the information from the presses around a place; `None` if there are too few.
    pub(crate) fn around(&self, place: Place, shape: Option<CurveShape>) -> Option<Taught> {
        let shape = shape?;
        let mut near: Vec<(f64, usize)> =
            self.all.iter().enumerate().map(|(i, (at, _))| (at.distance_mm(place), i)).collect();
        if near.len() < PRESSES_LEAST {
            return None;
        }
        let count = near.len().min(NEAREST);
        near.select_nth_unstable_by(count - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let softness = |(_, i): &(f64, usize)| {
            let Rise { from_n, to_n, way_mm } = self.all[*i].1;
            way_mm / (shape.depth_mm(to_n) - shape.depth_mm(from_n))
        };
        let softest = near[..count].iter().map(softness).fold(0.0, f64::max);
        (softest.is_finite() && softest > 0.0).then_some(Taught { shape, softest })
    }
}

impl Taught {
    /// Longest distance that a rise of the force needed around that place, mm.
    pub fn way_mm(&self, from_n: f64, to_n: f64) -> f64 {
        self.softest * (self.shape.depth_mm(to_n) - self.shape.depth_mm(from_n))
    }

    /// Force, N, of the softest of them at a position deeper by `way_mm` than where the force is `from_n`.
    pub fn force_n(&self, from_n: f64, way_mm: f64) -> f64 {
        self.shape.force_n(self.shape.depth_mm(from_n) + way_mm / self.softest)
    }
}
