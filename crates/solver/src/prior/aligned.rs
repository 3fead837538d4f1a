//! Full calibrations of a design's sensors, aligned to the design's typical sensor.

use super::posterior::informed;
use super::spread::about_their_mean;
use super::{PriorError, each_output, units_of};
use crate::adapt::{AdaptableMap, Moved};
use crate::{ArrayChange, Calibration};
use palpate_core::quantity::ArrayLayout;

/// Calibrations of sensors of one design, and how each sensor differs from the mean of all.
pub(crate) struct Aligned {
    /// Presses of each sensor, as the design's typical sensor would have read them.
    pub calibrations: Vec<Calibration>,
    /// Change of each sensor's units, compared with the typical sensor.
    pub moved: Vec<Vec<Moved>>,
    /// Map of the typical sensor, if there are several sensors.
    pub map: Option<AdaptableMap<'static>>,
    /// Outputs of each unit. All outputs of a unit change in common.
    pub units: Vec<Vec<usize>>,
}

/// Number of rounds in which the sensors are compared with their mean, which each round improves.
const ROUNDS: usize = 2;

impl Aligned {
    /// Aligns the calibrations of at least one sensor.
    ///
    /// # Errors
    /// The calibrations are of different arrays, or forces are unknown.
    pub(crate) fn of(calibrations: &[Calibration], layout: Option<&ArrayLayout>) -> Result<Self, PriorError> {
        let outputs = calibrations[0].units();
        if let Some(other) = calibrations.iter().position(|calibration| calibration.units() != outputs) {
            let found = calibrations[other].units();
            return Err(PriorError::Outputs { sensor: other + 1, found, expected: outputs });
        }
        if !calibrations.iter().all(Calibration::is_in_newtons) {
            return Err(PriorError::NoForces);
        }
        let units = units_of(layout, outputs);
        let mut aligned = calibrations.to_vec();
        let mut moved = vec![vec![Moved::ZERO; units.len()]; calibrations.len()];
        let mut typical = None;
        // a single sensor is its own mean
        let rounds = if calibrations.len() > 1 { ROUNDS } else { 0 };
        for _ in 0..rounds {
            let map = AdaptableMap::of(&Calibration::joined(&aligned), layout)?;
            let changes: Vec<Vec<Moved>> = calibrations.iter().map(|sensor| informed(&map, sensor, &units)).collect();
            moved = about_their_mean(&changes);
            let sensors = calibrations.iter().zip(&moved);
            aligned = sensors.map(|(of, moved)| map.unchanged(of, &each_output(moved, &units, outputs))).collect();
            typical = Some(map);
        }
        Ok(Aligned { calibrations: aligned, moved, map: typical, units })
    }

    /// Returns the presses of all sensors as one calibration of the typical sensor.
    pub(crate) fn joined(&self) -> Calibration {
        Calibration::joined(&self.calibrations)
    }

    /// Returns the change of each sensor.
    pub(crate) fn changes(&self) -> Vec<ArrayChange> {
        let outputs = self.calibrations[0].units();
        self.moved.iter().map(|moved| each_output(moved, &self.units, outputs)).collect()
    }
}
