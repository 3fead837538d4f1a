//! Measurements over time: how a held press relaxes, how the noise averages out, and what repeated presses wear off.
//!
//! | file | what it estimates |
//! |---|---|
//! | `relaxation` | time constants of values held at rest, by the fit in `exponentials` |
//! | `allan` | noise of means over longer and longer times |
//! | `wear` | change of the gain with each press, without the drift of the rig |
//! | `temperature` | change of a zero or a gain with the temperature |
//!
//! Intervals are 95 % and assume that the noise of readings is independent. Times are in seconds, and only their
//! differences count.

mod allan;
mod exponentials;
mod relaxation;
mod temperature;
mod wear;

pub use allan::{AllanPoint, allan_deviation, noise_sd};
pub use relaxation::{PlannedTerm, Relaxation, Term, relaxation, relaxation_bound};
pub use temperature::{TemperatureCoefficient, TemperaturePoint, temperature_coefficient};
pub use wear::{CyclePoint, Estimate, Wear, wear};

use palpate_core::algebra::{cholesky, substitute};
use statrs::distribution::{ContinuousCDF, StudentsT};
use std::array::from_fn;

/// Reason why measurements over time have no estimate.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OverTimeError {
    /// Too few readings, or presses at the worn place.
    #[error("{readings} readings, at least {needed} are needed")]
    TooFew {
        /// Number of readings.
        readings: usize,
        /// Number of readings required.
        needed: usize,
    },
    /// A number is missing, NaN or infinite, or times don't increase.
    #[error("reading {reading} has no finite time and value, or isn't later than the one before")]
    Reading {
        /// The reading, from 0.
        reading: usize,
    },
    /// Nothing determines the estimate: all presses have the same cycle, the temperature follows the time, or numbers are too large to be squared.
    #[error("the cycles or the temperatures don't differ enough, or numbers are too large")]
    Singular,
}

/// Normal equations of a linear least-squares fit with at most `N` parameters. A parameter whose factor is 0 in all
/// rows is absent.
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

    /// Returns the parameters, and the variance of each for values with a variance of 1 over their weight. `None` if
    /// the rows don't determine them.
    fn solve(&self) -> Option<[[f64; N]; 2]> {
        let covariance = self.covariance()?;
        Some([substitute(&cholesky(&self.matrix)?, self.right), from_fn(|i| covariance[i][i])])
    }

    /// Returns the covariance of the parameters for such values.
    fn covariance(&self) -> Option<[[f64; N]; N]> {
        let l = cholesky(&self.matrix)?;
        let unit = |i: usize| from_fn(|j| f64::from(u8::from(i == j)));
        Some(from_fn(|i| substitute(&l, unit(i))))
    }
}

/// Returns how many standard deviations a 95 % interval has to each side; infinite without degrees of freedom.
fn interval_sigmas(freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom).map_or(f64::INFINITY, |student| student.inverse_cdf(0.975))
}

#[cfg(test)]
mod tests;
