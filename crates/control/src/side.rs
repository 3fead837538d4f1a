//! Forces sideways of a load cell with three axes: their zero, and the length of the whole force.

use super::trip::{SafetyRule, Trip};
use super::zero::frozen_after;
use palpate_core::quantity::ForceReading;
use std::collections::VecDeque;

/// Zero of the forces along x and y, and their noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SideZero {
    /// Readings at zero force, N.
    pub offset_n: [f64; 2],
    /// Standard deviation of one reading, N.
    pub sigma_n: [f64; 2],
    /// Number of equal readings in a row that means a frozen axis; `None` if a healthy axis repeats its readings too.
    pub frozen_after: [Option<u32>; 2],
}

impl SideZero {
    /// Returns the zero of readings without load; `None` for a cell with one axis.
    pub(crate) fn of(readings: &[ForceReading]) -> Option<SideZero> {
        let sides: Option<Vec<[f64; 2]>> = readings.iter().map(|reading| reading.side_n).collect();
        let sides = sides.filter(|sides| !sides.is_empty())?;
        let axis = |axis: usize| {
            let mut codes: Vec<f64> = sides.iter().map(|side_n| side_n[axis]).collect();
            let n = codes.len() as f64;
            let mean = codes.iter().sum::<f64>() / n;
            let squares: f64 = codes.iter().map(|code| (code - mean).powi(2)).sum();
            codes.sort_by(f64::total_cmp);
            (mean, (squares / (n - 1.0).max(1.0)).sqrt(), frozen_after(&codes))
        };
        let [x, y] = [axis(0), axis(1)];
        Some(SideZero { offset_n: [x.0, y.0], sigma_n: [x.1, y.1], frozen_after: [x.2, y.2] })
    }

    /// Standard deviation of one reading of the noisier axis, N.
    pub fn sigma_most_n(&self) -> f64 {
        self.sigma_n[0].max(self.sigma_n[1])
    }

    /// Returns the forces of a reading, N from the zero.
    pub fn from_zero(&self, side_n: [f64; 2]) -> [f64; 2] {
        [side_n[0] - self.offset_n[0], side_n[1] - self.offset_n[1]]
    }
}

/// Running mean of the forces sideways, over the readings that the mean of the force along z contains.
#[derive(Debug, Default)]
pub(crate) struct SideWatch {
    recent: VecDeque<[f64; 2]>,
    last: Option<[f64; 2]>,
    equal: [u32; 2],
}

impl SideWatch {
    pub(crate) fn clear(&mut self) {
        self.recent.clear();
    }

    /// Checks one reading. `count` readings are in the mean of the force along z, `mean_n`; the length of the whole force must be
    /// within `most_n`.
    pub(crate) fn check(
        &mut self,
        zero: &SideZero,
        side_n: [f64; 2],
        (count, mean_n): (usize, f64),
        most_n: f64,
    ) -> Result<(), Trip> {
        if let Some(wrong) = side_n.into_iter().find(|n| !n.is_finite()) {
            return Err(Trip::new(SafetyRule::NotFinite, wrong, 0.0, "N"));
        }
        for axis in 0..2 {
            let is_same = self.last.is_some_and(|last| last[axis] == side_n[axis]);
            self.equal[axis] = if is_same { self.equal[axis] + 1 } else { 1 };
            if let Some(most) = zero.frozen_after[axis].filter(|most| self.equal[axis] >= *most) {
                let (equal, most) = (f64::from(self.equal[axis]), f64::from(most));
                return Err(Trip::new(SafetyRule::Frozen, equal, most, "equal readings sideways"));
            }
        }
        self.last = Some(side_n);
        self.recent.push_back(zero.from_zero(side_n));
        while self.recent.len() > count {
            self.recent.pop_front();
        }
        let sum = |axis: usize| self.recent.iter().map(|side_n| side_n[axis]).sum::<f64>();
        let [x_n, y_n] = [0, 1].map(|axis| sum(axis) / self.recent.len() as f64);
        let length_n = x_n.hypot(y_n).hypot(mean_n);
        if count >= 2 && length_n > most_n {
            return Err(Trip::new(SafetyRule::OverForce, length_n, most_n, "N, all axes"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Watch, Zero};
    use palpate_core::quantity::{Health, Limits};

    const LIMITS: Limits = Limits { force_n: 2.0, depth_mm: 1.0, stiffness_n_mm: 4.0 };

    /// A reading of a cell that reads 0.3 and -0.2 N sideways without load.
    fn reading(i: u32, force_n: f64, side_n: [f64; 2]) -> ForceReading {
        let ripple = 1e-4 * f64::from(i % 7);
        let side_n = Some([side_n[0] + 0.3 + ripple, side_n[1] - 0.2 - ripple]);
        ForceReading { at_s: 0.005 * f64::from(i), force_n: force_n + ripple, side_n, health: Health::default() }
    }

    fn watch() -> Watch {
        let readings: Vec<ForceReading> = (0..100).map(|i| reading(i, 0.0, [0.0; 2])).collect();
        Watch::new(&LIMITS, Zero::of(&readings, 0.005))
    }

    #[test]
    fn the_limit_is_one_of_the_whole_force() {
        let trip = |force_n: f64, side_n: [f64; 2]| {
            let mut watch = watch();
            (100..110).find_map(|i| watch.force_n(&reading(i, force_n, side_n)).err()).map(|trip| trip.rule)
        };
        assert_eq!(trip(1.9, [0.0; 2]), None);
        assert_eq!(trip(1.2, [1.2, 0.9]), None);
        assert_eq!(trip(1.2, [-1.2, 1.1]), Some(SafetyRule::OverForce));
        assert_eq!(trip(0.0, [0.0, -2.1]), Some(SafetyRule::OverForce));
        assert_eq!(trip(1.0, [f64::NAN, 0.0]), Some(SafetyRule::NotFinite));
    }

    #[test]
    fn an_axis_that_freezes_is_found_while_the_others_follow() {
        let mut watch = watch();
        let frozen = |i: u32| {
            let mut reading = reading(i, 0.01 * f64::from(i % 5), [0.0; 2]);
            reading.side_n = reading.side_n.map(|side_n| [0.3, side_n[1]]);
            reading
        };
        let trip = (100..400).find_map(|i| watch.force_n(&frozen(i)).err()).expect("it is found");
        assert_eq!((trip.rule, trip.to_string().contains("sideways")), (SafetyRule::Frozen, true), "{trip}");
    }
}
