//! A port of the controller, and what its links do.

use super::robot::Robot;
use crate::emulator::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
use palpate_core::parallel::lock;
use std::sync::{Arc, Mutex};
use tokio::sync::Notify;

/// One link to a port.
pub(super) trait Link: Send + Sized + 'static {
    /// Opens a link.
    fn open(robot: &mut Robot) -> Self;

    /// Closes the link.
    fn close(&mut self, robot: &mut Robot) {
        let _ = robot;
    }

    /// See [`Instrument::take_request`].
    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>>;

    /// See [`Instrument::answer`].
    fn answer(&mut self, request: &[u8], robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Vec<u8>;

    /// See [`Instrument::owed`]. The events of the controller needn't be thought of.
    fn owed(&mut self, robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Owed;
}

/// A port, or a link to it: each served link opens its own.
pub(super) struct Port<L: Link> {
    pub robot: Shared<Robot>,
    pub bell: Arc<Notify>,
    link: L,
}

impl<L: Link> Port<L> {
    pub(super) fn of(robot: Shared<Robot>, bell: Arc<Notify>) -> Self {
        let link = L::open(&mut lock(&robot));
        Port { robot, bell, link }
    }
}

impl<L: Link> Instrument for Port<L> {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.link.take_request(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut robot = lock(&self.robot);
        robot.run(scene, now_s);
        let answer = self.link.answer(request, &mut robot, scene, now_s);
        drop(robot);
        self.bell.notify_waiters();
        answer
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        Some(Arc::new(Mutex::new(Port::<L>::of(self.robot.clone(), self.bell.clone()))))
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    /// Returns what this link is owed, and lets the controller continue. Every open link does this.
    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        let mut robot = lock(&self.robot);
        robot.run(scene, now_s);
        match (self.link.owed(&mut robot, scene, now_s), robot.next_s()) {
            (Owed::At(at_s), next_s) => Owed::At(at_s.min(next_s)),
            (Owed::Nothing, next_s) if next_s.is_finite() => Owed::At(next_s),
            (owed, _) => owed,
        }
    }
}

impl<L: Link> Drop for Port<L> {
    fn drop(&mut self) {
        self.link.close(&mut lock(&self.robot));
    }
}
