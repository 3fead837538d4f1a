//! Intervals, travels and what a specimen bears.

use super::Axis;

/// A closed interval, mm (or the unit its owner's name says).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower end.
    pub min: f64,
    /// Upper end.
    pub max: f64,
}

impl Range {
    /// Whether a value lies in the interval, ends included; never for NaN.
    pub fn contains(&self, value: f64) -> bool {
        value >= self.min && value <= self.max
    }

    /// The interval, longer by a margin at either end.
    pub fn widened(&self, by: f64) -> Range {
        Range { min: self.min - by, max: self.max + by }
    }

    /// Upper less lower end.
    pub fn width(&self) -> f64 {
        self.max - self.min
    }
}

/// How far each axis may travel, in the stage frame, mm.
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

/// What the specimen bears: the plan and every move are checked against these.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest contact force, N.
    pub force_n: f64,
    /// Largest indentation, counted from the surface as touched there, mm.
    pub depth_mm: f64,
    /// Largest stiffness the specimen shows, relaxation included, N/mm: an upper bound on which every permit rests.
    pub stiffness_n_mm: f64,
}
