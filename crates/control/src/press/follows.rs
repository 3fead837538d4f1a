//! Proof that the load cell follows the force. A force may be old: a cell behind a slow filter shows a step long after it.

use super::state::{ForceLoop, Rested, STEP_LEAST_MM};
use super::{Branch, SafetyRule, Trip};
use crate::surface::Expected;

/// Largest rise of a mean at rest, in sd, and in N/s: a specimen relaxes, so its force falls, while a zero and a surface drift.
const RISE_SIGMAS: f64 = 6.0;
const RISE_N_S: f64 = 0.003;
/// Largest time constant of a load cell that is looked for, s. Slower filters of transmitters are rare.
const SLOWEST_S: f64 = 1.5;
/// Part of the force that such a cell may not yet show, as a fraction of the force limit.
const MISSING_SHARE: f64 = 0.1;
/// Force that the declared stiffness may give on the way from the last point at which the cell followed, as a multiple of the
/// limit. If the cell follows, the permit's own bound holds.
const UNPROVEN: f64 = 1.1;
/// Least rise of the force that shows that the cell follows, as a fraction of that of the declared stiffness.
const ANSWER_SHARE: f64 = 0.05;
/// Part of a force that a specimen may lose meanwhile by relaxation.
const RELAXED_SHARE: f64 = 0.2;
/// Longest wait for the proof, s.
const WAIT_MOST_S: f64 = 1.0;

impl ForceLoop {
    /// Begins the contact. From now on, a motion ends no deeper than the declared stiffness allows from the earliest contact, until
    /// the cell has shown that it follows.
    pub(super) fn make_contact(&mut self, force_n: f64) {
        self.in_contact = true;
        self.shown = (self.first_mm.min(self.z_mm), 0.0);
        self.met = (self.z_mm, force_n);
        self.rest(force_n, false);
    }

    /// Deepest z that doesn't depend on the present force, mm. It follows from the declared stiffness and the last point at which
    /// the cell was shown to follow. If the presses around predict the force, it follows from them.
    pub(super) fn most_mm(&self) -> f64 {
        if !self.in_contact {
            return f64::INFINITY; // the permit's own bound begins at the earliest contact too
        }
        let limits = &self.context.limits;
        let (shown_mm, shown_n) = self.shown;
        let room_n = (UNPROVEN * limits.force_n - shown_n).max(0.0);
        let by_travel = shown_mm + room_n / limits.stiffness_n_mm;
        let deepest_mm = match self.context.softest.learned_curve {
            Some(learned_curve) => {
                let Expected { z_mm, first_mm, .. } = self.context.expected;
                let safe_mm = (z_mm + first_mm) / 2.0 + learned_curve.safe_mm(limits.force_n);
                by_travel.max(safe_mm).min(self.neighbours_mm())
            }
            None => by_travel,
        };
        deepest_mm.min(self.doubted_mm())
    }

    /// Deepest z by the presses around, mm: there the force would exceed the limit.
    fn neighbours_mm(&self) -> f64 {
        let set_n = self.level_n();
        let learned_curve = self.context.softest.learned_curve;
        let deepest_mm = learned_curve
            .map_or(f64::INFINITY, |learned_curve| learned_curve.deepest_mm(self.context.limits.force_n, set_n));
        self.context.expected.last_mm + deepest_mm
    }

    /// Whether the presses around are what allows no deeper motion.
    pub(super) fn is_bounded_by_neighbours(&self) -> bool {
        self.in_contact && self.neighbours_mm() <= self.most_mm()
    }

    /// Whether nothing but a doubt about the force allows no deeper motion.
    pub(super) fn is_doubted(&self) -> bool {
        self.in_contact && self.doubted_mm() <= self.most_mm()
    }

    /// Time that the stage must rest before it moves to `wanted_mm`, s, so that the cell shows that it follows; `None` if it has
    /// shown that here, or needn't.
    ///
    /// # Errors
    /// A trip if the force didn't rise on the way to here, although the stage rested long enough.
    pub(super) fn must_show_answer_s(&self, wanted_mm: f64) -> Result<Option<f64>, Trip> {
        let is_shown = self.z_mm - self.shown.0 < STEP_LEAST_MM;
        // the permit keeps this reserve
        let reachable_mm = self.in_steps_mm(self.most_mm() - self.context.permit.reserve_mm());
        let needs = self.in_contact && !is_shown && wanted_mm > reachable_mm;
        if !needs || self.is_bounded_by_neighbours() || self.is_doubted() {
            return Ok(None);
        }
        match self.rested {
            Some(rested) if rested.is_long => {
                let (rose_n, least_n) = self.answer_n(self.force_n);
                Err(Trip::new(SafetyRule::NoResponse, rose_n, least_n, "N"))
            }
            _ => Ok(Some(self.proof_s())),
        }
    }

    /// Rise of the force since the last point at which the cell followed, or since the first look, and the least rise, N.
    fn answer_n(&self, force_n: f64) -> (f64, f64) {
        let (from_mm, from_n) = if self.shown.0 > self.met.0 { self.shown } else { self.met };
        let expected_n = ANSWER_SHARE * self.context.limits.stiffness_n_mm * (self.z_mm - from_mm);
        let lost_n = RELAXED_SHARE * from_n + RISE_SIGMAS * std::f64::consts::SQRT_2 * self.sigma_n;
        (force_n - from_n, expected_n - lost_n)
    }

    /// Checks that the force didn't rise while the stage rested. After a sufficient rest, the cell was shown to follow.
    pub(super) fn check_rest(&mut self, force_n: f64) -> Result<(), Trip> {
        // a specimen recovers after it was unloaded: its force rises
        let is_loaded = self.level().is_some_and(|(_, level)| level.branch == Branch::Loading);
        if !self.in_contact || !is_loaded {
            return Ok(());
        }
        // every motion ends a rest, however short it is: on steel a step of 0.1 um is a force
        if let Some(before) = self.rested {
            let between_s = self.moment.now_s - before.now_s;
            let (rise_n, sigma_n) = (force_n - before.force_n, before.sigma_n.hypot(self.sigma_n));
            let most_n = RISE_SIGMAS * sigma_n + RISE_N_S * between_s;
            if rise_n > most_n {
                return Err(Trip::new(SafetyRule::RisesAtRest, rise_n, most_n, "N"));
            }
            let is_long = between_s >= self.proof_s();
            let (rose_n, least_n) = self.answer_n(force_n);
            if is_long && rose_n >= least_n {
                self.shown = (self.z_mm, force_n);
            }
            self.rest(force_n, is_long);
        } else {
            self.rest(force_n, false);
        }
        Ok(())
    }

    fn rest(&mut self, force_n: f64, is_long: bool) {
        let (sigma_n, now_s) = (self.sigma_n, self.moment.now_s);
        self.rested = Some(Rested { force_n, sigma_n, now_s, is_long });
    }

    /// Rest after which the slowest cell would have shown a rise, s, if it didn't yet show a part of the force.
    fn proof_s(&self) -> f64 {
        let rise_n = RISE_SIGMAS * std::f64::consts::SQRT_2 * self.sigma_n;
        let wait_s = SLOWEST_S * rise_n / (MISSING_SHARE * self.context.limits.force_n);
        wait_s.max(self.context.timing.settle_s).min(WAIT_MOST_S)
    }
}
