//! Guard that the controller itself checks during a motion.

use super::CALL_DEADLINE;
use super::socket::Socket;
use super::text::XpsReply;
use palpate_link::device::{DeviceError, DeviceProblem};

/// Guard that the controller itself checks during a motion. The controller aborts without asking the host.
#[derive(Clone, Debug, PartialEq)]
pub struct Guard {
    /// The load cell's input, such as `GPIO2.ADC1`.
    pub input: String,
    /// Newtons per volt of that input.
    pub newton_per_volt: f64,
}

/// Event in the controller that aborts a group's motion.
#[derive(Debug)]
pub(super) struct Armed {
    id: i64,
    pub limit_n: f64,
}

impl Guard {
    /// Arms the guard: a motion of the group is aborted when the reading reaches `limit_n`, including the cell's own zero.
    pub(super) async fn arm(&self, socket: &mut Socket, group: &str, limit_n: f64) -> Result<Armed, DeviceError> {
        let doing = "arming its guard on the force";
        let volts = limit_n / self.newton_per_volt;
        let side = if self.newton_per_volt > 0.0 { "ADCHighLimit" } else { "ADCLowLimit" };
        let (input, condition) = (&self.input, format!("{group}.SGamma.MotionState,0,0,0,0"));
        let trigger = format!("EventExtendedConfigurationTriggerSet({input}.{side},{volts:.6},0,0,0,{condition})");
        let action = format!("EventExtendedConfigurationActionSet({group}.MoveAbort,0,0,0,0)");
        socket.call(doing, &trigger, CALL_DEADLINE).await?;
        socket.call(doing, &action, CALL_DEADLINE).await?;
        let started = socket.call(doing, "EventExtendedStart(int *)", CALL_DEADLINE).await?;
        let id = started.first().and_then(|id| id.trim().parse().ok()).filter(|&id| id >= 0);
        let id = id.ok_or_else(|| {
            let expected = "the number of an event".to_owned();
            socket.error(doing, DeviceProblem::Misfit { answer: started.join(","), expected })
        })?;
        Ok(Armed { id, limit_n })
    }
}

impl Armed {
    /// Removes the guard. An event that has already happened no longer exists, which is no error.
    pub(super) async fn disarm(self, socket: &mut Socket) -> Result<(), DeviceError> {
        let call = format!("EventExtendedRemove({})", self.id);
        let XpsReply { .. } = socket.call_plainly("removing its guard on the force", &call, CALL_DEADLINE).await?;
        Ok(())
    }
}
