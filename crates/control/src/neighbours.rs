//! Prediction of a value at a place from the values at the places around it, and how far such predictions have missed.

use palpate_core::algebra::{cholesky, substitute};
use palpate_core::quantity::Place;

/// Number of nearest presses for a prediction.
pub(super) const NEAREST: usize = 12;
/// Number of presses from which a prediction counts.
pub const LEARNED: usize = 10;
/// Standard deviation of one press about the smooth field, as a fraction: noise, relaxation, and error of the read-back.
const OWN: f64 = 0.02;
/// Weight of the assumed scatter, in presses. The second constant is the number of presses over which misses are remembered, and
/// the third is the largest miss that counts, in sd.
const PRIOR: f64 = 4.0;
const MEMORY: f64 = 100.0;
const MISS_MOST: f64 = 4.0;
/// Least ratio of the misses to the predicted standard deviations. Presses close together say little about those farther apart.
const SCALE_LEAST: f64 = 0.3;
/// Limit of a difference, in sd, and least limit as a fraction. A smaller difference can be the specimen's.
const SIGMAS: f64 = 6.0;
const LEAST: f64 = 0.25;
/// The same for a difference from an earlier press at the same place. Sound runs of the campaigns reach 6 %.
const LEAST_AGAIN: f64 = 0.15;

/// Smoothness of a field of values over a specimen.
#[derive(Clone, Copy, Debug)]
pub(super) struct FieldSmoothness {
    /// Distance over which the values change, mm.
    pub length_mm: f64,
    /// Standard deviation of the values over the whole specimen.
    pub spread: f64,
}

/// Weights of the values around, and standard deviation of the prediction before anything was learned of its misses.
#[derive(Clone, Debug)]
pub(super) struct NeighbourWeights {
    pub each: Vec<f64>,
    pub sigma: f64,
}

/// Size of the misses so far, relative to the sizes that were predicted.
#[derive(Clone, Debug)]
pub(super) struct Misses {
    mean_square: f64,
    count: f64,
}

impl Default for Misses {
    fn default() -> Self {
        Misses { mean_square: 1.0, count: 0.0 }
    }
}

impl Misses {
    /// Adds a miss, and its predicted standard deviation with the scale of the misses so far.
    pub(super) fn learn(&mut self, off: f64, sigma: f64) {
        self.count += 1.0;
        let square = (self.scale() * off / sigma).powi(2).min(MISS_MOST.powi(2));
        self.mean_square += (square - self.mean_square) / (self.count + PRIOR).min(MEMORY);
    }

    /// Ratio of the misses so far to the predicted standard deviations.
    pub(super) fn scale(&self) -> f64 {
        self.mean_square.sqrt().max(SCALE_LEAST)
    }
}

/// Largest difference between a value and its prediction with this standard deviation, both as logarithms or as fractions.
pub(super) fn most_off(sigma: f64) -> f64 {
    (SIGMAS * sigma).max(LEAST)
}

/// Largest difference between two values at the same place, both as logarithms or as fractions.
pub(super) fn most_changed(sigma: f64) -> f64 {
    (SIGMAS * sigma).max(LEAST_AGAIN)
}

/// Indices of the nearest places, nearest first.
pub(super) fn nearest(places: impl Iterator<Item = Place>, to: Place) -> Vec<usize> {
    let mut near: Vec<(f64, usize)> = places.enumerate().map(|(i, at)| (at.distance_mm(to), i)).collect();
    let by_distance = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if near.len() > NEAREST {
        near.select_nth_unstable_by(NEAREST - 1, by_distance);
        near.truncate(NEAREST);
    }
    near.sort_by(by_distance);
    near.into_iter().map(|(_, i)| i).collect()
}

/// Adds a value. If there is no room for more than `most` values, it replaces the value at the nearest place.
pub(super) fn remember<T>(all: &mut Vec<T>, value: T, most: usize, place: impl Fn(&T) -> Place) {
    if all.len() < most {
        all.push(value);
        return;
    }
    let distance_mm = |known: &T| place(known).distance_mm(place(&value));
    let nearest = (0..all.len()).min_by(|a, b| distance_mm(&all[*a]).total_cmp(&distance_mm(&all[*b])));
    if let Some(nearest) = nearest {
        all[nearest] = value;
    }
}

/// Returns the weights of ordinary kriging: the value at `to` is expected to be the weighted sum of the values at `places`. Values
/// apart by the field's length are alike by `exp(-1/2)`. Each place has an additional scatter of its own, in `own`. There are at
/// most [`NEAREST`] places.
pub(super) fn weights(places: &[Place], own: &[f64], to: Place, field: FieldSmoothness) -> Option<NeighbourWeights> {
    let alike = |distance_mm: f64| (-0.5 * (distance_mm / field.length_mm).powi(2)).exp();
    let noise = |own: f64| (own.hypot(OWN) / field.spread).powi(2);
    // a row without a place is that of a value unlike all others, so its weight is 0
    let mut covariance: [[f64; NEAREST]; NEAREST] =
        std::array::from_fn(|row| std::array::from_fn(|column| if row == column { 1.0 } else { 0.0 }));
    let (mut near, mut ones) = ([0.0; NEAREST], [0.0; NEAREST]);
    for (row, place) in places.iter().enumerate() {
        for (column, other) in places[..=row].iter().enumerate() {
            covariance[row][column] = alike(place.distance_mm(*other));
        }
        covariance[row][row] += noise(own[row]);
        (near[row], ones[row]) = (alike(place.distance_mm(to)), 1.0);
    }
    let solved = cholesky(&covariance)?;
    let (simple, of_mean) = (substitute(&solved, near), substitute(&solved, ones));
    let sum = |values: &[f64]| values.iter().sum::<f64>();
    // the mean is unknown: the weights sum to one
    let missing = (1.0 - sum(&simple)) / sum(&of_mean);
    let alone: f64 = near.iter().zip(&simple).map(|(near, weight)| near * weight).sum();
    let variance = 1.0 - alone + missing.powi(2) * sum(&of_mean);
    let each = simple.iter().zip(&of_mean).take(places.len()).map(|(simple, of_mean)| simple + missing * of_mean);
    let sigma = field.spread * variance.max(0.0).sqrt();
    Some(NeighbourWeights { each: each.collect(), sigma: sigma.hypot(OWN) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places() -> Vec<Place> {
        (0..16).map(|i| Place::new(0.5 * f64::from(i % 4), 0.5 * f64::from(i / 4))).collect()
    }

    #[test]
    fn a_smooth_field_is_predicted_and_its_error_grows_with_the_distance() {
        let value = |place: Place| 0.3 * (place.x_mm / 3.0).sin() + 0.1 * place.y_mm;
        let predict = |to: Place| {
            let near: Vec<Place> = nearest(places().into_iter(), to).into_iter().map(|i| places()[i]).collect();
            let weights =
                weights(&near, &[0.0; NEAREST], to, FieldSmoothness { length_mm: 3.0, spread: 0.25 }).unwrap();
            let sum: f64 = near.iter().zip(&weights.each).map(|(place, weight)| weight * value(*place)).sum();
            (sum - value(to), weights.sigma)
        };
        let (within, beside, far) =
            (predict(Place::new(0.8, 0.7)), predict(Place::new(2.0, 0.7)), predict(Place::new(9.0, 0.7)));
        assert!(within.0.abs() < 0.005 && within.1 < 0.03, "{within:?}");
        assert!(beside.0.abs() < 0.02 && beside.1 < 0.05, "{beside:?}");
        assert!(far.1 > 0.25, "{far:?}");
    }

    #[test]
    fn misses_scale_the_predicted_error() {
        let mut misses = Misses::default();
        for _ in 0..200 {
            misses.learn(0.2 * misses.scale(), misses.scale());
        }
        assert_eq!(misses.scale(), SCALE_LEAST);
        misses.learn(100.0, 1.0);
        assert!(misses.scale() < 0.7, "one miss counts for at most its bound: {}", misses.scale());
    }
}
