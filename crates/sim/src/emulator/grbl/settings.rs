//! Numbered settings, which a client reads with `$$` and writes with `$n=value` (GRBL's settings document).

use super::errors::GrblError;
use std::collections::BTreeMap;

/// Settings of a board, each as in GRBL's manual: rates in mm/min, accelerations in mm/s^2, travels in mm.
#[derive(Clone, Debug)]
pub struct BoardSettings {
    values: BTreeMap<u16, f64>,
}

/// Values of a frame that is ready for use: motors always on, soft limits and homing on, hard limits off.
const READY: [(u16, f64); 34] = [
    (0, 10.0),
    (1, 255.0),
    (2, 0.0),
    (3, 0.0),
    (4, 0.0),
    (5, 0.0),
    (6, 0.0),
    (10, 1.0),
    (11, 0.01),
    (12, 0.002),
    (13, 0.0),
    (SOFT_LIMITS, 1.0),
    (21, 0.0),
    (HOMING, 1.0),
    (HOMING_DIRECTION, 0.0),
    (LOCATE_MM_MIN, 60.0),
    (SEEK_MM_MIN, 600.0),
    (DEBOUNCE_MS, 25.0),
    (PULL_OFF_MM, 0.5),
    (30, 1000.0),
    (31, 0.0),
    (32, 0.0),
    (STEPS_PER_MM, 800.0),
    (101, 800.0),
    (102, 800.0),
    (RATE_MM_MIN, 1500.0),
    (111, 1500.0),
    (112, 1500.0),
    (ACCELERATION_MM_S2, 100.0),
    (121, 100.0),
    (122, 100.0),
    (TRAVEL_MM, 25.0),
    (131, 25.0),
    (132, 25.0),
];

/// Settings that are floating-point numbers; the others are whole numbers.
const FLOATS: [std::ops::RangeInclusive<u16>; 4] = [11..=12, 24..=25, 27..=27, 100..=132];

pub(super) const SOFT_LIMITS: u16 = 20;
pub(super) const HOMING: u16 = 22;
pub(super) const HOMING_DIRECTION: u16 = 23;
const LOCATE_MM_MIN: u16 = 24;
const SEEK_MM_MIN: u16 = 25;
const DEBOUNCE_MS: u16 = 26;
const PULL_OFF_MM: u16 = 27;
// the first of three, for x
pub(super) const STEPS_PER_MM: u16 = 100;
pub(super) const RATE_MM_MIN: u16 = 110;
pub(super) const ACCELERATION_MM_S2: u16 = 120;
pub(super) const TRAVEL_MM: u16 = 130;

impl Default for BoardSettings {
    fn default() -> Self {
        BoardSettings { values: READY.into() }
    }
}

impl BoardSettings {
    /// Returns the same settings with one changed.
    #[must_use]
    pub fn with(mut self, number: u16, value: f64) -> BoardSettings {
        self.values.insert(number, value);
        self
    }

    /// Writes a setting.
    pub fn write(&mut self, number: u16, value: f64) -> Result<(), GrblError> {
        if value < 0.0 {
            return Err(GrblError::NegativeValue);
        }
        if number == SOFT_LIMITS && value != 0.0 && !self.homes() {
            return Err(GrblError::SoftLimitNeedsHoming);
        }
        *self.values.get_mut(&number).ok_or(GrblError::InvalidStatement)? = value;
        if !self.homes() {
            self.values.insert(SOFT_LIMITS, 0.0);
        }
        Ok(())
    }

    /// Returns the lines that answer `$$`.
    pub fn lines(&self) -> impl Iterator<Item = String> + '_ {
        self.values.iter().map(|(number, value)| {
            let decimals = if FLOATS.iter().any(|range| range.contains(number)) { 3 } else { 0 };
            format!("${number}={value:.decimals$}")
        })
    }

    /// `$20`: whether lines beyond the travel are refused.
    pub(crate) fn limits_softly(&self) -> bool {
        self.of(SOFT_LIMITS) != 0.0
    }

    /// `$22`: whether the frame has switches to home to.
    pub fn homes(&self) -> bool {
        self.of(HOMING) != 0.0
    }

    /// `$23`: whether an axis searches toward minus.
    pub(crate) fn homes_to_minus(&self, axis: usize) -> bool {
        self.of(HOMING_DIRECTION) as u8 & (1 << axis) != 0
    }

    /// `$24`: speed of locating a switch, mm/s.
    pub(crate) fn locate_mm_s(&self) -> f64 {
        self.of(LOCATE_MM_MIN) / 60.0
    }

    /// `$25`: speed of searching for a switch, mm/s.
    pub fn seek_mm_s(&self) -> f64 {
        self.of(SEEK_MM_MIN) / 60.0
    }

    /// `$26`: rest between the phases of homing, s.
    pub(crate) fn debounce_s(&self) -> f64 {
        self.of(DEBOUNCE_MS) / 1000.0
    }

    /// `$27`: distance that an axis moves back from its switch, mm.
    pub fn pull_off_mm(&self) -> f64 {
        self.of(PULL_OFF_MM)
    }

    /// `$100` to `$102`: steps per mm.
    pub(crate) fn steps_per_mm(&self, axis: usize) -> f64 {
        self.of(STEPS_PER_MM + axis as u16)
    }

    /// `$110` to `$112`: largest rate of an axis, mm/s.
    pub fn most_mm_s(&self, axis: usize) -> f64 {
        self.of(RATE_MM_MIN + axis as u16) / 60.0
    }

    /// `$120` to `$122`: acceleration of an axis, mm/s^2.
    pub fn acceleration_mm_s2(&self, axis: usize) -> f64 {
        self.of(ACCELERATION_MM_S2 + axis as u16)
    }

    /// `$130` to `$132`: travel, mm.
    pub fn travel_mm(&self, axis: usize) -> f64 {
        self.of(TRAVEL_MM + axis as u16)
    }

    fn of(&self, number: u16) -> f64 {
        self.values.get(&number).copied().unwrap_or(0.0)
    }
}
