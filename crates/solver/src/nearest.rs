//! Predicts a reading from the presses of a calibration that read most alike.

use super::expectation::Prediction;
use super::gaussian_process::places_in_turn;
use super::noise::{Noise, Residual};
use super::surrogate::surrogate;
use super::view::has_several_lengths;
use super::{Calibration, ForceKnown};
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use palpate_core::parallel::in_parallel;

/// The presses of a calibration as readings, without their places and forces. A reading is predicted as the weighted mean of the
/// presses nearest to it. The weights reconstruct it best (locally linear, Roweis and Saul 2000), and sum to 1. If all presses have
/// one load, each is scaled to the reading first.
pub(super) struct NearestPresses {
    units: usize,
    /// Readings, row-major, presses x units, and the place of each.
    rows: Vec<f64>,
    places: Vec<usize>,
    is_scaled: bool,
    /// Typical deviation of each unit, in which distances are measured.
    sd: Vec<f64>,
    /// Deviation of a press from its prediction by presses at other places, and the part of its constant that isn't scaled with a press.
    noise: Noise,
    still: Vec<f64>,
    /// Presses that are predicted by those at other places.
    held: Vec<usize>,
}

/// Number of presses that are averaged.
const NEAREST: usize = 10;
/// Largest number of presses that are searched, and that are held out.
const MOST_PRESSES: usize = 2000;
const MOST_HELD: usize = 100;
/// Assumed deviation at first, as a fraction of a unit's root mean square, and the rounds in which it is replaced by the found one.
const DEVIATION_AT_FIRST: f64 = 0.05;
const ROUNDS: usize = 2;
/// Largest fraction of presses with an output that repeat it because it is one of few that the unit reads.
const AGAIN_MOST: f64 = 0.25;
/// Least deviation, as a fraction of the outputs' root mean square.
const LEAST_DEVIATION: f64 = 1e-6;

/// One of the nearest presses, and the factor that scales it to the reading.
struct Near {
    squares: f64,
    press: usize,
    scale: f64,
}

impl NearestPresses {
    /// Returns the presses of a calibration; `None` if they are too few.
    pub(crate) fn of(calibration: &Calibration, load: ForceKnown) -> Option<Self> {
        let units = calibration.units();
        let spots = calibration.by_place();
        if spots.len() <= NEAREST {
            return None;
        }
        let mut place_of = vec![0; calibration.len()];
        spots.iter().enumerate().for_each(|(place, spot)| spot.iter().for_each(|&press| place_of[press] = place));
        let presses: Vec<usize> = places_in_turn(calibration).into_iter().take(MOST_PRESSES).collect();
        let rows: Vec<f64> = presses.iter().flat_map(|&press| calibration.point(press).outputs).copied().collect();
        let rms = |of: &mut dyn Iterator<Item = &f64>, count: usize| {
            (of.map(|output| output * output).sum::<f64>() / count as f64).sqrt()
        };
        let least = LEAST_DEVIATION * rms(&mut rows.iter(), rows.len());
        let of_unit = |unit: usize| rms(&mut rows.iter().skip(unit).step_by(units), presses.len());
        let sd: Vec<f64> = (0..units).map(|unit| (DEVIATION_AT_FIRST * of_unit(unit)).max(least)).collect();
        let has_loads = calibration.has_several_forces() || has_several_lengths(calibration);
        let is_scaled = load == ForceKnown::Unknown && !has_loads;
        let every = presses.len().div_ceil(MOST_HELD);
        let mut nearest = NearestPresses {
            units,
            rows,
            places: presses.iter().map(|&press| place_of[press]).collect(),
            is_scaled,
            noise: Noise::additive(&sd),
            still: vec![0.0; units],
            sd,
            held: (0..presses.len()).step_by(every).collect(),
        };
        for _ in 0..ROUNDS {
            nearest.learn_noise(least);
        }
        if is_scaled && let Ok(response) = surrogate(calibration) {
            nearest.still = (0..units).map(|unit| response.noise.variance(unit, 0.0)).collect();
        }
        Some(nearest)
    }

    /// Learns how much presses deviate from their predictions.
    fn learn_noise(&mut self, least: f64) {
        let predicted = in_parallel(&self.held, |&press| self.predict_without_place(press, &[]));
        let of_unit = |unit: usize| {
            let residual = |(press, (prediction, leverage)): (&usize, &(Prediction, f64))| Residual {
                predicted: prediction.outputs[unit],
                residual: self.row(*press)[unit] - prediction.outputs[unit],
                leverage: *leverage,
            };
            self.held.iter().zip(&predicted).map(residual).collect()
        };
        let residuals: Vec<Vec<Residual>> = (0..self.units).map(of_unit).collect();
        let noise = Noise::fit(&residuals);
        let typical = |unit: usize| {
            let variances = residuals[unit].iter().map(|residual| noise.variance(unit, residual.predicted));
            (variances.sum::<f64>() / residuals[unit].len() as f64).sqrt().max(least)
        };
        self.sd = (0..self.units).map(typical).collect();
        self.noise = noise;
    }

    /// Whether presses are scaled to a reading.
    pub(crate) fn is_scaled(&self) -> bool {
        self.is_scaled
    }

    /// Root mean square of each output.
    pub(crate) fn sizes(&self) -> Vec<f64> {
        let squares =
            |unit: usize| self.rows.iter().skip(unit).step_by(self.units).map(|output| output * output).sum::<f64>();
        (0..self.units).map(|unit| (squares(unit) / self.places.len() as f64).sqrt()).collect()
    }

    fn row(&self, press: usize) -> &[f64] {
        &self.rows[press * self.units..][..self.units]
    }

    /// Returns the logarithms of the misfits of presses, each predicted by those at other places, without some units.
    pub(crate) fn held_out(&self, without: &[usize]) -> Vec<f64> {
        in_parallel(&self.held, |&press| self.predict_without_place(press, without).0.log_misfit)
    }

    /// Probability that a unit that works reads an output again in another contact that it feels. It isn't 0, because presses are few.
    /// `None` if many presses that read it are repeated by the one that is most alike for the other units, as those of a saturated unit are.
    pub(crate) fn repeats(&self, unit: usize, is_output: impl Fn(f64) -> bool) -> Option<f64> {
        let others: Vec<usize> = (0..self.units).filter(|other| *other != unit).collect();
        let reads = |press: usize| is_output(self.row(press)[unit]);
        let read: Vec<usize> = (0..self.places.len()).filter(|&press| reads(press)).take(MOST_HELD).collect();
        let alike = |press: usize| self.nearest(self.row(press), &others, Some(self.places[press]))[0].press;
        let again = read.iter().filter(|&&press| reads(alike(press))).count();
        (again as f64 <= AGAIN_MOST * read.len() as f64).then(|| (1 + again) as f64 / (2 + read.len()) as f64)
    }

    fn predict_without_place(&self, press: usize, without: &[usize]) -> (Prediction, f64) {
        self.predicted(self.row(press), without, Some(self.places[press]))
    }

    /// Returns what the nearest presses predict of a reading, of which some units don't count.
    pub(crate) fn predict(&self, outputs: &[f64], without: &[usize]) -> Prediction {
        self.predicted(outputs, without, None).0
    }

    /// Returns the prediction, and the sum of the squares of its weights.
    fn predicted(&self, outputs: &[f64], without: &[usize], other_than: Option<usize>) -> (Prediction, f64) {
        let counted: Vec<usize> = (0..self.units).filter(|unit| !without.contains(unit)).collect();
        let nearest = self.nearest(outputs, &counted, other_than);
        let scale = nearest[0].scale;
        // the map's error grows with the scale, the noise of a reading doesn't
        let variance = |unit: usize, output: f64| {
            let constant = self.noise.variance(unit, 0.0);
            let still = self.still[unit].min(constant);
            let moved = if self.is_scaled { still + scale * scale * (constant - still) } else { constant };
            (moved + self.noise.variance(unit, output) - constant).max(f64::MIN_POSITIVE)
        };
        let first = self.row(nearest[0].press);
        let precision: Vec<f64> =
            counted.iter().map(|&unit| 1.0 / variance(unit, scale * first[unit]).sqrt()).collect();
        let off = |near: &Near| -> Vec<f64> {
            let row = self.row(near.press);
            counted.iter().zip(&precision).map(|(&unit, by)| (outputs[unit] - near.scale * row[unit]) * by).collect()
        };
        let off: Vec<Vec<f64>> = nearest.iter().map(off).collect();
        let weights = weights(&off, counted.len() as f64);
        let mean = |unit: usize| {
            nearest.iter().zip(&weights).map(|(near, weight)| weight * near.scale * self.row(near.press)[unit]).sum()
        };
        let predicted: Vec<f64> = (0..self.units).map(mean).collect();
        let leverage: f64 = weights.iter().map(|weight| weight * weight).sum();
        let residual = |(&unit, by): (&usize, &f64)| ((outputs[unit] - predicted[unit]) * by).powi(2);
        let squares: f64 = counted.iter().zip(&precision).map(residual).sum();
        let misfit = squares / (1.0 + leverage) / counted.len() as f64;
        let sd = (0..self.units).map(|unit| (variance(unit, predicted[unit]) * (1.0 + leverage)).sqrt()).collect();
        let quiet_sd = (0..self.units).map(|unit| variance(unit, 0.0).sqrt()).collect();
        let log_misfit = misfit.max(f64::MIN_POSITIVE).ln();
        (Prediction { log_misfit, outputs: predicted, sd, quiet_sd }, leverage)
    }

    /// Returns the presses nearest to a reading in some units, the nearest first.
    fn nearest(&self, outputs: &[f64], counted: &[usize], other_than: Option<usize>) -> Vec<Near> {
        let scaled: Vec<f64> = counted.iter().map(|&unit| outputs[unit] / self.sd[unit]).collect();
        let length: f64 = scaled.iter().map(|value| value * value).sum();
        let presses = (0..self.places.len()).filter(|&press| other_than != Some(self.places[press]));
        let near = |press: usize| {
            let row = self.row(press);
            let (mut along, mut squares) = (0.0, 0.0);
            for (&unit, value) in counted.iter().zip(&scaled) {
                let of_press = row[unit] / self.sd[unit];
                along += of_press * value;
                squares += of_press * of_press;
            }
            match self.is_scaled {
                true => {
                    let scale = if along > 0.0 { along / squares } else { 0.0 };
                    Near { squares: length - along * scale, press, scale }
                }
                false => Near { squares: length - 2.0 * along + squares, press, scale: 1.0 },
            }
        };
        let mut all: Vec<Near> = presses.map(near).collect();
        let by_distance = |a: &Near, b: &Near| a.squares.total_cmp(&b.squares).then(a.press.cmp(&b.press));
        if all.len() > NEAREST {
            all.select_nth_unstable_by(NEAREST - 1, by_distance);
            all.truncate(NEAREST);
        }
        all.sort_by(by_distance);
        all
    }
}

/// Returns the weights of the presses with these deviations from a reading, in units of the noise. The mean of the presses has noise
/// too, so weights aren't larger than the deviations are worth. None is negative: a faulty reading isn't extrapolated to.
fn weights(off: &[Vec<f64>], counted: f64) -> Vec<f64> {
    let product = |i: usize, j: usize| off[i].iter().zip(&off[j]).map(|(a, b)| a * b).sum::<f64>();
    let mut used: Vec<usize> = (0..off.len()).collect();
    loop {
        let ridge = |i: usize, j: usize| if i == j { counted } else { 0.0 };
        let products = Mat::from_fn(used.len(), used.len(), |i, j| product(used[i], used[j]) + ridge(i, j));
        let solved: Vec<f64> = match products.llt(Side::Lower) {
            Ok(factor) => factor.solve(Mat::from_fn(used.len(), 1, |_, _| 1.0)).col(0).iter().copied().collect(),
            Err(_) => vec![1.0; used.len()],
        };
        let (least, weight) = solved.iter().enumerate().fold((0, f64::INFINITY), |(at, least), (i, weight)| {
            if *weight < least { (i, *weight) } else { (at, least) }
        });
        if weight < 0.0 && used.len() > 1 {
            used.remove(least);
            continue;
        }
        let sum: f64 = solved.iter().sum();
        let mut weights = vec![0.0; off.len()];
        used.iter().zip(solved).for_each(|(&press, weight)| weights[press] = weight / sum);
        return weights;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CalibrationPoint;
    use palpate_core::quantity::Place;

    #[test]
    fn a_saturated_output_is_repeated_and_another_one_is_not() {
        const LARGEST: f64 = 10.0;
        let place = |press: usize| Place::new((press % 15) as f64, (press / 15) as f64);
        let outputs = |press: usize| {
            let Place { x_mm, y_mm } = place(press);
            vec![(x_mm + 0.1 * y_mm).min(LARGEST), 14.0 - x_mm + 0.01 * y_mm, y_mm + 0.001 * x_mm, 14.0 - y_mm]
        };
        let rows: Vec<Vec<f64>> = (0..225).map(outputs).collect();
        let point = |(press, outputs)| CalibrationPoint { place: place(press), force_n: 1.0, outputs };
        let points: Vec<_> = rows.iter().map(Vec::as_slice).enumerate().map(point).collect();
        let presses = NearestPresses::of(&Calibration::new(&points).unwrap(), ForceKnown::Unknown).unwrap();
        assert_eq!(presses.repeats(0, |output| output == LARGEST), None);
        assert_eq!(presses.repeats(0, |output| output == 3.25), Some(0.5));
        // two presses far from each other read it
        assert_eq!(presses.repeats(0, |output| output == 3.0), Some(0.25));
    }
}
