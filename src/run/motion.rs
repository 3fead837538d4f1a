use super::Halt;
use super::hand::Hand;
use crate::control::{Permitted, Press, Rule, Trip};
use crate::device::{DeviceError, LoadCell, Problem, SensorArray, Stage};
use crate::quantity::{Axis, Place, Range};
use std::cell::Cell;
use std::time::Duration;
use tokio::sync::Notify;

/// How far a read-back may be from where the axis was sent, mm.
const IN_POSITION_MM: f64 = 0.003;

/// Least clearance above the highest the surface can be at which x and y may move, mm.
pub(super) const SIDEWAYS_CLEARANCE_MM: f64 = 0.030;

/// Readings averaged before x and y move: nothing moves sideways in contact.
const SIDEWAYS_READINGS: u32 = 2;

/// What a motion takes beyond its own profile, s: command, servo.
const OVERHEAD_S: f64 = 0.005;

/// The time of a motion from rest to rest, s.
pub(super) fn motion_s(way_mm: f64, speed_mm_s: f64, acceleration_mm_s2: f64) -> f64 {
    let (way, v, a) = (way_mm.abs(), speed_mm_s, acceleration_mm_s2);
    if way < v * v / a { 2.0 * (way / a).sqrt() } else { way / v + v / a }
}

impl<S: Stage, C: LoadCell, A: SensorArray> Hand<'_, S, C, A> {
    /// Moves along z to a permitted end, the force read and watched meanwhile. `press` says when a force means to stop.
    pub async fn move_z(&mut self, granted: Permitted, press: Option<&Press>) -> Result<(), Halt> {
        let target_mm = self.frame.to_stage(self.place, granted.z_mm()).z_mm;
        let from_mm = self.frame.to_stage(self.place, self.z_mm).z_mm;
        let expected = self.expected(target_mm - from_mm, granted.speed_mm_s());
        self.stage.begin(&[(Axis::Z, target_mm)], granted.speed_mm_s()).await?;
        let must_stop = |force_n| press.is_some_and(|press| press.must_stop(force_n));
        let stopped = self.follow(&[Axis::Z], expected, must_stop).await?;
        self.read_back_z((!stopped).then_some(target_mm)).await?;
        let at_mm = self.frame.to_stage(self.place, self.z_mm).z_mm;
        let way = Range { min: from_mm.min(target_mm) - IN_POSITION_MM, max: from_mm.max(target_mm) + IN_POSITION_MM };
        if !way.contains(at_mm) {
            let told = format!("z went from {from_mm:.4} toward {target_mm:.4} mm and says it is at {at_mm:.4} mm");
            return Err(lost(told));
        }
        Ok(())
    }

    /// Waits for a motion to end while every force is watched; whether a force ended it. Both run to their end, so that no
    /// exchange is ever dropped half-way.
    async fn follow(
        &mut self,
        axes: &[Axis],
        expected: Duration,
        must_stop: impl Fn(f64) -> bool,
    ) -> Result<bool, Halt> {
        let (stop, stopped, ended) = (Notify::new(), Cell::new(false), Cell::new(false));
        let ask_to_stop = || {
            if !stopped.replace(true) {
                stop.notify_one();
            }
        };
        let (stage, gauge) = (&mut self.stage, &mut self.cell);
        let follow = async {
            let followed = stage.follow(axes, expected, &stop).await;
            ended.set(true);
            followed
        };
        let watch = async {
            while !ended.get() {
                match gauge.force_n().await {
                    Ok(force_n) if must_stop(force_n) => ask_to_stop(),
                    Ok(_) => {}
                    Err(halt) => {
                        ask_to_stop();
                        return Err(halt);
                    }
                }
            }
            Ok(())
        };
        let (followed, watched) = tokio::join!(follow, watch);
        watched?;
        followed?;
        Ok(stopped.get())
    }

    /// Withdraws without looking at the force: for parking, when the load cell may be what failed.
    pub async fn retreat(&mut self, z_mm: f64) -> Result<(), Halt> {
        self.read_back_z(None).await?;
        if self.z_mm <= z_mm {
            return Ok(());
        }
        let target_mm = self.frame.to_stage(self.place, z_mm).z_mm;
        let from_mm = self.frame.to_stage(self.place, self.z_mm).z_mm;
        let expected = self.expected(target_mm - from_mm, self.usage.speed_mm_s);
        self.stage.begin(&[(Axis::Z, target_mm)], self.usage.speed_mm_s).await?;
        self.stage.follow(&[Axis::Z], expected, &Notify::new()).await?;
        self.read_back_z(Some(target_mm)).await
    }

    /// Moves x and y: only in the clear. `highest_mm` is the z above which no surface can be, here and there.
    pub async fn travel(&mut self, place: Place, highest_mm: f64) -> Result<(), Halt> {
        if place == self.place {
            return Ok(());
        }
        if self.z_mm > highest_mm - SIDEWAYS_CLEARANCE_MM {
            return Err(Trip::new(Rule::NotPermitted, self.z_mm, highest_mm - SIDEWAYS_CLEARANCE_MM, "mm").into());
        }
        let target = self.frame.to_stage(place, self.z_mm);
        let way_mm = (place.x_mm - self.place.x_mm).abs().max((place.y_mm - self.place.y_mm).abs());
        let expected = self.expected(way_mm, self.usage.speed_mm_s);
        let axes = [Axis::X, Axis::Y];
        let targets = axes.map(|axis| (axis, target.along(axis)));
        let touch_n = self.cell.watch.zero().detect_n();
        self.cell.watch.pause();
        let force_n = self.cell.mean_n(SIDEWAYS_READINGS).await?;
        if force_n.abs() >= touch_n {
            return Err(Trip::new(Rule::StillTouching, force_n, touch_n, "N").into());
        }
        self.stage.begin(&targets, self.usage.speed_mm_s).await?;
        if self.follow(&axes, expected, |force_n| force_n.abs() >= touch_n).await? {
            return Err(Trip::new(Rule::StillTouching, touch_n, touch_n, "N").into());
        }
        for axis in axes {
            let position_mm = self.stage.position_mm(axis).await?;
            self.check_arrival(axis, position_mm, target.along(axis)).await?;
        }
        self.place = place;
        Ok(())
    }

    /// Reads x, y and z back, wherever the axes are.
    pub async fn find_itself(&mut self) -> Result<(), Halt> {
        let x_mm = self.stage.position_mm(Axis::X).await?;
        let y_mm = self.stage.position_mm(Axis::Y).await?;
        self.place = self.frame.place_from_stage(x_mm, y_mm);
        self.read_back_z(None).await
    }

    async fn read_back_z(&mut self, target_mm: Option<f64>) -> Result<(), Halt> {
        let position_mm = self.stage.position_mm(Axis::Z).await?;
        self.z_mm = self.frame.z_from_stage(position_mm);
        match target_mm {
            Some(target_mm) => self.check_arrival(Axis::Z, position_mm, target_mm).await,
            None => Ok(()),
        }
    }

    /// A controller that refused a motion shows it here, and says why in its error queue.
    async fn check_arrival(&mut self, axis: Axis, position_mm: f64, target_mm: f64) -> Result<(), Halt> {
        if (position_mm - target_mm).abs() <= IN_POSITION_MM {
            return Ok(());
        }
        let complaints = self.stage.complaints().await?;
        let why = if complaints.is_empty() { "it has no complaint".to_owned() } else { complaints.join("; ") };
        let told = format!("{} was sent to {target_mm:.4} mm and is at {position_mm:.4} mm; {why}", axis.name());
        Err(lost(told))
    }

    fn expected(&self, way_mm: f64, speed_mm_s: f64) -> Duration {
        let profile_s = motion_s(way_mm, speed_mm_s, self.usage.acceleration_mm_s2);
        Duration::try_from_secs_f64(profile_s + OVERHEAD_S).unwrap_or(Duration::ZERO)
    }
}

fn lost(told: String) -> Halt {
    let doing = "checking where a motion ended".to_owned();
    DeviceError { device: "stage".to_owned(), doing, problem: Problem::Motion(told) }.into()
}
