//! The real cause of a rule that was broken by a force of the air.

use super::Halt;
use super::air::NoLoadForces;
use super::rig_control::LIGHT_READINGS;
use super::watched_cell::WatchedLoadCell;
use palpate_control::{Drift, NO_LOAD_READINGS, SafetyRule, Trip, Zero, check_sound};
use palpate_link::device::LoadCell;
use palpate_link::time::{Instant, sleep};
use std::ops::RangeInclusive;

/// Least number of equal readings of a cell that doesn't follow a contact.
const EQUAL_LEAST: u32 = 20;

/// Number of readings at rest that show a drift, and least time for them, s.
const DRIFT_READINGS: usize = 50;
const DRIFT_LOOK_S: f64 = 0.5;

/// Difference of two rates of the same drift, in sd of the later one.
const STEADY_SIGMAS: f64 = 3.0;

/// Force that is off over what the drift explains: it may have begun or ended in between, but a touch adds a step.
const EXPLAINED: RangeInclusive<f64> = 0.5..=1.5;

impl<C: LoadCell> WatchedLoadCell<'_, C> {
    /// Returns the real cause of a broken rule: without load, noise that has grown breaks the other rules first.
    pub(super) fn without_load(&self, trip: Trip) -> Trip {
        let (sigma_n, most_n) = (self.no_load.sigma_n(), self.watch.zero().noise_most_n());
        let noisy = self.no_load.open && self.no_load.count() >= NO_LOAD_READINGS && sigma_n > most_n;
        match (trip.rule, self.changed_n) {
            (SafetyRule::WrongSign | SafetyRule::StillTouching, _) if noisy => {
                Trip::new(SafetyRule::Noisy, sigma_n, most_n, "N")
            }
            (SafetyRule::WrongSign, Some(by_n)) => Trip::new(SafetyRule::Jumped, by_n, trip.limit.abs(), "N"),
            _ => trip,
        }
    }

    /// Returns the real cause of a broken rule at rest, before the first touch. Noise that has grown looks like an early touch.
    /// It also hides a real touch from the force while the outputs show it.
    pub(super) async fn at_first_touch(&mut self, trip: Trip) -> Trip {
        if trip.rule == SafetyRule::OutputsMoved && self.watch.equal() >= EQUAL_LEAST {
            // a cell that repeats its reading is sound until something presses it
            let (equal, least) = (f64::from(self.watch.equal()), f64::from(EQUAL_LEAST));
            return Trip::new(SafetyRule::Frozen, equal, least, "equal readings while the array shows a contact");
        }
        if !matches!(trip.rule, SafetyRule::SurfaceElsewhere | SafetyRule::OutputsMoved) {
            return trip;
        }
        let Ok(sigma_n) = self.still_sigma_n().await else { return trip };
        let most_n = self.watch.zero().noise_most_n();
        if sigma_n > most_n { Trip::new(SafetyRule::Noisy, sigma_n, most_n, "N") } else { trip }
    }

    /// Returns the real cause of a rule that was broken by a force of the air: a drift looks like a touch, or like a push that reads as a pull. The
    /// stage rests. It states the rate, and the one that would have passed.
    pub(super) async fn unless_it_drifts(&mut self, trip: Trip) -> Trip {
        let limit_n = match trip.rule {
            SafetyRule::SurfaceElsewhere => self.watch.zero().detect_n(),
            SafetyRule::WrongSign | SafetyRule::ForceRose | SafetyRule::ForceFell | SafetyRule::ZeroDrifted => {
                trip.limit.abs()
            }
            _ => return trip,
        };
        let Some(now) = self.still().await else { return trip };
        let before = *self.watch.zero();
        let (off_n, age_s) = (now.offset_n - before.at_n(now.at_s), now.at_s - before.at_s);
        let Some(seen_n_s) = now.drift.seen_n_s() else { return trip };
        if !EXPLAINED.contains(&(off_n / ((seen_n_s - before.drift.rate_n_s) * age_s))) {
            return trip;
        }
        // a drift that hasn't changed is known better from the whole time
        let since_n_s = before.drift.rate_n_s + off_n / age_s;
        let is_steady = (since_n_s - seen_n_s).abs() <= STEADY_SIGMAS * now.drift.sigma_n_s;
        let rate_n_s = if is_steady { since_n_s } else { seen_n_s };
        // the reading has moved on since
        let by_rule_n_s = (limit_n / off_n.abs().max(limit_n) * rate_n_s).abs();
        let passes_n_s = by_rule_n_s.min(Drift::most_n_s(self.watch.limit_n()));
        let drifts = Drift::trip(rate_n_s, passes_n_s);
        // the other rules allow no more with a larger force limit
        let needs_limit =
            passes_n_s < by_rule_n_s || matches!(trip.rule, SafetyRule::ForceRose | SafetyRule::ForceFell);
        match needs_limit {
            true => drifts.with(Drift::needs_limit(rate_n_s, self.watch.limit_n(), passes_n_s)),
            false => drifts,
        }
    }

    /// Returns the reading of a stage that rests, with its drift; `None` if the cell doesn't answer, or reports a fault.
    pub(super) async fn still(&mut self) -> Option<Zero> {
        let conversion_s = self.cell.conversion().as_secs_f64();
        let mut readings = Vec::new();
        for _ in 0..DRIFT_READINGS.max((DRIFT_LOOK_S / conversion_s) as usize) {
            sleep(self.cell.conversion()).await;
            readings.push(self.cell.read().await.ok().filter(|reading| check_sound(reading).is_ok())?);
        }
        Some(Zero::of(&readings, conversion_s))
    }

    /// Noise of some more readings at rest, N.
    pub(super) async fn still_sigma_n(&mut self) -> Result<f64, Halt> {
        let mut still = NoLoadForces { open: true, ..NoLoadForces::default() };
        for _ in 0..LIGHT_READINGS {
            let reading = self.sound_reading().await?;
            still.take(Instant::now(), &reading);
        }
        Ok(still.sigma_n())
    }
}
