//! A plane over places, learned from values as they arrive.

use palpate_core::quantity::Place;

/// Plane over places, fitted as values arrive. The fit is Bayesian, so the plane is usable before the first value.
///
/// Only sums are stored, so the size of the plane doesn't grow. Values are in any unit; precisions are in units of 1 / (sd of one
/// value)^2.
#[derive(Clone, Debug)]
pub(super) struct BayesianPlane {
    /// Origin of x and y.
    centre: Place,
    /// Diagonal of the prior's precision: height, slope in x, slope in y. The prior's mean is zero.
    prior: [f64; 3],
    /// Sums over the values: basis times basis, basis times value, value squared, all weighted.
    moments: [[f64; 3]; 3],
    weighted: [f64; 3],
    squares: f64,
    count: usize,
}

impl BayesianPlane {
    pub(crate) fn new(centre: Place, prior: [f64; 3]) -> Self {
        BayesianPlane { centre, prior, moments: [[0.0; 3]; 3], weighted: [0.0; 3], squares: 0.0, count: 0 }
    }

    /// Adds a value with its weight.
    pub(crate) fn take(&mut self, place: Place, value: f64, weight: f64) {
        let basis = self.basis(place);
        for (row, left) in basis.iter().enumerate() {
            for (column, right) in basis.iter().enumerate() {
                self.moments[row][column] += weight * left * right;
            }
            self.weighted[row] += weight * left * value;
        }
        self.squares += weight * value * value;
        self.count += 1;
    }

    /// Number of values added.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Returns the plane's value at a place and its variance, in units of the variance of one value.
    pub(crate) fn at(&self, place: Place) -> (f64, f64) {
        let basis = self.basis(place);
        let precision = self.precision();
        let height = dot(basis, solve(precision, self.weighted));
        (height, dot(basis, solve(precision, basis)).max(0.0))
    }

    /// Mean square of the values about the plane.
    pub(crate) fn scatter(&self) -> f64 {
        let plane = solve(self.precision(), self.weighted);
        let explained = 2.0 * dot(plane, self.weighted) - dot(plane, self.moments.map(|row| dot(row, plane)));
        (self.squares - explained).max(0.0) / self.count.saturating_sub(3).max(1) as f64
    }

    fn precision(&self) -> [[f64; 3]; 3] {
        let mut precision = self.moments;
        for (i, prior) in self.prior.iter().enumerate() {
            precision[i][i] += prior;
        }
        precision
    }

    fn basis(&self, place: Place) -> [f64; 3] {
        [1.0, place.x_mm - self.centre.x_mm, place.y_mm - self.centre.y_mm]
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Solves the equations by Cramer's rule. The prior makes the matrix positive definite.
fn solve(m: [[f64; 3]; 3], right: [f64; 3]) -> [f64; 3] {
    let determinant = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    // symmetric, so rows are columns
    let [a, b, c] = m;
    let whole = determinant(a, b, c);
    [determinant(right, b, c) / whole, determinant(a, right, c) / whole, determinant(a, b, right) / whole]
}
