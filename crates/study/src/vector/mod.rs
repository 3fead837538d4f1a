//! Studies of force vectors and of two contacts: errors against noise, units, calibration places and separation, with their bounds.
//!
//! Taxels have one output (the normal stress) or three (the traction). They are calibrated with presses of 1 N and, for a shear, drags of
//! 0.5 N in four directions.

mod figures;
mod shear;
mod specimen;
mod two;

pub use figures::{shear_figures, two_figures};
pub use shear::{ShearRow, shear};
pub use two::{TwoRow, two_contacts};

use palpate_core::quantity::round;

/// Size of a study.
#[derive(Clone, Copy, Debug)]
pub struct VectorSize {
    /// Calibration places along a side, where this isn't studied.
    pub side: usize,
    /// Contacts of each condition.
    pub tests: usize,
    /// Whether all values of each condition are studied; otherwise the first and the last.
    pub all: bool,
}

impl VectorSize {
    /// Complete study.
    pub const WHOLE: VectorSize = VectorSize { side: 25, tests: 2000, all: true };
    /// Small study for a first look, and for tests.
    pub const QUICK: VectorSize = VectorSize { side: 7, tests: 60, all: false };

    fn of<T: Copy>(self, values: &[T]) -> Vec<T> {
        let is_end = |index: usize| index == 0 || index + 1 == values.len();
        let counted = values.iter().enumerate().filter(|(index, _)| self.all || is_end(*index));
        counted.map(|(_, value)| *value).collect()
    }
}

/// Names of taxels by their number of outputs.
fn taxels(channels: usize) -> &'static str {
    if channels == 3 { "three axes" } else { "normal" }
}

/// Median of the times of solves, us.
fn median_us(mut times_s: Vec<f64>) -> f64 {
    times_s.sort_by(f64::total_cmp);
    round(1e6 * times_s.get(times_s.len() / 2).copied().unwrap_or(f64::NAN), 1)
}
