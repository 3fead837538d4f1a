//! The controller: power, safety, faults and registers. All its ports act on it.

use super::arm::{UrArm, UrFaultKind};
use super::motion::Path;
use super::pose::{self, Pose};
use super::programs::CYCLE_S;
use super::script::{Statement, Value, read_program};
use super::turn::Turn;
use crate::emulator::faults::Faults;
use crate::scene::Scene;
use palpate_core::quantity::Axis;
use std::collections::HashMap;

/// Deceleration in a stop for safety, mm/s^2.
const SAFETY_STOP_MM_S2: f64 = 10_000.0;
/// Time from a protective stop until it can be unlocked, s (Dashboard Server).
const LOCKED_S: f64 = 5.0;
/// Time for which RTDE refuses links after it was lost, s.
const RTDE_LOST_S: f64 = 2.0;
/// Lowest position of the speed slider.
const SLIDER_LEAST: f64 = 0.01;
/// Time before an event at which it counts as due, s.
pub(super) const EARLY_S: f64 = 1e-6;

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
}

/// The controller and the arm.
pub(super) struct Robot {
    pub arm: UrArm,
    pub faults: Faults<UrFaultKind>,
    pub is_on: bool,
    pub safety: Safety,
    pub runtime: Runtime,
    /// Integer registers that programs write and RTDE reads.
    pub registers: [i32; 48],
    /// Float registers, likewise.
    pub float_registers: [f64; 48],
    /// The TCP in the frame of the flange, which is the tip of the tool. Any client may set it.
    pub tcp: Pose,
    pub payload_kg: f64,
    /// What programs showed to people, as far as it is kept.
    pub messages: Vec<String>,
    pub is_remote: bool,
    /// Position of the speed slider, 0 to 1.
    pub slider: f64,
    /// RTDE links opened before this time are closed, s.
    pub rtde_lost_until_s: f64,
    pub rtde_silent: bool,
    pub path: Path,
    /// Deviations of motions: largest distance from the line, mm, and largest angle, rad.
    pub deviation: (f64, f64),
    /// Statements of the program that are left, the next one last, and the time at which it continues, s.
    pub statements: Vec<Statement>,
    pub variables: HashMap<String, Value>,
    pub wake_s: f64,
    /// Statements of the next program, and the time at which it begins, s.
    pub next: Vec<Statement>,
    pub begin_s: f64,
}

impl Robot {
    pub(super) fn new(arm: UrArm, scene: &Scene) -> Robot {
        let rest = (Axis::ALL.map(|axis| scene.motion(axis).end_mm()), Turn::of(arm.rotvec_rad));
        Robot {
            faults: Faults::new(&arm.faults, &arm.faults_after_bytes),
            arm,
            is_on: true,
            safety: Safety::Normal,
            runtime: Runtime::Stopped,
            registers: [0; 48],
            float_registers: [0.0; 48],
            tcp: [0.0; 6],
            payload_kg: 0.0,
            messages: Vec::new(),
            is_remote: true,
            slider: 1.0,
            rtde_lost_until_s: 0.0,
            rtde_silent: false,
            path: Path::between(rest, rest, [0.0; 2], 0.0),
            deviation: (0.0, 0.0),
            statements: Vec::new(),
            variables: HashMap::new(),
            wake_s: f64::INFINITY,
            next: Vec::new(),
            begin_s: f64::INFINITY,
        }
    }

    /// Lets everything happen that is due.
    pub(super) fn run(&mut self, scene: &mut Scene, now_s: f64) {
        self.faults.come(now_s);
        while self.next_s() <= now_s + EARLY_S {
            if self.next_s() == self.fault_s() {
                self.fail(scene, now_s);
            } else if self.next_s() == self.wake_s {
                self.wake(scene, now_s);
            } else {
                self.begin_next(scene, now_s);
            }
        }
    }

    /// Time of the next event, s; infinite without one.
    pub(super) fn next_s(&self) -> f64 {
        self.fault_s().min(self.wake_s).min(self.begin_s)
    }

    fn fault_s(&self) -> f64 {
        self.faults.next_s(|_| true)
    }

    fn fail(&mut self, scene: &mut Scene, now_s: f64) {
        let from_s = self.fault_s();
        let Some(kind) = self.faults.take(now_s + EARLY_S, |_| true) else { return };
        match kind {
            UrFaultKind::ProtectiveStop if self.safety == Safety::Normal => {
                self.safety = Safety::ProtectiveStop(from_s);
                if self.runtime == Runtime::Playing {
                    self.halt(Runtime::Pausing, SAFETY_STOP_MM_S2, scene, now_s);
                }
            }
            UrFaultKind::ProtectiveStop => {}
            UrFaultKind::EmergencyStop | UrFaultKind::PowerOff => {
                self.is_on = false;
                if kind == UrFaultKind::EmergencyStop {
                    self.safety = Safety::EmergencyStop;
                }
                self.end_program(SAFETY_STOP_MM_S2, scene, now_s);
            }
            UrFaultKind::SpeedSlider(fraction) => self.move_slider(fraction, scene, now_s),
            UrFaultKind::RtdeLost => self.rtde_lost_until_s = from_s + RTDE_LOST_S,
            UrFaultKind::RtdeSilent => self.rtde_silent = true,
            UrFaultKind::LocalControl => self.is_remote = false,
            UrFaultKind::Sideways { mm } => self.deviation.0 = mm,
            UrFaultKind::Tilt { rad } => self.deviation.1 = rad,
            UrFaultKind::Other(program) => {
                if let Some(program) = read_program(program.as_bytes()) {
                    self.take(program, now_s, scene, now_s);
                }
            }
        }
    }

    /// Moves the speed slider. A motion under way follows it.
    pub(super) fn move_slider(&mut self, fraction: f64, scene: &mut Scene, now_s: f64) {
        self.slider = fraction.clamp(SLIDER_LEAST, 1.0);
        if self.runtime == Runtime::Playing && self.path.is_moving(now_s) {
            self.path.drive(self.slider, scene, now_s);
            self.wake_s = self.path.end_s(scene);
        }
    }

    /// Pose of the TCP, as the encoders have it.
    pub(super) fn actual_pose(&self, scene: &mut Scene, now_s: f64) -> Pose {
        let place_mm = Axis::ALL.map(|axis| scene.axis(axis, now_s).0);
        let (off_mm, off_rad) = self.arm.noise(((now_s + EARLY_S) / CYCLE_S) as u64);
        let place_mm = std::array::from_fn(|n| place_mm[n] + off_mm[n]);
        self.tcp_pose(place_mm, self.path.turn(now_s).then(Turn::of(off_rad)))
    }

    /// Pose of the TCP as planned.
    pub(super) fn target_pose(&self, now_s: f64) -> Pose {
        let (place_mm, turn) = self.path.planned(now_s);
        self.tcp_pose(place_mm, turn)
    }

    fn tcp_pose(&self, stage_mm: [f64; 3], turn: Turn) -> Pose {
        pose::within(pose::pose(self.arm.tip_mm(stage_mm).map(|mm| mm / 1000.0), turn), self.tcp)
    }

    /// Unlocks a protective stop. Returns whether this can be done yet.
    pub(super) fn unlock(&mut self, now_s: f64) -> bool {
        let is_locked = matches!(self.safety, Safety::ProtectiveStop(since_s) if now_s < since_s + LOCKED_S);
        if !is_locked && self.safety != Safety::EmergencyStop {
            self.safety = Safety::Normal;
        }
        !is_locked
    }

    /// Mode of the robot (RTDE guide, `robot_mode`), and its name.
    pub(super) fn mode(&self) -> (i32, &'static str) {
        if self.is_on { (7, "RUNNING") } else { (3, "POWER_OFF") }
    }

    /// Safety mode and status of the guides, which are equal here, the safety bits, and the name. Bits: normal,
    /// reduced, protective stop, recovery, safeguard stop, emergency stop of the system, of the robot, of any,
    /// violation, fault, stopped due to safety.
    pub(super) fn safety_status(&self) -> (i32, i32, &'static str) {
        match self.safety {
            Safety::Normal => (1, 1, "NORMAL"),
            Safety::ProtectiveStop(_) => (3, 1 << 2 | 1 << 10, "PROTECTIVE_STOP"),
            Safety::EmergencyStop => (7, 1 << 6 | 1 << 7 | 1 << 10, "ROBOT_EMERGENCY_STOP"),
        }
    }

    /// Whether a program runs. One that is paused doesn't.
    pub(super) fn is_running(&self) -> bool {
        !matches!(self.runtime, Runtime::Stopped | Runtime::Paused)
    }
}
