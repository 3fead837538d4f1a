//! Regression of smooth functions of a place from measured values.

use super::centred::{Centred, scale_both, scale_rows};
use super::correlation::{Correlation, distance, distances};
use super::hyperparameters::{Hyperparameters, Regression, likeliest_noise};
use super::process::Process;
use faer::{Mat, MatRef, Side};

/// Smooth functions of a place, one for each output, regressed from measurements at some places: a Gaussian process with the most
/// likely of four covariances, also called kriging (Rasmussen and Williams 2006, equations 2.25, 4.17 and 5.8).
///
/// A place has any number of coordinates. All outputs share one correlation length, because the same cover smooths them. Each
/// output has its own scale and noise. Length, scales and noises are those with the largest marginal likelihood.
#[derive(Clone)]
pub(super) struct Kriging {
    dimensions: usize,
    outputs: usize,
    /// Process that predicts. Its means are 0 if the process is assumed to have mean 0.
    process: Process,
    /// Noise variance divided by the process' variance, one value for each output.
    noise_ratio: Vec<f64>,
    /// Number of typical measurements that each place counts for; `None` if all places count alike.
    counts: Option<Vec<f64>>,
    eigen: Eigen,
}

/// Prediction at a place by a process that was regressed without this place.
pub(super) struct LeftOutPrediction {
    /// Measured minus predicted values, row-major places x outputs.
    pub residuals: Vec<f64>,
    /// Variance of the prediction divided by the variance of the noise, row-major places x outputs.
    pub leverage: Vec<f64>,
}

/// Largest number of places for a regression. If there are more, those farthest apart are used. The cost grows with the cube of
/// this number.
pub(super) const MOST_PLACES: usize = 1200;

impl Kriging {
    /// Regresses `values` (row-major, places x outputs) on `places` (row-major, places x dimensions) with a known correlation.
    /// Requires at least one place; all numbers must be finite.
    pub(crate) fn fit_with(
        places: &[f64],
        dimensions: usize,
        values: &[f64],
        outputs: usize,
        manner: Regression,
        hyperparameters: &Hyperparameters,
    ) -> Self {
        Self::fit_counting(places, dimensions, values, outputs, manner, hyperparameters, None)
    }

    /// Regresses values that may have different noise.
    pub(crate) fn fit_counting(
        places: &[f64],
        dimensions: usize,
        values: &[f64],
        outputs: usize,
        manner: Regression,
        &Hyperparameters { correlation, is_weighted, .. }: &Hyperparameters,
        counts: Option<&[f64]>,
    ) -> Self {
        let counts = counts.filter(|_| is_weighted);
        let centred = Centred::new(values, outputs, manner.about_mean);
        let count = places.len() / dimensions;
        let eigen = Eigen::of(places, dimensions, correlation, counts);
        let mut scaled = Mat::from_fn(count, outputs, |row, output| centred.at(row, output));
        scale_rows(&mut scaled, counts);
        let turned = eigen.vectors.transpose() * scaled;
        let noise = likeliest_noise(&turned, |ratio| eigen.with_ridge(ratio, &turned));

        let scaled =
            Mat::from_fn(count, outputs, |i, output| turned[(i, output)] / (eigen.values[i] + noise[output].ratio));
        let mut weights = &eigen.vectors * scaled;
        scale_rows(&mut weights, counts);
        Kriging {
            dimensions,
            outputs,
            process: Process {
                inputs: places.to_vec(),
                correlation,
                mean: centred.mean,
                weights: rows(&weights).collect(),
            },
            noise_ratio: noise.iter().map(|noise| noise.ratio).collect(),
            counts: counts.map(<[f64]>::to_vec),
            eigen,
        }
    }

    /// Whether each place is weighted by its number of measurements.
    pub(crate) fn is_weighted(&self) -> bool {
        self.counts.is_some()
    }

    /// Returns the distance over which the outputs look smooth, in the places' unit.
    pub(crate) fn grain(&self) -> f64 {
        self.process.correlation.grain()
    }

    /// Writes the outputs at a place, one value each. Returns the distance to the nearest known place.
    pub(crate) fn predict(&self, place: &[f64], outputs: &mut [f64]) -> f64 {
        self.process.predict(place, outputs)
    }

    /// Returns the process that predicts.
    pub(crate) fn process(&self) -> &Process {
        &self.process
    }

    /// Returns the process that predicts, without the data for its uncertainty.
    pub(crate) fn into_process(self) -> Process {
        self.process
    }

    /// Returns the outputs at many places, row-major places x outputs.
    pub(crate) fn predict_all(&self, places: &[f64]) -> Vec<f64> {
        let known = self.eigen.values.len();
        let weights = MatRef::from_row_major_slice(&self.process.weights, known, self.outputs);
        let predicted = self.correlations(places).transpose() * weights;
        rows(&predicted).zip(self.process.mean.iter().cycle()).map(|(value, mean)| value + mean).collect()
    }

    /// Returns the variance of each prediction divided by the variance of the noise, row-major, places x outputs. It is about one
    /// over the number of measurements that are averaged by the prediction. It is large where there are no measurements.
    pub(crate) fn leverage(&self, places: &[f64]) -> Vec<f64> {
        let mut correlations = self.correlations(places);
        scale_rows(&mut correlations, self.counts.as_deref());
        let mut turned = self.eigen.vectors.transpose() * correlations;
        square(&mut turned);
        let text = turned.transpose() * self.precisions();
        let ratios = self.noise_ratio.iter().cycle();
        rows(&text).zip(ratios).map(|(text, ratio)| (1.0 - text).max(0.0) / ratio).collect()
    }

    /// Predicts each place from the other places, in closed form (equations 5.10 to 5.12).
    pub(crate) fn held_out(&self) -> LeftOutPrediction {
        let mut squares = self.eigen.vectors.clone();
        square(&mut squares);
        let mut precisions = squares * self.precisions();
        // twice: by the root of the count, squared
        scale_rows(&mut precisions, self.counts.as_deref());
        scale_rows(&mut precisions, self.counts.as_deref());
        let residuals = self.process.weights.iter().zip(rows(&precisions)).map(|(weight, p)| weight / p).collect();
        let ratios = self.noise_ratio.iter().cycle();
        let own = |i: usize| self.counts.as_ref().map_or(1.0, |counts| 1.0 / counts[i / self.outputs]);
        let terms = rows(&precisions).zip(ratios).enumerate();
        let leverage = terms.map(|(i, (p, ratio))| (1.0 / (p * ratio) - own(i)).max(0.0)).collect();
        LeftOutPrediction { residuals, leverage }
    }

    /// Returns the correlations of the known places with others, known x others.
    fn correlations(&self, places: &[f64]) -> Mat<f64> {
        let own: Vec<&[f64]> = self.process.inputs.chunks_exact(self.dimensions).collect();
        let others: Vec<&[f64]> = places.chunks_exact(self.dimensions).collect();
        self.process.correlation.of_all(Mat::from_fn(own.len(), others.len(), |i, j| distance(own[i], others[j])))
    }

    /// Returns the inverse of the eigenvalue plus the noise ratio, eigenvalues x outputs.
    fn precisions(&self) -> Mat<f64> {
        let value = |i: usize, output: usize| 1.0 / (self.eigen.values[i] + self.noise_ratio[output]);
        Mat::from_fn(self.eigen.values.len(), self.outputs, value)
    }
}

/// Returns a matrix' values, row by row.
fn rows(matrix: &Mat<f64>) -> impl Iterator<Item = f64> {
    (0..matrix.nrows()).flat_map(move |i| (0..matrix.ncols()).map(move |j| matrix[(i, j)]))
}

/// Squares every value.
fn square(matrix: &mut Mat<f64>) {
    for column in matrix.col_iter_mut() {
        column.iter_mut().for_each(|value| *value *= *value);
    }
}

/// Eigenvalues and eigenvectors of the correlations between places.
#[derive(Clone)]
struct Eigen {
    values: Vec<f64>,
    vectors: Mat<f64>,
}

impl Eigen {
    /// Returns the eigenvalues and eigenvectors. If there are counts, each row and each column is multiplied by the square root
    /// of its count. The noise is then the same everywhere.
    fn of(places: &[f64], dimensions: usize, correlation: Correlation, counts: Option<&[f64]>) -> Self {
        let mut correlations = correlation.of_lower(distances(places, dimensions));
        scale_both(&mut correlations, counts);
        match correlations.self_adjoint_eigen(Side::Lower) {
            Ok(eigen) => Eigen {
                values: eigen.S().column_vector().iter().map(|value| value.max(0.0)).collect(),
                vectors: eigen.U().to_owned(),
            },
            // Finite, symmetric matrices decompose; should one not, nothing is correlated and every prediction is the mean.
            Err(_) => Eigen {
                values: vec![1.0; correlations.nrows()],
                vectors: Mat::identity(correlations.nrows(), correlations.nrows()),
            },
        }
    }
    /// Returns the logarithm of the determinant of the correlations with `ridge` added to their diagonal. For each column of
    /// values in the eigenvectors' frame, it also returns the quadratic form with the inverse matrix.
    fn with_ridge(&self, ridge: f64, turned: &Mat<f64>) -> (f64, Vec<f64>) {
        let precisions: Vec<f64> = self.values.iter().map(|value| 1.0 / (value + ridge)).collect();
        let square = |output: usize| {
            let terms = turned.col_as_slice(output).iter().zip(&precisions);
            terms.map(|(turned, precision)| turned * turned * precision).sum()
        };
        (self.values.iter().map(|value| (value + ridge).ln()).sum(), (0..turned.ncols()).map(square).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::super::correlation::Smoothness;
    use super::*;
    use palpate_core::quantity::stream;
    use rand::distr::Distribution;
    use rand_distr::StandardNormal;

    const MANNER: Regression = Regression { about_mean: false, most_to_seek_with: 144, of: &Smoothness::WITH_SLOPES };

    fn truth(place: f64) -> f64 {
        (0.7 * place).sin()
    }

    /// 60 places, every second one measured well and the others badly, with their counts.
    fn unequal() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let mut rng = stream(3, 0, "unequal rows");
        let mut draw = |i: usize| {
            let normal: f64 = StandardNormal.sample(&mut rng);
            let count: f64 = if i.is_multiple_of(2) { 1.99 } else { 0.01 };
            (0.15 * i as f64, truth(0.15 * i as f64) + 0.05 * normal / count.sqrt(), count)
        };
        let rows: Vec<_> = (0..60).map(&mut draw).collect();
        (rows.iter().map(|r| r.0).collect(), rows.iter().map(|r| r.1).collect(), rows.iter().map(|r| r.2).collect())
    }

    fn error(kriging: &Kriging) -> f64 {
        let mut value = [0.0];
        let mut square = |i: u32| {
            let place = 0.05 * f64::from(i);
            kriging.predict(&[place], &mut value);
            (value[0] - truth(place)).powi(2)
        };
        ((0..170).map(&mut square).sum::<f64>() / 170.0).sqrt()
    }

    fn fit(places: &[f64], values: &[f64]) -> Kriging {
        let hyperparameters = Hyperparameters::of(places, 1, values, 1, MANNER);
        Kriging::fit_with(places, 1, values, 1, MANNER, &hyperparameters)
    }

    fn fit_weighted(places: &[f64], values: &[f64], counts: &[f64]) -> Kriging {
        let hyperparameters = Hyperparameters::weighted(places, 1, values, 1, MANNER, counts);
        Kriging::fit_counting(places, 1, values, 1, MANNER, &hyperparameters, Some(counts))
    }

    #[test]
    fn uncertain_deviation_has_little_weight() {
        let (places, values, counts) = unequal();
        let alike = fit(&places, &values);
        let weighted = fit_weighted(&places, &values, &counts);
        assert!(weighted.is_weighted());
        assert!(error(&weighted) < 0.5 * error(&alike), "{} {}", error(&weighted), error(&alike));
    }

    #[test]
    fn held_out_predictions_are_those_of_a_regression_without_the_place() {
        let (places, values, counts) = unequal();
        let hyperparameters = Hyperparameters::counting(&places, 1, &values, 1, MANNER, Some(&counts));
        let whole = Kriging::fit_counting(&places, 1, &values, 1, MANNER, &hyperparameters, Some(&counts));
        let LeftOutPrediction { residuals, leverage } = whole.held_out();
        let eigen = |rows: &[usize]| -> (Vec<f64>, Mat<f64>) {
            let places: Vec<f64> = rows.iter().map(|&row| places[row]).collect();
            let ratio = whole.noise_ratio[0];
            let own = |i: usize, j: usize| if i == j { ratio / counts[rows[i]] } else { 0.0 };
            let at = |i: usize, j: usize| whole.process.correlation.at((places[i] - places[j]).abs()) + own(i, j);
            (places.clone(), Mat::from_fn(rows.len(), rows.len(), at))
        };
        let rows: Vec<usize> = (0..places.len()).filter(|&row| row != 17).collect();
        let (others, matrix) = eigen(&rows);
        let to = Mat::from_fn(rows.len(), 1, |i, _| whole.process.correlation.at((others[i] - places[17]).abs()));
        let solved = faer::linalg::solvers::Solve::solve(&matrix.llt(Side::Lower).unwrap(), &to);
        let predicted: f64 = rows.iter().enumerate().map(|(i, &row)| solved[(i, 0)] * values[row]).sum();
        let variance = 1.0 - (0..rows.len()).map(|i| solved[(i, 0)] * to[(i, 0)]).sum::<f64>();
        assert!((residuals[17] - (values[17] - predicted)).abs() < 1e-6);
        assert!((leverage[17] / (variance / whole.noise_ratio[0]) - 1.0).abs() < 1e-4, "{}", leverage[17]);
    }

    #[test]
    fn equal_counts_change_nothing() {
        let (places, values, _) = unequal();
        let counts: Vec<f64> = (0..60).map(|i| if i % 3 == 0 { 1.4 } else { 0.8 }).collect();
        let weighted = fit_weighted(&places, &values, &counts);
        assert_eq!(weighted.process.weights, fit(&places, &values).process.weights);
    }
}
