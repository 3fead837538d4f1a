//! The outputs while the stage moves without load. They show a contact that a dead load cell doesn't show.

use super::Halt;
use super::rig_control::{OUTPUT_LOOKS, moved_beyond};
use super::window::OutputMeans;
use crate::rig::ArraySpec;
use palpate_control::{SafetyRule, Trip};
use palpate_core::quantity::seconds;
use palpate_link::device::{MotionOrders, SensorArray};
use palpate_link::time::{Instant, sleep_until};
use std::cell::Cell;
use std::time::Duration;
use tokio::sync::Notify;

/// Readings of a stage at rest from which the noise of each output follows.
const READINGS: u32 = 20;
/// Distance that the stage moves between two looks at the outputs, mm. Three looks must show a contact within 0.5 mm.
const LOOK_EVERY_MM: f64 = 0.1;
/// Age from which a look replaces the outputs that count as air. Outputs drift.
const NO_LOAD_FRESH: Duration = Duration::from_secs(1);

/// Outputs of a stage that has not touched anything since they were read.
#[derive(Clone, Debug)]
pub(super) struct NoLoadOutputs {
    known: Vec<f64>,
    sigmas: Vec<f64>,
    known_at: Instant,
    range: Option<f64>,
    unit: String,
}

impl NoLoadOutputs {
    /// Reads the outputs of a stage at rest.
    pub(super) async fn read<A: SensorArray>(array: &mut A, spec: &ArraySpec) -> Result<Self, Halt> {
        let mut means = OutputMeans::default();
        means.take_while(array, &Notify::new(), || true, |readings| readings < READINGS, |_, _| Ok(())).await?;
        let sigmas = means.sigmas();
        Ok(NoLoadOutputs {
            known: means.means,
            sigmas,
            known_at: Instant::now(),
            range: spec.range_v,
            unit: spec.unit.clone(),
        })
    }

    /// Reads the outputs until a motion is over. It stops the motion if outputs leave their noise, unless the force falls as it does
    /// when a contact ends; `falls` states that. `speed_mm_s` is the largest speed of the motion.
    pub(super) async fn watch<A: SensorArray>(
        &mut self,
        array: &mut A,
        speed_mm_s: f64,
        falls: &Cell<bool>,
        over: &Notify,
        orders: &MotionOrders,
    ) -> Result<(), Halt> {
        let every = seconds(LOOK_EVERY_MM / speed_mm_s);
        let mut now = vec![0.0; array.units()];
        let mut looks = 0;
        loop {
            let asked = Instant::now();
            array.read(&mut now).await?;
            match moved_beyond(&self.known, &now, &self.sigmas, self.range) {
                Some((moved, most)) => {
                    looks += 1;
                    if looks >= OUTPUT_LOOKS && falls.get() {
                        looks = 0;
                        self.renew(&now);
                    } else if looks >= OUTPUT_LOOKS {
                        orders.stop();
                        return Err(Trip::new(SafetyRule::OutputsMoved, moved, most, &self.unit).into());
                    }
                }
                None => {
                    looks = 0;
                    if self.known_at.elapsed() > NO_LOAD_FRESH {
                        self.renew(&now);
                    }
                }
            }
            tokio::select! {
                biased;
                () = over.notified() => return Ok(()),
                () = sleep_until(asked + every) => {}
            }
        }
    }

    fn renew(&mut self, now: &[f64]) {
        self.known.copy_from_slice(now);
        self.known_at = Instant::now();
    }
}
