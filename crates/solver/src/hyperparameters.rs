//! The most likely correlation and noise of values that were measured at some places.

use super::centred::{Centred, scale_both, scale_rows};
use super::correlation::{Correlation, Smoothness, distances, farthest_apart, likeliest};
use super::tridiagonal::Tridiagonal;
use faer::Mat;

/// Most likely correlation of some values.
#[derive(Clone, Debug)]
pub(super) struct Hyperparameters {
    pub correlation: Correlation,
    /// Noise variance divided by the process' variance, one value for each output.
    pub noise_ratio: Vec<f64>,
    /// Logarithm of the marginal likelihood of the places used in the search.
    pub likelihood: f64,
    /// Whether places are weighted by their number of measurements; otherwise all places count alike.
    pub is_weighted: bool,
}

/// Settings of a process' regression.
#[derive(Clone, Copy, Debug)]
pub(super) struct Regression {
    /// Whether each output varies about its mean; otherwise it varies about 0.
    pub about_mean: bool,
    /// Largest number of places used to search for the correlation.
    pub most_to_seek_with: usize,
    /// Smoothnesses that are tried.
    pub of: &'static [Smoothness],
}

/// Largest ratio of the counts of places that are treated as equal. It corresponds to forces within a factor of 1.5, which count
/// as one.
const ALIKE: f64 = 2.25;

/// Number of noise ratios that are tried: 10^(-8 + i / 4).
const NOISE_RATIOS: i32 = 36;

/// Standard deviation of the logarithm of the noise ratios within one array: a factor of 4.5.
const NOISE_ALIKE: f64 = 1.5;

/// Number of rounds in which the noise ratios and their mean are found alternately.
const ROUNDS_OF_NOISE: usize = 5;

impl Hyperparameters {
    /// Returns the most likely correlation of values (row-major, places x outputs) measured at places (row-major, places x
    /// dimensions). Requires at least one place; all numbers must be finite.
    pub(crate) fn of(places: &[f64], dimensions: usize, values: &[f64], outputs: usize, manner: Regression) -> Self {
        Self::counting(places, dimensions, values, outputs, manner, None)
    }

    /// Returns the most likely correlation of values that may have different noise. `counts` is the number of typical
    /// measurements that the value at each place is worth. The likelihood also decides whether these counts are used or all
    /// places count alike.
    pub(crate) fn weighted(
        places: &[f64],
        dimensions: usize,
        values: &[f64],
        outputs: usize,
        manner: Regression,
        counts: &[f64],
    ) -> Self {
        let alike = Self::of(places, dimensions, values, outputs, manner);
        let (least, most) = counts.iter().fold((f64::MAX, 0.0f64), |(l, m), count| (l.min(*count), m.max(*count)));
        if most < ALIKE * least {
            return alike;
        }
        let weighted = Self::counting(places, dimensions, values, outputs, manner, Some(counts));
        if weighted.likelihood > alike.likelihood { weighted } else { alike }
    }

    /// Returns the most likely correlation, with the given counts if there are any.
    pub(super) fn counting(
        places: &[f64],
        dimensions: usize,
        values: &[f64],
        outputs: usize,
        manner: Regression,
        counts: Option<&[f64]>,
    ) -> Self {
        let centred = Centred::new(values, outputs, manner.about_mean);
        let few = farthest_apart(places, dimensions, manner.most_to_seek_with.min(places.len() / dimensions));
        let few_places: Vec<f64> =
            few.iter().flat_map(|&row| &places[row * dimensions..][..dimensions]).copied().collect();
        let few_counts: Option<Vec<f64>> = counts.map(|counts| few.iter().map(|&row| counts[row]).collect());
        let mut few_values = Mat::from_fn(few.len(), outputs, |row, output| centred.at(few[row], output));
        scale_rows(&mut few_values, few_counts.as_deref());
        let apart = distances(&few_places, dimensions);
        let noise = |correlation: Correlation| {
            let mut correlations = correlation.of_lower(apart.clone());
            scale_both(&mut correlations, few_counts.as_deref());
            let mut turned = few_values.clone();
            let tridiagonal = Tridiagonal::of(correlations, &mut turned);
            likeliest_noise(&turned, |ratio| tridiagonal.with_ridge(ratio, &turned))
        };
        let likelihood = |correlation| noise(correlation).iter().map(|noise| noise.likelihood).sum::<f64>();
        let (correlation, likelihood) = likeliest(&apart, manner.of, likelihood);
        let noise_ratio = noise(correlation).iter().map(|noise| noise.ratio).collect();
        // scaling the rows scaled the determinant too
        let scaled = few_counts.map_or(0.0, |counts| 0.5 * outputs as f64 * counts.iter().map(|c| c.ln()).sum::<f64>());
        Hyperparameters { correlation, noise_ratio, likelihood: likelihood + scaled, is_weighted: counts.is_some() }
    }
}

/// Noise ratio, and the likelihood of an output's values under it.
#[derive(Clone, Copy)]
pub(super) struct NoiseRatio {
    /// Noise variance divided by the process' variance.
    pub ratio: f64,
    /// Logarithm of the marginal likelihood, without the terms that don't depend on the ratio.
    likelihood: f64,
}

/// Returns the most likely noise ratio of each output; each column of `values` is one output. For a ratio, `with` returns the
/// logarithm of the determinant of correlations plus noise, and each column's quadratic form with the inverse matrix.
///
/// With few places, the likelihood alone can mistake the smoothest noise for signal. But the units of one array are similar, so
/// their ratios share one log-normal distribution. Its mean is found together with the ratios.
pub(super) fn likeliest_noise(values: &Mat<f64>, with: impl Fn(f64) -> (f64, Vec<f64>)) -> Vec<NoiseRatio> {
    let ratios: Vec<f64> = (0..NOISE_RATIOS).map(|i| 10f64.powf(-8.0 + f64::from(i) / 4.0)).collect();
    let measured: Vec<(f64, Vec<f64>)> = ratios.iter().map(|ratio| with(*ratio)).collect();
    let count = values.nrows() as f64;
    let of_output = |output: usize| -> Vec<NoiseRatio> {
        let is_flat = values.col_as_slice(output).iter().map(|value| value * value).sum::<f64>() <= f64::MIN_POSITIVE;
        let tried = ratios.iter().zip(&measured).map(|(ratio, (determinant, squares))| {
            let scale = squares[output] / count;
            // an output that is the same everywhere is as likely under any ratio
            let likelihood = if is_flat { 0.0 } else { -0.5 * (count * scale.ln() + determinant) };
            // not known where rounding took the definiteness
            NoiseRatio { ratio: *ratio, likelihood: likelihood.max(f64::NEG_INFINITY) }
        });
        tried.collect()
    };
    let curves: Vec<Vec<NoiseRatio>> = (0..values.ncols()).map(of_output).collect();
    let in_common = |i: &usize| curves.iter().map(|curve| curve[*i].likelihood).sum::<f64>();
    let together = (0..ratios.len()).max_by(|a, b| in_common(a).total_cmp(&in_common(b))).unwrap_or(0);
    let mut mean = ratios[together].ln();
    let mut chosen = Vec::new();
    for _ in 0..ROUNDS_OF_NOISE {
        let prior = |noise: &NoiseRatio| -0.5 * ((noise.ratio.ln() - mean) / NOISE_ALIKE).powi(2);
        let posterior = |noise: NoiseRatio| NoiseRatio { likelihood: noise.likelihood + prior(&noise), ..noise };
        let best = |curve: &Vec<NoiseRatio>| {
            curve.iter().map(|noise| posterior(*noise)).max_by(|a, b| a.likelihood.total_cmp(&b.likelihood))
        };
        chosen = curves.iter().filter_map(best).collect();
        mean = chosen.iter().map(|noise| noise.ratio.ln()).sum::<f64>() / chosen.len().max(1) as f64;
    }
    chosen
}
