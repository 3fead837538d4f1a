//! Preparation of the groups of an XPS: initialised, homed, within the rig's travel.

use super::CALL_DEADLINE;
use super::stage::Xps;
use super::text::{GroupState, XpsReply};
use crate::MOTION_MARGIN;
use crate::clear::{CLEARING_Z, clear_z};
use palpate_core::quantity::Axis;
use palpate_link::device::{DeviceError, DeviceProblem, MotionOrder, MotionOrders, Stage, StageUse};
use palpate_link::time::{Instant, sleep};
use std::time::Duration;

/// Longest time for initialisation and search for home.
const HOME_DEADLINE: Duration = Duration::from_secs(120);

/// Rest between killing, initialising and homing a group, required by some firmware (EPICS waits as long).
const BETWEEN: Duration = Duration::from_millis(50);

/// Largest difference of two limits of a travel that are the same, mm.
const SAME_LIMIT_MM: f64 = 0.001;

impl Xps {
    /// Makes a group able to move and checks its axes.
    pub(super) async fn prepare(
        &mut self,
        nth: usize,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        self.acceleration_mm_s2 = usage.acceleration_mm_s2;
        self.bring_to_ready(nth, usage, orders).await?;
        for axis in self.groups[nth].axes.clone() {
            self.set_up(axis, usage).await?;
        }
        Ok(())
    }

    /// Brings a group to rest and makes it able to move. Initialises it if needed, and searches for home if it isn't referenced.
    pub(super) async fn bring_to_ready(
        &mut self,
        nth: usize,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let doing = "making its group ready";
        let group = self.groups[nth].name.clone();
        let state = self.until_still(nth, doing, MOTION_MARGIN).await?;
        match state {
            GroupState::Ready => return Ok(()),
            GroupState::Disabled => {
                self.ask(doing, &format!("GroupMotionEnable({group})")).await?;
                return Ok(());
            }
            _ if !self.grouping.home_search => {
                let text = format!(
                    "the group {group} isn't homed. Home it with the specimen removed, or set home_search = true \
                     if its way is clear of the specimen"
                );
                return Err(self.error(doing, DeviceProblem::Mismatch(text)));
            }
            _ => {}
        }
        if nth > 0 {
            // its group may have been homed before, and z may be in contact
            if let Some(problem) = clear_z(self, usage, orders).await? {
                return Err(self.error(CLEARING_Z, problem));
            }
        }
        if state != GroupState::NotReferenced {
            // from the state after an earlier fault
            self.ask(doing, &format!("GroupKill({group})")).await?;
            sleep(BETWEEN).await;
            self.wait_for(nth, "initialising its group", &format!("GroupInitialize({group})"), orders).await?;
            sleep(BETWEEN).await;
        }
        self.wait_for(nth, "homing", &format!("GroupHomeSearch({group})"), orders).await?;
        match self.until_still(nth, "homing", MOTION_MARGIN).await? {
            GroupState::Ready => Ok(()),
            state => {
                Err(self.error("homing", DeviceProblem::Motion(format!("the group is {state:?} after its search"))))
            }
        }
    }

    /// Sends a call that is answered when its operation has ended. A stop kills the group, which is an error.
    async fn wait_for(
        &mut self,
        nth: usize,
        doing: &str,
        call: &str,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let Xps { groups, brakes, .. } = self;
        let moves = &mut groups[nth].moves;
        moves.begin(doing, call, CALL_DEADLINE).await?;
        let until = Instant::now() + HOME_DEADLINE;
        let answer = loop {
            tokio::select! {
                biased;
                () = orders.pulled().notified() => {
                    if orders.take() == Some(MotionOrder::Stop) {
                        brakes.kill(nth, doing).await?;
                    }
                }
                answer = moves.answer_by(doing, until) => break answer?,
            }
        };
        match answer {
            Some(XpsReply { code: 0, .. }) => Ok(()),
            Some(XpsReply { code, .. }) => Err(moves.refused(doing, call, code)),
            None => {
                brakes.kill(nth, doing).await?;
                moves.close();
                let text = format!("{call} didn't finish within {} s", HOME_DEADLINE.as_secs());
                Err(self.error(doing, DeviceProblem::Motion(text)))
            }
        }
    }

    /// Checks the controller's limits against the rig's, and narrows the controller's travel to the rig's.
    pub(super) async fn set_up(&mut self, axis: Axis, usage: &StageUse) -> Result<(), DeviceError> {
        let (doing, positioner, travel) =
            ("checking an axis against the rig", self.positioner(axis), usage.travel.along(axis));
        let call = format!("PositionerMaximumVelocityAndAccelerationGet({positioner},double *,double *)");
        let [fastest_mm_s, most_mm_s2] = self.ask_numbers(doing, &call).await?;
        for (most, wanted, key) in [
            (fastest_mm_s, usage.speed_mm_s, "speed_mm_s"),
            (most_mm_s2, usage.acceleration_mm_s2, "acceleration_mm_s2"),
        ] {
            if most < wanted {
                let text = format!("{positioner} allows {key} up to {most}, less than the rig's {wanted}");
                return Err(self.error(doing, DeviceProblem::Mismatch(text)));
            }
        }
        let read = format!("PositionerUserTravelLimitsGet({positioner},double *,double *)");
        let [least_mm, most_mm] = self.ask_numbers(doing, &read).await?;
        if travel.min < least_mm - SAME_LIMIT_MM || travel.max > most_mm + SAME_LIMIT_MM {
            let text = format!(
                "{positioner} goes from {least_mm} to {most_mm} mm, but the rig's travel is {} to {} mm",
                travel.min, travel.max
            );
            return Err(self.error(doing, DeviceProblem::Mismatch(text)));
        }
        let set = format!("PositionerUserTravelLimitsSet({positioner},{},{})", travel.min, travel.max);
        self.ask(doing, &set).await?;
        let [least_mm, most_mm] = self.ask_numbers(doing, &read).await?;
        if (least_mm - travel.min).abs().max((most_mm - travel.max).abs()) > SAME_LIMIT_MM {
            let text = format!("{positioner} was limited to the rig's travel but reports {least_mm} to {most_mm} mm");
            return Err(self.error(doing, DeviceProblem::Mismatch(text)));
        }
        let call = format!("PositionerSGammaParametersGet({positioner},double *,double *,double *,double *)");
        self.profiles[axis.index()] = self.ask_numbers(doing, &call).await?;
        Ok(())
    }
}
