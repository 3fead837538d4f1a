//! The printer: its axes, its firmware's configuration, and its faults.

use super::fault::{MarlinFault, MarlinFaultAfterBytes};
use crate::emulator::grbl::machine::HomingSearch;
use crate::emulator::grbl::{BoardSettings, MotionBoard};

/// Distance that an axis moves back from its switch during homing, mm (HOMING_BUMP_MM).
const BUMP_MM: [f64; 3] = [5.0, 5.0, 2.0];
/// Ratio of the first to the second speed of homing (HOMING_BUMP_DIVISOR).
const BUMP_DIVISOR: [f64; 3] = [2.0, 2.0, 4.0];

/// A printer and the configuration of its firmware. The defaults are those of stock Marlin 2.1, except for the places of the ends.
#[derive(Clone, Debug)]
pub struct MarlinBoard {
    /// Steps per mm (M92).
    pub steps_per_mm: [f64; 3],
    /// Largest speed of each axis, mm/s (M203).
    pub most_mm_s: [f64; 3],
    /// Largest acceleration of each axis, mm/s^2 (M201).
    pub acceleration_mm_s2: [f64; 3],
    /// Largest acceleration of a motion, mm/s^2 (M204 T).
    pub travel_acceleration_mm_s2: f64,
    /// The - end of each axis, mm in the scene. It counts 0 after homing.
    pub min_ends_mm: [f64; 3],
    /// Distance between the ends of each axis, mm. It is also the travel of the software endstops.
    pub lengths_mm: [f64; 3],
    /// Axes that home to their + end. z of a stock printer homes toward the bed.
    pub homes_to_plus: [bool; 3],
    /// Speed of the search for home, mm/s.
    pub homing_mm_s: [f64; 3],
    /// Rise of the bed along x and y, in mm per mm, that the motions follow after `M420 S1`. `None`: a build without bed levelling.
    pub bed_rise: Option<[f64; 2]>,
    /// Whether G20 is known (INCH_MODE_SUPPORT). Stock builds don't know it.
    pub inches: bool,
    /// Whether G92 shifts the logical coordinates only, as in stock builds. A build with NO_WORKSPACE_OFFSETS counts the steps again from there, and
    /// its software endstops move along (G92.cpp).
    pub workspace_offsets: bool,
    /// Number of steps that a motion has at least (MIN_STEPS_PER_SEGMENT). Fewer steps are added to the next motion.
    pub least_steps: i64,
    /// Time without motion after which the motors are switched off, s; 0 for never.
    pub idle_s: f64,
    /// Distance that each axis moves, mm, when its motor is switched off, such as by its weight. The firmware doesn't know it.
    pub slip_mm: [f64; 3],
    /// Time from the opening of the port, which resets the board, to `start`, s. `None`: opening doesn't reset it.
    pub boot_s: Option<f64>,
    /// Whether M112 and M410 act when they are received, with or without a number, before all that waits (EMERGENCY_PARSER, e_parser.h).
    pub emergency_parser: bool,
    /// Whether an `ok` follows a `Resend`. Builds of around 2.0.8 send none (`flush_and_request_resend`, queue.cpp).
    pub ok_after_resend: bool,
    /// Whether M290 is known (BABYSTEPPING). Its steps aren't counted.
    pub babysteps: bool,
    /// Faults.
    pub faults: Vec<MarlinFault>,
    /// Faults after some bytes.
    pub faults_after_bytes: Vec<MarlinFaultAfterBytes>,
}

impl Default for MarlinBoard {
    /// A stock printer of 200 mm. The - end of each axis is at 0 in the scene.
    fn default() -> Self {
        MarlinBoard {
            steps_per_mm: [80.0, 80.0, 400.0],
            most_mm_s: [300.0, 300.0, 5.0],
            acceleration_mm_s2: [3000.0, 3000.0, 100.0],
            travel_acceleration_mm_s2: 3000.0,
            min_ends_mm: [0.0; 3],
            lengths_mm: [200.0; 3],
            homes_to_plus: [false; 3],
            homing_mm_s: [50.0, 50.0, 4.0],
            bed_rise: None,
            inches: false,
            workspace_offsets: true,
            least_steps: 6,
            idle_s: 120.0,
            slip_mm: [0.0; 3],
            boot_s: Some(2.0),
            emergency_parser: false,
            ok_after_resend: true,
            babysteps: false,
            faults: Vec::new(),
            faults_after_bytes: Vec::new(),
        }
    }
}

impl MarlinBoard {
    /// What each axis counts at its home, and when the board is switched on, mm.
    pub fn home_mm(&self) -> [f64; 3] {
        std::array::from_fn(|n| if self.homes_to_plus[n] { self.lengths_mm[n] } else { 0.0 })
    }

    /// Returns the frame and the limits of its motions.
    pub(super) fn frame(&self) -> MotionBoard {
        MotionBoard {
            settings: self.limits(BoardSettings::default()),
            plus_ends_mm: std::array::from_fn(|n| self.min_ends_mm[n] + self.lengths_mm[n]),
            lengths_mm: self.lengths_mm,
            boot_s: None,
            ..MotionBoard::default()
        }
    }

    /// Returns settings with the limits of the motions.
    pub(super) fn limits(&self, settings: BoardSettings) -> BoardSettings {
        (0..).zip(0..3).fold(settings, |settings, (number, n): (u16, usize)| {
            settings
                .with(MotionBoard::STEPS_PER_MM + number, self.steps_per_mm[n])
                .with(MotionBoard::RATE + number, 60.0 * self.most_mm_s[n])
                .with(MotionBoard::ACCELERATION + number, self.acceleration_mm_s2[n])
        })
    }

    /// Returns the search of an axis for its home: fast to its switch, back, slowly to its switch (motion.cpp, `homeaxis`).
    pub(super) fn homing(&self, axis: usize) -> HomingSearch {
        let (min_mm, length_mm) = (self.min_ends_mm[axis], self.lengths_mm[axis]);
        let back_mm = BUMP_MM[axis].min(length_mm);
        let (switch_mm, back_mm) = if self.homes_to_plus[axis] {
            (min_mm + length_mm, min_mm + length_mm - back_mm)
        } else {
            (min_mm, min_mm + back_mm)
        };
        let speed_mm_s = self.homing_mm_s[axis];
        let slow_mm_s = speed_mm_s / BUMP_DIVISOR[axis];
        let phases = vec![(switch_mm, speed_mm_s), (back_mm, speed_mm_s), (switch_mm, slow_mm_s)];
        HomingSearch { phases, home_mm: self.home_mm()[axis] }
    }
}
