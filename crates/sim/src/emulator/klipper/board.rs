//! The printer: its axes, its configuration file, and its faults.

use crate::emulator::faults::{DeviceFault, FaultAfterBytes};

/// A printer with cartesian axes and the configuration of its Klipper. It has no extruder and no heaters, and its endstops aren't
/// connected.
#[derive(Clone, Debug)]
pub struct KlipperBoard {
    /// Steps per mm: microsteps times full steps per rotation, divided by the rotation distance.
    pub steps_per_mm: [f64; 3],
    /// Largest speed of a motion, mm/s (`max_velocity`).
    pub max_velocity_mm_s: f64,
    /// Largest acceleration of a motion, mm/s^2 (`max_accel`).
    pub max_accel_mm_s2: f64,
    /// Largest speed of z, mm/s (`max_z_velocity`).
    pub max_z_velocity_mm_s: f64,
    /// Largest acceleration of z, mm/s^2 (`max_z_accel`).
    pub max_z_accel_mm_s2: f64,
    /// The - end of each axis, mm in the scene. It is the place of `position_min`, which is 0.
    pub min_ends_mm: [f64; 3],
    /// Distance between the ends of each axis, mm (`position_max`).
    pub lengths_mm: [f64; 3],
    /// Time without motion after which the motors are switched off, s (`[idle_timeout] timeout`).
    pub idle_timeout_s: f64,
    /// Whether SET_KINEMATIC_POSITION is known (`[force_move] enable_force_move`).
    pub enable_force_move: bool,
    /// Faults.
    pub faults: Vec<KlipperFault>,
    /// Faults after some bytes.
    pub faults_after_bytes: Vec<KlipperFaultAfterBytes>,
}

impl Default for KlipperBoard {
    /// A printer of 200 mm as in Klipper's example configurations. The - end of each axis is at 0 in the scene.
    fn default() -> Self {
        KlipperBoard {
            steps_per_mm: [80.0, 80.0, 400.0],
            max_velocity_mm_s: 300.0,
            max_accel_mm_s2: 3000.0,
            max_z_velocity_mm_s: 5.0,
            max_z_accel_mm_s2: 100.0,
            min_ends_mm: [0.0; 3],
            lengths_mm: [200.0; 3],
            idle_timeout_s: 600.0,
            enable_force_move: true,
            faults: Vec::new(),
            faults_after_bytes: Vec::new(),
        }
    }
}

impl KlipperBoard {
    /// Ends of an axis, mm in the scene.
    pub(super) fn ends_mm(&self, axis: usize) -> (f64, f64) {
        (self.min_ends_mm[axis], self.min_ends_mm[axis] + self.lengths_mm[axis])
    }
}

/// A fault of the printer or its host.
pub type KlipperFault = DeviceFault<KlipperFaultKind>;
/// A fault of them after some bytes on all connections.
pub type KlipperFaultAfterBytes = FaultAfterBytes<KlipperFaultKind>;

/// Kinds of fault. Each happens once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KlipperFaultKind {
    /// The microcontroller shuts down with `Timer too close`: the motion ends at once, and the motors are off.
    Shutdown,
    /// The microcontroller and Klipper restart. The motion ends at once, and nothing is homed.
    McuRestart,
    /// Moonraker restarts: all connections hang up, and for 3 s new ones do at once. The printer moves on.
    MoonrakerRestart,
    /// The next answer is never sent. Its connection stays open, and answers nothing more.
    LostAnswer,
    /// The next answer is sent later by this time, s.
    SlowAnswer(f64),
    /// The motors are switched off as after the idle timeout.
    IdleTimeout,
    /// Another client runs this script. It waits for the one that runs (gcode.py), and shares all coordinates with it.
    Other(&'static str),
}

impl KlipperFaultKind {
    /// Whether it happens with an answer, not at its time.
    pub(super) fn is_of_answer(self) -> bool {
        matches!(self, KlipperFaultKind::LostAnswer | KlipperFaultKind::SlowAnswer(_))
    }
}
