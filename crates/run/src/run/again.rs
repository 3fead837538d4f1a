//! Checks before a run continues: whether this is still the same specimen, and the return to the position after the last contact.

use super::Halt;
use super::execute::{Runner, Standby};
use super::past::{Past, TouchedPlace};
use super::shift::sideways_shift;
use crate::rig::Home;
use palpate_control::{MotionContext, NoLoadReadings, PressTask, SafetyRule, Strategy, TRAVEL_CLEARANCE_MM, Trip};
use palpate_core::quantity::Place;
use palpate_data::dataset::{NoLoad, Record, Retouch};
use palpate_data::recipe::Plan;

/// Largest allowed move of a surface that was touched before, mm: half of the indenter's clearance during travel.
pub(super) const MOVED_MOST_MM: f64 = TRAVEL_CLEARANCE_MM / 2.0;

/// Force with which a place is touched again if it carried more before, as a fraction of the specimen's limit.
const TOUCH_SHARE: f64 = 0.25;

/// Tolerance of that force, as a fraction of the force. The second constant is the sampling time, s. Only the start of the
/// contact matters.
const TOUCH_TOLERANCE: f64 = 0.2;
const TOUCH_SAMPLE_S: f64 = 0.05;

/// Number of the first contact outside the plan. It is far above the numbers of planned contacts.
const UNCOUNTED: u64 = 1 << 62;

/// Largest difference between two looks at the same air, in standard deviations.
const SAME_SIGMAS: f64 = 5.0;

/// Largest sideways shift of a stage that a person brought to its zero again, mm: below the error of the best sensors.
const SHIFT_MOST_MM: f64 = 0.3;

/// Returns the task that repeats the first level of the press at a place; `None` if no level was pressed there.
fn again(known: &TouchedPlace, plan: &Plan) -> Option<PressTask> {
    let (_, set) = known.felt.as_ref()?;
    let entry = plan.entries.iter().find(|entry| entry.press == known.press)?;
    Some(PressTask { levels: PressTask::one(*set), strategy: Strategy::Guarded, drag: None, ..entry.task.clone() })
}

impl Runner<'_> {
    /// Touches again some places that were touched before, as if nothing were known of the specimen, and compares. If a person
    /// brought the stage to its zero, the presses there are repeated and their outputs are compared too, because a touch doesn't show
    /// that the zero moved sideways.
    pub(super) async fn touch_again(&mut self, past: &Past, next: Place) -> Result<(), Halt> {
        let by_hand = self.conditions.spec.stage.home == Home::ByHand;
        let (landmarks, mut repeated) = (past.landmarks(self.plan), Vec::new());
        for (nth, known) in landmarks.iter().enumerate() {
            let next = landmarks.get(nth + 1).map_or(next, |known| known.place);
            let force_n = known.force_n.min(TOUCH_SHARE * self.conditions.spec.limits.force_n);
            let task = PressTask {
                levels: PressTask::press(force_n),
                force_tolerance_n: TOUCH_TOLERANCE * force_n,
                depth_tolerance_mm: 0.0, // no depth is set
                hold_s: 0.0,
                sample_s: TOUCH_SAMPLE_S,
                strategy: Strategy::Guarded,
                sample_after_s: None,
                over_time: None,
                drag: None,
            };
            let task = if by_hand { again(known, self.plan).unwrap_or(task) } else { task };
            let number = UNCOUNTED + nth as u64;
            let pressed = self
                .again_if_missed(async |runner: &mut Runner<'_>| runner.contact(number, known.place, &task, next).await)
                .await?;
            let touched_mm = pressed.touched_mm.unwrap_or(f64::NAN);
            let t_s = self.conditions.clock.now_s();
            let retouch = Retouch { t_s, place: known.place, before_mm: known.z_mm, touched_mm };
            self.ledger.record(&Record::Retouch(retouch))?;
            self.listener.retouched(&retouch);
            let moved_mm = touched_mm - known.z_mm;
            let is_there = moved_mm.abs() <= MOVED_MOST_MM; // written as the positive condition, so NaN fails
            if !is_there {
                return Err(Trip::new(SafetyRule::SurfaceMoved, moved_mm, MOVED_MOST_MM, "mm").into());
            }
            if let (true, Some((before, _)), Some(now)) = (by_hand, &known.felt, pressed.felt(known.place)) {
                repeated.push((before.clone(), now));
            }
        }
        if let Some(shift) = sideways_shift(&repeated, &past.felt) {
            let shift_mm = shift.distance_mm(Place::default());
            if shift_mm > SHIFT_MOST_MM {
                return Err(Trip::new(SafetyRule::ZeroShifted, shift_mm, SHIFT_MOST_MM, "mm").into());
            }
        }
        Ok(())
    }

    /// Goes to the position where the last contact ended, above the next place. The earlier no-load readings of the cell remain valid
    /// if the cell still reads the same.
    pub(super) async fn go_back(&mut self, place: Place, before: Standby) -> Result<(), Halt> {
        self.go_to(place).await?;
        self.rig_control.cell.begin_no_load();
        let now = self.rig_control.cell.end_no_load().await?;
        let zero = *self.rig_control.cell.watch.zero();
        let first_mm = self.map.expect(place).first_mm;
        // no nearer than x and y may move, even if a journal states it
        let back_mm = before.z_mm.min(self.permit.clear_mm(first_mm));
        if self.rig_control.z_mm < back_mm {
            let sensor_state = MotionContext {
                z_mm: self.rig_control.z_mm,
                force_n: now.mean_n - zero.at_n(now.at_s),
                sigma_n: zero.sigma_mean_n(now.readings),
                age_s: self.rig_control.cell.age_s(),
                first_mm,
                most_mm: f64::INFINITY,
            };
            let granted = self.permit.advance(&sensor_state, back_mm, self.rig_control.usage.speed_mm_s)?;
            self.rig_control.move_z(granted, None).await?;
            self.rig_control.cell.settle().await?;
        }
        // an earlier process had another clock
        let of_now = |before: NoLoad| match before.force.at_s > 0.0 {
            true => before,
            false => NoLoad { force: NoLoadReadings { at_s: now.at_s, ..before.force }, ..before },
        };
        let is_same = |before: &NoLoad| {
            let most_n = SAME_SIGMAS * zero.sigma_mean_n(now.readings).hypot(zero.sigma_mean_n(before.force.readings));
            (now.mean_n - before.force.mean_n - zero.drift.rate_n_s * (now.at_s - before.force.at_s)).abs() <= most_n
        };
        self.standby = Some(Standby { no_load: before.no_load.map(of_now).filter(is_same), ..before });
        Ok(())
    }
}
