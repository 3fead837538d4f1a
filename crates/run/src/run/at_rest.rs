//! A contact at rest: while the force is read, the stage is asked whether z still is where it came to rest.

use super::Halt;
use super::motion::{GIVEN_UP_AFTER, lost};
use super::retraction::then_notify;
use super::rig_control::RigControl;
use palpate_core::quantity::Axis;
use palpate_link::device::{DeviceProblem, LoadCell, MotionOrders, SensorArray, Stage};
use palpate_link::time::{Instant, sleep_until, timeout};
use std::cell::Cell;
use std::pin::pin;
use std::time::Duration;
use tokio::sync::Notify;

/// Interval of the questions.
const ASKED_EVERY: Duration = Duration::from_secs(1);

/// Where z came to rest, stage coordinates, mm, and how far a later read-back may be from it.
#[derive(Clone, Copy, Debug)]
pub(super) struct AtRest {
    z_mm: f64,
    most_mm: f64,
}

impl AtRest {
    /// Asks the stage each second until a time, or until something is over. If that failed, a question under way is given up at once, because
    /// nothing watches the force any more.
    ///
    /// # Errors
    /// z isn't where it was: it moved, or the controller restarted or counts from another zero. Any motion then needs a read-back first.
    pub(super) async fn asked<S: Stage>(
        &self,
        stage: &mut S,
        until: Instant,
        over: &Notify,
        failed: &Cell<bool>,
    ) -> Result<(), Halt> {
        loop {
            let ask_at = Instant::now() + ASKED_EVERY;
            if ask_at >= until {
                return Ok(());
            }
            tokio::select! {
                biased;
                () = over.notified() => return Ok(()),
                () = sleep_until(ask_at) => {}
            }
            let (orders, mut is_over) = (MotionOrders::default(), false);
            let mut asked = pin!(stage.position_mm(Axis::Z, &orders));
            let answer = tokio::select! {
                biased;
                answer = &mut asked => answer,
                () = over.notified() => {
                    if failed.get() {
                        return Ok(());
                    }
                    is_over = true;
                    match timeout(GIVEN_UP_AFTER, asked).await {
                        Ok(answer) => answer,
                        Err(_) => return Ok(()),
                    }
                }
            };
            let is_mm = answer?;
            // written as the positive condition, so NaN fails
            let rests = (is_mm - self.z_mm).abs() <= self.most_mm;
            if !rests {
                let text = format!(
                    "z came to rest at {:.4} mm and is at {is_mm:.4} mm: something else moved it, or it lost its place",
                    self.z_mm
                );
                return Err(lost(DeviceProblem::Motion(text)));
            }
            if is_over {
                return Ok(());
            }
        }
    }
}

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Returns where z rests now.
    pub(super) fn at_rest(&self) -> AtRest {
        AtRest { z_mm: self.stage_z_mm(self.z_mm), most_mm: self.usage.steps.at_rest_mm(Axis::Z) }
    }

    /// Reads the force for this time, s, in contact at rest.
    pub(super) async fn dwell(&mut self, seconds: f64) -> Result<(), Halt> {
        let until = Instant::now() + Duration::from_secs_f64(seconds);
        let at_rest = self.at_rest();
        let (stage, cell) = (&mut self.stage, &mut self.cell);
        let (failed, over) = (Cell::new(false), Notify::new());
        let forces = async {
            while Instant::now() < until && !failed.get() {
                cell.force_n().await.inspect_err(|_| failed.set(true))?;
            }
            Ok::<(), Halt>(())
        };
        let forces = then_notify(forces, &over);
        let rests = async { at_rest.asked(stage, until, &over, &failed).await.inspect_err(|_| failed.set(true)) };
        let (forces, rests) = tokio::join!(forces, rests);
        forces?;
        rests
    }
}
