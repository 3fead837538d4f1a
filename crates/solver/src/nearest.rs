//! Predicts a reading from the presses of a calibration that read most alike.

use super::expectation::Prediction;
use super::gaussian_process::places_in_turn;
use super::noise::{Noise, Residual};
use super::view::has_several_lengths;
use super::{Calibration, ForceKnown};
use palpate_core::algebra::{cholesky, substitute};
use std::sync::OnceLock;

/// The presses of a calibration as readings, without their places and forces. A reading is predicted as the weighted mean of the
/// presses nearest to it. The weights reconstruct it best (locally linear, Roweis and Saul 2000), and sum to 1. If all presses have
/// one load, each is scaled to the reading first.
pub(super) struct NearestPresses {
    units: usize,
    /// Readings, row-major, presses x units, and the place of each.
    rows: Vec<f64>,
    places: Vec<usize>,
    /// Readings in typical deviations, units x presses, and the square of each press.
    columns: Vec<f32>,
    squares: Vec<f32>,
    is_scaled: bool,
    /// Typical deviation of each unit, in which distances are measured.
    sd: Vec<f64>,
    /// Deviation of a press from its prediction by presses at other places, and the part of its constant that isn't scaled with a press.
    noise: Noise,
    still: Vec<f64>,
    /// Presses that are predicted by those at other places, each compared with all presses when it is first needed.
    held: Vec<usize>,
    compared: OnceLock<Vec<ComparedReading>>,
}

/// A reading and its products with all presses, from which those without some units follow.
pub(super) struct ComparedReading {
    pub outputs: Vec<f64>,
    /// Outputs in typical deviations, and their square.
    scaled: Vec<f32>,
    square: f32,
    along: Vec<f32>,
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
/// Least part of a square that must remain without some units. With less, a subtraction in single precision leaves mainly rounding errors.
const LEAST_REST: f32 = 1e-5;

/// One of the nearest presses, and the factor that scales it to the reading.
struct Near {
    press: usize,
    scale: f64,
}

impl NearestPresses {
    /// Returns the presses of a calibration; `None` if they are too few. `still` is the variance of each output without a contact; if it is
    /// unknown, the noise isn't scaled with a press.
    pub(crate) fn of(calibration: &Calibration, load: ForceKnown, still: Option<Vec<f64>>) -> Option<Self> {
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
            columns: Vec::new(),
            squares: Vec::new(),
            is_scaled,
            noise: Noise::additive(&sd),
            still: vec![0.0; units],
            sd,
            held: (0..presses.len()).step_by(every).collect(),
            compared: OnceLock::new(),
        };
        for _ in 0..ROUNDS {
            nearest.scale_columns();
            nearest.learn_noise(least);
        }
        nearest.scale_columns();
        if is_scaled && let Some(still) = still.filter(|still| still.len() == units) {
            nearest.still = still;
        }
        Some(nearest)
    }

    /// Learns how much presses deviate from their predictions.
    fn learn_noise(&mut self, least: f64) {
        let predicted: Vec<_> = (0..self.held.len()).map(|held| self.predict_held(held, &[])).collect();
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

    /// Divides all readings by the typical deviations.
    fn scale_columns(&mut self) {
        let (presses, units) = (self.places.len(), self.units);
        self.columns.clear();
        for unit in 0..units {
            let of_unit = self.rows.iter().skip(unit).step_by(units);
            self.columns.extend(of_unit.map(|output| (output / self.sd[unit]) as f32));
        }
        self.squares = vec![0.0; presses];
        for column in self.columns.chunks_exact(presses) {
            self.squares.iter_mut().zip(column).for_each(|(square, output)| *square += output * output);
        }
        self.compared = OnceLock::new();
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

    fn column(&self, unit: usize) -> &[f32] {
        &self.columns[unit * self.places.len()..][..self.places.len()]
    }

    /// Number of presses that are held out.
    pub(crate) fn held_count(&self) -> usize {
        self.held.len()
    }

    /// Returns the logarithms of the misfits of presses, each predicted by those at other places, without some units.
    pub(crate) fn held_out(&self, without: &[usize]) -> Vec<f64> {
        (0..self.held.len()).map(|held| self.predict_held(held, without).0.log_misfit).collect()
    }

    /// Probability that a unit that works reads an output again in another contact that it feels. It isn't 0, because presses are few.
    /// `None` if many presses that read it are repeated by the one that is most alike for the other units, as those of a saturated unit are.
    pub(crate) fn repeats(&self, unit: usize, is_output: impl Fn(f64) -> bool) -> Option<f64> {
        let reads = |press: usize| is_output(self.row(press)[unit]);
        let read: Vec<usize> = (0..self.places.len()).filter(|&press| reads(press)).take(MOST_HELD).collect();
        let alike = |press: usize| {
            let compared = self.compare(self.row(press).to_vec());
            self.nearest(&compared, &[unit], Some(self.places[press])).first().map(|near| near.press)
        };
        let again = read.iter().filter(|&&press| alike(press).is_some_and(reads)).count();
        (again as f64 <= AGAIN_MOST * read.len() as f64).then(|| (1 + again) as f64 / (2 + read.len()) as f64)
    }

    fn predict_held(&self, held: usize, without: &[usize]) -> (Prediction, f64) {
        let compared = self
            .compared
            .get_or_init(|| self.held.iter().map(|&press| self.compare(self.row(press).to_vec())).collect());
        self.predicted(&compared[held], without, Some(self.places[self.held[held]]))
    }

    /// Compares a reading with all presses.
    pub(crate) fn compare(&self, outputs: Vec<f64>) -> ComparedReading {
        let scaled: Vec<f32> = outputs.iter().zip(&self.sd).map(|(output, sd)| (output / sd) as f32).collect();
        let along = self.products(&scaled, &[]);
        let square = scaled.iter().map(|output| output * output).sum();
        ComparedReading { outputs, scaled, square, along }
    }

    /// Returns the products of a reading with all presses, without some units.
    fn products(&self, scaled: &[f32], without: &[usize]) -> Vec<f32> {
        let mut along = vec![0.0; self.places.len()];
        for (unit, &value) in scaled.iter().enumerate().filter(|(unit, _)| !without.contains(unit)) {
            along.iter_mut().zip(self.column(unit)).for_each(|(sum, output)| *sum += value * output);
        }
        along
    }

    /// Returns what the nearest presses predict of a reading, of which some units don't count.
    pub(crate) fn predict(&self, reading: &ComparedReading, without: &[usize]) -> Prediction {
        self.predicted(reading, without, None).0
    }

    /// Returns the prediction, and the sum of the squares of its weights.
    fn predicted(&self, reading: &ComparedReading, without: &[usize], other_than: Option<usize>) -> (Prediction, f64) {
        let outputs = &reading.outputs;
        let counted: Vec<usize> = (0..self.units).filter(|unit| !without.contains(unit)).collect();
        let nearest = self.nearest(reading, without, other_than);
        let scale = nearest.first().map_or(0.0, |near| near.scale);
        // the map's error grows with the scale, the noise of a reading doesn't
        let variance = |unit: usize, output: f64| {
            let constant = self.noise.variance(unit, 0.0);
            let still = self.still[unit].min(constant);
            let moved = if self.is_scaled { still + scale * scale * (constant - still) } else { constant };
            (moved + self.noise.variance(unit, output) - constant).max(f64::MIN_POSITIVE)
        };
        let first = nearest.first().map_or(outputs.as_slice(), |near| self.row(near.press));
        let precision: Vec<f64> =
            counted.iter().map(|&unit| 1.0 / variance(unit, scale * first[unit]).sqrt()).collect();
        let mut off = Vec::with_capacity(NEAREST * counted.len());
        for near in &nearest {
            let row = self.row(near.press);
            off.extend(counted.iter().zip(&precision).map(|(&unit, by)| (outputs[unit] - near.scale * row[unit]) * by));
        }
        let weights = weights(&off, counted.len());
        let mut predicted = vec![0.0; self.units];
        for (near, weight) in nearest.iter().zip(weights) {
            let factor = weight * near.scale;
            predicted.iter_mut().zip(self.row(near.press)).for_each(|(sum, output)| *sum += factor * output);
        }
        let leverage: f64 = weights.iter().map(|weight| weight * weight).sum();
        let residual = |(&unit, by): (&usize, &f64)| ((outputs[unit] - predicted[unit]) * by).powi(2);
        let squares: f64 = counted.iter().zip(&precision).map(residual).sum();
        let misfit = squares / (1.0 + leverage) / counted.len() as f64;
        let sd = (0..self.units).map(|unit| (variance(unit, predicted[unit]) * (1.0 + leverage)).sqrt()).collect();
        let quiet_sd = (0..self.units).map(|unit| variance(unit, 0.0).sqrt()).collect();
        let log_misfit = misfit.max(f64::MIN_POSITIVE).ln();
        (Prediction { log_misfit, outputs: predicted, sd, quiet_sd }, leverage)
    }

    /// Returns the presses nearest to a reading without some units, the nearest first.
    fn nearest(&self, reading: &ComparedReading, without: &[usize], other_than: Option<usize>) -> Vec<Near> {
        let (mut along, mut squares) = (reading.along.clone(), self.squares.clone());
        for &unit in without {
            let value = reading.scaled[unit];
            for ((along, square), output) in along.iter_mut().zip(&mut squares).zip(self.column(unit)) {
                *along -= value * output;
                *square -= output * output;
            }
        }
        let rest = reading.scaled.iter().enumerate().filter(|(unit, _)| !without.contains(unit));
        let square: f32 = rest.map(|(_, output)| output * output).sum();
        if square < LEAST_REST * reading.square {
            along = self.products(&reading.scaled, without);
        }
        // a press of which hardly anything is left is like no reading
        let scale = |along: f32, rest: f32, square: f32| {
            if rest > LEAST_REST * square { along.max(0.0) / rest } else { 0.0 }
        };
        let all = along.iter().zip(&squares).zip(&self.squares);
        let scales: Vec<f32> = match self.is_scaled {
            true => all.map(|((along, rest), square)| scale(*along, *rest, *square)).collect(),
            false => vec![1.0; along.len()],
        };
        let terms = scales.iter().zip(&along).zip(&squares);
        let distances: Vec<f32> =
            terms.map(|((scale, along), rest)| square - scale * (2.0 * along - scale * rest)).collect();
        let (mut found, mut most): (Vec<(f32, usize)>, f32) = (Vec::with_capacity(NEAREST + 1), f32::INFINITY);
        for (press, &distance) in distances.iter().enumerate() {
            if distance < most && other_than != Some(self.places[press]) {
                found.insert(found.partition_point(|(other, _)| *other <= distance), (distance, press));
                found.truncate(NEAREST);
                if let [.., (last, _)] = found[..]
                    && found.len() == NEAREST
                {
                    most = last;
                }
            }
        }
        found.into_iter().map(|(_, press)| Near { press, scale: f64::from(scales[press]) }).collect()
    }
}

/// Returns the weights of the presses with these deviations from a reading (row-major, presses x units), in units of the noise. The
/// mean of the presses has noise too, so weights aren't larger than the deviations are worth. None is negative: a faulty reading isn't
/// extrapolated to.
fn weights(off: &[f64], units: usize) -> [f64; NEAREST] {
    let mut products = [[0.0; NEAREST]; NEAREST];
    let rows: Vec<&[f64]> = off.chunks_exact(units.max(1)).collect();
    for (i, one) in rows.iter().enumerate() {
        for (j, other) in rows[..=i].iter().enumerate() {
            products[i][j] = one.iter().zip(*other).map(|(a, b)| a * b).sum();
        }
        products[i][i] += units as f64;
    }
    let mut is_used: [bool; NEAREST] = std::array::from_fn(|i| i < rows.len());
    loop {
        // a press that isn't used is replaced by an equation of its own
        let of_used = |i: usize, j: usize| match is_used[i] && is_used[j] {
            true => products[i][j],
            false => f64::from(u8::from(i == j)),
        };
        let right = is_used.map(|is_used| f64::from(u8::from(is_used)));
        let system: [[f64; NEAREST]; NEAREST] =
            std::array::from_fn(|i| std::array::from_fn(|j| if j <= i { of_used(i, j) } else { 0.0 }));
        let solved = cholesky(&system).map_or(right, |factor| substitute(&factor, right));
        let used = (0..NEAREST).filter(|&i| is_used[i]);
        let least = used.clone().min_by(|&i, &j| solved[i].total_cmp(&solved[j]));
        match least {
            Some(least) if solved[least] < 0.0 && used.count() > 1 => is_used[least] = false,
            _ => {
                let sum: f64 = solved.iter().sum();
                return solved.map(|weight| weight / sum);
            }
        }
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
        let presses = NearestPresses::of(&Calibration::new(&points).unwrap(), ForceKnown::Unknown, None).unwrap();
        assert_eq!(presses.repeats(0, |output| output == LARGEST), None);
        assert_eq!(presses.repeats(0, |output| output == 3.25), Some(0.5));
        // two presses far from each other read it
        assert_eq!(presses.repeats(0, |output| output == 3.0), Some(0.25));
    }
}
