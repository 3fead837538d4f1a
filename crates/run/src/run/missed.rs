//! Missed readings of the array or of a monitor: the indenter leaves the contact, and what was under way is done again.
//!
//! Only these two are asked again. A load cell or a stage that doesn't answer ends the run.

use super::Halt;
use super::execute::Runner;
use super::monitors::{Monitors, answers};
use super::rig_control::RigControl;
use palpate_core::quantity::Place;
use palpate_data::dataset::{self, Flag, MissedReading, NoLoad, Record, RecordedContact};
use palpate_data::recipe::{Entry, OnMiss};
use palpate_link::device::{DeviceError, DeviceProblem, LoadCell, SensorArray, Stage};
use palpate_link::time::{sleep, timeout};
use std::time::Duration;

/// Number of times that a press is made again. A link that fails three times in a row at one press has a cause that doesn't pass.
const RETRIES_MOST: u32 = 2;

/// Longest wait for an array or a monitor that is silent, before each retry. A converter that restarts, or a USB device that is found again, takes some
/// seconds.
const BACK_WITHIN: Duration = Duration::from_secs(10);

/// Pause between two attempts to reach it. A device that restarts needn't answer more often.
const ASK_EVERY: Duration = Duration::from_millis(500);

/// Largest number of presses in a row with missed readings that are only flagged. An array that is gone for so long needs a person, and the
/// specimen needs no more presses.
const FLAGGED_MOST: u32 = 10;

impl Halt {
    /// Returns the halt for a reading of the array or of a monitor that failed. What can't pass by itself isn't a missed reading: a program
    /// that has ended isn't started again, because a new one may be another.
    pub(super) fn unread(error: DeviceError) -> Halt {
        match error.problem {
            DeviceProblem::Link(_) | DeviceProblem::Refused(_) | DeviceProblem::Misfit { .. } => Halt::Missed(error),
            _ => error.into(),
        }
    }
}

impl<'a> Runner<'a> {
    /// Does something that begins and ends in the clear. If a reading is missed meanwhile, leaves the contact and does it again.
    ///
    /// # Errors
    /// Readings were missed each time; the indenter is in the clear. Or another halt.
    pub(super) async fn again_if_missed<T>(
        &mut self,
        mut act: impl AsyncFnMut(&mut Runner<'a>) -> Result<T, Halt>,
    ) -> Result<T, Halt> {
        let mut retries = 0;
        loop {
            let missed = match act(self).await {
                Err(Halt::Missed(error)) if self.plan.on_miss != OnMiss::End => error,
                done => return done,
            };
            let (t_s, press, why) = (self.conditions.clock.now_s(), self.pressing, missed.to_string());
            self.rig_control.array_answers = false;
            self.leave_unfinished().await?;
            self.ledger.record(&Record::Missed(MissedReading { t_s, press, why }))?;
            if retries == RETRIES_MOST || !self.rig_control.are_back(&mut self.monitors).await? {
                return Err(Halt::Missed(missed));
            }
            retries += 1;
            self.listener.waits(&format!("{missed}: trying again ({retries} of {RETRIES_MOST})"));
        }
    }

    /// Makes an entry of the plan, again if readings are missed. If they are missed each time, the recipe may have its row flagged.
    pub(super) async fn press_again_if_missed(
        &mut self,
        entry: &Entry,
        next: Option<Place>,
    ) -> Result<RecordedContact, Halt> {
        let series = self.rig_control.series.clone();
        let made = self
            .again_if_missed(async |runner: &mut Runner<'a>| {
                series.iter().for_each(|series| series.begin(entry.press, runner.monitors.values()));
                runner.press(entry, next).await
            })
            .await;
        match made {
            Ok(mut contact) if self.monitors.are_missed() => {
                self.flagged += 1;
                contact.levels.iter_mut().for_each(|level| level.flags.push(Flag::Missed));
                Ok(contact)
            }
            Ok(contact) => {
                self.flagged = 0;
                Ok(contact)
            }
            Err(Halt::Missed(_)) if self.may_flag() => {
                self.flagged += 1;
                self.missed_contact(entry).await
            }
            Err(halt) => Err(halt),
        }
    }

    /// Reads the monitors that are due, again if readings are missed. Returns how long the next press must wait; `None` if it may begin: also
    /// if the recipe has its row flagged.
    pub(super) async fn look_at_monitors(&mut self) -> Result<Option<Duration>, Halt> {
        let looked = self
            .again_if_missed(async |runner: &mut Runner<'a>| {
                runner.monitors.look(runner.conditions.clock, runner.listener).await
            })
            .await;
        match looked {
            Err(Halt::Missed(_)) if self.may_flag() => Ok(None),
            looked => looked,
        }
    }

    /// Whether a press with missed readings may be flagged.
    fn may_flag(&self) -> bool {
        self.plan.on_miss == OnMiss::Flag && self.flagged < FLAGGED_MOST
    }

    /// Leaves a contact before its press has ended: the force is watched, and z goes to the clear. The array isn't asked before.
    pub(super) async fn leave_unfinished(&mut self) -> Result<(), Halt> {
        self.standby = None;
        let park_mm = self.park_mm();
        let rig_control = &mut self.rig_control;
        rig_control.cell.watch.pause();
        rig_control.watch_z().await?;
        rig_control.stage.guard(None).await?;
        if rig_control.z_mm > park_mm {
            let granted = self.permit.retract(rig_control.z_mm, park_mm, rig_control.usage.speed_mm_s)?;
            rig_control.move_z(granted, None).await?;
            rig_control.cell.settle().await?;
        }
        // a motion of x and y may have ended without a word about its end
        rig_control.find_itself().await
    }

    /// Returns the record of an entry whose readings were missed each time: what is known without the array.
    async fn missed_contact(&mut self, entry: &Entry) -> Result<RecordedContact, Halt> {
        self.rig_control.cell.begin_no_load();
        let force = self.rig_control.cell.end_no_load().await?;
        let no_load = NoLoad { force, outputs: Vec::new() };
        let (t_s, units) = (self.conditions.clock.now_s(), self.rig_control.array.units());
        let row = |level: usize| {
            let set = entry.task.level_set(level);
            let row = dataset::Press {
                press: entry.press,
                level: level as u64,
                phase: Some(entry.phase),
                x_mm: entry.place.x_mm,
                y_mm: entry.place.y_mm,
                force_set_n: set.force_n(),
                depth_set_mm: set.depth_mm(),
                t_s: Some(t_s),
                outputs: vec![f64::NAN; units],
                flags: vec![Flag::Missed],
                air_before_n: Some(force.mean_n),
                air_after_n: Some(force.mean_n),
                ..dataset::Press::default()
            };
            row.rounded()
        };
        Ok(RecordedContact {
            press: entry.press,
            levels: (0..entry.task.levels.len()).map(row).collect(),
            no_load_before: no_load.clone(),
            no_load_after: no_load,
            monitors: self.monitors.values(),
            ..RecordedContact::default()
        })
    }
}

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Waits in the clear until the array and the monitors that were silent answer. The load cell is read meanwhile. Returns whether they
    /// are back.
    async fn are_back(&mut self, monitors: &mut Monitors) -> Result<bool, Halt> {
        let (cell, array) = (&mut self.cell, &mut self.array);
        let asks = async {
            while !answers(array).await || !monitors.answer().await {
                sleep(ASK_EVERY).await;
            }
        };
        cell.watch.pause();
        let is_back = cell.watched_while(timeout(BACK_WITHIN, asks)).await?.is_ok();
        self.array_answers = is_back;
        Ok(is_back)
    }
}
