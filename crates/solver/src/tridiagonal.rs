//! A symmetric matrix, rotated so that only its diagonal and the values next to the diagonal remain.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::tridiag::{tridiag_in_place, tridiag_in_place_scratch};
use faer::linalg::householder::{
    apply_block_householder_sequence_transpose_on_the_left_in_place_scratch as turn_scratch,
    apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj as turn,
};
use faer::linalg::qr::no_pivoting::factor::recommended_block_size;
use faer::{Conj, Mat, Par};

/// Symmetric matrix in the frame in which it is tridiagonal (Golub and Van Loan 2013, section 8.3.1).
///
/// It takes a third of the time of the eigenvectors, and is sufficient if only sums of squares and determinants are needed.
pub(super) struct Tridiagonal {
    diagonal: Vec<f64>,
    /// Values below the diagonal, one value fewer.
    below: Vec<f64>,
}

impl Tridiagonal {
    /// Rotates a matrix, of which only the lower triangle is used, and columns of values with it.
    pub(crate) fn of(mut matrix: Mat<f64>, values: &mut Mat<f64>) -> Self {
        let count = matrix.nrows();
        if count > 1 {
            let block = recommended_block_size::<f64>(count, count).min(count - 1);
            let mut reflections = Mat::zeros(block, count - 1);
            let scratch = tridiag_in_place_scratch::<f64>(count, Par::Seq, Default::default()).or(turn_scratch::<f64>(
                count - 1,
                block,
                values.ncols(),
            ));
            let mut memory = MemBuffer::new(scratch);
            let stack = MemStack::new(&mut memory);
            tridiag_in_place(matrix.as_mut(), reflections.as_mut(), Par::Seq, stack, Default::default());
            let axes = matrix.as_ref().submatrix(1, 0, count - 1, count - 1);
            turn(axes, reflections.as_ref(), Conj::No, values.as_mut().subrows_mut(1, count - 1), Par::Seq, stack);
        }
        Tridiagonal {
            diagonal: (0..count).map(|i| matrix[(i, i)]).collect(),
            below: (1..count).map(|i| matrix[(i, i - 1)]).collect(),
        }
    }

    /// Returns the logarithm of the determinant of the matrix with `ridge` added to its diagonal. For each column of the rotated
    /// values, also returns the quadratic form with the inverse of this matrix. The matrix plus `ridge` must be positive
    /// definite.
    pub(crate) fn with_ridge(&self, ridge: f64, turned: &Mat<f64>) -> (f64, Vec<f64>) {
        let first = self.diagonal[..1].iter().map(|diagonal| (diagonal + ridge, 0.0));
        let mut pivots: Vec<(f64, f64)> = first.collect();
        for (diagonal, below) in self.diagonal[1..].iter().zip(&self.below) {
            let factor = below / pivots[pivots.len() - 1].0;
            pivots.push((diagonal + ridge - factor * below, factor));
        }
        let square = |column: usize| {
            let mut last = 0.0;
            let squares = pivots.iter().zip(turned.col_as_slice(column)).map(|((pivot, factor), value)| {
                last = value - factor * last;
                last * last / pivot
            });
            squares.sum()
        };
        (pivots.iter().map(|(pivot, _)| pivot.ln()).sum(), (0..turned.ncols()).map(square).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Side;
    use faer::linalg::solvers::Solve;

    #[test]
    fn determinant_and_squares_are_those_of_a_cholesky_factor() {
        for count in [1, 2, 5, 60] {
            let apart = |i: usize, j: usize| (i as f64 - j as f64).abs();
            let matrix = Mat::from_fn(count, count, |i, j| (-0.3 * apart(i, j)).exp());
            let values = Mat::from_fn(count, 2, |i, column| (i as f64 + 0.4 * column as f64).sin());
            let mut turned = values.clone();
            let (determinant, squares) = Tridiagonal::of(matrix.clone(), &mut turned).with_ridge(0.01, &turned);
            let ridged = Mat::from_fn(count, count, |i, j| matrix[(i, j)] + if i == j { 0.01 } else { 0.0 });
            let factor = ridged.llt(Side::Lower).unwrap();
            let expected: f64 = (0..count).map(|i| 2.0 * factor.L()[(i, i)].ln()).sum();
            assert!((determinant - expected).abs() < 1e-9, "{count}: {determinant} {expected}");
            let measured = values.transpose() * factor.solve(&values);
            for (column, square) in squares.iter().enumerate() {
                assert!((square - measured[(column, column)]).abs() < 1e-9 * (1.0 + square), "{count}: {square}");
            }
        }
    }
}
