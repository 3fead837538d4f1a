//! What the array feels of a contact in which the load cell shows too little force.

use super::rig_control::{RigControl, moved_beyond};
use palpate_control::{SafetyRule, Trip};
use palpate_link::device::{LoadCell, SensorArray, Stage};

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Returns a trip by a force that isn't reached with what the array feels of it, the other witness. The stage rests in contact. How much
    /// the array feels for each newton isn't known yet at a first press, so it doesn't decide between the load cell and the specimen.
    pub(super) async fn as_array_feels(&mut self, trip: Trip, range: Option<f64>) -> Trip {
        if trip.rule != SafetyRule::OutOfReach || trip.unit != "N" {
            return trip;
        }
        let mut now = vec![0.0; self.array.units()];
        let Ok(Ok(())) = self.cell.watched_while(self.array.read(&mut now)).await else { return trip };
        match moved_beyond(&self.no_load, &now, self.no_load_sigmas(), range) {
            Some(_) => trip.with(
                "the array feels the contact, so either the load cell reads too little or the specimen is softer than expected"
                    .to_owned(),
            ),
            None => trip,
        }
    }
}
