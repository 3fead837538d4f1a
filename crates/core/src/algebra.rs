//! Algebra of small matrices whose size is known when the program is compiled.

use std::array::from_fn;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Index, IndexMut, Mul, Sub};

/// A matrix of `R` rows and `C` columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matrix<const R: usize, const C: usize>([[f64; C]; R]);

/// A column of `N` values.
pub type Vector<const N: usize> = Matrix<N, 1>;

/// Fraction of a pivot that must remain in [`cholesky`]. Below it only rounding errors are left.
const LEAST_PIVOT: f64 = 1e-12;

impl<const R: usize, const C: usize> Matrix<R, C> {
    /// The matrix of zeros.
    pub const ZERO: Self = Matrix([[0.0; C]; R]);

    /// Returns the matrix with these rows.
    pub const fn of(rows: [[f64; C]; R]) -> Self {
        Matrix(rows)
    }

    /// Returns the rows.
    pub const fn rows(&self) -> &[[f64; C]; R] {
        &self.0
    }

    /// Returns the matrix with rows and columns exchanged.
    pub fn transpose(&self) -> Matrix<C, R> {
        Matrix(from_fn(|i| from_fn(|j| self.0[j][i])))
    }

    fn with(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Matrix(from_fn(|i| from_fn(|j| f(self.0[i][j], other.0[i][j]))))
    }
}

impl<const N: usize> Vector<N> {
    /// Returns the column of these values.
    pub const fn column(values: [f64; N]) -> Self {
        let mut rows = [[0.0; 1]; N];
        let mut i = 0;
        while i < N {
            rows[i][0] = values[i];
            i += 1;
        }
        Matrix(rows)
    }

    /// Returns the values.
    pub fn values(&self) -> [f64; N] {
        self.0.map(|[value]| value)
    }

    /// Returns the sum of the products of the values.
    pub fn dot(&self, other: &Self) -> f64 {
        self.0.iter().flatten().zip(other.0.iter().flatten()).map(|(a, b)| a * b).sum()
    }

    /// Returns a function of each value.
    pub fn map(&self, f: impl Fn(f64) -> f64) -> Self {
        Matrix(self.0.map(|row| row.map(&f)))
    }

    /// Returns the products of the values, one by one.
    pub fn times(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl<const N: usize> Matrix<N, N> {
    /// Returns the matrix with these values on the diagonal.
    pub fn from_diagonal(values: Vector<N>) -> Self {
        Matrix(from_fn(|i| from_fn(|j| if i == j { values[i] } else { 0.0 })))
    }

    /// Returns the values on the diagonal.
    pub fn diagonal(&self) -> Vector<N> {
        Matrix(from_fn(|i| [self.0[i][i]]))
    }

    /// Returns the matrix with ones on the diagonal.
    pub fn identity() -> Self {
        Self::from_diagonal(Vector::column([1.0; N]))
    }

    /// Returns `x` with `self * x = right`, or `None` for a singular matrix.
    pub fn solve<const K: usize>(&self, right: Matrix<N, K>) -> Option<Matrix<N, K>> {
        let (determinant, solved) = self.eliminate(right);
        let is_finite = determinant != 0.0 && solved.0.iter().flatten().all(|value| value.is_finite());
        is_finite.then_some(solved)
    }

    /// Returns the inverse, or `None` for a singular matrix.
    pub fn inverse(&self) -> Option<Self> {
        self.solve(Self::identity())
    }

    /// Returns the determinant.
    pub fn determinant(&self) -> f64 {
        self.eliminate(Matrix::<N, 0>::ZERO).0
    }

    /// Eliminates by Gauss and Jordan, with the largest remaining value of each column as its pivot. Returns the determinant and
    /// the solution.
    fn eliminate<const K: usize>(&self, right: Matrix<N, K>) -> (f64, Matrix<N, K>) {
        let (mut a, mut x, mut determinant) = (self.0, right.0, 1.0);
        for column in 0..N {
            let size = |row: &usize| a[*row][column].abs();
            let pivot = (column..N).max_by(|i, j| size(i).total_cmp(&size(j))).unwrap_or(column);
            if pivot != column {
                a.swap(pivot, column);
                x.swap(pivot, column);
                determinant = -determinant;
            }
            determinant *= a[column][column];
            let inverse = 1.0 / a[column][column];
            a[column] = a[column].map(|value| value * inverse);
            x[column] = x[column].map(|value| value * inverse);
            let (pivot_a, pivot_x) = (a[column], x[column]);
            for row in (0..N).filter(|&row| row != column) {
                let factor = a[row][column];
                a[row].iter_mut().zip(pivot_a).for_each(|(value, pivot)| *value -= factor * pivot);
                x[row].iter_mut().zip(pivot_x).for_each(|(value, pivot)| *value -= factor * pivot);
            }
        }
        (determinant, Matrix(x))
    }
}

/// Returns the lower triangle `l` with `l l' = a`, or `None` if `a` isn't positive definite. It reads the lower triangle of `a`.
#[inline]
pub fn cholesky<const N: usize>(a: &[[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let mut l = [[0.0; N]; N];
    for i in 0..N {
        for j in 0..=i {
            let rest: f64 = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = match i == j {
                true if rest > LEAST_PIVOT * a[i][i] => rest.sqrt(),
                true => return None, // NaN too
                false => rest / l[j][j],
            };
        }
    }
    Some(l)
}

/// Returns `x` with `l l' x = right`, for the lower triangle of [`cholesky`].
#[inline]
pub fn substitute<const N: usize>(l: &[[f64; N]; N], right: [f64; N]) -> [f64; N] {
    let mut x = right;
    for i in 0..N {
        x[i] = (x[i] - (0..i).map(|k| l[i][k] * x[k]).sum::<f64>()) / l[i][i];
    }
    for i in (0..N).rev() {
        x[i] = (x[i] - (i + 1..N).map(|k| l[k][i] * x[k]).sum::<f64>()) / l[i][i];
    }
    x
}

impl<const N: usize> Index<usize> for Vector<N> {
    type Output = f64;

    fn index(&self, i: usize) -> &f64 {
        &self.0[i][0]
    }
}

impl<const N: usize> IndexMut<usize> for Vector<N> {
    fn index_mut(&mut self, i: usize) -> &mut f64 {
        &mut self.0[i][0]
    }
}

impl<const R: usize, const C: usize> Add for Matrix<R, C> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl<const R: usize, const C: usize> AddAssign for Matrix<R, C> {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<const R: usize, const C: usize> Sub for Matrix<R, C> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl<const R: usize, const C: usize, const K: usize> Mul<Matrix<C, K>> for Matrix<R, C> {
    type Output = Matrix<R, K>;

    fn mul(self, other: Matrix<C, K>) -> Matrix<R, K> {
        Matrix(from_fn(|i| from_fn(|k| (0..C).map(|j| self.0[i][j] * other.0[j][k]).sum())))
    }
}

impl<const R: usize, const C: usize> Mul<f64> for Matrix<R, C> {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Matrix(self.0.map(|row| row.map(|value| value * factor)))
    }
}

impl<const R: usize, const C: usize> Div<f64> for Matrix<R, C> {
    type Output = Self;

    fn div(self, divisor: f64) -> Self {
        Matrix(self.0.map(|row| row.map(|value| value / divisor)))
    }
}

impl<const R: usize, const C: usize> Sum for Matrix<R, C> {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::ZERO, Add::add)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Matrix<3, 3> = Matrix::of([[0.0, 2.0, 1.0], [4.0, -1.0, 3.0], [1.0, 1.0, 1.0]]);

    fn is_near<const R: usize, const C: usize>(a: Matrix<R, C>, b: Matrix<R, C>) -> bool {
        (a - b).rows().iter().flatten().all(|value| value.abs() < 1e-12)
    }

    #[test]
    fn a_system_is_solved_although_its_first_pivot_is_zero() {
        let x = Vector::column([1.0, -2.0, 3.0]);
        assert!(is_near(A.solve(A * x).unwrap(), x));
        assert!(is_near(A.inverse().unwrap() * A, Matrix::identity()));
        // by the first row: -2 (4 - 3) + 1 (4 + 1)
        assert!((A.determinant() - 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_singular_matrix_has_no_inverse() {
        let rank_2 = Matrix::of([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [0.0, 1.0, 1.0]]);
        assert_eq!(rank_2.inverse(), None);
        assert_eq!(Matrix::<2, 2>::ZERO.inverse(), None);
        assert_eq!(Matrix::of([[f64::NAN, 0.0], [0.0, 1.0]]).inverse(), None);
    }

    #[test]
    fn cholesky_factor_solves_and_an_indefinite_matrix_has_none() {
        let definite = A.transpose() * A;
        let l = cholesky(definite.rows()).unwrap();
        assert!(is_near(Matrix::of(l) * Matrix::of(l).transpose(), definite));
        let x = Vector::column(substitute(&l, [1.0, 2.0, 3.0]));
        assert!(is_near(definite * x, Vector::column([1.0, 2.0, 3.0])), "{x:?}");
        assert_eq!(cholesky(&[[1.0, 2.0], [2.0, 1.0]]), None);
    }
}
