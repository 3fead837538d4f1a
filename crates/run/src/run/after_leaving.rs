//! The real cause of a rule that was broken in contact, where it shows only after the contact was left.

use super::Halt;
use super::causes::{DRIFT_LOOK_S, EQUAL_LEAST, LONG_AGO_S, SLOW_LOOK_S};
use super::watched_cell::WatchedLoadCell;
use palpate_control::{Drift, SafetyRule, Trip};
use palpate_link::device::LoadCell;

/// What is known of a trip when the contact is left.
pub(super) enum AtTrip {
    /// The cell repeated this reading under load, N as the cell reads.
    Repeated(f64),
    /// The force was this much over what a rule allows, N, and was read at this time, s.
    Over(f64, f64),
}

impl<C: LoadCell> WatchedLoadCell<'_, C> {
    /// Returns what may show the real cause after the contact is left; `None` if the cause is known.
    pub(super) fn at_trip(&self, halt: Option<&Halt>) -> Option<AtTrip> {
        let Some(Halt::Tripped(trip)) = halt else { return None };
        let zero = self.watch.zero();
        let repeated = || {
            let code_n = self.watch.last_code()?;
            (code_n - zero.at_n(self.read_s) >= zero.detect_n()).then_some(AtTrip::Repeated(code_n))
        };
        match trip.rule {
            SafetyRule::Frozen => repeated(),
            SafetyRule::NoResponse if self.watch.equal() >= EQUAL_LEAST => repeated(),
            SafetyRule::HardContact | SafetyRule::OverForce if self.read_s - zero.at_s >= LONG_AGO_S => {
                Some(AtTrip::Over(trip.measured - trip.limit, self.read_s))
            }
            _ => None,
        }
    }

    /// Returns the trip by the real cause, now that the stage rests in the clear; `None` if nothing shows another one.
    pub(super) async fn after_leaving(&mut self, at_trip: AtTrip) -> Option<Trip> {
        match at_trip {
            AtTrip::Repeated(code_n) => self.saturated(code_n).await,
            AtTrip::Over(over_n, at_s) => self.drifted(over_n, at_s).await,
        }
    }

    /// Returns the trip of a cell that repeated this reading under load and reads less now: it was at the end of its range.
    async fn saturated(&mut self, code_n: f64) -> Option<Trip> {
        let (now, sigma_n) = self.still(DRIFT_LOOK_S).await?;
        let (zero, limit_n) = (*self.watch.zero(), self.watch.limit_n());
        // one that still repeats its readings doesn't measure
        let measures = sigma_n > 0.0 && code_n - now.offset_n >= zero.detect_n();
        if !measures {
            return None;
        }
        self.cell.largest.is_the_end();
        Some(Trip::new(SafetyRule::Saturated, code_n - zero.at_n(self.read_s), limit_n, "N"))
    }

    /// Returns the trip of a cell whose zero has drifted by more than the force was over what is allowed.
    async fn drifted(&mut self, over_n: f64, at_s: f64) -> Option<Trip> {
        let (now, _) = self.still(SLOW_LOOK_S).await?;
        let (rate_n_s, off_n) = self.drift_until(&now)?;
        let zero = self.watch.zero();
        let was_off_n = off_n * (at_s - zero.at_s) / (now.at_s - zero.at_s);
        if was_off_n <= over_n {
            return None;
        }
        let passes_n_s = (rate_n_s * (1.0 - over_n / was_off_n)).abs();
        Some(Drift::trip(rate_n_s, passes_n_s.min(Drift::most_n_s(self.watch.limit_n()))))
    }
}
