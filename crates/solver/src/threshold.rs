//! Threshold above which a misfit is more than noise.

use super::heldout::GOLDEN_SHARE;
use super::response::ForwardResponse;
use super::widths::FEWEST_TRIALS;
use super::{Calibration, ForceKnown, Setting};
use palpate_core::quantity::stream;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use statrs::distribution::{ChiSquared, ContinuousCDF, Gamma};

/// Fraction of the false alarms that calibration presses may cause as weak signals, and as contacts outside the area. Most false
/// alarms are reserved for readings that no single contact explains.
pub(super) const WEAK_SHARE: f64 = 0.25;

/// Number of forces to which each held-out press is scaled.
const FORCES_A_PRESS: usize = 4;

/// Residuals that remain if one contact is assumed: the sum of squares of a contact's residuals divided by their noise. They are
/// learned from the calibration's own presses. Each press is compared with a map made without it, and scaled over the expected
/// forces.
#[derive(Clone, Debug)]
pub(super) struct Unexplained {
    /// Sums of squares of the presses.
    sums: Vec<f64>,
    mean: f64,
    variance: f64,
    /// Number of units minus number of unknowns.
    free: usize,
    /// Number of places from which the threshold was learned.
    places: usize,
}

/// Largest relative deviation of the residuals' mean from that of noise alone, for a map that explains a calibration. The second
/// constant is the limit for the variance.
const MEAN_OF_NOISE: f64 = 0.15;
const VARIANCE_OF_NOISE: f64 = 0.35;
/// Least number of places from which this can be decided.
const FEWEST_TO_TELL: usize = 100;

impl Unexplained {
    /// Measures the residuals of a map on its calibration.
    pub(crate) fn of(response: &ForwardResponse, calibration: &Calibration, setting: &Setting<'_>) -> Self {
        let units = response.field.channels();
        let mut rng = stream(0, 0, "thresholds");
        let (mut value, mut along_x, mut along_y) = (vec![0.0; units], vec![0.0; units], vec![0.0; units]);
        let mut sums = Vec::with_capacity(response.held.len() * FORCES_A_PRESS);
        let (least, most) = setting.shares(calibration);
        let columns = [true, true, setting.load == ForceKnown::Unknown, setting.common_offset];
        for (index, held) in response.held.iter().enumerate() {
            response.field.value_and_gradient(held.place, &mut value, &mut along_x, &mut along_y);
            for part in 0..FORCES_A_PRESS {
                // evenly over the forces, shuffled over the presses
                let quantile = (index as f64 * GOLDEN_SHARE + part as f64 / FORCES_A_PRESS as f64).fract();
                let share = least + (most - least) * quantile;
                let force_n = share * held.force_n;
                let rows = held.residuals.iter().enumerate().map(|(unit, residual)| {
                    let g = value[unit];
                    let variance = response.variance_from(held.force_n, unit, force_n, g, residual.leverage);
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    let jacobian = [force_n * along_x[unit], force_n * along_y[unit], g, 1.0];
                    (share * residual.residual + response.missing_noise(unit, share) * normal, 1.0 / variance, jacobian)
                });
                sums.push(left_over(rows, columns));
            }
        }
        let count = sums.len().max(1) as f64;
        let mean = sums.iter().sum::<f64>() / count;
        let variance = sums.iter().map(|sum| (sum - mean).powi(2)).sum::<f64>() / count;
        let (free, places) = (units.saturating_sub(setting.unknowns()), calibration.by_place().len());
        Unexplained { sums, mean, variance, free, places }
    }

    /// Returns the limit that is exceeded at the rate `false_alarms`. Mean and variance of the sums give a gamma distribution
    /// (with perfect weights, a chi-squared distribution). With some hundreds of presses, the tail itself contains much less
    /// information than mean and variance. If the presses themselves exceed the limit more often, their own limit counts: noise may
    /// have a longer tail.
    pub(crate) fn limit(&self, false_alarms: f64) -> f64 {
        let Unexplained { mean, variance, free, .. } = *self;
        let of_presses = upper(self.sums.clone(), false_alarms).unwrap_or(0.0);
        Gamma::new(mean * mean / variance, mean / variance)
            .map(|gamma| gamma.inverse_cdf(1.0 - false_alarms))
            .ok()
            .filter(|misfit| misfit.is_finite() && *misfit > 0.0)
            .unwrap_or_else(|| chi2_quantile(free, false_alarms))
            .max(of_presses)
    }

    /// Whether the residuals are only noise, independent for each unit. The mean of a chi-squared variable is its degrees of
    /// freedom, and its variance is twice that.
    pub(crate) fn is_noise(&self) -> bool {
        let free = self.free as f64;
        let off = |found: f64, expected: f64| (found / expected - 1.0).abs();
        self.places >= FEWEST_TO_TELL
            && off(self.mean, free) <= MEAN_OF_NOISE
            && off(self.variance, 2.0 * free) <= VARIANCE_OF_NOISE
    }
}

/// Returns the value that a chi-squared variable with `degrees` degrees of freedom exceeds with this probability.
pub(super) fn chi2_quantile(degrees: usize, probability: f64) -> f64 {
    ChiSquared::new(degrees.max(1) as f64).map_or(f64::INFINITY, |chi2| chi2.inverse_cdf(1.0 - probability))
}

/// Returns the value that the fraction `share` of the values exceeds; `None` if there are few values.
pub(super) fn upper(mut values: Vec<f64>, share: f64) -> Option<f64> {
    values.retain(|value| !value.is_nan());
    if values.len() < FEWEST_TRIALS {
        return None;
    }
    values.sort_by(f64::total_cmp);
    Some(values[((1.0 - share) * (values.len() - 1) as f64).round() as usize])
}

/// Returns the rest of a weighted sum of squares after some unknowns have been fitted, to first order. The selected columns of
/// the Jacobian (x, y, force, common offset) are projected out one after another. Rows are residual, weight and Jacobian.
fn left_over(rows: impl Iterator<Item = (f64, f64, [f64; 4])>, columns: [bool; 4]) -> f64 {
    let mut rows: Vec<[f64; 5]> = rows
        .map(|(residual, weight, [x, y, force, offset])| [x, y, force, offset, residual].map(|v| v * weight.sqrt()))
        .collect();
    for column in (0..4).filter(|&column| columns[column]) {
        let length: f64 = rows.iter().map(|row| row[column] * row[column]).sum();
        if length == 0.0 {
            continue;
        }
        for other in column + 1..5 {
            let share = rows.iter().map(|row| row[column] * row[other]).sum::<f64>() / length;
            rows.iter_mut().for_each(|row| row[other] -= share * row[column]);
        }
    }
    rows.iter().map(|row| row[4] * row[4]).sum()
}
