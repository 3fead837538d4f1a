//! Measured values minus their means.

use faer::Mat;

/// Values minus the mean of their column, if the process varies about the mean.
pub(super) struct Centred<'a> {
    values: &'a [f64],
    pub mean: Vec<f64>,
    /// Columns that are 0 throughout after centring, except for rounding errors.
    flat: Vec<bool>,
}

impl<'a> Centred<'a> {
    /// Takes values, row-major, rows x outputs.
    pub(crate) fn new(values: &'a [f64], outputs: usize, about_mean: bool) -> Self {
        match about_mean {
            true => Centred { values, mean: column_means(values, outputs), flat: flat_columns(values, outputs) },
            false => Centred { values, mean: vec![0.0; outputs], flat: vec![false; outputs] },
        }
    }

    pub(crate) fn at(&self, row: usize, output: usize) -> f64 {
        let value = self.values[row * self.mean.len() + output];
        if self.flat[output] { 0.0 } else { value - self.mean[output] }
    }
}

/// Multiplies each row by the square root of its count, if there are counts.
pub(super) fn scale_rows(matrix: &mut Mat<f64>, counts: Option<&[f64]>) {
    for column in matrix.col_iter_mut().filter(|_| counts.is_some()) {
        column.iter_mut().zip(counts.into_iter().flatten()).for_each(|(value, count)| *value *= count.sqrt());
    }
}

/// Multiplies each row and each column by the square root of its count, if there are counts.
pub(super) fn scale_both(matrix: &mut Mat<f64>, counts: Option<&[f64]>) {
    scale_rows(matrix, counts);
    for (column, count) in matrix.col_iter_mut().zip(counts.into_iter().flatten()) {
        column.iter_mut().for_each(|value| *value *= count.sqrt());
    }
}

pub(super) fn column_means(values: &[f64], columns: usize) -> Vec<f64> {
    let rows = (values.len() / columns).max(1) as f64;
    (0..columns).map(|column| values[column..].iter().step_by(columns).sum::<f64>() / rows).collect()
}

/// Returns for each column whether all its values are equal, except for rounding.
fn flat_columns(values: &[f64], columns: usize) -> Vec<bool> {
    let is_flat = |column: usize| {
        let of_column = || values[column..].iter().step_by(columns);
        let (least, most) = of_column().fold((f64::MAX, f64::MIN), |(l, m), v| (l.min(*v), m.max(*v)));
        most - least <= 1e-9 * most.abs().max(least.abs())
    };
    (0..columns).map(is_flat).collect()
}
