//! A Universal Robots arm of the e-Series with PolyScope 5, as its ports show it. The facts are those of the public
//! documents "RTDE guide", "Dashboard Server e-Series", "Primary and Secondary Interfaces" and "URScript manual", and
//! of public clients.
//!
//! Port 30004 is RTDE, 30002 the secondary interface, which takes programs, and 29999 the dashboard. Each served link
//! has its own state. The controller belongs to all of them: its programs run while any link is open.
//!
//! The flange is the scene's indenter, and the TCP is there until a program sets another one; then poses are those of that point, and
//! the arm stays where it is. Programs compute with poses as the "URScript manual" has it: `pose_add` of a pose without a rotation
//! shifts along the axes of the base. A text message goes to the pendant only, so a program that refuses has to write a register, too.
//!
//! Motions are straight, with a trapezoid of speed, and the speed
//! slider scales their time. A slider that is moved during a motion changes its speed with the acceleration of the
//! motion. A motion that only turns the tool takes its speed as rad/s. A blend radius is accepted, and the arm stops
//! anyway. The joints aren't modelled, so a pose is reachable if it is near enough to the base. Nothing switches the
//! power on, or continues a paused program.
//!
//! `actual_TCP_force` is the force of the environment on the tool, in the base frame: a tool that points down and
//! presses reads a positive z. `target_speed_fraction` is the slider. `speed_scaling` is that of the trajectory
//! limiter, which doesn't act here: it stays 1. The product of both scales the speed of a motion.

mod arm;
mod dashboard;
mod motion;
mod pose;
mod programs;
mod robot;
mod rtde;
mod script;
mod secondary;
#[cfg(test)]
mod tests;
mod turn;
mod variables;

use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
pub use arm::{UrArm, UrFault, UrFaultAfterBytes, UrFaultKind};
use dashboard::Dashboard;
use palpate_core::parallel::lock;
use robot::Robot;
use rtde::Rtde;
use secondary::Secondary;
use std::sync::{Arc, Mutex};
use tokio::sync::Notify;

/// Port of the dashboard.
pub const DASHBOARD_PORT: u16 = 29999;
/// Port of the secondary interface.
pub const SECONDARY_PORT: u16 = 30002;
/// Port of RTDE.
pub const RTDE_PORT: u16 = 30004;

/// Version of the controller and its date.
const VERSION: [u32; 4] = [5, 11, 9, 1_010_452];
const VERSION_DATE: &str = "Jan 24 2022";

/// What a link to a port does. The methods are those of [`Instrument`]. The events of the controller needn't be thought
/// of.
trait Link: Send {
    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>>;
    fn answer(&mut self, request: &[u8], robot: &mut Robot, scene: &mut Scene, now_s: f64) -> Vec<u8>;
    fn owed(&mut self, robot: &Robot, scene: &mut Scene, now_s: f64) -> Owed;
}

/// A robot at one of its ports, or one link to it. A new one is at the port of RTDE; [`at_port`](Instrument::at_port)
/// returns the others.
pub struct UrEmulator {
    robot: Shared<Robot>,
    bell: Arc<Notify>,
    port: u16,
    link: Box<dyn Link>,
    held: Vec<u8>,
}

impl UrEmulator {
    /// Creates a robot that is switched on, with released brakes, in remote control. The tip is at the present place of
    /// the scene's axes.
    pub fn new(arm: UrArm, scene: &Scene) -> Self {
        let robot = Arc::new(Mutex::new(Robot::new(arm, scene)));
        UrEmulator { robot, bell: Arc::default(), port: RTDE_PORT, link: Box::<Rtde>::default(), held: Vec::new() }
    }
}

impl Instrument for UrEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        if self.port != SECONDARY_PORT {
            return self.link.take_request(inbox);
        }
        lock(&self.robot).faults.admit(inbox, &mut self.held, |bytes| self.link.take_request(bytes))
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut robot = lock(&self.robot);
        robot.run(scene, now_s);
        let answer = if request.is_empty() { Vec::new() } else { self.link.answer(request, &mut robot, scene, now_s) };
        self.bell.notify_waiters();
        answer
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        self.at_port(self.port)
    }

    fn at_port(&self, port: u16) -> Option<Shared<dyn Instrument>> {
        let link: Box<dyn Link> = match port {
            DASHBOARD_PORT => Box::<Dashboard>::default(),
            SECONDARY_PORT => Box::<Secondary>::default(),
            RTDE_PORT => Box::<Rtde>::default(),
            _ => return None,
        };
        let (robot, bell) = (self.robot.clone(), self.bell.clone());
        Some(Arc::new(Mutex::new(UrEmulator { robot, bell, port, link, held: Vec::new() })))
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        Some(self.bell.clone())
    }

    /// Returns what this link is owed, and lets the controller continue. Every open link does this.
    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        let mut robot = lock(&self.robot);
        robot.run(scene, now_s);
        match (self.link.owed(&robot, scene, now_s), robot.next_s()) {
            (Owed::At(at_s), next_s) => Owed::At(at_s.min(next_s)),
            (Owed::Nothing, next_s) if next_s.is_finite() => Owed::At(next_s),
            (owed, _) => owed,
        }
    }
}
