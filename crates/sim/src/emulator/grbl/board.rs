//! The frame and its board: where the ends are, where homing ends, what it counts there.

use super::fault::{GrblFault, GrblFaultAfterBytes};
use super::settings::{self, BoardSettings};

/// Distance of the ends of a frame without switches from the place where it is switched on, at least, mm.
pub const ROOM_MM: f64 = 5.0;

/// A frame of three axes and the board that drives it.
#[derive(Clone, Debug)]
pub struct MotionBoard {
    /// Settings of the board.
    pub settings: BoardSettings,
    /// The + end of each axis, mm in the scene. A limit switch is at each end.
    pub plus_ends_mm: [f64; 3],
    /// Distance between the ends of each axis, mm.
    pub lengths_mm: [f64; 3],
    /// Whether homing sets the count to zero (build option HOMING_FORCE_SET_ORIGIN, `Z` in the answer to `$I`).
    pub sets_origin: bool,
    /// Time from the opening of its port, which resets the board, to its welcome, s. `None`: opening doesn't reset it.
    pub boot_s: Option<f64>,
    /// Faults.
    pub faults: Vec<GrblFault>,
    /// Faults after some bytes.
    pub faults_after_bytes: Vec<GrblFaultAfterBytes>,
}

impl Default for MotionBoard {
    /// A stock build on an Uno, whose bootloader takes 1.7 s. Its + ends are at 0, so that what it counts after homing is the place
    /// in the scene.
    fn default() -> Self {
        let settings = BoardSettings::default();
        let lengths_mm = std::array::from_fn(|n| settings.travel_mm(n));
        MotionBoard {
            settings,
            plus_ends_mm: [0.0; 3],
            lengths_mm,
            sets_origin: false,
            boot_s: Some(1.7),
            faults: Vec::new(),
            faults_after_bytes: Vec::new(),
        }
    }
}

impl MotionBoard {
    /// Numbers of settings that a rig decides.
    pub const SOFT_LIMITS: u16 = settings::SOFT_LIMITS;
    /// Whether it homes to switches.
    pub const HOMING: u16 = settings::HOMING;
    /// Axes that home toward minus, one bit each.
    pub const HOMING_DIRECTION: u16 = settings::HOMING_DIRECTION;
    /// Steps per mm of x; those of y and z follow, as in the next ones.
    pub(crate) const STEPS_PER_MM: u16 = settings::STEPS_PER_MM;
    /// Largest rate of x, mm/min; those of y and z follow, as in the next two.
    pub const RATE: u16 = settings::RATE_MM_MIN;
    /// Acceleration of x, mm/s^2.
    pub const ACCELERATION: u16 = settings::ACCELERATION_MM_S2;
    /// Travel of x, mm.
    pub const TRAVEL: u16 = settings::TRAVEL_MM;

    /// Returns the - and the + end of an axis, mm in the scene.
    pub fn ends_mm(&self, axis: usize) -> (f64, f64) {
        (self.plus_ends_mm[axis] - self.lengths_mm[axis], self.plus_ends_mm[axis])
    }

    /// Returns the switch that an axis homes to, and the place at which homing leaves it, mm in the scene.
    pub(crate) fn switch_mm(&self, axis: usize) -> (f64, f64) {
        let (min_mm, max_mm) = self.ends_mm(axis);
        let off_mm = self.settings.pull_off_mm().min(self.lengths_mm[axis]); // the other end stops it
        if self.settings.homes_to_minus(axis) { (min_mm, min_mm + off_mm) } else { (max_mm, max_mm - off_mm) }
    }

    /// Returns what an axis counts after homing, mm (GRBL's limits.c).
    pub fn home_mm(&self, axis: usize) -> f64 {
        let off_mm = self.settings.pull_off_mm();
        match self.settings.homes_to_minus(axis) {
            _ if self.sets_origin => 0.0,
            true => off_mm - self.settings.travel_mm(axis),
            false => -off_mm,
        }
    }

    /// Returns the counts that the soft limits allow, mm (GRBL's system.c).
    pub(crate) fn soft_limits_mm(&self, axis: usize) -> (f64, f64) {
        let travel_mm = self.settings.travel_mm(axis);
        let is_up = self.sets_origin && self.settings.homes_to_minus(axis);
        if is_up { (0.0, travel_mm) } else { (-travel_mm, 0.0) }
    }
}
