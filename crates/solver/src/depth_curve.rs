//! How strongly an array answers to the depth of a press: the curve that turns a solved intensity into a depth.
//!
//! Outputs grow linearly with force, but not with depth. A press at a place p and a depth d has the outputs g(d) h(p), so the
//! logarithm of their length is log g(d) + log H(p). H is unknown and smooth. This is a partially linear model (Robinson 1988,
//! Econometrica 56, 931): the part that the place explains is removed from the lengths and from the depths by the same local
//! fit, and what is left shows g.

use palpate_core::algebra::{Matrix, Vector};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Monotone curve from the depth of a press, mm, to its intensity. Intensities are positive and have no unit; the root mean square
/// of those of the calibration presses is 1. Between its knots the logarithm of the intensity is linear in the logarithm of the
/// depth. Beyond them the last slope continues.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthCurve {
    /// Natural logarithms of the depths, mm, of the knots, ascending; the first and the last are those of the presses.
    log_depths: Vec<f64>,
    /// Natural logarithms of the intensities of the knots, ascending.
    log_intensities: Vec<f64>,
}

/// One press of which the place, the depth and the length of the outputs are known.
#[derive(Clone, Copy, Debug)]
pub(super) struct DepthPress {
    pub place: Place,
    /// Depth, mm; positive.
    pub depth_mm: f64,
    /// Length of the row of outputs; at least 0.
    pub length: f64,
}

/// Least ratio of the largest to the smallest depth from which the curve can be learned.
pub const SEVERAL_DEPTHS: f64 = 1.5;
/// Least part of the variance of the log-depths that the places don't explain.
const LEAST_SHARE: f64 = 0.01;
/// Bounds of the exponent of the curve, everywhere. Outputs that hardly grow with the depth don't show it.
const SLOPES: [f64; 2] = [0.05, 10.0];
/// Number of presses around a place from which the part of the place is fitted.
const NEAREST: usize = 12;
/// Largest number of presses from which the curve is learned.
const MOST_PRESSES: usize = 2000;
/// Number of presses that each part of a free curve requires, and its largest number of parts.
const PRESSES_A_PART: usize = 15;
const MOST_PARTS: usize = 8;
/// Weight of the exponent of the power law in each part of a free curve, in presses.
const PRIOR_PRESSES: f64 = 1.0;
/// Number of parts of the presses that are held out in turn to compare both curves.
const FOLDS: usize = 5;
/// Largest ratio of the held-out variances of a free curve and of the power law, and number of standard errors of their difference,
/// from which the free curve is used.
const CLEARLY_LESS: f64 = 0.97;
const CLEAR_SIGMAS: f64 = 2.0;
/// Largest solved depth, as a multiple of the largest depth of a press. It keeps every depth finite.
const DEEPEST: f64 = 1000.0;
/// Number of rounds in which the weights of the presses are learned from their residuals.
const ROUNDS: usize = 3;
/// Number of rounds over all slopes; they then have converged.
const SLOPE_ROUNDS: usize = 100;
/// Median of the square of a normal variable of variance 1; and the number of standard deviations from which residuals count less.
const MEDIAN_OF_SQUARES: f64 = 0.455;
const HUBER_SIGMAS: f64 = 2.5;
/// What is added to the weights' squares for each slope of a local fit.
const RIDGE: f64 = 0.01;

impl DepthCurve {
    /// Learns the curve; `None` if the depths hardly differ, or if the place of a press determines its depth.
    pub(super) fn fit(presses: &[DepthPress]) -> Option<Self> {
        let range = |presses: &[DepthPress]| {
            let depths = presses.iter().map(|press| press.depth_mm);
            depths.fold((f64::INFINITY, 0.0f64), |(least, most), mm| (least.min(mm), most.max(mm)))
        };
        let all = range(presses);
        let felt: Vec<DepthPress> = presses.iter().filter(|press| press.length > 0.0).copied().collect();
        let (least_mm, most_mm) = range(&felt);
        if most_mm.is_nan() || most_mm < SEVERAL_DEPTHS * least_mm || felt.len() < 3 {
            return None;
        }
        let share = MOST_PRESSES as f64 / felt.len() as f64;
        let felt: Vec<DepthPress> = (0..felt.len()).filter(|&i| scattered(i) < share).map(|i| felt[i]).collect();
        let local: Vec<LocalFit> = (0..felt.len()).map(|press| LocalFit::of(&felt, press)).collect();
        let log_depths: Vec<f64> = felt.iter().map(|press| press.depth_mm.ln()).collect();
        let log_lengths: Vec<f64> = felt.iter().map(|press| press.length.ln()).collect();
        let own = |values: &[f64]| -> Vec<f64> { local.iter().map(|fit| fit.residual(values)).collect() };
        let (lengths, depths) = (own(&log_lengths), own(&log_depths));
        if variance(&depths) < LEAST_SHARE * variance(&log_depths) {
            return None;
        }
        let of_parts = |knots: &[f64]| -> Vec<Vec<f64>> {
            let part =
                |ends: &[f64]| -> Vec<f64> { log_depths.iter().map(|log| log.clamp(ends[0], ends[1])).collect() };
            knots.windows(2).map(|ends| own(&part(ends))).collect()
        };
        let ends = [all.0.ln(), all.1.ln()];
        let mut rows = Rows { parts: vec![depths], lengths, weights: vec![1.0; felt.len()] };
        let mut power = rows.slopes(|_| true, 1.0)[0];
        for _ in 0..ROUNDS {
            rows.weights = weights(&felt, &rows.residuals(&[power]));
            power = rows.slopes(|_| true, power)[0];
        }
        let knots = knots(&log_depths, ends);
        let (mut slopes, mut at) = (vec![power], ends.to_vec());
        if knots.len() > 2 {
            let free = Rows { parts: of_parts(&knots), ..rows.clone() };
            if free.is_clearly_better_than(&rows, power) {
                (slopes, at) = (free.slopes(|_| true, power), knots);
            }
        }
        Some(DepthCurve::through(at, &slopes).normalised(presses))
    }

    /// Returns the curve with these slopes between the knots.
    fn through(log_depths: Vec<f64>, slopes: &[f64]) -> Self {
        let mut log_intensities = vec![0.0];
        for (ends, slope) in log_depths.windows(2).zip(slopes) {
            log_intensities.push(log_intensities.last().copied().unwrap_or(0.0) + slope * (ends[1] - ends[0]));
        }
        DepthCurve { log_depths, log_intensities }
    }

    /// Returns the curve with which the root mean square of the presses' intensities is 1.
    fn normalised(mut self, presses: &[DepthPress]) -> Self {
        let squares: f64 = presses.iter().map(|press| self.intensity(press.depth_mm).powi(2)).sum();
        let log_rms = 0.5 * (squares / presses.len() as f64).ln();
        self.log_intensities.iter_mut().for_each(|log| *log -= log_rms);
        self
    }

    /// Whether a curve that was read from bytes is one that can be evaluated.
    pub(super) fn is_sound(&self) -> bool {
        let rises = |logs: &[f64]| {
            logs.len() >= 2 && logs.iter().all(|log| log.is_finite()) && logs.windows(2).all(|pair| pair[0] < pair[1])
        };
        self.log_depths.len() == self.log_intensities.len() && rises(&self.log_depths) && rises(&self.log_intensities)
    }

    /// Returns the intensity of a press at a depth, mm. It is positive for a positive depth, and 0 for others.
    pub fn intensity(&self, depth_mm: f64) -> f64 {
        if depth_mm > 0.0 { extended(&self.log_depths, &self.log_intensities, depth_mm.ln()).exp() } else { 0.0 }
    }

    /// Returns the depth, mm, of a press with an intensity. Noise can make a solved intensity negative; the depth is then that of the
    /// opposite intensity, negative too. It is always finite.
    pub fn depth_mm(&self, intensity: f64) -> f64 {
        let [_, most_mm] = self.range_mm();
        let log = extended(&self.log_intensities, &self.log_depths, intensity.abs().ln());
        // without an intensity the logarithm has no bound, and no depth is left
        log.min((DEEPEST * most_mm).ln()).exp().copysign(intensity)
    }

    /// Returns half of the range of depths, mm, of the intensities within a distance of this one. It is always finite.
    pub fn half_width_mm(&self, intensity: f64, half_width: f64) -> f64 {
        0.5 * (self.depth_mm(intensity + half_width) - self.depth_mm(intensity - half_width))
    }

    /// Returns the smallest and the largest depth of the presses, mm.
    pub fn range_mm(&self) -> [f64; 2] {
        let at = |log: Option<&f64>| log.copied().unwrap_or_default().exp();
        [at(self.log_depths.first()), at(self.log_depths.last())]
    }
}

/// Returns the value of a polyline with ascending knots. The first and the last slope continue.
fn extended(from: &[f64], to: &[f64], at: f64) -> f64 {
    let part = from.partition_point(|knot| *knot <= at).clamp(1, from.len() - 1);
    let slope = (to[part] - to[part - 1]) / (from[part] - from[part - 1]);
    to[part] + slope * (at - from[part])
}

/// Returns a number in 0..1 for each index. Successive indices are spread evenly, with the period of no grid and of no staircase.
fn scattered(index: usize) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    (index as f64 * GOLDEN).fract()
}

fn variance(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64
}

/// Returns the ends of the parts of a free curve: quantiles of the depths, all different.
fn knots(log_depths: &[f64], ends: [f64; 2]) -> Vec<f64> {
    let mut sorted = log_depths.to_vec();
    sorted.sort_by(f64::total_cmp);
    let parts = (sorted.len() / PRESSES_A_PART).clamp(1, MOST_PARTS);
    let mut knots = vec![ends[0]];
    // knots closer than this have too few depths between them
    let least = 0.02 * (ends[1] - ends[0]);
    for inner in (1..parts).map(|part| sorted[part * sorted.len() / parts]) {
        if inner > knots[knots.len() - 1] + least && inner < ends[1] - least {
            knots.push(inner);
        }
    }
    knots.push(ends[1]);
    knots
}

/// Returns the weight of each press: the inverse of the variance of its log-length, relative to the least. The variance is a constant
/// part, and a part of additive noise, which grows as the square of 1 / length; the faintest fifth of the presses shows it against
/// the loudest half. Residuals far beyond it count less (Huber 1964).
fn weights(presses: &[DepthPress], residuals: &[f64]) -> Vec<f64> {
    let faint = |press: usize| presses[press].length.powi(-2);
    let mut order: Vec<usize> = (0..presses.len()).collect();
    order.sort_by(|a, b| presses[*a].length.total_cmp(&presses[*b].length));
    let typical = |of: &[usize]| {
        let middle = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let squares = of.iter().map(|press| residuals[*press].powi(2)).collect();
        [middle(of.iter().map(|press| faint(*press)).collect()), middle(squares) / MEDIAN_OF_SQUARES]
    };
    let (low, high) = (typical(&order[..presses.len().div_ceil(5)]), typical(&order[presses.len() / 2..]));
    let additive = ((low[1] - high[1]) / (low[0] - high[0])).max(0.0); // without a difference of lengths it is NaN, then 0
    let constant = (high[1] - additive * high[0]).max(0.0);
    let variances: Vec<f64> = (0..presses.len()).map(|press| constant + additive * faint(press)).collect();
    let least = variances.iter().copied().fold(f64::INFINITY, f64::min);
    if least <= 0.0 || !least.is_finite() {
        return vec![1.0; presses.len()];
    }
    let of = |(variance, residual): (&f64, &f64)| {
        least / variance * (HUBER_SIGMAS * variance.sqrt() / residual.abs()).min(1.0)
    };
    variances.iter().zip(residuals).map(of).collect()
}

/// Weights with which the values of the nearest presses predict that of a press: a line through them, without the press itself.
struct LocalFit {
    press: usize,
    others: Vec<(usize, f64)>,
}

impl LocalFit {
    fn of(presses: &[DepthPress], press: usize) -> Self {
        let place = presses[press].place;
        let square_mm2 = |other: &Place| (other.x_mm - place.x_mm).powi(2) + (other.y_mm - place.y_mm).powi(2);
        let others = presses.iter().enumerate().filter(|(other, _)| *other != press);
        let mut others: Vec<(usize, f64)> = others.map(|(other, at)| (other, square_mm2(&at.place))).collect();
        let count = NEAREST.min(others.len());
        // ties by the index, so that the order of equal distances doesn't depend on the sort
        others.select_nth_unstable_by(count - 1, |a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        others.truncate(count);
        others.sort_by_key(|(other, _)| *other);
        let reach_mm = others.iter().map(|(_, mm2)| *mm2).fold(0.0, f64::max).sqrt().max(f64::MIN_POSITIVE);
        // presses at the place count most, the farthest a quarter
        let row = |(other, mm2): &(usize, f64)| {
            let at = presses[*other].place;
            let terms = [1.0, (at.x_mm - place.x_mm) / reach_mm, (at.y_mm - place.y_mm) / reach_mm];
            (Vector::<3>::column(terms), 1.0 - 0.75 * mm2.sqrt() / reach_mm)
        };
        let rows: Vec<(Vector<3>, f64)> = others.iter().map(row).collect();
        let outer = |(terms, weight): &(Vector<3>, f64)| {
            let [a, b, c] = terms.values();
            Matrix::of([a, b, c].map(|value| [a, b, c].map(|other| weight * value * other)))
        };
        // the slopes are held near 0 where the presses don't show them: all at one place or on a line
        let ridge = Matrix::from_diagonal(Vector::column([0.0, RIDGE, RIDGE]));
        let normal = rows.iter().map(outer).sum::<Matrix<3, 3>>() + ridge;
        let first = normal.solve(Vector::column([1.0, 0.0, 0.0])).unwrap_or(Vector::ZERO);
        let others = others.iter().zip(&rows).map(|((other, _), (terms, weight))| (*other, weight * terms.dot(&first)));
        LocalFit { press, others: others.collect() }
    }

    /// Returns the value of the press minus what the presses around it predict.
    fn residual(&self, values: &[f64]) -> f64 {
        values[self.press] - self.others.iter().map(|(other, weight)| weight * values[*other]).sum::<f64>()
    }
}

/// Log-lengths and parts of the log-depths, without what the places explain.
#[derive(Clone)]
struct Rows {
    /// For each part of the curve its regressor, one value for each press.
    parts: Vec<Vec<f64>>,
    lengths: Vec<f64>,
    weights: Vec<f64>,
}

impl Rows {
    /// Returns the slope of each part by weighted least squares within [`SLOPES`], from the presses that are used. Each slope is
    /// drawn to `typical` as by a few presses. One slope after the other is optimised; the problem is convex.
    fn slopes(&self, is_used: impl Fn(usize) -> bool, typical: f64) -> Vec<f64> {
        let used: Vec<usize> = (0..self.lengths.len()).filter(|press| is_used(*press)).collect();
        let dot =
            |a: &[f64], b: &[f64]| used.iter().map(|&press| self.weights[press] * a[press] * b[press]).sum::<f64>();
        let products: Vec<Vec<f64>> =
            self.parts.iter().map(|a| self.parts.iter().map(|b| dot(a, b)).collect()).collect();
        let right: Vec<f64> = self.parts.iter().map(|part| dot(part, &self.lengths)).collect();
        let mut slopes = vec![typical; self.parts.len()];
        let is_several = self.parts.len() > 1;
        for _ in 0..if is_several { SLOPE_ROUNDS } else { 1 } {
            for part in 0..slopes.len() {
                let others: f64 =
                    (0..slopes.len()).filter(|other| *other != part).map(|o| products[part][o] * slopes[o]).sum();
                let prior = if is_several { PRIOR_PRESSES * products[part][part] / used.len() as f64 } else { 0.0 };
                let slope = (right[part] - others + prior * typical) / (products[part][part] + prior);
                slopes[part] = if slope.is_finite() { slope.clamp(SLOPES[0], SLOPES[1]) } else { typical };
            }
        }
        slopes
    }

    /// Returns what these slopes don't explain, for each press.
    fn residuals(&self, slopes: &[f64]) -> Vec<f64> {
        let explained =
            |press: usize| self.parts.iter().zip(slopes).map(|(part, slope)| slope * part[press]).sum::<f64>();
        self.lengths.iter().enumerate().map(|(press, length)| length - explained(press)).collect()
    }

    /// Returns the weighted square of each press's residual, by slopes that are fitted without its fold.
    fn held_out(&self, typical: f64) -> Vec<f64> {
        let fold = |press: usize| (scattered(press) * FOLDS as f64) as usize;
        let mut squares = vec![0.0; self.lengths.len()];
        for held in 0..FOLDS {
            let residuals = self.residuals(&self.slopes(|press| fold(press) != held, typical));
            for press in (0..squares.len()).filter(|press| fold(*press) == held) {
                squares[press] = self.weights[press] * residuals[press].powi(2);
            }
        }
        squares
    }

    /// Whether these parts explain held-out presses clearly better than a power law.
    fn is_clearly_better_than(&self, power: &Rows, typical: f64) -> bool {
        let (own, other) = (self.held_out(typical), power.held_out(typical));
        let gains: Vec<f64> = other.iter().zip(&own).map(|(other, own)| other - own).collect();
        let sum = |values: &[f64]| values.iter().sum::<f64>();
        let standard_error = (gains.len() as f64 * variance(&gains)).sqrt();
        sum(&own) <= CLEARLY_LESS * sum(&other) && sum(&gains) >= CLEAR_SIGMAS * standard_error
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Presses on a grid of 12 x 12 places, of random depths up to 1 mm, with a length of `g` and of the place, and 2 % of noise.
    fn presses(g: impl Fn(f64) -> f64, depths: [f64; 2]) -> Vec<DepthPress> {
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let press = |i: usize| {
            let place = Place::new((i % 12) as f64, (i / 12) as f64);
            let depth_mm = depths[0] + (depths[1] - depths[0]) * random();
            let of_place = 3.0 + (0.4 * place.x_mm).sin() + 0.1 * place.y_mm;
            DepthPress { place, depth_mm, length: of_place * g(depth_mm) * (1.0 + 0.04 * (random() - 0.5)) }
        };
        (0..144).map(press).collect()
    }

    /// Largest relative deviation of the curve's ratios from those of `g`.
    fn off(curve: &DepthCurve, g: impl Fn(f64) -> f64) -> f64 {
        let ratio = |depth_mm: f64| (curve.intensity(depth_mm) / g(depth_mm)).ln();
        (2..=10).map(|i| (ratio(0.1 * f64::from(i)) - ratio(0.6)).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_power_law_is_found_whatever_the_places() {
        for power in [0.6, 1.0, 1.5, 2.2] {
            let curve = DepthCurve::fit(&presses(|mm| mm.powf(power), [0.1, 1.0])).unwrap();
            assert_eq!(curve.log_depths.len(), 2, "{power}");
            assert!(off(&curve, |mm| mm.powf(power)) < 0.03, "{power}: {curve:?}");
        }
    }

    #[test]
    fn another_monotone_curve_is_found_by_its_parts() {
        // a skin that stiffens, and an array that saturates
        let curves: [fn(f64) -> f64; 2] = [|mm| mm + 4.0 * mm.powi(4), |mm| 1.0 - (-4.0 * mm).exp()];
        for g in curves {
            let curve = DepthCurve::fit(&presses(g, [0.1, 1.0])).unwrap();
            assert!(curve.log_depths.len() > 2 && off(&curve, g) < 0.08, "{}: {curve:?}", off(&curve, g));
        }
    }

    #[test]
    fn one_depth_shows_no_curve() {
        assert_eq!(DepthCurve::fit(&presses(|mm| mm, [0.8, 1.0])), None);
        let alike = presses(|mm| mm, [0.1, 1.0]).into_iter().map(|press| DepthPress { length: 0.0, ..press });
        assert_eq!(DepthCurve::fit(&alike.collect::<Vec<_>>()), None);
        // the place determines the depth
        let sloped = presses(|mm| mm, [0.1, 1.0]).into_iter();
        let sloped = sloped.map(|press| DepthPress { depth_mm: (0.2 * press.place.x_mm - 2.0).exp(), ..press });
        assert_eq!(DepthCurve::fit(&sloped.collect::<Vec<_>>()), None);
    }

    #[test]
    fn the_inverse_returns_the_depth_and_is_always_finite() {
        let all = presses(|mm| mm + 4.0 * mm.powi(4), [0.1, 1.0]);
        let curve = DepthCurve::fit(&all).unwrap();
        for depth_mm in [0.01, 0.1, 0.35, 0.999, 1.0, 4.0] {
            let again = curve.depth_mm(curve.intensity(depth_mm));
            assert!((again - depth_mm).abs() < 1e-12 * depth_mm.max(1.0), "{depth_mm}: {again}");
            assert_eq!(curve.depth_mm(-curve.intensity(depth_mm)), -again);
        }
        for intensity in [0.0, -0.0, 1e-300, -1e300, f64::MAX, f64::MIN] {
            assert!(curve.depth_mm(intensity).is_finite() && curve.half_width_mm(intensity, 1e300).is_finite());
        }
        assert_eq!(curve.depth_mm(0.0), 0.0);
        let mean_square = all.iter().map(|press| curve.intensity(press.depth_mm).powi(2)).sum::<f64>() / 144.0;
        assert!((mean_square - 1.0).abs() < 1e-12, "{mean_square}");
    }

    #[test]
    fn presses_near_their_noise_count_little() {
        let mut state = 11u64;
        let mut noisy = presses(|mm| mm.powf(1.5), [0.01, 1.0]);
        for press in &mut noisy {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            press.length = press.length.hypot(0.2 * (state >> 11) as f64 / (1u64 << 53) as f64);
        }
        let curve = DepthCurve::fit(&noisy).unwrap();
        assert!(off(&curve, |mm| mm.powf(1.5)) < 0.1, "{curve:?}");
    }
}
