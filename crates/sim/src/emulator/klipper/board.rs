//! The printer: its axes, its configuration file, and its faults.

use super::fault::KlipperFault;

/// A printer with cartesian axes and the configuration of its Klipper. It has no extruder and no heaters.
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
    /// Axes whose endstop is at their + end.
    pub homes_to_plus: [bool; 3],
    /// Speed of the search for the endstop, mm/s (`homing_speed`). The second approach has half of it.
    pub homing_mm_s: [f64; 3],
    /// Time without motion after which the motors are switched off, s (`[idle_timeout] timeout`).
    pub idle_timeout_s: f64,
    /// Whether FORCE_MOVE and SET_KINEMATIC_POSITION are known (`[force_move] enable_force_move`).
    pub enable_force_move: bool,
    /// Whether there is a `[bed_mesh]`, so that BED_MESH_CLEAR is known.
    pub has_bed_mesh: bool,
    /// Faults.
    pub faults: Vec<KlipperFault>,
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
            homes_to_plus: [false; 3],
            homing_mm_s: [50.0, 50.0, 5.0],
            idle_timeout_s: 600.0,
            enable_force_move: true,
            has_bed_mesh: false,
            faults: Vec::new(),
        }
    }
}

impl KlipperBoard {
    /// Distance by which an axis moves back from its endstop, mm (`homing_retract_dist`).
    pub(super) const RETRACT_MM: f64 = 5.0;
    /// Speed at a right-angled corner, mm/s (`square_corner_velocity`). Moves here rest there.
    pub(super) const SQUARE_CORNER_MM_S: f64 = 5.0;

    /// What an axis counts at its endstop, mm (`position_endstop`).
    pub fn endstop_mm(&self, axis: usize) -> f64 {
        if self.homes_to_plus[axis] { self.lengths_mm[axis] } else { 0.0 }
    }

    /// Place of the endstop of an axis, mm in the scene.
    pub(super) fn switch_mm(&self, axis: usize) -> f64 {
        self.min_ends_mm[axis] + self.endstop_mm(axis)
    }

    /// Returns the place that an axis reaches on the way to a place, mm in the scene.
    pub(super) fn within_ends(&self, axis: usize, place_mm: f64) -> f64 {
        let min_mm = self.min_ends_mm[axis];
        place_mm.clamp(min_mm, min_mm + self.lengths_mm[axis])
    }
}
