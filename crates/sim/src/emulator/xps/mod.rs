//! The Newport XPS-Q8 with three VP-25XL in one, two or three groups: receives calls and sends replies over several sockets. It follows the
//! known parts of its manual and the calls and replies of existing clients.
//!
//! A call that is answered when it is finished (moves, homing, initialisation) occupies its own socket. Another call there is
//! answered with -1 until then. Calls on other sockets are served and can end it. After `GroupMoveAbort` it answers -27, and
//! after `GroupKill` -26, both once the group rests. The abort itself answers at once.
//!
//! `GroupHomeSearch` homes z first if the group has it, then x and y together. Groups move independently. Jerk times are stored and have no
//! other effect. If the manual isn't clear, this controller follows the stricter of two readings. A group does one thing at a time, so a
//! move of one positioner is refused (-22) while another moves. Calls must name the number and the types of their results.
//!
//! An event that guards a move is checked once in each millisecond, only while it is started and a motion that it could stop is
//! under way.

mod controller;
mod errors;
mod events;
mod fault;
mod group;
mod motion;
mod positioner;
mod syntax;
#[cfg(test)]
mod tests;

use super::faults::Faults;
use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
use controller::{CallReply, Controller};
use errors::Code;
pub use fault::{XpsFault, XpsFaultAfterBytes, XpsFaultKind};
use group::{EmulatedGroup, PendingReply};
use palpate_core::parallel::lock;
use palpate_core::quantity::Axis;
use positioner::EmulatedPositioner;
use std::sync::{Arc, Mutex, MutexGuard};
use syntax::Call;
use tokio::sync::Notify;

/// A Newport XPS-Q8 motion controller with three VP-25XL stages in any groups: 12.5 mm to either side, 25 mm/s. Its analog input
/// `GPIO2.ADC1` reads the load cell.
///
/// At power-on its groups aren't initialised. The present place of each positioner counts as zero until it is homed. One value of
/// this type is one socket; each served link opens its own.
pub struct XpsEmulator {
    controller: Shared<Controller>,
    bell: Arc<Notify>,
    pending: Option<Pending>,
    /// Number of restarts of the controller when this socket was first served.
    opened: Option<u32>,
    held: Vec<u8>,
}

/// Call that is answered later.
struct Pending {
    request: Vec<u8>,
    outcome: PendingReply,
}

impl XpsEmulator {
    /// Creates a controller that is switched on at the present place of the scene's axes. `positioners` are those of x, y and z,
    /// each after its group: `("XYZ", "X")`. Those of one group are in it in this order. `volts_per_newton` is the gain of the load
    /// cell's amplifier.
    pub fn new(scene: &Scene, positioners: [(&str, &str); 3], volts_per_newton: f64) -> Self {
        let mut groups: Vec<(&str, Vec<EmulatedPositioner>)> = Vec::new();
        for (axis, (group, positioner)) in Axis::ALL.into_iter().zip(positioners) {
            let positioner = EmulatedPositioner::new(positioner, axis, scene);
            match groups.iter_mut().find(|(name, _)| *name == group) {
                Some((_, positioners)) => positioners.push(positioner),
                None => groups.push((group, vec![positioner])),
            }
        }
        let groups = groups.into_iter().map(|(name, positioners)| EmulatedGroup::new(name, positioners)).collect();
        let controller = Controller::new(groups, volts_per_newton);
        XpsEmulator::on(Arc::new(Mutex::new(controller)), Arc::default())
    }

    fn on(controller: Shared<Controller>, bell: Arc<Notify>) -> Self {
        XpsEmulator { controller, bell, pending: None, opened: None, held: Vec::new() }
    }

    /// Gives the controller faults: at their times, and after some bytes.
    #[must_use]
    pub fn with_faults(self, timed: &[XpsFault], after_bytes: &[XpsFaultAfterBytes]) -> Self {
        self.controller().faults = Faults::new(timed, after_bytes);
        self
    }

    /// Whether the controller has closed this socket.
    fn is_closed(&mut self, now_s: f64) -> bool {
        let (restarts, down_until_s) = {
            let controller = self.controller();
            (controller.restarts, controller.down_until_s)
        };
        *self.opened.get_or_insert(restarts) != restarts || now_s < down_until_s
    }

    /// Returns what arrives of an answer.
    fn said(&self, reply: Vec<u8>, now_s: f64) -> Vec<u8> {
        match self.controller().faults.take(now_s, |kind| !kind.is_timed()) {
            Some(XpsFaultKind::LostAnswer) => Vec::new(),
            Some(_) => reply.repeat(2),
            None => reply,
        }
    }

    /// Locks the controller. It is locked last, after the instrument and the scene.
    fn controller(&self) -> MutexGuard<'_, Controller> {
        lock(&self.controller)
    }
}

impl Instrument for XpsEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        lock(&self.controller).faults.admit(inbox, &mut self.held, syntax::take_request)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        self.is_closed(now_s); // it is open from now on
        self.controller().notice(scene, now_s);
        if self.is_closed(now_s) || request.is_empty() {
            self.bell.notify_waiters();
            return Vec::new();
        }
        let mut controller = self.controller();
        let answer = match self.pending {
            Some(_) => Err(Code::BUSY_SOCKET),
            None => Call::read(request).and_then(|call| controller.run(call, scene, now_s)),
        };
        let stirred = controller.take_stirred();
        drop(controller);
        if stirred {
            self.bell.notify_waiters();
        }
        let reply = match answer {
            Ok(CallReply::Values(values)) => syntax::done(&values),
            Ok(CallReply::Later(outcome)) => {
                self.pending = Some(Pending { request: request.to_vec(), outcome });
                return Vec::new();
            }
            Err(code) => syntax::failed(code, request),
        };
        self.said(reply, now_s)
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        Some(Arc::new(Mutex::new(XpsEmulator::on(self.controller.clone(), self.bell.clone()))))
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    /// Returns what this link is owed, and lets the controller continue. Normally a link that waits for a group's operation does
    /// this. If that link was closed or never existed, all other links do it.
    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        self.is_closed(now_s); // it is open from now on
        let mut controller = self.controller();
        controller.notice(scene, now_s);
        let (stirred, next_s) = (controller.take_stirred(), controller.next_s(now_s));
        let waits = self.pending.is_some() || controller.is_unattended();
        let fault_s = controller.faults.next_s(XpsFaultKind::is_timed);
        drop(controller);
        if stirred {
            self.bell.notify_waiters();
        }
        if self.is_closed(now_s) {
            return Owed::HungUp;
        }
        if let Some(Pending { request, outcome }) = &self.pending
            && let Some(&code) = outcome.get()
        {
            let reply = if code == Code::DONE { syntax::done("") } else { syntax::failed(code, request) };
            self.pending = None;
            let reply = self.said(reply, now_s);
            return if reply.is_empty() { self.owed(scene, now_s) } else { Owed::Ready(reply) };
        }
        let next_s = if waits { next_s.min(fault_s) } else { fault_s };
        if next_s.is_finite() { Owed::At(next_s) } else { Owed::Nothing }
    }
}

impl Drop for XpsEmulator {
    /// Notifies the other links. The operation for which this link waited continues, and the other links must look after it.
    fn drop(&mut self) {
        if self.pending.take().is_some() {
            self.bell.notify_waiters();
        }
    }
}
