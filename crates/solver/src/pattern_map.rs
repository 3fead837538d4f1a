//! A smooth map of the pattern, inverted with correlated errors of all units.

use super::correlation::Smoothness;
use super::field::{CalibratedArea, SplineField};
use super::hyperparameters::{Hyperparameters, Regression};
use super::kriging::Kriging;
use super::spots::coordinates;
use super::view::has_several_lengths;
use super::{Calibration, FitError, ForceKnown, Locate, LocatedContact, SolveError, Workspace};
use faer::{Mat, MatRef, Side};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Map of the contact's pattern, from place to place, and the common deviations of held-out presses from it. A drift, another
/// depth or the map's own error affects several units together, so a deviation of this kind then has little weight. The solution
/// is the place with the smallest deviation of the reading in this measure (Mahalanobis 1936).
///
/// The pattern is the reading divided by its length; under a constant load, it is the reading itself. If the calibration has
/// readings of several lengths at one place, the pattern also changes linearly with the logarithm of the length.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct PatternMap {
    load: ForceKnown,
    /// Whitened pattern of a reading of typical length. It is followed by its change with the logarithm of the length, if it
    /// changes.
    field: SplineField,
    /// Logarithm of the length: typical, smallest and largest.
    log_lengths: [f64; 3],
    /// Matrix that whitens a deviation: row-major, units x units, one row for each whitened coordinate.
    whitening: Vec<f64>,
    /// Start places, and the whitened pattern at each, row-major.
    starts: Vec<Place>,
    patterns: Vec<f64>,
    /// Logarithm of the force that reads with length 1, as a function of place.
    log_force: SplineField,
    /// Exponent of the force as a function of the length.
    power: f64,
    /// Force of the calibration if the load is constant, N.
    force_n: f64,
}

const MANNER: Regression = Regression { about_mean: true, most_to_seek_with: 144, of: &Smoothness::WITH_SLOPES };

/// Number of cells of the pattern's table in the distance over which the pattern is smooth.
const CELLS_A_GRAIN: f64 = 6.0;

/// Number of places along each side of the area at which the search may start.
const STARTS_A_SIDE: usize = 25;

/// Number of these places at which the search does start.
const TRIED_STARTS: usize = 3;

/// Least spread of the lengths at a place (standard deviation of their logarithm) that shows how the pattern changes with the
/// length.
const LEAST_SPREAD: f64 = 0.1;

/// Least number of places that must show this change.
const FEWEST_SLOPES: usize = 9;

/// Largest number of steps from a start.
const MOST_STEPS: usize = 12;

/// Length of the last step: the search ends after a shorter step. Fraction of the area's longer side.
const LAST_STEP: f64 = 1e-6;

/// Longest step, as a fraction of the same side.
const LONGEST_STEP: f64 = 0.1;

/// Least variance of a whitened unit, as a fraction of the mean over all units.
const LEAST_VARIANCE: f64 = 1e-9;

/// Most likely correlations of a pattern map.
#[derive(Default)]
pub(super) struct Correlations {
    pattern: Option<Hyperparameters>,
    slopes: Option<Hyperparameters>,
    log_force: Option<Hyperparameters>,
}

impl PatternMap {
    /// Fits the map, with the correlations of a larger calibration if they are known. Returns the correlations to which the map
    /// was fitted.
    pub(crate) fn fit(
        calibration: &Calibration,
        load: ForceKnown,
        known: &Correlations,
    ) -> Result<(Self, Correlations), FitError> {
        let units = calibration.units();
        let mut presses = GroupedPresses::of(calibration, load);
        let places = presses.places();
        let area = CalibratedArea::around(places.iter().copied()).ok_or(FitError::NothingToTellApart)?;
        let log_lengths = presses.log_lengths();
        let has_slopes = load == ForceKnown::Unknown && has_several_lengths(calibration);
        let slopes = if has_slopes { presses.take_slopes(units, log_lengths[0], &known.slopes) } else { None };
        let (slopes, of_slopes) = slopes.unzip();
        let means = presses.means(units);
        let (kriging, of_pattern) = kriging(&places, &means, units, &known.pattern);
        let residuals = presses.held_out(&means, &kriging.held_out().residuals, units);
        let whitening = whitening(&residuals, units, places.len());
        let matrix = MatRef::from_row_major_slice(&whitening, units, units);
        let whitened = |kriging: &Kriging, places: &[Place]| {
            let patterns = kriging.predict_all(&coordinates(places.iter().copied()));
            MatRef::from_row_major_slice(&patterns, places.len(), units) * matrix.transpose()
        };
        let sample = |places: &[Place]| {
            let patterns: Vec<Mat<f64>> =
                std::iter::once(&kriging).chain(&slopes).map(|kriging| whitened(kriging, places)).collect();
            let row = |i: usize| patterns.iter().flat_map(move |of| (0..units).map(move |unit| of[(i, unit)]));
            (0..places.len()).flat_map(row).collect()
        };
        let grain = slopes.iter().map(Kriging::grain).fold(kriging.grain(), f64::min);
        let channels = if slopes.is_some() { 2 * units } else { units };
        let field = SplineField::new(area, grain / CELLS_A_GRAIN, channels, sample);
        let starts = area.grid(STARTS_A_SIDE);
        let mut patterns = vec![0.0; starts.len() * channels];
        for (place, pattern) in starts.iter().zip(patterns.chunks_exact_mut(channels)) {
            field.value(*place, pattern);
        }
        let power = if calibration.has_several_forces() { presses.power() } else { 1.0 };
        let (forces, of_force) = self::kriging(&places, &presses.log_forces(power), 1, &known.log_force);
        let sample = |places: &[Place]| forces.predict_all(&coordinates(places.iter().copied()));
        let log_force = SplineField::new(area, forces.grain() / CELLS_A_GRAIN, 1, sample);
        let force_n = calibration.typical_force_n();
        let correlations = Correlations { pattern: Some(of_pattern), slopes: of_slopes, log_force: Some(of_force) };
        let map = PatternMap { load, field, log_lengths, whitening, starts, patterns, log_force, power, force_n };
        Ok((map, correlations))
    }

    /// Returns the best fit to the whitened reading near a place: the place, the sum of squares, and the standard error in the
    /// measure of the calibration's deviations. `longer` is the logarithm of the ratio of the reading's length to the typical
    /// length.
    fn descend(&self, start: Place, longer: f64, workspace: &mut Workspace) -> (Place, f64, f64) {
        let Workspace { pattern: reading, buffers, .. } = workspace;
        let area = self.field.area();
        let (mut place, mut best) = (start, None);
        let mut step = (0.0, 0.0);
        for _ in 0..MOST_STEPS {
            self.field.value_and_gradient(place, &mut buffers.value, &mut buffers.along_x, &mut buffers.along_y);
            let (mut xx, mut xy, mut yy, mut x, mut y, mut squares) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
            let units = reading.len();
            let of = |buffer: &[f64], unit: usize| {
                buffer[unit] + buffer.get(units + unit).map_or(0.0, |slope| longer * slope)
            };
            for (unit, reading) in reading.iter().enumerate() {
                let (along_x, along_y) = (of(&buffers.along_x, unit), of(&buffers.along_y, unit));
                let residual = reading - of(&buffers.value, unit);
                xx += along_x * along_x;
                xy += along_x * along_y;
                yy += along_y * along_y;
                x += along_x * residual;
                y += along_y * residual;
                squares += residual * residual;
            }
            // a line of places shows nothing across it
            let least = 1e-9 * (xx + yy) + f64::MIN_POSITIVE;
            (xx, yy) = (xx + least, yy + least);
            let determinant = (xx * yy - xy * xy).max(f64::MIN_POSITIVE);
            let scale_mm = (0.5 * (xx + yy) / determinant).sqrt();
            match best {
                Some((_, least, _)) if squares >= least => step = (0.25 * step.0, 0.25 * step.1),
                _ => {
                    best = Some((place, squares, scale_mm));
                    step = ((yy * x - xy * y) / determinant, (xx * y - xy * x) / determinant);
                }
            }
            let longest = LONGEST_STEP * area.side_mm();
            let length = step.0.hypot(step.1);
            let share = if length > longest { longest / length } else { 1.0 };
            let from = best.map_or(place, |best| best.0);
            place = area.clamp(Place::new(from.x_mm + share * step.0, from.y_mm + share * step.1));
            if place.distance_mm(from) <= LAST_STEP * area.side_mm() {
                break;
            }
        }
        best.unwrap_or((place, f64::INFINITY, f64::INFINITY))
    }
}

impl Locate for PatternMap {
    fn name(&self) -> &'static str {
        "pattern-map"
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<LocatedContact, SolveError> {
        let length = length(outputs);
        if length == 0.0 {
            return Err(SolveError::AllEqual);
        }
        let units = outputs.len();
        let scale = scale(self.load, length);
        workspace.buffers.resize(self.field.channels());
        let [typical, least, most] = self.log_lengths;
        let longer = length.ln().clamp(least, most) - typical;
        workspace.pattern.clear();
        let whitened = |row: &[f64]| row.iter().zip(outputs).map(|(w, output)| w * output * scale).sum::<f64>();
        workspace.pattern.extend(self.whitening.chunks_exact(units).map(whitened));

        let mut nearest = [(f64::INFINITY, 0); TRIED_STARTS];
        for (index, pattern) in self.patterns.chunks_exact(self.field.channels()).enumerate() {
            let (pattern, slopes) = pattern.split_at(units);
            let deviations = pattern.iter().zip(&workspace.pattern).map(|(pattern, reading)| reading - pattern);
            let squares: f64 = match slopes.is_empty() {
                true => deviations.map(|deviation| deviation * deviation).sum(),
                false => deviations.zip(slopes).map(|(deviation, slope)| (deviation - longer * slope).powi(2)).sum(),
            };
            if squares < nearest[TRIED_STARTS - 1].0 {
                nearest[TRIED_STARTS - 1] = (squares, index);
                nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
            }
        }
        let found = nearest.iter().filter(|start| start.0.is_finite());
        let found = found.map(|&(_, start)| self.descend(self.starts[start], longer, workspace));
        let (place, residue, scale_mm) = found.min_by(|a, b| a.1.total_cmp(&b.1)).ok_or(SolveError::OutOfProportion)?;
        let mut log_force = [0.0];
        self.log_force.value(place, &mut log_force);
        let force_n = self.load.force_n(self.force_n, log_force[0] + self.power * length.ln())?;
        Ok(LocatedContact { place, force_n, residue, scale_mm, ..LocatedContact::PLAIN })
    }
}

/// Regresses values on places, with a known correlation or the most likely one.
fn kriging(
    places: &[Place],
    values: &[f64],
    outputs: usize,
    known: &Option<Hyperparameters>,
) -> (Kriging, Hyperparameters) {
    let places = coordinates(places.iter().copied());
    let hyperparameters = known.clone().unwrap_or_else(|| Hyperparameters::of(&places, 2, values, outputs, MANNER));
    (Kriging::fit_with(&places, 2, values, outputs, MANNER, &hyperparameters), hyperparameters)
}

/// Presses grouped by place.
struct GroupedPresses {
    spots: Vec<PatternSpot>,
}

struct PatternSpot {
    place: Place,
    /// Pattern, logarithm of the length and logarithm of the force of each press.
    presses: Vec<(Vec<f64>, f64, f64)>,
}

impl GroupedPresses {
    /// Returns the presses without those that no unit felt.
    fn of(calibration: &Calibration, load: ForceKnown) -> Self {
        let press = |&index: &usize| {
            let point = calibration.point(index);
            let length = length(point.outputs);
            let scale = scale(load, length);
            let pattern = point.outputs.iter().map(|output| output * scale).collect();
            (length > 0.0).then(|| (pattern, length.ln(), point.force_n.ln()))
        };
        let spots = super::spots::by_spread_place(calibration).into_iter().map(|presses| PatternSpot {
            place: calibration.point(presses[0]).place,
            presses: presses.iter().filter_map(press).collect(),
        });
        GroupedPresses { spots: spots.filter(|spot| !spot.presses.is_empty()).collect() }
    }

    fn places(&self) -> Vec<Place> {
        self.spots.iter().map(|spot| spot.place).collect()
    }

    /// Logarithms of the lengths of all presses: mean, least and largest.
    fn log_lengths(&self) -> [f64; 3] {
        let all = || self.spots.iter().flat_map(|spot| &spot.presses).map(|press| press.1);
        let mean = all().sum::<f64>() / all().count().max(1) as f64;
        [mean, all().fold(mean, f64::min), all().fold(mean, f64::max)]
    }

    /// Determines the change of the pattern with the logarithm of the length, from place to place, and subtracts it from each
    /// press. The rest is the pattern at the typical length.
    fn take_slopes(
        &mut self,
        units: usize,
        typical: f64,
        known: &Option<Hyperparameters>,
    ) -> Option<(Kriging, Hyperparameters)> {
        let (mut places, mut slopes) = (Vec::new(), Vec::new());
        for PatternSpot { place, presses } in &self.spots {
            let count = presses.len() as f64;
            let mean = presses.iter().map(|press| press.1).sum::<f64>() / count;
            let squares: f64 = presses.iter().map(|press| (press.1 - mean).powi(2)).sum();
            if squares > count * LEAST_SPREAD * LEAST_SPREAD {
                places.push(*place);
                let slope =
                    |unit: usize| presses.iter().map(|press| (press.1 - mean) * press.0[unit]).sum::<f64>() / squares;
                slopes.extend((0..units).map(slope));
            }
        }
        if places.len() < FEWEST_SLOPES {
            return None;
        }
        let (kriging, hyperparameters) = kriging(&places, &slopes, units, known);
        let mut slope = vec![0.0; units];
        for PatternSpot { place, presses } in &mut self.spots {
            kriging.predict(&[place.x_mm, place.y_mm], &mut slope);
            for (pattern, log_length, _) in presses {
                pattern.iter_mut().zip(&slope).for_each(|(value, slope)| *value -= (*log_length - typical) * slope);
            }
        }
        Some((kriging, hyperparameters))
    }

    /// Returns the mean pattern at each place, row-major places x units.
    fn means(&self, units: usize) -> Vec<f64> {
        let mean = |spot: &PatternSpot, unit: usize| {
            spot.presses.iter().map(|press| press.0[unit]).sum::<f64>() / spot.presses.len() as f64
        };
        self.spots.iter().flat_map(|spot| (0..units).map(move |unit| mean(spot, unit))).collect()
    }

    /// Returns each press' pattern minus the prediction of a map made without its place, row-major presses x units. `residuals`
    /// is the same difference for the places' means.
    fn held_out(&self, means: &[f64], residuals: &[f64], units: usize) -> Vec<f64> {
        let rows = residuals.chunks_exact(units).zip(means.chunks_exact(units));
        let of_spot = |(spot, (residuals, mean)): (&'_ PatternSpot, (&'_ [f64], &'_ [f64]))| -> Vec<f64> {
            let off = |pattern: &[f64], unit: usize| pattern[unit] - mean[unit] + residuals[unit];
            spot.presses.iter().flat_map(|(pattern, ..)| (0..units).map(|unit| off(pattern, unit))).collect()
        };
        self.spots.iter().zip(rows).flat_map(of_spot).collect()
    }

    /// Exponent with which the force grows with the reading's length, from presses that share their place.
    fn power(&self) -> f64 {
        let (mut squares, mut products) = (0.0, 0.0);
        for PatternSpot { presses, .. } in &self.spots {
            let count = presses.len() as f64;
            let length = presses.iter().map(|press| press.1).sum::<f64>() / count;
            let force = presses.iter().map(|press| press.2).sum::<f64>() / count;
            squares += presses.iter().map(|press| (press.1 - length).powi(2)).sum::<f64>();
            products += presses.iter().map(|press| (press.1 - length) * (press.2 - force)).sum::<f64>();
        }
        let power = products / squares;
        if power.is_finite() && power > 0.0 { power } else { 1.0 }
    }

    /// Logarithm of the force that would give a reading of length 1 at each place.
    fn log_forces(&self, power: f64) -> Vec<f64> {
        let of = |spot: &PatternSpot| {
            let sum: f64 = spot.presses.iter().map(|(_, length, force)| force - power * length).sum();
            sum / spot.presses.len() as f64
        };
        self.spots.iter().map(of).collect()
    }
}

/// Returns the matrix that makes deviations (row-major, presses x units) uncorrelated with variance 1. It is the inverse of the
/// Cholesky factor of their covariance.
///
/// The correlations are shrunk towards 0 according to their own errors (Schäfer and Strimmer 2005, equation 10). The shrinking
/// assumes one press for each place, because presses at one place share the map's error there.
fn whitening(deviations: &[f64], units: usize, places: usize) -> Vec<f64> {
    let presses = deviations.len() / units;
    let deviations = MatRef::from_row_major_slice(deviations, presses, units);
    let variance = |unit: usize| (0..presses).map(|i| deviations[(i, unit)].powi(2)).sum::<f64>() / presses as f64;
    let variances: Vec<f64> = (0..units).map(variance).collect();
    let least = (LEAST_VARIANCE * variances.iter().sum::<f64>() / units as f64).max(f64::MIN_POSITIVE);
    let sd: Vec<f64> = variances.iter().map(|variance| variance.max(least).sqrt()).collect();
    let scaled = Mat::from_fn(presses, units, |i, unit| deviations[(i, unit)] / sd[unit]);
    let squared = Mat::from_fn(presses, units, |i, unit| scaled[(i, unit)].powi(2));
    let correlation = scaled.transpose() * &scaled;
    let fourth = squared.transpose() * &squared;
    let (mut errors, mut squares) = (0.0, 0.0);
    for i in 0..units {
        for j in (0..units).filter(|&j| j != i) {
            let r = correlation[(i, j)] / presses as f64;
            errors += (fourth[(i, j)] / presses as f64 - r * r).max(0.0) / places as f64;
            squares += r * r;
        }
    }
    let kept = if squares > 0.0 { (1.0 - errors / squares).clamp(0.0, 1.0 - LEAST_SHRINKING) } else { 0.0 };
    let shrunk = Mat::from_fn(units, units, |i, j| match i == j {
        true => 1.0,
        false => kept * correlation[(i, j)] / presses as f64,
    });
    let mut whitening = vec![0.0; units * units];
    match shrunk.llt(Side::Lower) {
        Ok(factor) => {
            let factor = factor.L();
            for column in 0..units {
                for row in column..units {
                    let known: f64 = (column..row).map(|k| factor[(row, k)] * whitening[k * units + column]).sum();
                    whitening[row * units + column] = (f64::from(row == column) - known) / factor[(row, row)];
                }
            }
        }
        Err(_) => (0..units).for_each(|unit| whitening[unit * units + unit] = 1.0),
    }
    for row in whitening.chunks_exact_mut(units) {
        row.iter_mut().zip(&sd).for_each(|(value, sd)| *value /= sd);
    }
    whitening
}

/// Least shrinking of the correlations. It is needed because patterns of length 1 don't fill their space.
const LEAST_SHRINKING: f64 = 1e-3;

/// Factor that gives a reading's pattern.
fn scale(load: ForceKnown, length: f64) -> f64 {
    match load {
        ForceKnown::Unknown => 1.0 / length,
        ForceKnown::Constant => 1.0,
    }
}

fn length(outputs: &[f64]) -> f64 {
    outputs.iter().map(|output| output * output).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::method::FittedMethod;
    use crate::{CalibrationPoint, ForceRule, Pearson};
    use rand::distr::Distribution;
    use rand_distr::StandardNormal;

    /// Four units that see where it is pressed, and all of them something else as well that has nothing to do with it.
    fn outputs(place: Place, nuisance: f64) -> [f64; 4] {
        let Place { x_mm, y_mm } = place;
        let of_place = [1.0 + 0.1 * x_mm, 1.0 - 0.1 * x_mm, 1.0 + 0.1 * y_mm, 1.0 - 0.1 * y_mm];
        std::array::from_fn(|unit| of_place[unit] + 0.2 * nuisance * [1.0, 1.0, -1.0, -1.0][unit])
    }

    fn rows(random: bool) -> Vec<(Place, [f64; 4])> {
        let mut rng = palpate_core::quantity::stream(5, 0, "nuisance");
        let mut row = |i: u32| {
            let place = Place::new(f64::from(i % 9) - 4.0, f64::from(i / 9) - 4.0);
            let place = if random { Place::new(0.8 * place.x_mm + 0.3, 0.8 * place.y_mm - 0.2) } else { place };
            let normal: f64 = StandardNormal.sample(&mut rng);
            (place, outputs(place, normal))
        };
        (0..81).map(&mut row).collect()
    }

    #[test]
    fn common_mode_without_place_information_is_removed() {
        let calibration = rows(false);
        let points: Vec<_> = calibration
            .iter()
            .map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs })
            .collect();
        let calibration = Calibration::new(&points).unwrap();
        let methods = [
            FittedMethod::PatternMap(
                PatternMap::fit(&calibration, ForceKnown::Unknown, &Correlations::default()).unwrap().0,
            ),
            FittedMethod::Pearson(Pearson::fit(&calibration, None, ForceRule::LeastSquares).unwrap()),
        ];
        let errors = methods.map(|method| {
            let error = |(place, outputs): &(Place, [f64; 4])| {
                let reading = outputs.map(|output| 0.4 * output);
                method.locate(&reading, &mut Workspace::default()).unwrap().place.distance_mm(*place)
            };
            rows(true).iter().map(error).sum::<f64>() / 81.0
        });
        assert!(errors[0] < 0.3 && errors[0] < 0.3 * errors[1], "{errors:?}");
    }
}
