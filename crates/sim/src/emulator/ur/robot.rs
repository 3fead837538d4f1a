//! The controller: power, safety, programs and registers. All its ports act on it.

use super::arm::{UrArm, UrFault, UrFaultKind};
use super::motion::{Deviation, Line, Path};
use super::pose::Pose;
use super::script::Step;
use super::variables::Input;
use crate::scene::Scene;
use std::collections::VecDeque;

/// Deceleration in a stop for safety, mm/s^2.
const SAFETY_STOP_MM_S2: f64 = 10_000.0;
/// Time from a protective stop until it can be unlocked, s (Dashboard Server).
const LOCKED_S: f64 = 5.0;
/// Time from power to idle, and from idle to released brakes, s.
const BOOT_S: f64 = 3.0;
const RELEASE_S: f64 = 1.0;
/// Time for which RTDE refuses links after it was lost, s.
const RTDE_LOST_S: f64 = 2.0;
/// Lowest position of the speed slider.
const SLIDER_LEAST: f64 = 0.01;
/// Time before an event at which it counts as due, s.
pub(super) const EARLY_S: f64 = 1e-6;

/// Modes of the robot (RTDE guide, `robot_mode`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum RobotMode {
    PowerOff = 3,
    PowerOn = 4,
    Idle = 5,
    Running = 7,
}

/// Safety status, and the time since when, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Safety {
    Normal,
    ProtectiveStop(f64),
    EmergencyStop,
}

/// State of the program (RTDE guide, `runtime_state`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Runtime {
    Stopping = 0,
    Stopped = 1,
    Playing = 2,
    Pausing = 3,
    Paused = 4,
    Resuming = 5,
}

/// Registers that programs write and RTDE reads.
pub(super) struct Registers {
    pub integers: [i32; 48],
    pub doubles: [f64; 48],
    pub bits: u128,
}

/// The controller and the arm.
pub(super) struct Robot {
    pub arm: UrArm,
    pub mode: RobotMode,
    pub safety: Safety,
    pub runtime: Runtime,
    pub registers: Registers,
    pub is_remote: bool,
    /// Position of the speed slider, 0 to 1.
    pub slider: f64,
    pub tcp: [f64; 6],
    pub payload_kg: f64,
    pub cog_m: [f64; 3],
    pub digital_outputs: u64,
    /// Inputs that a link has set up, and the link.
    pub inputs: Vec<(Input, u64)>,
    pub syntax_errors: u64,
    pub runtime_errors: u64,
    /// Number of times that RTDE was lost, and the time until which it refuses links, s.
    pub rtde_losses: u64,
    pub rtde_lost_until_s: f64,
    pub rtde_silent: bool,
    /// Links opened so far.
    pub links: u64,
    /// Pose of the TCP in the frame of the tip.
    pub tool: Pose,
    pub path: Option<Path>,
    pub deviation: Deviation,
    pub steps: VecDeque<Step>,
    /// Motion that the program waits for.
    pub line: Option<Line>,
    /// Time at which the program does something next, s.
    pub wake_s: f64,
    /// Time that a paused program has left to wait, s.
    pub left_s: f64,
    /// Program that is compiled at this time, s, and runs next.
    pub next: Option<(f64, Vec<Step>)>,
    pub secondary: VecDeque<(f64, Vec<Step>)>,
    /// Time of the next change of mode, s, and whether the brakes are to be released.
    power: (f64, bool),
}

/// What happens at a time.
#[derive(Clone, Copy, Debug)]
enum Event {
    Fault,
    Program,
    Next,
    Secondary,
    Power,
}

impl Robot {
    pub(super) fn new(arm: UrArm) -> Robot {
        Robot {
            tcp: arm.tip,
            tool: arm.tool(arm.tip),
            arm,
            mode: RobotMode::Running,
            safety: Safety::Normal,
            runtime: Runtime::Stopped,
            registers: Registers { integers: [0; 48], doubles: [0.0; 48], bits: 0 },
            is_remote: true,
            slider: 1.0,
            payload_kg: 0.0,
            cog_m: [0.0; 3],
            digital_outputs: 0,
            inputs: Vec::new(),
            syntax_errors: 0,
            runtime_errors: 0,
            rtde_losses: 0,
            rtde_lost_until_s: 0.0,
            rtde_silent: false,
            links: 0,
            path: None,
            deviation: Deviation::default(),
            steps: VecDeque::new(),
            line: None,
            wake_s: f64::INFINITY,
            left_s: 0.0,
            next: None,
            secondary: VecDeque::new(),
            power: (f64::INFINITY, false),
        }
    }

    /// Lets everything happen that is due.
    pub(super) fn run(&mut self, scene: &mut Scene, now_s: f64) {
        loop {
            let (at_s, event) = self.next_event();
            if at_s > now_s + EARLY_S {
                return;
            }
            match event {
                Event::Fault => self.fail(scene, now_s),
                Event::Program => self.wake(scene, now_s),
                Event::Next => self.start_next(scene, now_s),
                Event::Secondary => {
                    let steps = self.secondary.pop_front().map(|(_, steps)| steps).unwrap_or_default();
                    self.run_secondary(steps.into(), scene, now_s);
                }
                Event::Power => self.change_power(now_s),
            }
        }
    }

    /// Time of the next event, s; infinite without one.
    pub(super) fn next_s(&self) -> f64 {
        self.next_event().0
    }

    fn next_event(&self) -> (f64, Event) {
        let fault_s = self.arm.faults.iter().map(|fault| fault.from_s).fold(f64::INFINITY, f64::min);
        let events = [
            (self.wake_s, Event::Program),
            (self.next.as_ref().map_or(f64::INFINITY, |next| next.0), Event::Next),
            (self.secondary.front().map_or(f64::INFINITY, |next| next.0), Event::Secondary),
            (self.power.0, Event::Power),
        ];
        events.into_iter().fold((fault_s, Event::Fault), |one, other| if other.0 < one.0 { other } else { one })
    }

    fn fail(&mut self, scene: &mut Scene, now_s: f64) {
        let faults = self.arm.faults.iter().enumerate();
        let Some((index, _)) = faults.min_by(|a, b| a.1.from_s.total_cmp(&b.1.from_s)) else { return };
        let UrFault { from_s, kind } = self.arm.faults.remove(index);
        match kind {
            UrFaultKind::ProtectiveStop if self.safety == Safety::Normal => {
                self.safety = Safety::ProtectiveStop(from_s);
                self.pause_with(SAFETY_STOP_MM_S2, scene, now_s);
            }
            UrFaultKind::ProtectiveStop => {}
            UrFaultKind::EmergencyStop => {
                self.safety = Safety::EmergencyStop;
                self.power_off(scene, now_s);
            }
            UrFaultKind::SpeedSlider(fraction) => self.move_slider(fraction, scene, now_s),
            UrFaultKind::RtdeLost => {
                self.rtde_losses += 1;
                self.rtde_lost_until_s = from_s + RTDE_LOST_S;
            }
            UrFaultKind::RtdeSilent => self.rtde_silent = true,
            UrFaultKind::LocalControl => self.is_remote = false,
            UrFaultKind::Sideways { mm } => self.deviation.sideways_mm = mm,
            UrFaultKind::Tilt { rad } => self.deviation.tilt_rad = rad,
            UrFaultKind::PowerOff => self.power_off(scene, now_s),
        }
    }

    /// Moves the speed slider. A motion under way follows it.
    pub(super) fn move_slider(&mut self, fraction: f64, scene: &mut Scene, now_s: f64) {
        if !fraction.is_finite() {
            return;
        }
        self.slider = fraction.clamp(SLIDER_LEAST, 1.0);
        if self.runtime == Runtime::Playing
            && self.line.is_some()
            && let Some(path) = &mut self.path
        {
            path.rescale(self.slider, scene, now_s);
            self.wake_s = path.end_s(scene);
        }
    }
}

/// Power and safety.
impl Robot {
    /// Switches the arm on, and releases its brakes if this is asked for.
    pub(super) fn power_on(&mut self, releases: bool, now_s: f64) {
        match self.mode {
            _ if self.safety == Safety::EmergencyStop => {}
            RobotMode::PowerOff => (self.mode, self.power) = (RobotMode::PowerOn, (now_s + BOOT_S, releases)),
            RobotMode::PowerOn => self.power.1 |= releases,
            RobotMode::Idle if releases => self.power = (now_s + RELEASE_S, true),
            RobotMode::Idle | RobotMode::Running => {}
        }
    }

    /// Switches the arm off. Its brakes stop it.
    pub(super) fn power_off(&mut self, scene: &mut Scene, now_s: f64) {
        self.end_program(SAFETY_STOP_MM_S2, scene, now_s);
        (self.mode, self.power) = (RobotMode::PowerOff, (f64::INFINITY, false));
    }

    /// Unlocks a protective stop. Returns whether this can be done yet.
    pub(super) fn unlock(&mut self, now_s: f64) -> bool {
        match self.safety {
            Safety::ProtectiveStop(since_s) if now_s < since_s + LOCKED_S => return false,
            Safety::ProtectiveStop(_) => self.safety = Safety::Normal,
            Safety::Normal | Safety::EmergencyStop => {}
        }
        true
    }

    fn change_power(&mut self, now_s: f64) {
        let releases = self.power.1;
        (self.mode, self.power.0) = match self.mode {
            RobotMode::PowerOn if releases => (RobotMode::Idle, now_s + RELEASE_S),
            RobotMode::PowerOn => (RobotMode::Idle, f64::INFINITY),
            RobotMode::Idle if releases => (RobotMode::Running, f64::INFINITY),
            mode => (mode, f64::INFINITY),
        };
    }
}
