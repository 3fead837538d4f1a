//! A Universal Robots arm of the e-Series with PolyScope 5, as its ports show it. The facts are those of the public
//! documents "RTDE guide", "Dashboard Server e-Series", "Primary and Secondary Interfaces" and "URScript manual", and
//! of public clients.
//!
//! Port 30004 is RTDE, 30002 the secondary interface, which takes programs, and 29999 the dashboard. Each served link
//! has its own state. The controller belongs to all of them: its programs run while any link is open.
//!
//! The tip of the tool is the scene's indenter. Motions are straight, with a trapezoid of speed, and the speed slider
//! scales their time. A slider that is moved during a motion changes its speed with the acceleration of the motion. A
//! motion that only turns the tool takes its speed as rad/s. A blend radius is accepted, and the arm stops anyway. The
//! joints aren't modelled, so a pose is reachable if it is near enough to the base.
//!
//! `actual_TCP_force` is the force of the environment on the tool, in the base frame: a tool that points down and
//! presses reads a positive z. `target_speed_fraction` is the slider. `speed_scaling` is that of the trajectory
//! limiter, which doesn't act here: it stays 1. The product of both scales the speed of a motion.

mod arm;
mod dashboard;
mod link;
mod motion;
mod pose;
mod programs;
mod readings;
mod robot;
mod rtde;
mod script;
mod secondary;
#[cfg(test)]
mod tests;
mod variables;

use super::{Instrument, Owed, Shared};
use crate::scene::{Scene, SceneDevice};
pub use arm::{UrArm, UrFault, UrFaultKind};
use dashboard::Dashboard;
use link::Port;
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

/// Control cycle, s.
const CYCLE_S: f64 = 0.002;
/// Version of the controller and its date.
const VERSION: [u32; 4] = [5, 11, 9, 1_010_452];
const VERSION_DATE: &str = "Jan 24 2022";

/// A robot. This value is its RTDE port; [`at_port`](Instrument::at_port) returns the others.
pub struct UrEmulator {
    rtde: Port<Rtde>,
}

impl UrEmulator {
    /// Creates a robot that is switched on, with released brakes, in remote control. The tip is at the present place of
    /// the scene's axes.
    pub fn new(arm: UrArm, _scene: &Scene) -> Self {
        UrEmulator { rtde: Port::of(Arc::new(Mutex::new(Robot::new(arm))), Arc::default()) }
    }

    /// Number of programs that weren't run because of a syntax error or an unknown statement.
    pub fn syntax_errors(&self) -> u64 {
        lock(&self.rtde.robot).syntax_errors
    }

    /// Number of programs that ended with an error, such as a pose that can't be reached.
    pub fn runtime_errors(&self) -> u64 {
        lock(&self.rtde.robot).runtime_errors
    }
}

impl Instrument for UrEmulator {
    fn device(&self) -> SceneDevice {
        self.rtde.device()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.rtde.take_request(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        self.rtde.answer(request, scene, now_s)
    }

    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        self.rtde.accept()
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        self.rtde.bell()
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        self.rtde.owed(scene, now_s)
    }

    fn at_port(&self, port: u16) -> Option<Shared<dyn Instrument>> {
        let (robot, bell) = (self.rtde.robot.clone(), self.rtde.bell.clone());
        match port {
            DASHBOARD_PORT => Some(Arc::new(Mutex::new(Port::<Dashboard>::of(robot, bell)))),
            SECONDARY_PORT => Some(Arc::new(Mutex::new(Port::<Secondary>::of(robot, bell)))),
            RTDE_PORT => Some(Arc::new(Mutex::new(Port::<Rtde>::of(robot, bell)))),
            _ => None,
        }
    }
}
