//! Motions and readings of a rig without a load cell. The outputs are read during every motion: an array that falls silent stops the stage.

use super::Halt;
use super::motion::{LATE_SHARE, SIDEWAYS, SILENT_S, way_mm};
use super::rig_control::RigControl;
use super::window::{OutputMeans, is_saturated};
use super::without_cell::length;
use palpate_control::{MotionProfile, Permit, Permitted, SafetyRule, Sideways, Trip};
use palpate_core::quantity::{Axis, Place, seconds};
use palpate_link::device::{DeviceError, LoadCell, MotionOrders, SensorArray, Stage};
use palpate_link::time::{Instant, sleep, sleep_until};
use std::time::Duration;
use tokio::sync::Notify;

/// Number of readings of the outputs at rest.
const AT_REST_READINGS: u32 = 20;

/// Distance of two readings of the same outputs that noise doesn't reach, in sd of a mean, and the part of the outputs that drift and a
/// converter's steps may add.
const NOISE_SIGMAS: f64 = 8.0;
const STEP_SHARE: f64 = 1e-3;

/// Outputs of a stage at rest.
#[derive(Clone, Debug)]
pub(super) struct OutputsAtRest {
    /// Mean of each output, in the array's unit.
    pub means: Vec<f64>,
    /// Standard deviation of the distance between two such readings.
    sigma: f64,
}

impl OutputsAtRest {
    /// Distance from other outputs: root of the sum of the squares.
    pub(super) fn distance(&self, others: &[f64]) -> f64 {
        length(self.means.iter().zip(others).map(|(own, other)| own - other))
    }

    /// Largest distance from other outputs of the same state.
    pub(super) fn noise_most(&self) -> f64 {
        NOISE_SIGMAS * self.sigma + STEP_SHARE * length(self.means.iter().copied())
    }
}

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Reads the outputs of a stage at rest.
    pub(super) async fn outputs_at_rest(&mut self) -> Result<OutputsAtRest, Halt> {
        let mut means = OutputMeans::default();
        let check = |now: &[f64], _| is_saturated(now, None).map(drop);
        means
            .take_while(&mut self.array, &Notify::new(), || true, |readings| readings < AT_REST_READINGS, check)
            .await?;
        let sigma = length(means.sigmas().into_iter()) * (2.0 / f64::from(AT_REST_READINGS)).sqrt();
        Ok(OutputsAtRest { means: means.means, sigma })
    }

    /// Averages the outputs for this time, s. Returns also whether one of them was at the end of the range.
    pub(super) async fn sample_outputs(
        &mut self,
        sample_s: f64,
        range_v: Option<f64>,
    ) -> Result<(OutputMeans, bool), Halt> {
        let (mut means, mut saturated) = (OutputMeans::default(), false);
        let until = Instant::now() + seconds(sample_s);
        let check = |now: &[f64], _: Duration| {
            saturated |= is_saturated(now, range_v)?;
            Ok::<(), DeviceError>(())
        };
        let goes_on = |readings| Instant::now() < until || readings < 2;
        means.take_while(&mut self.array, &Notify::new(), || true, goes_on, check).await?;
        Ok((means, saturated))
    }

    /// Moves z to a permitted end.
    pub(super) async fn move_z_unforced(&mut self, granted: Permitted) -> Result<(), Halt> {
        let (target_mm, from_mm) = (self.stage_z_mm(granted.z_mm()), self.stage_z_mm(self.z_mm));
        let targets = [(Axis::Z, target_mm)];
        let places_mm = self.drive_unforced(&targets, granted.speed_mm_s(), target_mm - from_mm).await?;
        self.arrived_z(places_mm.first().copied(), target_mm).await
    }

    /// Moves x and y in the clear. `first_mm` is the earliest z at which contact is possible here and there.
    pub(super) async fn travel_unforced(&mut self, place: Place, permit: &Permit, first_mm: f64) -> Result<(), Halt> {
        if place == self.place {
            return Ok(());
        }
        self.read_back_z().await?;
        let Sideways { .. } = permit.sideways(self.z_mm, first_mm, 0.0)?;
        let target = self.frame.to_stage(place, self.z_mm);
        let targets = SIDEWAYS.map(|axis| (axis, target.along(axis)));
        let (speed_mm_s, way_mm) = (self.usage.speed_mm_s, way_mm(self.place, place));
        let places_mm = self.drive_unforced(&targets, speed_mm_s, way_mm).await?;
        self.arrived_at(place, targets, &places_mm).await
    }

    /// Moves axes to their targets while the outputs are read.
    async fn drive_unforced(
        &mut self,
        targets: &[(Axis, f64)],
        speed_mm_s: f64,
        way_mm: f64,
    ) -> Result<Vec<f64>, Halt> {
        self.cell.cancel.check()?;
        let expected = seconds(MotionProfile::new(way_mm, speed_mm_s, self.usage.acceleration_mm_s2).duration_s());
        let axes: Vec<Axis> = targets.iter().map(|(axis, _)| *axis).collect();
        let (orders, over) = (MotionOrders::default(), Notify::new());
        let ways = self.ways_to(targets);
        let RigControl { stage, array, usage, .. } = self;
        let late = seconds(usage.abilities.late_s);
        let motion = async {
            stage.begin(&ways, speed_mm_s, &orders).await?;
            let begun = Instant::now();
            let silent = async {
                loop {
                    let takes = expected.mul_f64((1.0 + LATE_SHARE) * orders.slowness());
                    let due = begun + takes + late + seconds(SILENT_S);
                    if Instant::now() >= due {
                        break;
                    }
                    sleep_until(due).await;
                }
            };
            let follow = stage.follow(&axes, expected, &orders);
            tokio::pin!(follow);
            let followed = tokio::select! {
                biased;
                followed = &mut follow => Ok(followed?),
                () = silent => {
                    orders.stop();
                    let _ = follow.await; // an exchange isn't abandoned
                    Err(Trip::new(SafetyRule::StageSilent, SILENT_S, SILENT_S, "s").into())
                }
            };
            followed
        };
        let motion = async {
            let moved: Result<Vec<f64>, Halt> = motion.await;
            over.notify_one();
            moved
        };
        let mut means = OutputMeans::default();
        let outputs = async {
            let check = |now: &[f64], _| is_saturated(now, None).map(drop);
            let read = means.take_while(array, &over, || true, |_| true, check).await;
            if read.is_err() {
                orders.stop();
            }
            read
        };
        let (moved, read) = tokio::join!(motion, outputs);
        read?;
        let places_mm = moved?;
        sleep(seconds(self.timing.settle_s)).await;
        Ok(places_mm)
    }
}
