//! Detection of a press that is impossibly soft or stiff. A load cell that reads too little makes every specimen appear soft, and
//! one that reads too much makes it appear stiff.

use super::guarded::RESPONSE_SHARE;
use super::state::{ForceLoop, TELL_SIGMAS};
use super::{SafetyRule, Trip};
use crate::learned_curve::{KnownSoftness, LearnedCurve, WAY_MM};
use crate::task::PressLevel;

/// Fraction of the declared least stiffness below which a press counts as too soft. The force relaxes while it is reached.
const DECLARED_SHARE: f64 = 0.9;
/// Rise that the declared stiffness must have produced before the check, as a fraction of the set force.
const SHOWN_SHARE: f64 = 0.25;
/// Ratio of the present force to the force at the first look from which a rise is compared.
const ROSE: f64 = 2.0;

/// Lowest stiffness that a press may have.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Softest {
    /// Least stiffness that the rig declares, N/mm; `None` if the rig declares no such value.
    pub declared_n_mm: Option<f64>,
    /// Information from the presses around; `None` if there are too few.
    pub learned_curve: Option<LearnedCurve>,
    /// An earlier press, and the force, N, at whose depth by this press a force is doubted; `None` if the places around predict the force,
    /// or if the load cell has just shown that it measures it.
    pub doubted: Option<(KnownSoftness, f64)>,
}

impl ForceLoop {
    /// Whether this is the first press of a specimen whose least stiffness is declared. Such a press goes in steps, with any
    /// strategy.
    pub(super) fn must_show_stiffness(&self) -> bool {
        !self.context.expected.touched && self.context.softest.declared_n_mm.is_some()
    }

    /// Compares the rise since the first look in contact with the declared and the learned stiffness.
    pub(super) fn check_softness(&self) -> Result<(), Trip> {
        let Some(&(from_mm, from_n)) = self.path.first() else { return Ok(()) };
        if self.level != self.first_loaded() || self.dwelt {
            return Ok(());
        }
        self.check_declared(from_mm, from_n)?;
        self.check_learned_curve(from_mm, from_n)
    }

    /// Compares the rise of a shot in the same way, from the lowest possible surface.
    pub(super) fn check_shot_softness(&self) -> Result<(), Trip> {
        self.check_learned_curve(self.context.expected.last_mm, 0.0)
    }

    /// Checks the declared stiffness at the first press only. Later presses are compared with the first one.
    fn check_declared(&self, from_mm: f64, from_n: f64) -> Result<(), Trip> {
        let Some(least_n_mm) = self.context.softest.declared_n_mm else { return Ok(()) };
        let (way_mm, noise_n) = (self.z_mm - from_mm, TELL_SIGMAS * self.sigma_n);
        let expected_n = least_n_mm * way_mm;
        if self.context.expected.touched || expected_n < SHOWN_SHARE * self.level_n() {
            return Ok(());
        }
        let rose_n = self.force_n - from_n;
        if rose_n + noise_n < DECLARED_SHARE * expected_n {
            return Err(Trip::new(SafetyRule::SofterThanDeclared, rose_n / way_mm, least_n_mm, "N/mm"));
        }
        Ok(())
    }

    fn check_learned_curve(&self, from_mm: f64, from_n: f64) -> Result<(), Trip> {
        let Some(learned_curve) = self.context.softest.learned_curve else { return Ok(()) };
        let (way_mm, noise_n) = (self.z_mm - from_mm, TELL_SIGMAS * self.sigma_n);
        let (rose_n, expected_n) = (self.force_n - from_n, learned_curve.force_n(from_n, way_mm) - from_n);
        if rose_n < RESPONSE_SHARE * expected_n {
            return Ok(()); // another rule checks for a missing response
        }
        // a force that hasn't risen is compared as if it had, because the distance was long enough
        let to_n = (self.force_n + noise_n).max(ROSE * from_n + noise_n);
        let longest_mm = learned_curve.longest_mm((from_n - noise_n).max(0.0), to_n) + self.read_back_mm();
        if way_mm > longest_mm {
            return Err(Trip::new(SafetyRule::SofterThanTaught, rose_n / way_mm, rose_n / longest_mm, "N/mm"));
        }
        Ok(())
    }

    /// Deepest z of the first level, mm, before the force is doubted.
    pub(super) fn doubted_mm(&self) -> f64 {
        let is_force = |level: PressLevel| level.set.force_n().is_some();
        let is_first = self.level == self.first_loaded() && self.level().is_some_and(|(_, level)| is_force(level));
        // a gain that is wrong doesn't change where the force is zero
        match (self.context.softest.doubted, self.touched_mm()) {
            (Some((known, doubted_n)), Some(touched_mm)) if is_first => {
                touched_mm + known.depth_mm(doubted_n) + self.read_back_mm()
            }
            _ => f64::INFINITY,
        }
    }

    /// Checks at the end of the first level that the force didn't rise within a shorter distance than the presses around need.
    pub(super) fn check_stiffness(&self) -> Result<(), Trip> {
        let Some(learned_curve) = self.context.softest.learned_curve.filter(|_| self.level == self.first_loaded())
        else {
            return Ok(());
        };
        let from = match self.landing {
            Some(_) => Some((self.context.expected.first_mm, 0.0)),
            None => self.path.first().copied(),
        };
        let Some((from_mm, from_n)) = from else { return Ok(()) };
        let (way_mm, rose_n, noise_n) = (self.z_mm - from_mm, self.force_n - from_n, TELL_SIGMAS * self.sigma_n);
        let shortest_mm = learned_curve.shortest_mm(from_n + noise_n, (self.force_n - noise_n).max(from_n + noise_n));
        if way_mm < shortest_mm - self.read_back_mm() {
            return Err(Trip::new(SafetyRule::StifferThanTaught, rose_n / way_mm, rose_n / shortest_mm, "N/mm"));
        }
        Ok(())
    }

    /// Possible error of a distance in contact, mm: of two read-backs, and of a contact that isn't flat.
    pub(super) fn read_back_mm(&self) -> f64 {
        WAY_MM + self.context.permit.steps().reserve_mm()
    }
}
