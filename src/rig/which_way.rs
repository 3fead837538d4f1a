//! What no measurement in air shows of a rig, and a person confirms: the direction of z, and the zero of a stage without switches.

use crate::device::Identity;
use crate::quantity::Down;
use std::fmt::Debug;

/// Source that knows whether a stage really moves z away from the specimen when commanded to.
pub trait WhichWay: Debug + Send + Sync {
    /// Whether a person has already confirmed the direction, with this stage on this link.
    fn is_known(&self, stage: &Identity, down: Down) -> bool;

    /// Announces that z is about to move by this distance, mm.
    ///
    /// # Errors
    /// Returns an error with advice if there is nobody to watch. Nothing has moved.
    fn announce(&self, stage: &Identity, way_mm: f64) -> Result<(), String>;

    /// Asks whether z moved away from the specimen, and remembers it if so. `is_cancelled` returns whether the person wants a
    /// stop instead.
    ///
    /// # Errors
    /// Returns an error if z didn't move away, or nobody confirms it.
    fn confirm(&self, stage: &Identity, down: Down, is_cancelled: &dyn Fn() -> bool) -> Result<(), String>;

    /// Asks whether a stage without switches stands where the rig has these positions of x, y and z, mm.
    ///
    /// # Errors
    /// Returns an error if it doesn't stand there, or nobody confirms it. Nothing has moved.
    fn confirm_zero(&self, stage: &Identity, at_mm: [f64; 3], is_cancelled: &dyn Fn() -> bool) -> Result<(), String>;
}

/// Absence of a person. A rig that isn't simulated doesn't move.
#[derive(Debug)]
pub(super) struct Nobody;

impl WhichWay for Nobody {
    fn is_known(&self, _: &Identity, _: Down) -> bool {
        false
    }

    fn announce(&self, _: &Identity, _: f64) -> Result<(), String> {
        Err("the direction of z isn't confirmed".to_owned())
    }

    fn confirm(&self, _: &Identity, _: Down, _: &dyn Fn() -> bool) -> Result<(), String> {
        Err("the direction of z isn't confirmed".to_owned())
    }

    fn confirm_zero(&self, _: &Identity, _: [f64; 3], _: &dyn Fn() -> bool) -> Result<(), String> {
        Err("the zero of the stage isn't confirmed".to_owned())
    }
}
