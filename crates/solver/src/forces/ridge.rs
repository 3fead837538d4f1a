//! Linear and quadratic ridge regression of three components, whose ridge is chosen on left-out groups.

use super::ForceTable;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use serde::{Deserialize, Serialize};

/// Ridges that are tried, as fractions of the mean square of a feature.
const RIDGES: [f64; 9] = [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0];

/// Largest number of outputs whose products are features. With more outputs, only their squares are.
const PRODUCTS_MOST: usize = 40;

/// Number of rows whose features are in memory at once.
const ROWS_AT_ONCE: usize = 2048;

/// Outputs scaled to mean 0 and standard deviation 1, and features made of them.
#[derive(Serialize, Deserialize)]
pub(super) struct Features {
    means: Vec<f64>,
    over_sd: Vec<f64>,
}

impl Features {
    pub(super) fn of(table: &ForceTable, rows: &[usize]) -> Features {
        let count = rows.len().max(1) as f64;
        let sum = |of: &dyn Fn(usize) -> f64| rows.iter().map(|&row| of(row)).sum::<f64>();
        let means: Vec<f64> = (0..table.channels).map(|i| sum(&|row| table.row(row)[i]) / count).collect();
        let over_sd = means.iter().enumerate().map(|(i, mean)| {
            let variance = sum(&|row| (table.row(row)[i] - mean).powi(2)) / count;
            if variance > 1e-18 * mean * mean && variance.is_normal() { 1.0 / variance.sqrt() } else { 0.0 }
        });
        Features { over_sd: over_sd.collect(), means }
    }

    pub(super) fn channels(&self) -> usize {
        self.means.len()
    }

    /// Whether there is a finite scale for this number of outputs.
    pub(super) fn is_sound(&self, channels: usize) -> bool {
        [&self.means, &self.over_sd].iter().all(|each| each.len() == channels && each.iter().all(|n| n.is_finite()))
    }

    pub(super) fn standard(&self, outputs: &[f64]) -> Vec<f64> {
        outputs
            .iter()
            .zip(&self.means)
            .zip(&self.over_sd)
            .map(|((output, mean), over)| (output - mean) * over)
            .collect()
    }
}

/// Features of scaled outputs: a constant and the outputs.
pub(super) fn linear(standard: &[f64]) -> Vec<f64> {
    let mut features = vec![1.0];
    features.extend(standard);
    features
}

/// The same, with squares and products.
pub(super) fn quadratic(standard: &[f64]) -> Vec<f64> {
    let mut features = linear(standard);
    let channels = standard.len();
    for i in 1..=channels {
        let last = if channels <= PRODUCTS_MOST { channels } else { i };
        (i..=last).for_each(|j| features.push(features[i] * features[j]));
    }
    features
}

/// A linear function of features for each component.
#[derive(Serialize, Deserialize)]
pub(super) struct Ridge {
    /// Row-major, features x 3; the first feature alone if the others can't be used.
    weights: Vec<[f64; 3]>,
}

impl Ridge {
    /// Whether there are finite weights for this number of features, the constant included.
    pub(super) fn is_sound(&self, features: usize) -> bool {
        [1, features].contains(&self.weights.len()) && self.weights.iter().flatten().all(|weight| weight.is_finite())
    }

    pub(super) fn of(&self, features: &[f64]) -> [f64; 3] {
        let mut answer = [0.0; 3];
        for (feature, weights) in features.iter().zip(&self.weights) {
            (0..3).for_each(|component| answer[component] += feature * weights[component]);
        }
        answer
    }
}

/// Rows of a table in parts that can be left out.
pub(super) struct Fold<'a> {
    features: &'a Features,
    table: &'a ForceTable,
    rows: &'a [usize],
    parts: &'a [Vec<usize>],
}

/// Sums over rows: products of features with each other, and with the forces.
struct Sums {
    products: Mat<f64>,
    with_forces: Mat<f64>,
    rows: f64,
}

impl<'a> Fold<'a> {
    pub(super) fn of(
        features: &'a Features,
        table: &'a ForceTable,
        rows: &'a [usize],
        parts: &'a [Vec<usize>],
    ) -> Self {
        Fold { features, table, rows, parts }
    }

    /// Fits all rows with the ridge that is best on left-out parts. Also returns the fits without each part.
    pub(super) fn fit(&self, is_linear: bool) -> (Ridge, Vec<Ridge>) {
        let each: Vec<Sums> = self.parts.iter().map(|part| self.sums(part, is_linear)).collect();
        let all = Sums::together(&each);
        let without_each = |ridge: f64| each.iter().map(|sums| all.less(sums).solve(ridge)).collect::<Vec<Ridge>>();
        let mut tried = RIDGES.map(|ridge| (0.0, ridge, without_each(ridge)));
        for (nth, part) in self.parts.iter().enumerate() {
            for row in part.iter().map(|&at| self.rows[at]) {
                let features = self.of_row(row, is_linear);
                for (squares, _, fits) in &mut tried {
                    let answer = fits[nth].of(&features);
                    *squares += (0..3).map(|i| (answer[i] - self.table.forces_n[row][i]).powi(2)).sum::<f64>();
                }
            }
        }
        let (_, ridge, fits) =
            tried.into_iter().reduce(|best, other| if other.0 < best.0 { other } else { best }).unwrap_or_default();
        (all.solve(ridge), fits)
    }

    fn of_row(&self, row: usize, is_linear: bool) -> Vec<f64> {
        let standard = self.features.standard(self.table.row(row));
        if is_linear { linear(&standard) } else { quadratic(&standard) }
    }

    fn sums(&self, part: &[usize], is_linear: bool) -> Sums {
        let width = part.first().map_or(0, |&at| self.of_row(self.rows[at], is_linear).len());
        let mut sums = Sums { products: Mat::zeros(width, width), with_forces: Mat::zeros(width, 3), rows: 0.0 };
        for part in part.chunks(ROWS_AT_ONCE) {
            let rows: Vec<Vec<f64>> = part.iter().map(|&at| self.of_row(self.rows[at], is_linear)).collect();
            let matrix = Mat::from_fn(rows.len(), width, |row, feature| rows[row][feature]);
            let forces = Mat::from_fn(rows.len(), 3, |row, i| self.table.forces_n[self.rows[part[row]]][i]);
            sums.products += matrix.transpose() * &matrix;
            sums.with_forces += matrix.transpose() * &forces;
            sums.rows += rows.len() as f64;
        }
        sums
    }
}

impl Sums {
    fn together(each: &[Sums]) -> Sums {
        let mut all = Sums {
            products: Mat::zeros(each[0].products.nrows(), each[0].products.ncols()),
            with_forces: Mat::zeros(each[0].with_forces.nrows(), 3),
            rows: 0.0,
        };
        for sums in each {
            all.products += &sums.products;
            all.with_forces += &sums.with_forces;
            all.rows += sums.rows;
        }
        all
    }

    fn less(&self, other: &Sums) -> Sums {
        Sums {
            products: &self.products - &other.products,
            with_forces: &self.with_forces - &other.with_forces,
            rows: self.rows - other.rows,
        }
    }

    /// Fits the rows; to their mean if the features can't be used.
    fn solve(&self, ridge: f64) -> Ridge {
        let mut matrix = self.products.clone();
        // the constant has no ridge; a feature that is always 0 has one, so the matrix is invertible
        (1..matrix.nrows()).for_each(|i| matrix[(i, i)] += ridge * (self.rows + matrix[(i, i)]));
        let weights = match matrix.llt(Side::Lower) {
            Ok(factor) => {
                let solved = factor.solve(&self.with_forces);
                (0..solved.nrows()).map(|row| [0, 1, 2].map(|i| solved[(row, i)])).collect()
            }
            Err(_) => vec![[0, 1, 2].map(|i| self.with_forces[(0, i)] / self.rows.max(1.0))],
        };
        Ridge { weights }
    }
}
