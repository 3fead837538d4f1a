//! Drags: x and y move in contact along a permitted way, while the forces are watched on all axes.

use super::Halt;
use super::air::side_mean;
use super::motion::{watched, way_mm};
use super::rig_control::RigControl;
use super::watched_cell::{OnDoubt, WatchedLoadCell};
use palpate_control::{Drag, DragWatch, MotionProfile, PermittedDrag, Steer, mean_of};
use palpate_core::quantity::{Axis, Place, seconds};
use palpate_link::device::{LoadCell, MotionOrders, SensorArray, Stage};
use palpate_link::time::Instant;
use std::cell::{Cell, RefCell};
use std::pin::pin;

impl<C: LoadCell> WatchedLoadCell<'_, C> {
    /// Returns the mean forces of a stage at rest: along z, and along x and y if the cell has three axes, N from the zero.
    pub(super) async fn mean_axes_n(&mut self, readings: u32) -> Result<(f64, Option<[f64; 2]>), Halt> {
        self.settle().await?;
        let least_s = self.whole_s(f64::from(readings) * self.cell.conversion().as_secs_f64());
        let (mut read, mut sides) = (Vec::new(), Vec::new());
        while read.len() < readings.max(1) as usize || self.now_s() - read.first().map_or(0.0, |(s, _)| *s) < least_s {
            let force_n = self.force_n().await?;
            read.push((self.now_s(), force_n));
            sides.push(self.side_n);
        }
        let force_n = mean_of(&read, self.watch.zero()).map_or(f64::NAN, |mean| mean.value);
        Ok((force_n, side_mean(sides.into_iter())))
    }
}

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Carries out a permitted drag from the present place, and returns the way that the tip went along x and y, mm, and the number of
    /// slips. A force over its limit stops it; the way out is then along z.
    pub(super) async fn drag(&mut self, granted: PermittedDrag) -> Result<([f64; 2], u64), Halt> {
        let Drag { x_mm, y_mm, speed_mm_s, .. } = granted.drag();
        let began = self.place;
        let end = Place::new(self.place.x_mm + x_mm, self.place.y_mm + y_mm);
        let target = self.frame.to_stage(end, self.z_mm);
        let targets = [Axis::X, Axis::Y].map(|axis| (axis, target.along(axis)));
        let ways = self.ways_to(&targets);
        // the stage knows the speed of its fastest axis
        let longest_mm = way_mm(self.place, end);
        let speed_mm_s = (speed_mm_s * longest_mm / granted.drag().way_mm()).min(self.usage.speed_mm_s);
        let profile = MotionProfile::new(longest_mm, speed_mm_s, self.usage.acceleration_mm_s2);
        let expected = seconds(profile.duration_s());
        let side_sigma_n = self.cell.watch.zero().side.map_or(0.0, |side| side.sigma_most_n());
        // an exchange takes between almost nothing and the longest one
        let stops_after_s = self.timing.exchange_s / 2.0 + speed_mm_s / (2.0 * self.usage.acceleration_mm_s2);
        let drag_watch =
            RefCell::new(DragWatch::new(granted.drag(), granted.shear_most_n(), side_sigma_n, stops_after_s));
        let broken = Cell::new(None);
        let (orders, due) = (MotionOrders::default(), Cell::new(Some(Instant::now() + expected)));
        self.cell.moves(speed_mm_s, OnDoubt::Stop);
        let places_mm = {
            let stage = &mut self.stage;
            let motion = pin!(async {
                stage.begin(&ways, speed_mm_s, &orders).await?;
                Ok(stage.follow(&[Axis::X, Axis::Y], expected, &orders).await?)
            });
            let steer = |watched_cell: &mut WatchedLoadCell<'_, C>, force_n: f64| {
                let side_n = watched_cell.side_n.unwrap_or([f64::NAN; 2]); // no drag without three axes
                match drag_watch.borrow_mut().see(force_n, side_n, watched_cell.now_s()) {
                    Ok(false) => Steer::On,
                    Ok(true) => Steer::Stop,
                    Err(trip) => {
                        broken.set(Some(trip));
                        Steer::Stop
                    }
                }
            };
            watched(&mut self.cell, motion, &orders, &due, steer).await?
        };
        self.cell.settled = Instant::now() + seconds(self.timing.settle_s);
        if orders.stopped() {
            // as the stage reported when it came to rest: the force is read again at once
            if let [x_mm, y_mm] = places_mm[..] {
                self.place = self.frame.place_from_stage(x_mm, y_mm);
                self.pressed = self.place;
            }
        } else {
            self.arrived_at(end, targets, &places_mm).await?;
        }
        if let Some(trip) = broken.take() {
            return Err(trip.into());
        }
        let went = [self.pressed.x_mm - began.x_mm, self.pressed.y_mm - began.y_mm];
        Ok((went, drag_watch.into_inner().slips()))
    }
}
