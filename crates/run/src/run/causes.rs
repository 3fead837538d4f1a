//! The real cause of a rule that was broken by a force of the air.

use super::Halt;
use super::air::NoLoadForces;
use super::rig_control::LIGHT_READINGS;
use super::watched_cell::WatchedLoadCell;
use palpate_control::{Drift, NO_LOAD_READINGS, SafetyRule, Trip, Zero, check_sound, without_glitches};
use palpate_core::quantity::ForceReading;
use palpate_link::device::LoadCell;
use palpate_link::time::{Instant, sleep};
use std::ops::RangeInclusive;

/// Least number of equal readings of a cell that doesn't follow a contact.
pub(super) const EQUAL_LEAST: u32 = 20;

/// Number of readings at rest that show a drift, and least time for them, s.
const DRIFT_READINGS: usize = 50;
pub(super) const DRIFT_LOOK_S: f64 = 0.5;

/// The same for a slow drift that has had time, s: of 3 mN of noise it shows 0.6 mN/s. And the least age of the zero, s: in it a drift that forces
/// aren't corrected by moves the zero by half a touch.
pub(super) const SLOW_LOOK_S: f64 = 3.0;
pub(super) const LONG_AGO_S: f64 = 10.0;

/// Largest change of the force while it is read at rest, as a fraction of the force limit: the largest drift moves it by 4 % in this time. And the
/// number of readings in a row that show a larger one.
const MOVES_SHARE: f64 = 0.1;
const MOVED_READINGS: u32 = 4;

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

    /// Returns the real cause of a rule that was broken by a force of the air: a drift looks like a touch, or like a push that reads as a pull, and
    /// noise that has grown does too. The stage rests. It states the rate, and the one that would have passed.
    pub(super) async fn real_cause(&mut self, trip: Trip) -> Trip {
        let before = *self.watch.zero();
        let is_long_ago = self.read_s - before.at_s >= LONG_AGO_S;
        let (limit_n, may_drift) = match trip.rule {
            SafetyRule::SurfaceElsewhere => (before.detect_n(), true),
            SafetyRule::WrongSign | SafetyRule::ForceRose | SafetyRule::ForceFell | SafetyRule::ZeroDrifted => {
                (trip.limit.abs(), true)
            }
            SafetyRule::StillTouching if is_long_ago => (trip.limit.abs(), true),
            // noise that begins in the air may begin with a step
            SafetyRule::Jumped if is_long_ago || self.no_load.open => (trip.limit.abs(), is_long_ago),
            _ => return trip,
        };
        let is_slow = trip.rule == SafetyRule::ZeroDrifted || is_long_ago;
        let Some((now, sigma_n)) = self.still(if is_slow { SLOW_LOOK_S } else { DRIFT_LOOK_S }).await else {
            return trip;
        };
        let most_n = before.noise_most_n();
        let looks_alike =
            matches!(trip.rule, SafetyRule::WrongSign | SafetyRule::SurfaceElsewhere | SafetyRule::Jumped);
        if looks_alike && sigma_n > most_n {
            return Trip::new(SafetyRule::Noisy, sigma_n, most_n, "N");
        }
        match may_drift {
            true => self.unless_it_drifts(trip, limit_n, &now),
            false => trip,
        }
    }

    /// Returns a trip by the drift of a cell that rests with this zero, if that explains the trip by a force over this limit.
    fn unless_it_drifts(&self, trip: Trip, limit_n: f64, now: &Zero) -> Trip {
        let Some((rate_n_s, off_n)) = self.drift_until(now) else { return trip };
        // the reading has moved on since; a zero that moved in a rest counts from its air already
        let moved_n = if trip.rule == SafetyRule::ZeroDrifted { trip.measured } else { off_n };
        let by_rule_n_s = (limit_n / moved_n.abs().max(limit_n) * rate_n_s).abs();
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

    /// Returns the rate of a cell that rests with this zero, and how far it is off the zero of the watch, if the rate explains that.
    pub(super) fn drift_until(&self, now: &Zero) -> Option<(f64, f64)> {
        let before = self.watch.zero();
        let (off_n, age_s) = (now.offset_n - before.at_n(now.at_s), now.at_s - before.at_s);
        let seen_n_s = now.drift.seen_n_s()?;
        if !EXPLAINED.contains(&(off_n / ((seen_n_s - before.drift.rate_n_s) * age_s))) {
            return None;
        }
        // a drift that hasn't changed is known better from the whole time
        let since_n_s = before.drift.rate_n_s + off_n / age_s;
        let is_steady = (since_n_s - seen_n_s).abs() <= STEADY_SIGMAS * now.drift.sigma_n_s;
        Some((if is_steady { since_n_s } else { seen_n_s }, off_n))
    }

    /// Returns a trip by a zero that is outside its range, with the drift since the first zero, if the air in between shows it too.
    pub(super) fn since_first_zero(&self, trip: Trip, now: &Zero) -> Trip {
        let (Some((at_s, offset_n)), Some(line)) = (self.first_zero, &self.line) else { return trip };
        let (took_s, seen) = (now.at_s - at_s, line.drift());
        let rate_n_s = (now.offset_n - offset_n) / took_s;
        if !EXPLAINED.contains(&((seen.rate_n_s + seen.hidden_n_s) / rate_n_s)) {
            return trip;
        }
        let rate_mn_s = 1000.0 * rate_n_s;
        trip.with(format!("the load cell drifts: by {rate_mn_s:.2} mN/s in the {took_s:.0} s since its first zero"))
    }

    /// Returns the reading of a stage that rests, with its drift, and the noise of one reading, N; `None` if the cell doesn't answer, reports a
    /// fault, or moves by more than a drift: then nothing more is waited for.
    pub(super) async fn still(&mut self, seconds: f64) -> Option<(Zero, f64)> {
        let conversion_s = self.cell.conversion().as_secs_f64();
        let (most_n, mut moved) = (MOVES_SHARE * self.watch.limit_n(), 0);
        let mut readings: Vec<ForceReading> = Vec::new();
        for _ in 0..DRIFT_READINGS.max((seconds / conversion_s) as usize) {
            sleep(self.cell.conversion()).await;
            let reading = self.cell.read().await.ok().filter(|reading| check_sound(reading).is_ok())?;
            let has_moved = readings.first().is_some_and(|first| (reading.force_n - first.force_n).abs() > most_n);
            moved = if has_moved { moved + 1 } else { 0 };
            if moved >= MOVED_READINGS {
                return None;
            }
            readings.push(reading);
        }
        let (readings, _) = without_glitches(&readings).ok()?;
        Some((Zero::of(&readings, conversion_s), step_sigma_n(&readings)))
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

/// Returns the noise of one reading, from the differences of successive readings: a force that relaxes isn't noise.
fn step_sigma_n(readings: &[ForceReading]) -> f64 {
    let squares: f64 = readings.windows(2).map(|pair| (pair[1].force_n - pair[0].force_n).powi(2)).sum();
    (squares / (2.0 * readings.windows(2).len().max(1) as f64)).sqrt()
}
