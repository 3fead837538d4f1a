//! The Newport XPS-Q8 with one group of three VP-25XL: calls in, replies out, over several sockets (what is known of its
//! manual, and what clients in the field send and take).
//!
//! A call that is answered when it is finished (moves, homing, initialisation) holds its own socket: another one there is
//! answered with -1 until then. Other sockets are served, and end it: after `GroupMoveAbort` it answers -27, after
//! `GroupKill` -26, both once the group rests; the abort itself answers at once.
//!
//! `GroupHomeSearch` homes z first, then x and y together. Jerk times are kept and otherwise mean nothing. Where the
//! manual is silent, this controller is the stricter of two readings: a group does one thing at a time, so a move of one of
//! its positioners is refused (-22) while another moves; results are named in their number and by their types.
//!
//! An event that guards a move is looked at once a millisecond, and only while it is started and something moves that it
//! could stop.

mod controller;
mod errors;
mod events;
mod group;
mod motion;
mod positioner;
mod syntax;
#[cfg(test)]
mod tests;

use super::{Instrument, Owed, Shared};
use crate::scene::{Device, Scene};
use controller::{Answer, Controller};
use errors::Code;
use group::{Group, Outcome};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use syntax::Call;
use tokio::sync::Notify;

/// A Newport XPS-Q8 motion controller with one group of three VP-25XL stages: 12.5 mm to either side, 25 mm/s. Its analog
/// input `GPIO2.ADC1` reads the load cell.
///
/// It is switched on with its group not initialised, and takes the place where each positioner stands for zero until they are
/// homed. One of these is one socket; each link that is served opens its own.
pub struct Xps {
    controller: Shared<Controller>,
    bell: Arc<Notify>,
    pending: Option<Pending>,
}

/// A call that is answered later.
struct Pending {
    request: Vec<u8>,
    outcome: Outcome,
}

impl Xps {
    /// A controller that is switched on where the scene's axes stand. `positioners` are those of x, y and z, called
    /// `group.positioner`; the load cell's amplifier gives so many volts a newton.
    pub fn new(scene: &Scene, group: &str, positioners: [&str; 3], volts_per_newton: f64) -> Self {
        let controller = Controller::new(Group::new(group, positioners, scene), volts_per_newton);
        Xps::on(Arc::new(Mutex::new(controller)), Arc::default())
    }

    fn on(controller: Shared<Controller>, bell: Arc<Notify>) -> Self {
        Xps { controller, bell, pending: None }
    }

    /// The controller is the last to be locked, after the instrument and the scene.
    fn controller(&self) -> MutexGuard<'_, Controller> {
        self.controller.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Instrument for Xps {
    fn device(&self) -> Device {
        Device::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        syntax::take_request(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut controller = self.controller();
        controller.notice(scene, now_s);
        let answer = match self.pending {
            Some(_) => Err(Code::BUSY_SOCKET),
            None => Call::read(request).and_then(|call| controller.run(call, scene, now_s)),
        };
        let stirred = controller.take_stirred();
        drop(controller);
        if stirred {
            self.bell.notify_waiters();
        }
        match answer {
            Ok(Answer::Values(values)) => syntax::done(&values),
            Ok(Answer::Later(outcome)) => {
                self.pending = Some(Pending { request: request.to_vec(), outcome });
                Vec::new()
            }
            Err(code) => syntax::failed(code, request),
        }
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        Some(Arc::new(Mutex::new(Xps::on(self.controller.clone(), self.bell.clone()))))
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    /// The link that waits for the group's errand is the one by whose asking the controller continues; if it was closed, or
    /// nobody ever waited, it is all others.
    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        let mut controller = self.controller();
        controller.notice(scene, now_s);
        let (stirred, next_s) = (controller.take_stirred(), controller.next_s(now_s));
        let waits = self.pending.is_some() || controller.is_unattended();
        drop(controller);
        if stirred {
            self.bell.notify_waiters();
        }
        if let Some(Pending { request, outcome }) = &self.pending
            && let Some(&code) = outcome.get()
        {
            let reply = if code == Code::DONE { syntax::done("") } else { syntax::failed(code, request) };
            self.pending = None;
            return Owed::Ready(reply);
        }
        if waits && next_s.is_finite() { Owed::At(next_s) } else { Owed::Nothing }
    }
}

impl Drop for Xps {
    /// What this link waited for continues, and others must look after it.
    fn drop(&mut self) {
        if self.pending.take().is_some() {
            self.bell.notify_waiters();
        }
    }
}
