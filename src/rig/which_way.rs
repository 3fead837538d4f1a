//! Direction of z: the only property of a rig that no measurement in air shows.

use crate::device::Identity;
use crate::quantity::Down;
use std::fmt::Debug;

/// Source that knows whether a stage really moves z away from the specimen when commanded to.
pub trait WhichWay: Debug + Send + Sync {
    /// Whether somebody saw it before, with this stage on this link.
    fn is_known(&self, stage: &Identity, down: Down) -> bool;

    /// Says that z is about to move by this distance, mm.
    ///
    /// # Errors
    /// There is nobody to see it, and what to do about that; nothing has moved.
    fn announce(&self, stage: &Identity, way_mm: f64) -> Result<(), String>;

    /// Asks whether z went away from the specimen, and remembers it if it did. `is_cancelled` says that a person wants a stop instead.
    ///
    /// # Errors
    /// It didn't, or nobody says so.
    fn confirm(&self, stage: &Identity, down: Down, is_cancelled: &dyn Fn() -> bool) -> Result<(), String>;
}

/// Nobody: a rig that isn't simulated stays where it is.
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
}
