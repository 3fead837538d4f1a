//! Correlation of outputs at two places.

use faer::Mat;
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
        let lengths = apart / self.length;
        match self.smoothness {
            Smoothness::Rough => (-lengths).exp(),
            Smoothness::Even => {
                let r = 3f64.sqrt() * lengths;
                (1.0 + r) * (-r).exp()
            }
            Smoothness::Smooth => {
                let r = 5f64.sqrt() * lengths;
                (1.0 + r + r * r / 3.0) * (-r).exp()
            }
            Smoothness::Gaussian => (-0.5 * lengths * lengths).exp(),
        }
    }

    /// Returns the correlation for each distance below the diagonal of a matrix, and on the diagonal.
    pub(crate) fn of_lower(&self, apart: &Mat<f64>) -> Mat<f64> {
        Mat::from_fn(apart.nrows(), apart.ncols(), |i, j| if i >= j { self.at(apart[(i, j)]) } else { 0.0 })
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
