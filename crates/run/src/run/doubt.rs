//! A press that needs much more depth than the presses so far: the load cell first shows at a known place that it measures the force.

use super::Halt;
use super::checks::HalfPress;
use super::execute::Runner;
use super::press::Pressed;
use palpate_control::{KnownSoftness, SafetyRule, Trip};
use palpate_core::quantity::Place;
use palpate_data::dataset::{Record, Retouch};
use palpate_data::recipe::Entry;

/// Ratio of the force by the stiffest press so far to the set force at which a force is doubted. Places of sound specimens differ by less,
/// except at free edges, and there a doubt costs two seconds.
pub(super) const DOUBTED: f64 = 1.13;
/// The same while a known press is repeated with half its force: it goes no deeper than that press did.
const REPEATED: f64 = 2.0;
/// Least force that is doubted, as a fraction of the limit. Less does no harm, and errors of the touch are a large part of its depth.
const DOUBTED_LEAST: f64 = 0.5;

impl Runner<'_> {
    /// Returns the press by which a force is doubted, and the force at whose depth it is.
    pub(super) fn doubted(&self, place: Place, force_set_n: f64) -> Option<(KnownSoftness, f64)> {
        let known = self.map.doubted(place, force_set_n)?;
        let least_n = DOUBTED_LEAST * self.conditions.spec.limits.force_n;
        Some((known, (self.doubts_over? * force_set_n).max(least_n)))
    }

    /// Makes the contact of an entry. If its force is doubted, z leaves the contact, the press with which the checks are compared is
    /// repeated with half its force, and the contact is made again.
    pub(super) async fn undoubted_contact(&mut self, entry: &Entry, next: Place) -> Result<Pressed, Halt> {
        let made = self.contact(entry.press, entry.place, &entry.task, next).await;
        let Some(trip) = self.doubt.take() else { return made };
        self.leave_unfinished().await?;
        self.show_force(entry, trip).await?;
        self.contact_doubted_over(None, entry, next).await
    }

    /// Makes a contact whose force is doubted beyond another ratio than usual; `None`: beyond none.
    async fn contact_doubted_over(&mut self, times: Option<f64>, entry: &Entry, next: Place) -> Result<Pressed, Halt> {
        self.doubts_over = times;
        let made = self.contact(entry.press, entry.place, &entry.task, next).await;
        self.doubts_over = Some(DOUBTED);
        made
    }

    /// Presses a known place with half its force.
    ///
    /// # Errors
    /// The trip of the doubt, if there is no such place; another one if the press needs another depth than before.
    async fn show_force(&mut self, entry: &Entry, trip: Trip) -> Result<(), Halt> {
        let Some(HalfPress { entry: again, before, before_mm }) = self.checks.half(self.plan, entry.press) else {
            return Err(trip.into());
        };
        let pressed = self.contact_doubted_over(Some(REPEATED), &again, entry.place).await;
        self.doubt = None; // a doubt about this press is answered by its own trip
        let pressed = pressed?;
        let (t_s, place, known_mm) = (self.conditions.clock.now_s(), again.place, self.map.expect(again.place).z_mm);
        let touched_mm = pressed.touched_mm.unwrap_or(f64::NAN);
        let retouch = Retouch { t_s, place, before_mm: known_mm, touched_mm };
        self.ledger.record(&Record::Retouch(retouch))?;
        self.listener.retouched(&retouch);
        let sunk = pressed.first_loaded().and_then(|now| self.map.compare([(before.force_n, before_mm), now]));
        match sunk {
            Some(sunk) if sunk.depth.abs() <= sunk.limit => Ok(()),
            Some(sunk) => {
                let [by, limit] = [sunk.depth, sunk.limit].map(|share| 100.0 * share);
                Err(Trip::new(SafetyRule::SofterThanTaught, by, limit, "% more depth at a known place").into())
            }
            None => Err(trip.into()),
        }
    }
}
