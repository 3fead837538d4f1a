//! The array's readings under one contact, as a function of place.

use super::Calibration;
use super::field::SplineField;
use super::hyperparameters::Hyperparameters;
use super::noise::{Noise, Residual};
use faer::Mat;
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Readings of the array under one contact, from place to place, and their uncertainty. This is the forward map that a forward
/// solver inverts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct ForwardResponse {
    /// Output of each unit per newton.
    pub field: SplineField,
    /// Variance of `field` divided by the noise variance of one calibration press, one value for each unit.
    pub leverage: SplineField,
    /// Deviation of an output from the map.
    pub noise: Noise,
    /// Force of the calibration presses, N. The map's error grows with the force divided by this force.
    pub force_n: f64,
    /// The calibration's presses, each compared with a map made without it. Empty if the response was read from a file.
    #[serde(skip)]
    pub held: Vec<LeftOutPress>,
    /// Largest leverage, mean of all units, at which the map is known. It is the leverage of the press that is predicted worst by
    /// the others. If the map is less certain than this, the place is outside the calibrated places.
    pub known_leverage: f64,
    /// Correlation of the map, if it has one; `None` if the response was read from a file.
    #[serde(skip)]
    pub hyperparameters: Option<Hyperparameters>,
}

/// Calibration press, compared with a map made without it.
#[derive(Clone, Debug)]
pub(super) struct LeftOutPress {
    /// Place of the press.
    pub place: Place,
    /// Force, N.
    pub force_n: f64,
    /// Residuals, one for each unit.
    pub residuals: Vec<Residual>,
}

/// Number of cells along each side of the table with the map's own error.
const LEVERAGE_CELLS: f64 = 12.0;

impl ForwardResponse {
    /// Combines a map with the presses compared with it. `leverage` is called once, for many places. It returns the map's
    /// variance at each place divided by the variance of one calibration press, row-major, places x units.
    pub(crate) fn new(
        field: SplineField,
        leverage: impl FnOnce(&[Place]) -> Vec<f64>,
        held: Vec<LeftOutPress>,
        calibration: &Calibration,
    ) -> Self {
        let (area, units) = (field.area(), field.channels());
        let side = (area.most.x_mm - area.least.x_mm).max(area.most.y_mm - area.least.y_mm).max(f64::MIN_POSITIVE);
        let leverage = SplineField::new(area, side / LEVERAGE_CELLS, units, leverage);
        let of_unit = |unit: usize| held.iter().map(|held| held.residuals[unit]).collect();
        let noise = Noise::fit(&(0..units).map(of_unit).collect::<Vec<Vec<Residual>>>());
        let mean = |held: &LeftOutPress| held.residuals.iter().map(|r| r.leverage).sum::<f64>() / units as f64;
        let known_leverage = held.iter().map(mean).fold(0.0, f64::max);
        ForwardResponse {
            field,
            leverage,
            noise,
            force_n: calibration.typical_force_n(),
            held,
            known_leverage,
            hyperparameters: None,
        }
    }

    /// Returns the variance of one unit's output under `force_n`, if one newton gives `per_newton`. It contains the noise of the
    /// reading and the map's own error.
    #[inline]
    pub(crate) fn variance(&self, unit: usize, force_n: f64, per_newton: f64, leverage: f64) -> f64 {
        self.variance_from(self.force_n, unit, force_n, per_newton, leverage)
    }

    /// Returns the same variance, with the map's error for presses of `calibrated_n`.
    #[inline]
    pub(crate) fn variance_from(
        &self,
        calibrated_n: f64,
        unit: usize,
        force_n: f64,
        per_newton: f64,
        leverage: f64,
    ) -> f64 {
        let share = force_n / calibrated_n;
        let of_calibration = self.noise.variance(unit, calibrated_n * per_newton);
        self.noise.variance(unit, force_n * per_newton) + share * share * leverage.max(0.0) * of_calibration
    }

    /// Returns the sum of squares of a reading divided by its noise, assuming that nothing touched the array.
    pub(crate) fn loudness(&self, outputs: &[f64]) -> f64 {
        outputs.iter().enumerate().map(|(unit, output)| output * output / self.noise.variance(unit, 0.0)).sum()
    }

    /// Returns the response of a map that is valid wherever it was fitted, because the map includes the structure under the
    /// cover.
    pub(crate) fn known_everywhere(self) -> Self {
        ForwardResponse { known_leverage: f64::INFINITY, ..self }
    }

    /// Returns the response of a map that is known within its area, however large its own error is.
    pub(crate) fn known_within(self) -> Self {
        ForwardResponse { known_leverage: self.known_leverage.max(self.largest_leverage()), ..self }
    }

    /// Largest leverage within the area, mean of all units.
    pub(crate) fn largest_leverage(&self) -> f64 {
        let mut leverage = vec![0.0; self.field.channels()];
        let mut mean = |place: Place| {
            self.leverage.value(place, &mut leverage);
            leverage.iter().sum::<f64>() / leverage.len() as f64
        };
        self.field.area().grid(LEVERAGE_CELLS as usize + 1).into_iter().map(&mut mean).fold(0.0, f64::max)
    }

    /// Returns the noise that must be added to an output scaled by `share`, as a standard deviation. The output is then as noisy
    /// as a measured one. Proportional noise scales with the output, additive noise doesn't.
    pub(crate) fn missing_noise(&self, unit: usize, share: f64) -> f64 {
        (self.noise.variance(unit, 0.0) * (1.0 - share * share).max(0.0)).sqrt()
    }

    /// Mean leverage of the calibration's presses, each predicted by the others.
    pub(crate) fn mean_leverage(&self) -> f64 {
        let all = || self.held.iter().flat_map(|held| &held.residuals);
        all().map(|residual| residual.leverage).sum::<f64>() / all().count().max(1) as f64
    }

    /// Mean square of the correlations of two units' residuals, divided by that of independent units. It is about 1 if each unit has its
    /// own errors, and larger if errors are common to several units.
    pub(crate) fn correlation(&self) -> f64 {
        let (units, presses) = (self.field.channels(), self.held.len());
        let deviation = |held: &LeftOutPress, unit: usize| {
            let Residual { predicted, residual, leverage } = held.residuals[unit];
            residual / (self.noise.variance(unit, predicted) * (1.0 + leverage.max(0.0))).sqrt()
        };
        let deviations = Mat::from_fn(presses, units, |press, unit| deviation(&self.held[press], unit));
        let products = deviations.transpose() * &deviations;
        let mut squares = 0.0;
        for one in 0..units {
            for other in 0..one {
                squares += products[(one, other)].powi(2) / (products[(one, one)] * products[(other, other)]);
            }
        }
        let pairs = units * units.saturating_sub(1) / 2;
        if pairs == 0 { 1.0 } else { presses as f64 * squares / pairs as f64 }
    }

    /// Returns the noise of each unit under the calibration's force: a standard deviation, as the root mean square over the
    /// calibration's presses.
    pub(crate) fn typical_sd(&self) -> Vec<f64> {
        let of_unit = |unit: usize| {
            let variances = self.held.iter().map(|held| self.noise.variance(unit, held.residuals[unit].predicted));
            (variances.sum::<f64>() / self.held.len() as f64).sqrt()
        };
        (0..self.field.channels()).map(of_unit).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surrogate::surrogate;
    use crate::{Calibration, CalibrationPoint};
    use palpate_core::quantity::stream;
    use rand::distr::Distribution;
    use rand_distr::StandardNormal;

    /// Calibration of six units on 15 x 15 places, with an error that all units share and one of their own.
    fn response(shared: f64, own: f64) -> ForwardResponse {
        let mut rng = stream(1, 0, "residuals");
        let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
        let mut press = |index: usize| {
            let place = Place::new((index % 15) as f64, (index / 15) as f64);
            let of_all = shared * normal();
            let output = |unit: usize| {
                let (x_mm, y_mm) = (place.x_mm - 3.0 * unit as f64, place.y_mm - 7.0);
                1.0 + (-(x_mm * x_mm + y_mm * y_mm) / 60.0).exp() + of_all + own * normal()
            };
            (place, (0..6).map(output).collect::<Vec<f64>>())
        };
        let presses: Vec<_> = (0..225).map(&mut press).collect();
        let point = |(place, outputs): &'_ (Place, Vec<f64>)| (*place, outputs.clone());
        let owned: Vec<_> = presses.iter().map(point).collect();
        let points: Vec<_> =
            owned.iter().map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
        surrogate(&Calibration::new(&points).unwrap()).unwrap()
    }

    #[test]
    fn units_with_a_common_error_have_correlated_residuals() {
        let [own, shared] = [response(0.0, 0.02), response(0.01, 0.02)].map(|response| response.correlation());
        assert!(own < 2.0 && shared > 5.0, "{own} {shared}");
    }
}
