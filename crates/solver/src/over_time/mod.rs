//! Measurements over time: how a held press relaxes, how the noise averages out, and what repeated presses wear off.
//!
//! | file | what it estimates |
//! |---|---|
//! | `relaxation` | time constants of values held at rest |
//! | `allan` | noise of means over longer and longer times |
//! | `wear` | change of the gain with each press, without the drift of the rig |
//!
//! Intervals are 95 % and assume that the noise of readings is independent. Times are in seconds, and only their differences count.

mod allan;
mod relaxation;
mod wear;

pub use allan::{AllanPoint, allan_deviation, noise_sd};
pub use relaxation::{PlannedTerm, Relaxation, Term, relaxation, relaxation_bound};
pub use wear::{CyclePoint, Estimate, Wear, wear};

use palpate_core::algebra::{cholesky, substitute};
use statrs::distribution::{ContinuousCDF, StudentsT};
use statrs::function::beta::beta_reg;

/// Reason why measurements over time have no estimate.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OverTimeError {
    /// There isn't one value for each time.
    #[error("{times} times, but {values} values")]
    Lengths {
        /// Number of times.
        times: usize,
        /// Number of values.
        values: usize,
    },
    /// Too few readings or presses.
    #[error("{readings} readings, at least {needed} are needed")]
    TooFew {
        /// Number of readings.
        readings: usize,
        /// Number of readings required.
        needed: usize,
    },
    /// A number is NaN or infinite.
    #[error("reading {reading} has a number that isn't finite")]
    NotFinite {
        /// The reading, from 0.
        reading: usize,
    },
    /// Times don't increase.
    #[error("reading {reading} isn't later than the one before")]
    Order {
        /// The reading, from 0.
        reading: usize,
    },
    /// The presses don't differ in what they should show.
    #[error("the presses at the worn place have the same number of cycles")]
    SameCycle,
}

/// Normal equations of a linear least-squares fit with at most `N` parameters. A parameter whose factor is 0 in all rows is absent.
struct LeastSquares<const N: usize> {
    /// The lower triangle is filled.
    matrix: [[f64; N]; N],
    right: [f64; N],
}

impl<const N: usize> LeastSquares<N> {
    /// Sums rows: the factors of the parameters, the value, and its weight.
    fn of(rows: impl Iterator<Item = ([f64; N], f64, f64)>) -> Self {
        let mut sums = LeastSquares { matrix: [[0.0; N]; N], right: [0.0; N] };
        for (row, value, weight) in rows {
            for i in 0..N {
                (0..=i).for_each(|j| sums.matrix[i][j] += weight * row[i] * row[j]);
                sums.right[i] += weight * row[i] * value;
            }
        }
        for (i, row) in sums.matrix.iter_mut().enumerate().filter(|(i, row)| row[*i] == 0.0) {
            row[i] = 1.0; // makes an absent parameter 0
        }
        sums
    }

    /// Returns the parameters; `None` if the rows don't determine them.
    fn solve(&self) -> Option<[f64; N]> {
        Some(substitute(&cholesky(&self.matrix)?, self.right))
    }

    /// Returns the variance of each parameter for values with a variance of 1 over their weight.
    fn variances(&self) -> Option<[f64; N]> {
        let l = cholesky(&self.matrix)?;
        Some(std::array::from_fn(|i| substitute(&l, std::array::from_fn(|j| f64::from(u8::from(i == j))))[i]))
    }
}

/// Returns how many standard deviations a 95 % interval has to each side; infinite without degrees of freedom.
fn interval_sigmas(freedom: usize) -> f64 {
    StudentsT::new(0.0, 1.0, freedom as f64).map_or(f64::INFINITY, |student| student.inverse_cdf(0.975))
}

/// Returns the probability that `added` needless parameters lower the sum of squares this much or more (F-test). `freedom` is the
/// number of values minus all parameters.
fn by_chance(squares: f64, without: f64, added: usize, freedom: usize) -> f64 {
    match squares < without && freedom > 0 {
        true => beta_reg(0.5 * freedom as f64, 0.5 * added as f64, squares / without),
        false => 1.0, // NaN too
    }
}

#[cfg(test)]
mod tests;
