//! A regression on many coordinates that only predicts.

use super::centred::column_means;
use super::correlation::Correlation;
use super::hyperparameters::Hyperparameters;
use faer::linalg::solvers::Solve;
use faer::{Mat, MatRef, Side};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Gaussian process with known correlation and noise. It predicts with a Cholesky factor (Rasmussen and Williams 2006, algorithm
/// 2.1).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Process {
    /// Inputs, row-major, rows x dimensions.
    pub inputs: Vec<f64>,
    /// Correlation as a function of the distance between inputs.
    pub correlation: Correlation,
    /// Mean of each output.
    pub mean: Vec<f64>,
    /// Weights, row-major, rows x outputs. A prediction is a product of correlations with these.
    pub weights: Vec<f64>,
}

impl Process {
    /// Regresses `values` (row-major, rows x outputs) on `inputs` (row-major, rows x dimensions). Also predicts the first
    /// `leading` outputs of each row from the other rows. Returns these as measured minus predicted, row-major.
    pub(crate) fn fit(
        inputs: Vec<f64>,
        dimensions: usize,
        values: &[f64],
        outputs: usize,
        hyperparameters: &Hyperparameters,
        leading: usize,
    ) -> (Self, Vec<f64>) {
        let count = inputs.len() / dimensions;
        let mean = column_means(values, outputs);
        let centred = Mat::from_fn(count, outputs, |row, output| values[row * outputs + output] - mean[output]);
        let correlations = correlations(&inputs, dimensions, hyperparameters.correlation);
        let mut weights = vec![0.0; count * outputs];
        let mut held_out = vec![0.0; count * leading];
        // the leading outputs share one noise, the geometric mean of theirs; one factor does for them
        let logs = hyperparameters.noise_ratio[..leading].iter().map(|ratio| ratio.ln());
        let shared = (logs.sum::<f64>() / leading as f64).exp();
        for (first, past, ratio) in std::iter::once((0, leading, shared))
            .chain((leading..outputs).map(|i| (i, i + 1, hyperparameters.noise_ratio[i])))
        {
            let mut noisy = correlations.clone();
            (0..count).for_each(|i| noisy[(i, i)] += ratio);
            // finite and positive definite because of its noise; otherwise every prediction is the mean
            let Ok(factor) = noisy.llt(Side::Lower) else { continue };
            let solved = factor.solve(centred.subcols(first, past - first));
            for (row, weights) in weights.chunks_exact_mut(outputs).enumerate() {
                (first..past).for_each(|output| weights[output] = solved[(row, output - first)]);
            }
            if first == 0 {
                let precisions = inverse_diagonal(factor.L());
                for (row, held_out) in held_out.chunks_exact_mut(leading).enumerate() {
                    (0..leading).for_each(|output| held_out[output] = solved[(row, output)] / precisions[row]);
                }
            }
        }
        let correlation = hyperparameters.correlation;
        (Process { inputs, correlation, mean, weights }, held_out)
    }

    /// Writes the outputs at an input. Returns the distance to the nearest known input.
    pub(crate) fn predict(&self, input: &[f64], outputs: &mut [f64]) -> f64 {
        outputs.copy_from_slice(&self.mean);
        self.correlation.add_weighted(input, &self.inputs, &self.weights, outputs)
    }

    /// Returns the predictions of a process of places (inputs x and y), row-major, places x outputs.
    pub(crate) fn predict_places(&self, places: &[Place]) -> Vec<f64> {
        let mut predicted = vec![0.0; places.len() * self.mean.len()];
        for (place, outputs) in places.iter().zip(predicted.chunks_exact_mut(self.mean.len())) {
            self.predict(&[place.x_mm, place.y_mm], outputs);
        }
        predicted
    }

    /// Returns all numbers of a process of places: the correlation, the means, the places, and the weights.
    pub(crate) fn numbers(&self) -> Vec<f64> {
        [&self.correlation.numbers()[..], &self.mean, &self.inputs, &self.weights].concat()
    }

    /// Returns the process of places with these [numbers](Self::numbers) and so many outputs; `None` if there is none.
    pub(crate) fn of_numbers(numbers: &[f64], outputs: usize) -> Option<Self> {
        let (correlation, rest) = numbers.split_first_chunk()?;
        let (mean, rest) = rest.split_at_checked(outputs)?;
        let count = rest.len() / (2 + outputs);
        let (inputs, weights) = rest.split_at_checked(2 * count)?;
        let correlation = Correlation::of_numbers(*correlation).filter(|_| weights.len() == count * outputs)?;
        let [mean, inputs, weights] = [mean, inputs, weights].map(<[f64]>::to_vec);
        Some(Process { inputs, correlation, mean, weights })
    }
}

/// Returns the logarithm of the marginal likelihood of values (row-major, rows x outputs) under a correlation and a noise ratio.
/// All outputs share both. `None` if the matrix isn't positive definite.
pub(super) fn likelihood(
    inputs: &[f64],
    dimensions: usize,
    values: &[f64],
    outputs: usize,
    correlation: Correlation,
    ratio: f64,
) -> Option<f64> {
    let count = inputs.len() / dimensions;
    let mean = column_means(values, outputs);
    let centred = Mat::from_fn(count, outputs, |row, output| values[row * outputs + output] - mean[output]);
    let mut noisy = correlations(inputs, dimensions, correlation);
    (0..count).for_each(|i| noisy[(i, i)] += ratio);
    let factor = noisy.llt(Side::Lower).ok()?;
    let log_determinant: f64 = 2.0 * (0..count).map(|i| factor.L()[(i, i)].ln()).sum::<f64>();
    let mut turned = centred;
    factor.L().solve_lower_triangular_in_place(turned.as_mut());
    let of = |output: usize| {
        let scale = turned.col(output).iter().map(|value| value * value).sum::<f64>() / count as f64;
        // an output that is the same everywhere is as likely under any correlation
        if scale <= f64::MIN_POSITIVE { 0.0 } else { -0.5 * (count as f64 * scale.ln() + log_determinant) }
    };
    Some((0..outputs).map(of).sum())
}

/// Returns the correlations of all rows with each other, from the product of the rows.
fn correlations(inputs: &[f64], dimensions: usize, correlation: Correlation) -> Mat<f64> {
    let count = inputs.len() / dimensions;
    let rows = MatRef::from_row_major_slice(inputs, count, dimensions);
    let mut products = rows * rows.transpose();
    let squares: Vec<f64> = (0..count).map(|i| products[(i, i)]).collect();
    for (j, column) in products.col_iter_mut().enumerate() {
        for (i, value) in column.iter_mut().enumerate() {
            let square = if i == j { 0.0 } else { squares[i] + squares[j] - 2.0 * *value };
            *value = correlation.at(square.max(0.0).sqrt());
        }
    }
    products
}

/// Returns the diagonal of a matrix' inverse, from the matrix' Cholesky factor.
fn inverse_diagonal(factor: MatRef<'_, f64>) -> Vec<f64> {
    let mut inverse = Mat::<f64>::identity(factor.nrows(), factor.nrows());
    factor.solve_lower_triangular_in_place(inverse.as_mut());
    inverse.col_iter().map(|column| column.iter().map(|value| value * value).sum()).collect()
}
