//! Change of a sensor after some presses: a linear model with normal errors, linearised again some times.

use super::spread::DesignSpread;
use crate::Calibration;
use crate::adapt::{AdaptableMap, Fit, LinearRow, Moved};
use palpate_core::algebra::Matrix;

/// The change of each unit, and its covariance.
pub(super) struct ArrayPosterior {
    pub moved: Vec<Moved>,
    pub covariances: Vec<Matrix<4, 4>>,
}

/// A change and its covariance.
pub(super) type UnitEstimate = (Moved, Matrix<4, 4>);

/// Number of rounds in which the map is linearised.
const ROUNDS: usize = 4;

/// Factors for the standard deviation of what all units have in common, for the gain, the place and the width. Few sensors show
/// little of this deviation, so larger ones are tried too, weighted by their marginal likelihood.
const COMMON: [f64; 3] = [1.0, 4.0, 16.0];

/// What the presses show about one unit.
#[derive(Clone, Copy)]
pub(super) struct Information {
    /// Sum of the squares of the slopes, divided by the variances.
    pub matrix: Matrix<4, 4>,
    /// Sum of slopes times residuals, divided by the variances.
    pub vector: Moved,
}

impl Information {
    pub(super) const NONE: Information = Information { matrix: Matrix::ZERO, vector: Moved::ZERO };

    pub(super) fn of(rows: &[LinearRow]) -> Self {
        let mut sum = Information::NONE;
        rows.iter().for_each(|LinearRow { slopes, left, variance }| sum.add(slopes, *left, *variance));
        sum
    }

    /// Adds one output with its derivatives, its residual and the variance of the residual.
    pub(super) fn add(&mut self, slopes: &Moved, left: f64, variance: f64) {
        self.matrix += *slopes * slopes.transpose() / variance;
        self.vector += *slopes * (left / variance);
    }

    /// Returns the estimate and its covariance if changes about 0 have these variances.
    pub(super) fn with(&self, variances: &Moved) -> UnitEstimate {
        let variances = Matrix::from_diagonal(*variances);
        let covariance = variances * inverse(Matrix::identity() + self.matrix * variances);
        (covariance * self.vector, covariance)
    }
}

impl ArrayPosterior {
    /// Returns the posterior of each unit's change with the spread of the design.
    pub(super) fn of(fit: &Fit<'_>, units: &[Vec<usize>], spread: &DesignSpread) -> Self {
        let own = Matrix::from_diagonal(spread.own.squares());
        let commons = commons(&spread.common.squares());
        let mut posterior =
            ArrayPosterior { moved: vec![Moved::ZERO; units.len()], covariances: vec![own; units.len()] };
        for _ in 0..ROUNDS {
            let rows = units.iter().zip(&posterior.moved).map(|(of, moved)| fit.rows(of, moved, Moved::ZERO));
            let informed: Vec<Information> = rows.map(|rows| Information::of(&rows)).collect();
            posterior = Self::joint(&informed, &own, &commons);
        }
        posterior
    }

    /// Returns the posterior if the change of a unit is the sum of its own change, with variances `own`, and a change that all
    /// units have in common. Each of the variances `commons` is weighted by its marginal likelihood.
    pub(super) fn joint(informed: &[Information], own: &Matrix<4, 4>, commons: &[Matrix<4, 4>]) -> Self {
        // of each unit, with its own change integrated out: its information about the common change
        let kept: Vec<Matrix<4, 4>> =
            informed.iter().map(|of| inverse(Matrix::identity() + of.matrix * *own)).collect();
        let about_common: Matrix<4, 4> = kept.iter().zip(informed).map(|(kept, of)| *kept * of.matrix).sum();
        let toward: Moved = kept.iter().zip(informed).map(|(kept, of)| *kept * of.vector).sum();
        let tried = commons.iter().map(|variances| {
            let shrunk = Matrix::identity() + about_common * *variances;
            let covariance = *variances * inverse(shrunk);
            let evidence = 0.5 * (toward.dot(&(covariance * toward)) - shrunk.determinant().abs().ln());
            (evidence, covariance * toward, covariance)
        });
        let tried: Vec<(f64, Moved, Matrix<4, 4>)> = tried.collect();
        let most = tried.iter().map(|(evidence, ..)| *evidence).fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = tried.iter().map(|(evidence, ..)| (evidence - most).exp()).collect();
        let sum: f64 = weights.iter().sum();
        let weighed = || tried.iter().zip(&weights);
        let common: Moved = weighed().map(|((_, mean, _), weight)| *mean * (weight / sum)).sum();
        let covariance: Matrix<4, 4> = weighed()
            .map(|((_, mean, covariance), weight)| {
                let off = *mean - common;
                (*covariance + off * off.transpose()) * (weight / sum)
            })
            .sum();
        let of_unit = |(kept, of): (&Matrix<4, 4>, &Information)| {
            let shrunk = *own * *kept;
            let share = Matrix::identity() - shrunk * of.matrix;
            let moved = common + shrunk * (of.vector - of.matrix * common);
            (moved, shrunk + share * covariance * share.transpose())
        };
        let (moved, covariances) = kept.iter().zip(informed).map(of_unit).unzip();
        ArrayPosterior { moved, covariances }
    }
}

/// Returns the change of each unit as a full calibration shows it, without a prior.
pub(super) fn informed(map: &AdaptableMap<'_>, sensor: &Calibration, units: &[Vec<usize>]) -> Vec<Moved> {
    let fit = Fit { map, new: sensor, forces_are_known: true };
    let side_mm = map.response.field.area().side_mm();
    let free = Moved::column([1.0, side_mm, side_mm, 1.0]);
    estimates(&fit, units, &free).into_iter().map(|(moved, ..)| moved).collect()
}

/// Returns the change of each unit and its covariance, if changes about 0 have these standard deviations.
pub(super) fn estimates(fit: &Fit<'_>, units: &[Vec<usize>], sd: &Moved) -> Vec<UnitEstimate> {
    let variances = sd.times(*sd);
    let of_unit = |of: &Vec<usize>| {
        let mut found = (Moved::ZERO, Matrix::ZERO);
        for _ in 0..ROUNDS {
            found = Information::of(&fit.rows(of, &found.0, Moved::ZERO)).with(&variances);
            found.0[0] = found.0[0].max(LEAST_GAIN - 1.0);
            found.0[3] = found.0[3].clamp(-MOST_WIDTH, MOST_WIDTH);
        }
        found
    };
    units.iter().map(of_unit).collect()
}

/// Least gain, and largest relative change of a width, in a search. Beyond them the linearised map means nothing.
const LEAST_GAIN: f64 = 0.01;
const MOST_WIDTH: f64 = 0.5;

/// Returns the variances of the common change that are tried.
fn commons(variances: &Moved) -> Vec<Matrix<4, 4>> {
    let times = |gain: f64, place: f64, width: f64| {
        let factors = Moved::column([gain, place, place, width]);
        Matrix::from_diagonal(variances.times(factors.times(factors)))
    };
    let mut tried = Vec::new();
    for gain in COMMON {
        for place in COMMON {
            tried.extend(COMMON.map(|width| times(gain, place, width)));
        }
    }
    tried
}

/// Returns the inverse; of a singular matrix zeros, so that it has no weight.
pub(super) fn inverse(matrix: Matrix<4, 4>) -> Matrix<4, 4> {
    matrix.inverse().unwrap_or(Matrix::ZERO)
}
