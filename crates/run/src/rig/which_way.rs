//! What no measurement without load shows of a rig, and a person confirms: the direction of z, the zero of a stage without switches, and
//! that nothing is in the way of a search for home toward the specimen.

use palpate_core::quantity::Down;
use palpate_link::device::{HomeSearch, Identity};
use std::fmt::Debug;

/// Source that knows whether a stage really moves z away from the specimen when commanded to.
pub trait WhichWay: Debug + Send + Sync {
    /// Whether a person has already confirmed the direction, with this stage on this link.
    fn is_known(&self, stage: &Identity, down: Down) -> bool;

    /// Announces that z is about to move by this distance, mm, away from the specimen, or to search for home like this.
    ///
    /// # Errors
    /// Returns an error with advice if there is nobody to watch. Nothing has moved.
    fn announce(&self, stage: &Identity, way_mm: f64, search: HomeSearch) -> Result<(), String>;

    /// Asks whether z may search for home on the specimen's side, because nothing is in its way.
    ///
    /// # Errors
    /// Returns an error if something is, or nobody confirms it. Nothing has moved.
    fn confirm_clear(&self, stage: &Identity, is_cancelled: &dyn Fn() -> bool) -> Result<(), String>;

    /// Asks for what was taken out of the way of that search to be put back, now that z is home and away from the specimen.
    ///
    /// # Errors
    /// Returns an error if it isn't put back.
    fn confirm_back(&self, is_cancelled: &dyn Fn() -> bool) -> Result<(), String>;

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
pub(super) struct Unattended;

impl WhichWay for Unattended {
    fn is_known(&self, _: &Identity, _: Down) -> bool {
        false
    }

    fn announce(&self, _: &Identity, _: f64, _: HomeSearch) -> Result<(), String> {
        Err("the direction of z isn't confirmed".to_owned())
    }

    fn confirm_clear(&self, _: &Identity, _: &dyn Fn() -> bool) -> Result<(), String> {
        Err("it isn't confirmed that z may search for home toward the specimen".to_owned())
    }

    fn confirm_back(&self, _: &dyn Fn() -> bool) -> Result<(), String> {
        Err("it isn't confirmed that indenter and specimen are back".to_owned())
    }

    fn confirm(&self, _: &Identity, _: Down, _: &dyn Fn() -> bool) -> Result<(), String> {
        Err("the direction of z isn't confirmed".to_owned())
    }

    fn confirm_zero(&self, _: &Identity, _: [f64; 3], _: &dyn Fn() -> bool) -> Result<(), String> {
        Err("the zero of the stage isn't confirmed".to_owned())
    }
}
