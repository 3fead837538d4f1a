//! Normal equations of a few unknowns.

use palpate_core::algebra::{cholesky, substitute};

/// Normal equations of `N` unknowns: J'WJ and J'Wr, summed over weighted rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct NormalEquations<const N: usize = 3> {
    /// J'WJ, the information about the unknowns.
    pub information: [[f64; N]; N],
    /// J'Wr, half the decrease of the sum of squares along each unknown.
    pub slope: [f64; N],
}

impl<const N: usize> Default for NormalEquations<N> {
    fn default() -> Self {
        NormalEquations { information: [[0.0; N]; N], slope: [0.0; N] }
    }
}

impl<const N: usize> NormalEquations<N> {
    /// Adds a row. The half above the diagonal is left to [`finish`](Self::finish).
    #[inline]
    pub(crate) fn add(&mut self, weight: f64, jacobian: [f64; N], residual: f64) {
        for (i, row) in self.information.iter_mut().enumerate() {
            let weighted = weight * jacobian[i];
            self.slope[i] += weighted * residual;
            for (sum, other) in row.iter_mut().zip(&jacobian[..=i]) {
                *sum += weighted * other;
            }
        }
    }

    /// Fills in the half above the diagonal.
    pub(crate) fn finish(&mut self) {
        for i in 0..N {
            for j in i + 1..N {
                self.information[i][j] = self.information[j][i];
            }
        }
    }

    /// Returns the step to the smallest sum of squares along the free unknowns. There is no step if the unknowns can't be
    /// distinguished.
    pub(crate) fn step(&self, free: [bool; N]) -> [f64; N] {
        let (mut a, mut x) = (self.information, self.slope);
        for i in (0..N).filter(|&i| !free[i]) {
            a[i] = [0.0; N];
            a.iter_mut().for_each(|row| row[i] = 0.0);
            a[i][i] = 1.0;
            x[i] = 0.0;
        }
        cholesky(&a).map_or([0.0; N], |l| substitute(&l, x))
    }

    /// Returns the reduction of the sum of squares by a step, to first order.
    pub(crate) fn gain(&self, step: [f64; N]) -> f64 {
        step.iter().zip(&self.slope).map(|(step, slope)| step * slope).sum()
    }
}

/// Returns the inverse of a matrix, or `None` if the matrix isn't positive definite.
pub(super) fn inverse<const N: usize>(a: &[[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let l = cholesky(a)?;
    let column = |i: usize| {
        let mut unit = [0.0; N];
        unit[i] = 1.0;
        substitute(&l, unit)
    };
    let inverse = std::array::from_fn(column); // symmetric: columns are rows
    inverse.iter().flatten().all(|value| value.is_finite()).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normal() -> NormalEquations {
        let mut normal = NormalEquations::default();
        // three unknowns 1, -2, 3 read by four rows without error
        for (weight, jacobian) in
            [(1.0, [1.0, 0.5, 0.0]), (2.0, [0.0, 1.0, 1.0]), (0.5, [1.0, 1.0, 1.0]), (1.0, [0.3, 0.0, 1.0])]
        {
            let residual = jacobian[0] - 2.0 * jacobian[1] + 3.0 * jacobian[2];
            normal.add(weight, jacobian, residual);
        }
        normal.finish();
        normal
    }

    #[test]
    fn step_solves_the_free_parameters_and_leaves_the_others() {
        let step = normal().step([true; 3]);
        for (found, truth) in step.iter().zip([1.0, -2.0, 3.0]) {
            assert!((found - truth).abs() < 1e-12, "{step:?}");
        }
        assert_eq!(normal().step([true, false, true])[1], 0.0);
        assert!(normal().gain(step) > normal().gain(normal().step([true, false, true])));
    }

    #[test]
    fn inverse_is_exact_and_a_singular_matrix_is_reported() {
        let a = normal().information;
        let inverse = inverse(&a).unwrap();
        for (i, row) in a.iter().enumerate() {
            let product = |j: usize| row.iter().zip(&inverse).map(|(value, row)| value * row[j]).sum::<f64>();
            assert!((0..3).all(|j| (product(j) - f64::from(u8::from(i == j))).abs() < 1e-12));
        }
        let mut blind = NormalEquations::<3>::default();
        blind.add(1.0, [1.0, 1.0, 0.0], 1.0);
        blind.finish();
        assert_eq!(super::inverse(&blind.information), None);
        assert_eq!(blind.step([true; 3]), [0.0; 3]);
    }
}
