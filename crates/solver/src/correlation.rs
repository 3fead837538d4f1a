//! Correlation of outputs at two places.

use faer::Mat;
use pulp::Arch;
use serde::{Deserialize, Serialize};

/// Similarity of the outputs at two places.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Correlation {
    smoothness: Smoothness,
    /// Length of the correlation, in the places' unit.
    length: f64,
}

/// Smoothness of the outputs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Smoothness {
    /// Continuous: Matérn 1/2.
    Rough,
    /// Once differentiable: Matérn 3/2.
    Even,
    /// Twice differentiable: Matérn 5/2.
    Smooth,
    /// Infinitely differentiable.
    Gaussian,
}

impl Smoothness {
    /// All smoothnesses; the one that fits most skins is first.
    pub(crate) const ALL: [Self; 4] = [Smoothness::Smooth, Smoothness::Gaussian, Smoothness::Even, Smoothness::Rough];

    /// Smoothnesses with a slope, which a map needs to be inverted.
    pub(crate) const WITH_SLOPES: [Self; 3] = [Smoothness::Smooth, Smoothness::Gaussian, Smoothness::Even];
}

impl Correlation {
    pub(crate) fn at(&self, apart: f64) -> f64 {
        let mut value = [apart];
        self.replace(&mut value);
        value[0]
    }

    /// Replaces distances by their correlations.
    #[inline(always)]
    fn replace(&self, distances: &mut [f64]) {
        // one loop for each, so that several values are computed at once
        #[inline(always)]
        fn each(distances: &mut [f64], per_distance: f64, of: impl Fn(f64) -> f64) {
            distances.iter_mut().for_each(|value| *value = of(per_distance * *value));
        }
        let per_distance = 1.0 / self.length;
        match self.smoothness {
            Smoothness::Rough => each(distances, per_distance, |r| exp_of_negative(-r)),
            Smoothness::Even => each(distances, 3f64.sqrt() * per_distance, |r| (1.0 + r) * exp_of_negative(-r)),
            Smoothness::Smooth => {
                each(distances, 5f64.sqrt() * per_distance, |r| (1.0 + r + r * r / 3.0) * exp_of_negative(-r));
            }
            Smoothness::Gaussian => each(distances, per_distance, |r| exp_of_negative(-0.5 * r * r)),
        }
    }

    /// Returns the smoothness as a number, and the length.
    pub(crate) fn numbers(&self) -> [f64; 2] {
        let smoothness = Smoothness::ALL.iter().position(|smoothness| *smoothness == self.smoothness);
        [smoothness.unwrap_or_default() as f64, self.length]
    }

    /// Returns the correlation with these [numbers](Self::numbers); `None` if there is none.
    pub(crate) fn of_numbers([smoothness, length]: [f64; 2]) -> Option<Self> {
        let smoothness = *Smoothness::ALL.get(smoothness as usize)?;
        (length > 0.0).then_some(Correlation { smoothness, length })
    }

    /// Returns the correlation for each distance in a matrix.
    pub(crate) fn of_all(&self, distances: Mat<f64>) -> Mat<f64> {
        self.of_columns(distances, |_| 0)
    }

    /// Returns the correlation for each distance below the diagonal of a square matrix, and on the diagonal.
    pub(crate) fn of_lower(&self, distances: Mat<f64>) -> Mat<f64> {
        self.of_columns(distances, |column| column)
    }

    /// Replaces the distances of each column from its `first` row on.
    fn of_columns(&self, mut distances: Mat<f64>, first: impl Fn(usize) -> usize) -> Mat<f64> {
        let arch = Arch::new();
        for column in 0..distances.ncols() {
            let distances = &mut distances.col_as_slice_mut(column)[first(column)..];
            arch.dispatch(
                #[inline(always)]
                || self.replace(distances),
            );
        }
        distances
    }

    /// Returns the distance over which outputs look smooth, in the places' unit.
    pub(crate) fn grain(&self) -> f64 {
        match self.smoothness {
            Smoothness::Gaussian => self.length,
            _ => 0.5 * self.length,
        }
    }

    /// Adds the predictions of known places (row-major, places x dimensions) to the outputs at a place. Each known place adds its
    /// covariance with the place times its weights (row-major, places x outputs). Returns the distance to the nearest known
    /// place.
    pub(crate) fn add_weighted(&self, place: &[f64], known: &[f64], weights: &[f64], outputs: &mut [f64]) -> f64 {
        let mut nearest = f64::INFINITY;
        for (known, weights) in known.chunks_exact(place.len()).zip(weights.chunks_exact(outputs.len())) {
            let apart = distance(place, known);
            nearest = nearest.min(apart);
            let covariance = self.at(apart);
            outputs.iter_mut().zip(weights).for_each(|(output, weight)| *output += covariance * weight);
        }
        nearest
    }
}

/// Returns `e^x` for an `x` of at most 0, within two units of the last place, and at least `e^-708`. It has no branch, so several
/// values are computed at once, and no call into the system's library, so they are the same on every machine.
#[inline(always)]
fn exp_of_negative(x: f64) -> f64 {
    /// A sum with this number is rounded to an integer, which its last bits contain.
    const ROUND: f64 = 1.5 * (1_u64 << 52) as f64;
    /// The natural logarithm of 2 in two parts. The first has zeros at its end, so its product with an integer is exact.
    const LN_2: [f64; 2] = [f64::from_bits(0x3fe6_2e42_fee0_0000), f64::from_bits(0x3dea_39ef_3579_3c76)];
    /// Inverses of the factorials from 13 to 0: the series of Taylor.
    const TERMS: [f64; 14] = {
        let (mut terms, mut factorial, mut n) = ([1.0; 14], 1.0, 1);
        while n < 14 {
            factorial *= n as f64;
            terms[13 - n] = 1.0 / factorial;
            n += 1;
        }
        terms
    };
    let x = x.max(-708.0);
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let power = shifted - ROUND;
    let rest = (x - power * LN_2[0]) - power * LN_2[1];
    let sum = TERMS.into_iter().fold(0.0, |sum, term| sum * rest + term);
    sum * f64::from_bits((shifted.to_bits() << 52).wrapping_add(1.0f64.to_bits()))
}

/// Number of lengths that are tried for each smoothness, evenly spaced on a logarithmic scale from the spacing of the places to
/// [`LONGEST`].
const LENGTHS: usize = 6;

/// Longest length that is tried, as a multiple of the places' extent.
const LONGEST: f64 = 4.0;

/// Number of times that the step between lengths is halved around the best length.
const HALVINGS: usize = 3;

/// Returns the correlation with the largest likelihood, and this likelihood, for places with these distances [apart](distances).
pub(super) fn likeliest(
    apart: &Mat<f64>,
    smoothnesses: &[Smoothness],
    likelihood: impl Fn(Correlation) -> f64,
) -> (Correlation, f64) {
    let count = apart.nrows();
    let apart = |i: usize, j: usize| apart[(i.max(j), i.min(j))];
    let extent = (0..count).map(|i| apart(0, i)).fold(0.0, f64::max);
    if extent == 0.0 {
        // one place only: any length will do
        return (Correlation { smoothness: Smoothness::Smooth, length: 1.0 }, 0.0);
    }
    let others = |i: usize| (0..count).filter(move |&j| j != i);
    let nearest = |i: usize| others(i).map(|j| apart(i, j)).filter(|apart| *apart > 0.0).fold(extent, f64::min);
    let spacing = (0..count).map(nearest).fold(extent, f64::min).max(extent / 1000.0);
    let (least, most) = (spacing.ln(), (LONGEST * extent).ln());
    let scored = |smoothness: Smoothness, log_length: f64| {
        let correlation = Correlation { smoothness, length: log_length.exp() };
        (correlation, likelihood(correlation))
    };
    let better = |a: (Correlation, f64), b: (Correlation, f64)| if b.1 > a.1 { b } else { a };
    let best_of = |smoothness: Smoothness| {
        let mut step = (most - least) / (LENGTHS - 1) as f64;
        let first = scored(smoothness, least);
        let mut best = (1..LENGTHS).map(|i| scored(smoothness, least + step * i as f64)).fold(first, better);
        for _ in 0..HALVINGS {
            step *= 0.5;
            let middle = best.0.length.ln();
            for log_length in [middle - step, middle + step] {
                best = better(best, scored(smoothness, log_length));
            }
        }
        best
    };
    let none = (Correlation { smoothness: Smoothness::Smooth, length: 1.0 }, f64::NEG_INFINITY);
    smoothnesses.iter().map(|&smoothness| best_of(smoothness)).fold(none, better)
}

/// Returns up to `count` rows that are far apart. The first row comes first; each further row is the farthest from all rows
/// before it.
pub(super) fn farthest_apart(places: &[f64], dimensions: usize, count: usize) -> Vec<usize> {
    let rows: Vec<&[f64]> = places.chunks_exact(dimensions).collect();
    if rows.len() <= count {
        return (0..rows.len()).collect();
    }
    let mut apart = vec![f64::INFINITY; rows.len()];
    let mut chosen = Vec::with_capacity(count);
    let mut next = 0;
    while chosen.len() < count {
        chosen.push(next);
        for (apart, row) in apart.iter_mut().zip(&rows) {
            *apart = apart.min(distance(row, rows[next]));
        }
        next = (0..rows.len()).max_by(|&a, &b| apart[a].total_cmp(&apart[b]).then(b.cmp(&a))).unwrap_or(0);
    }
    chosen
}

/// Returns the distances between all places (row-major, places x dimensions) as the lower triangle.
pub(super) fn distances(places: &[f64], dimensions: usize) -> Mat<f64> {
    let rows: Vec<&[f64]> = places.chunks_exact(dimensions).collect();
    Mat::from_fn(rows.len(), rows.len(), |i, j| if i > j { distance(rows[i], rows[j]) } else { 0.0 })
}

/// The distance between two places.
pub(super) fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_that_of_the_library_within_two_units_of_the_last_place() {
        for step in 0..=70_800 {
            let x = -0.01 * f64::from(step) - 1e-7 * f64::from(step % 97);
            let (found, library) = (exp_of_negative(x), x.max(-708.0).exp());
            assert!((found / library - 1.0).abs() <= 2.0 * f64::EPSILON, "{x}: {found}, by the library {library}");
        }
        assert_eq!(exp_of_negative(0.0), 1.0);
        assert!(exp_of_negative(f64::NEG_INFINITY) < 1e-300);
    }

    #[test]
    fn value_is_the_same_alone_and_in_a_batch() {
        let distances = Mat::from_fn(37, 3, |i, j| 0.17 * i as f64 + 0.05 * j as f64);
        for smoothness in Smoothness::ALL {
            let correlation = Correlation { smoothness, length: 1.3 };
            let all = correlation.of_all(distances.clone());
            for (i, j) in (0..37).flat_map(|i| (0..3).map(move |j| (i, j))) {
                assert_eq!(all[(i, j)], correlation.at(distances[(i, j)]), "{smoothness:?}");
            }
        }
    }
}
