//! Intervals, travels and limits of a specimen.

use super::Axis;

/// A closed interval, mm (or the unit in its owner's name).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower end.
    pub min: f64,
    /// Upper end.
    pub max: f64,
}

impl Range {
    /// Whether a value is in the interval, ends included; always false for NaN.
    pub fn contains(&self, value: f64) -> bool {
        value >= self.min && value <= self.max
    }

    /// Returns the end in a direction: the largest value for a positive one, else the smallest.
    pub fn end(&self, direction: f64) -> f64 {
        if direction > 0.0 { self.max } else { self.min }
    }

    /// Returns the interval, extended by a margin at both ends.
    pub fn widened(&self, by: f64) -> Range {
        Range { min: self.min - by, max: self.max + by }
    }

    /// Upper end minus lower end.
    pub fn width(&self) -> f64 {
        self.max - self.min
    }
}

/// Travel limits of each axis, in the stage frame, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Travel {
    /// Travel of x, y and z, in that order.
    pub axes: [Range; 3],
}

impl Travel {
    /// The travel of one axis.
    pub fn along(&self, axis: Axis) -> Range {
        self.axes[axis.index()]
    }
}

/// Limits of the specimen. The plan and every move are checked against them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest contact force, N.
    pub force_n: f64,
    /// Largest indentation, relative to the surface touched there, mm.
    pub depth_mm: f64,
    /// Largest stiffness of the specimen, relaxation included, N/mm. Every permit relies on this upper bound.
    pub stiffness_n_mm: f64,
}
