//! Noise of outputs, unit by unit.

use serde::{Deserialize, Serialize};

/// Deviation of a unit's output from the output that the contact should cause, for each unit. It has an additive part and a part
/// proportional to the output, variance a^2 + (b y)^2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Noise {
    /// a^2, in the square of the outputs' unit.
    additive: Vec<f64>,
    /// b^2.
    proportional: Vec<f64>,
}

/// One output with its prediction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Residual {
    /// Predicted value.
    pub predicted: f64,
    /// Measured minus predicted value.
    pub residual: f64,
    /// Variance of the prediction divided by the variance of the noise.
    pub leverage: f64,
}

/// Number of reweighting rounds to find the two parts; some ten are enough.
const ROUNDS: usize = 30;

/// Largest leverage at which a residual shows more of the noise than of the map.
const SURE: f64 = 0.3;

/// Least noise, as a fraction of the largest output. No measurement is more accurate.
const LEAST_SHARE: f64 = 1e-6;

impl Noise {
    /// Returns the most likely noise parameters for the residuals of each unit. Assumes normal errors and uses Fisher's scoring.
    pub(crate) fn fit(residuals: &[Vec<Residual>]) -> Self {
        let (additive, proportional) = residuals.iter().map(|of_unit| parts(of_unit)).unzip();
        Noise { additive, proportional }
    }

    /// Returns noise that doesn't depend on the output, with these standard deviations.
    pub(crate) fn additive(sd: &[f64]) -> Self {
        Noise { additive: sd.iter().map(|sd| sd * sd).collect(), proportional: vec![0.0; sd.len()] }
    }

    /// Returns noise with these additive and proportional parts.
    pub(crate) fn of_parts(additive: Vec<f64>, proportional: Vec<f64>) -> Self {
        Noise { additive, proportional }
    }

    /// Returns the additive and the proportional parts of all units.
    pub(crate) fn parts(&self) -> [Vec<f64>; 2] {
        [self.additive.clone(), self.proportional.clone()]
    }

    /// Returns the variance of a unit's output when `output` is the expected value.
    #[inline]
    pub(crate) fn variance(&self, unit: usize, output: f64) -> f64 {
        self.additive[unit] + self.proportional[unit] * output * output
    }
}

/// Returns a^2 and b^2 of one unit. The squares of its residuals are regressed on 1 and y^2. Each square is weighted by the
/// variance found in the previous round.
fn parts(residuals: &[Residual]) -> (f64, f64) {
    let largest = residuals.iter().map(|r| r.predicted.abs()).fold(0.0, f64::max);
    let least = (LEAST_SHARE * largest).powi(2).max(f64::MIN_POSITIVE);
    let square = |r: &Residual| r.residual * r.residual / (1.0 + r.leverage);
    let mean = residuals.iter().map(square).sum::<f64>() / residuals.len().max(1) as f64;
    let (mut a, mut b) = (mean.max(least), 0.0);
    for _ in 0..ROUNDS {
        let mut normal = [0.0; 5]; // sums of w, w y^2, w y^4, w r^2, w y^2 r^2
        for residual in residuals {
            let y = residual.predicted * residual.predicted;
            let weight = (a + b * y).powi(-2);
            let terms = [1.0, y, y * y, square(residual), y * square(residual)];
            normal.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
        }
        let [one, y, yy, r, yr] = normal;
        let determinant = one * yy - y * y;
        (a, b) = if determinant > 1e-9 * one * yy {
            ((r * yy - yr * y) / determinant, (yr * one - r * y) / determinant)
        } else {
            (r / one, 0.0)
        };
        if b < 0.0 {
            (a, b) = (r / one, 0.0);
        } else if a < least {
            (a, b) = (least, (yr / yy).max(0.0));
        }
        a = a.max(least);
    }
    // A proportional part must earn its place: by Akaike's criterion a parameter is worth one unit of log-likelihood. Where the map
    // itself is the larger error, which it is where the output is steep, the two can't be distinguished.
    let surprise = |a: f64, b: f64| -> f64 {
        let of = |r: &Residual| {
            let variance = a + b * r.predicted * r.predicted;
            0.5 * (variance.ln() + square(r) / variance)
        };
        residuals.iter().map(of).sum()
    };
    let alone = mean.max(least);
    let is_map_sure = residuals.iter().filter(|r| r.leverage < SURE).count() * 2 > residuals.len();
    if !is_map_sure || surprise(alone, 0.0) <= surprise(a, b) + 1.0 { (alone, 0.0) } else { (a, b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::quantity::stream;
    use rand::distr::Distribution;
    use rand_distr::StandardNormal;

    fn noise_of(a: f64, b: f64) -> (f64, f64) {
        let mut rng = stream(7, 0, "residuals");
        let draws = (0..4000).map(|i| {
            let predicted = f64::from(i % 100) / 100.0;
            let normal: f64 = StandardNormal.sample(&mut rng);
            let residual = (a * a + (b * predicted).powi(2)).sqrt() * normal * 1.2f64.sqrt();
            Residual { predicted, residual, leverage: 0.2 }
        });
        let noise = Noise::fit(&[draws.collect()]);
        (noise.variance(0, 0.0).sqrt(), (noise.variance(0, 1.0) - noise.variance(0, 0.0)).sqrt())
    }

    #[test]
    fn both_parts_of_the_noise_are_found() {
        let (a, b) = noise_of(0.001, 0.01);
        assert!((a / 0.001 - 1.0).abs() < 0.1 && (b / 0.01 - 1.0).abs() < 0.05, "{a} {b}");
        let (a, b) = noise_of(0.01, 0.0);
        assert!((a / 0.01 - 1.0).abs() < 0.05 && b < 0.004, "{a} {b}");
    }

    #[test]
    fn without_noise_the_least_is_left() {
        let exact = vec![Residual { predicted: 2.0, residual: 0.0, leverage: 0.1 }; 5];
        assert_eq!(Noise::fit(&[exact]).variance(0, 0.0), 4e-12);
        let nothing = vec![Residual { predicted: 0.0, residual: 0.0, leverage: 0.0 }];
        assert!(Noise::fit(&[nothing, Vec::new()]).variance(1, 0.0) > 0.0);
    }
}
