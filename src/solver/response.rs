//! What the array reads under one contact, from place to place.

use super::Calibration;
use super::field::Field;
use super::noise::{Noise, Residual};
use super::sought::Sought;
use crate::quantity::Place;
use serde::{Deserialize, Serialize};

/// What the array reads under one contact, from place to place, and how far that can be trusted: the forward map that a
/// forward solver inverts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Response {
    /// Each unit's output a newton.
    pub field: Field,
    /// The variance of that over the variance which the noise of one calibration press has, a unit each.
    pub leverage: Field,
    /// How far an output strays from the map.
    pub noise: Noise,
    /// The force that the calibration was pressed with, N: the map's error grows with the force over this.
    pub force_n: f64,
    /// The calibration's presses against a map made without them; a response that was read from a file has none.
    #[serde(skip)]
    pub held: Vec<Held>,
    /// The leverage, mean of all units, up to which the map is known: that of the press which is worst predicted by the others.
    /// Where the map is less sure than there, it has left the calibrated places behind.
    pub known_leverage: f64,
    /// The correlation of the map, where it has one; a response that was read from a file has none.
    #[serde(skip)]
    pub sought: Option<Sought>,
}

/// A calibration press against a map made without it.
#[derive(Clone, Debug)]
pub(super) struct Held {
    /// Where it was pressed.
    pub place: Place,
    /// How hard, N.
    pub force_n: f64,
    /// One a unit.
    pub residuals: Vec<Residual>,
}

/// Cells along each side of the table that holds the map's own error.
const LEVERAGE_CELLS: f64 = 12.0;

impl Response {
    /// The result of a map and the presses compared with it. `leverage` is asked once, for many places: the variance of the map at
    /// each over that of one calibration press, row-major, places x units.
    pub fn new(
        field: Field,
        leverage: impl FnOnce(&[Place]) -> Vec<f64>,
        held: Vec<Held>,
        calibration: &Calibration,
    ) -> Self {
        let (area, units) = (field.area(), field.channels());
        let side = (area.most.x_mm - area.least.x_mm).max(area.most.y_mm - area.least.y_mm).max(f64::MIN_POSITIVE);
        let leverage = Field::new(area, side / LEVERAGE_CELLS, units, leverage);
        let of_unit = |unit: usize| held.iter().map(|held| held.residuals[unit]).collect();
        let noise = Noise::fit(&(0..units).map(of_unit).collect::<Vec<Vec<Residual>>>());
        let mean = |held: &Held| held.residuals.iter().map(|r| r.leverage).sum::<f64>() / units as f64;
        let known_leverage = held.iter().map(mean).fold(0.0, f64::max);
        Response { field, leverage, noise, force_n: calibration.typical_force_n(), held, known_leverage, sought: None }
    }

    /// The variance of one unit's output under `force_n`, where a newton gives `per_newton`: the noise of the reading, and the
    /// map's own error.
    #[inline]
    pub fn variance(&self, unit: usize, force_n: f64, per_newton: f64, leverage: f64) -> f64 {
        self.variance_from(self.force_n, unit, force_n, per_newton, leverage)
    }

    /// The same, the map's error being that of presses of `calibrated_n`.
    #[inline]
    pub fn variance_from(&self, calibrated_n: f64, unit: usize, force_n: f64, per_newton: f64, leverage: f64) -> f64 {
        let share = force_n / calibrated_n;
        let of_calibration = self.noise.variance(unit, calibrated_n * per_newton);
        self.noise.variance(unit, force_n * per_newton) + share * share * leverage.max(0.0) * of_calibration
    }

    /// The sum of squares of a reading over its noise, if nothing touched the array.
    pub fn loudness(&self, outputs: &[f64]) -> f64 {
        outputs.iter().enumerate().map(|(unit, output)| output * output / self.noise.variance(unit, 0.0)).sum()
    }

    /// The same for a map that holds wherever it was fitted, as it knows what is under the cover.
    pub fn known_everywhere(self) -> Self {
        Response { known_leverage: f64::INFINITY, ..self }
    }

    /// What must be added to an output that is scaled by `share` for it to be as noisy as one that was measured: standard
    /// deviation. Proportional noise scales along, additive noise doesn't.
    pub fn missing_noise(&self, unit: usize, share: f64) -> f64 {
        (self.noise.variance(unit, 0.0) * (1.0 - share * share).max(0.0)).sqrt()
    }

    /// The noise of each unit under the calibration's force, root mean square over the calibration's presses: a standard deviation.
    pub fn typical_sd(&self) -> Vec<f64> {
        let of_unit = |unit: usize| {
            let variances = self.held.iter().map(|held| self.noise.variance(unit, held.residuals[unit].predicted));
            (variances.sum::<f64>() / self.held.len() as f64).sqrt()
        };
        (0..self.field.channels()).map(of_unit).collect()
    }
}
