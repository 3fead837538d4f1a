//! Prediction of a value at a place from the values at the places around it, and how far such predictions have missed. A prediction
//! counts only where it was tested: at distances from which places that were left out have been predicted.

use palpate_core::algebra::{cholesky, substitute};
use palpate_core::quantity::Place;

/// Number of nearest presses for a prediction.
pub(super) const NEAREST: usize = 12;
/// Number of places from which a prediction counts.
pub const LEARNED: usize = 10;
/// Distance of two presses at the same place, mm: the read-back of a stage that returns to it.
pub(super) const SAME_MM: f64 = 0.02;
/// Number of misses at a distance that test it.
const TESTED: usize = 5;
/// Standard deviation of one press about the smooth field, as a fraction: noise, relaxation, and error of the read-back.
pub(super) const OWN: f64 = 0.02;
/// Weight of the assumed scatter, in presses. The second constant is the number of presses over which misses are remembered, and
/// the third is the largest miss that counts, in sd.
const PRIOR: f64 = 4.0;
const MEMORY: f64 = 100.0;
const MISS_MOST: f64 = 4.0;
/// Least ratio of the misses to the predicted standard deviations. Presses close together say little about those farther apart.
const SCALE_LEAST: f64 = 0.3;
/// Largest ratio with which predictions are compared: beyond it the values change over shorter distances than is assumed.
const SCALE_MOST: f64 = 2.0;
/// Limit of a difference, in sd, and least limit as a fraction. A smaller difference can be the specimen's.
pub(super) const SIGMAS: f64 = 6.0;
const LEAST: f64 = 0.25;
/// The same for a difference from an earlier press at the same place. Sound runs of the campaigns reach 6 %.
const LEAST_AGAIN: f64 = 0.15;
/// The limit for a scatter that few misses have shown: normal quantile with a probability of 1e-6, either way.
const RARE_SIGMAS: f64 = 4.9;

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

/// Size of the misses so far, relative to the sizes that were predicted. Each place adds one miss, predicted from the other places.
#[derive(Clone, Debug)]
pub(super) struct Misses {
    mean_square: f64,
    count: f64,
    /// Largest distances from a predicted place to the nearest other place, mm, in falling order.
    farthest_mm: [f64; TESTED],
}

impl Default for Misses {
    fn default() -> Self {
        Misses { mean_square: 1.0, count: 0.0, farthest_mm: [0.0; TESTED] }
    }
}

impl Misses {
    /// Adds a miss, its predicted standard deviation with the scale of the misses so far, and the distance of the nearest place, mm.
    pub(super) fn learn(&mut self, off: f64, sigma: f64, nearest_mm: f64) {
        self.count += 1.0;
        let square = (self.scale() * off / sigma).powi(2).min(MISS_MOST.powi(2));
        self.mean_square += (square - self.mean_square) / (self.count + PRIOR).min(MEMORY);
        if let Some(at) = self.farthest_mm.iter().position(|known_mm| nearest_mm > *known_mm) {
            self.farthest_mm[at..].rotate_right(1);
            self.farthest_mm[at] = nearest_mm;
        }
    }

    /// Ratio of the misses so far to the predicted standard deviations.
    pub(super) fn scale(&self) -> f64 {
        self.mean_square.sqrt().max(SCALE_LEAST)
    }

    /// Whether enough predictions from places as far away were tested, and were about as good as predicted.
    pub(super) fn have_tested(&self, nearest_mm: f64) -> bool {
        nearest_mm <= self.farthest_mm[TESTED - 1] + SAME_MM && self.scale() <= SCALE_MOST
    }

    /// Largest difference of a sound press, in standard deviations: the quantile of Student's t for the number of misses, in
    /// the approximation of Wallace (1959), but at least the usual limit.
    pub(super) fn sigmas(&self) -> f64 {
        let free = self.count.clamp(1.0, MEMORY);
        let normal = RARE_SIGMAS * (8.0 * free + 3.0) / (8.0 * free + 1.0);
        (free * ((normal * normal / free).exp() - 1.0)).sqrt().max(SIGMAS)
    }
}

/// Largest difference between a value and another one with this standard deviation between them, both as logarithms or as fractions.
pub(super) fn most_off(sigma: f64) -> f64 {
    most_off_by(SIGMAS, sigma)
}

/// The same for a number of standard deviations.
pub(super) fn most_off_by(sigmas: f64, sigma: f64) -> f64 {
    (sigmas * sigma).max(LEAST)
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
            misses.learn(0.2 * misses.scale(), misses.scale(), 1.0);
        }
        assert_eq!(misses.scale(), SCALE_LEAST);
        misses.learn(100.0, 1.0, 1.0);
        assert!(misses.scale() < 0.7, "one miss counts for at most its bound: {}", misses.scale());
    }

    #[test]
    fn few_misses_widen_the_limit_and_only_tested_distances_are_judged() {
        let after = |count: usize, distance_mm: f64, miss: f64| {
            let mut misses = Misses::default();
            (0..count).for_each(|_| misses.learn(miss * misses.scale(), misses.scale(), distance_mm));
            misses
        };
        // quantiles of Student's t, 10 and 40 degrees of freedom, 1 - 4.79e-7
        for (count, exact) in [(10, 10.565), (40, 5.782)] {
            let sigmas = after(count, 1.0, 1.0).sigmas();
            assert!((sigmas / f64::max(exact, SIGMAS) - 1.0).abs() < 0.02, "{count}: {sigmas}");
        }
        assert_eq!(after(1000, 1.0, 1.0).sigmas(), SIGMAS);
        assert!(!after(TESTED - 1, 1.0, 1.0).have_tested(1.0));
        let misses = after(TESTED, 1.0, 1.0);
        assert!(misses.have_tested(1.0 + SAME_MM / 2.0) && !misses.have_tested(1.1));
        assert!(!after(40, 1.0, 3.0).have_tested(1.0), "values that change over shorter distances");
    }
}
