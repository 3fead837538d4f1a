//! Smooth map of the outputs per newton along each axis, with its own error and the noise of a reading.

use super::calibration::{VectorCalibration, VectorSpot};
use super::{PRESS, ShearPrior, VectorCovariance, VectorError, VectorWorkspace};
use crate::field::{CalibratedArea, SplineField};
use crate::hyperparameters::Hyperparameters;
use crate::kriging::Kriging;
use crate::noise::{Noise, Residual};
use crate::spots::coordinates;
use crate::surrogate::{CELLS_A_GRAIN, MANNER};
use crate::threshold::chi2_quantile;
use crate::two::Pair;
use palpate_core::quantity::{Place, stream};
use rand::RngExt;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Smooth map of the outputs per newton along each axis, and everything that a solve needs.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct VectorMap {
    pub(crate) axes: [Option<AxisMap>; 3],
    pub(crate) noise: Noise,
    pub(crate) area: CalibratedArea,
    pub(crate) outputs: usize,
    /// Residuals of the calibration's presses, each compared with a map made without its place, in units of their standard
    /// deviation. Empty if the map is exact.
    held: Vec<Vec<f64>>,
    pub(crate) coarse: super::solve::Coarse,
    /// Share of single contacts that may be called something else.
    pub(crate) false_alarms: f64,
    /// Sums of squares that they exceed at this rate, without and with a shear.
    pub(super) misfit_most: [f64; 2],
    /// Limits of a reading without contact, of the gain of a place beyond the border, and of what a pair leaves.
    weak_most: f64,
    beyond_most: f64,
    pair_most: f64,
    /// Whether most outputs are known less certainly at a place without presses than a reading of one press.
    is_sparse: bool,
}

/// Map of the outputs per newton along one axis.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct AxisMap {
    pub field: SplineField,
    /// Variance of the map, in units of the noise's variance, per N^2. `None` if the map is exact.
    error: Option<SplineField>,
}

impl AxisMap {
    /// Writes the variance of the map at a place, in units of the noise's variance, per N^2.
    pub(crate) fn error(&self, place: Place, error: &mut [f64]) {
        match &self.error {
            Some(field) => field.value(place, error),
            None => error.fill(0.0),
        }
        error.iter_mut().for_each(|value| *value = value.max(0.0));
    }
}

/// Least variance of the places across their longest direction, as a fraction of that along it.
const LEAST_WIDTH: f64 = 1e-4;
/// Least number of outputs: as many as the unknowns of a press.
pub(super) const FEWEST_OUTPUTS: usize = 3;
/// Least number of places of a map.
const FEWEST_PLACES: usize = 6;
/// Number of cells along each side of the table with the map's own error: some for each step from one place to the next, because the
/// error grows between places.
const ERROR_CELLS: f64 = 24.0;
/// Force of the single contacts from which limits follow, N: the largest expected one. The map's error grows with the force, and noise
/// doesn't, so weaker contacts exceed the limits less often.
const MOST_FORCE_N: f64 = 2.0;
/// Usual share of single contacts that may be called something else.
const FALSE_ALARMS: f64 = 0.01;

impl VectorMap {
    /// Smooths each axis over the places at which the presses determine it, by kriging with the most likely correlation and noise.
    ///
    /// # Errors
    /// The places are few, or on a line.
    pub fn fit(calibration: &VectorCalibration) -> Result<Self, VectorError> {
        let outputs = calibration.outputs;
        if outputs < FEWEST_OUTPUTS {
            return Err(VectorError::TooFewOutputs { outputs });
        }
        let pulls = calibration.rows.iter().filter(|row| row.force_n[PRESS] < 0.0).count();
        if 2 * pulls > calibration.rows.len() {
            return Err(VectorError::Pulls);
        }
        let pressed = calibration.spots.iter().filter(|spot| spot.columns[PRESS].is_some());
        let area = CalibratedArea::around(pressed.clone().map(|spot| spot.place))
            .filter(|_| pressed.clone().count() >= FEWEST_PLACES && spans_area(pressed.clone().map(|spot| spot.place)))
            .ok_or(VectorError::TooFewPlaces { places: pressed.count(), needed: FEWEST_PLACES })?;
        let smoothed = [0, 1, PRESS].map(|axis| SmoothedAxis::of(calibration, axis, area));
        let held: Vec<Vec<Residual>> =
            (0..calibration.spots.len()).flat_map(|spot| held_rows(calibration, spot, &smoothed)).collect();
        let uncertain = held.iter().flatten().filter(|residual| residual.leverage > 1.0).count();
        let is_sparse = 2 * uncertain > outputs * held.len();
        let of_output = |output: usize| held.iter().map(|held| held[output]).collect();
        let noise = Noise::fit(&(0..outputs).map(of_output).collect::<Vec<Vec<Residual>>>());
        let standard = |(output, r): (usize, &Residual)| {
            r.residual / (noise.variance(output, r.predicted) * (1.0 + r.leverage)).sqrt()
        };
        let held = held.iter().map(|row| row.iter().enumerate().map(standard).collect()).collect();
        let axes = smoothed.map(|axis| axis.map(|axis| axis.map));
        Ok(VectorMap { held, is_sparse, ..Self::with(axes, noise, area, outputs) })
    }

    /// Returns the map of columns that are known exactly, with the standard deviation of each output's noise. `columns` gives the
    /// outputs per newton along x, y and into the specimen, one axis after another, at a place of the area between two corners.
    pub fn known(corners: [Place; 2], step_mm: f64, noise_sd: &[f64], columns: impl Fn(Place) -> Vec<f64>) -> Self {
        let (area, outputs) = (CalibratedArea { least: corners[0], most: corners[1] }, noise_sd.len());
        let axis = |axis: usize| {
            let sample = |places: &[Place]| {
                places.iter().flat_map(|place| columns(*place)[axis * outputs..][..outputs].to_vec()).collect()
            };
            Some(AxisMap { field: SplineField::new(area, step_mm, outputs, sample), error: None })
        };
        let noise = Noise::additive(noise_sd);
        Self::with([axis(0), axis(1), axis(PRESS)], noise, area, outputs)
    }

    fn with(axes: [Option<AxisMap>; 3], noise: Noise, area: CalibratedArea, outputs: usize) -> Self {
        let coarse = super::solve::Coarse::of(&axes, &noise, area, outputs);
        let unlimited = f64::INFINITY;
        let map = VectorMap {
            axes,
            noise,
            area,
            outputs,
            held: Vec::new(),
            coarse,
            false_alarms: FALSE_ALARMS,
            misfit_most: [unlimited; 2],
            weak_most: unlimited,
            beyond_most: unlimited,
            pair_most: unlimited,
            is_sparse: false,
        };
        map.with_false_alarms(FALSE_ALARMS)
    }

    /// Returns the same map with another share of single contacts that each limit may call something else. It is 1 % by default.
    pub fn with_false_alarms(self, share: f64) -> Self {
        let sheared = 3 + self.axes[..PRESS].iter().flatten().count();
        let limit = |unknowns: usize| chi2_quantile(self.outputs.saturating_sub(unknowns), share);
        VectorMap {
            false_alarms: share,
            misfit_most: [limit(3), limit(sheared)],
            weak_most: limit(0),
            beyond_most: chi2_quantile(1, 2.0 * share),
            pair_most: limit(6),
            ..self
        }
    }

    /// Returns readings of single contacts without shear at random places, from which limits follow. Each has the errors of one of
    /// the calibration's presses, scaled to its own noise and map error.
    pub(crate) fn single_contacts(&self, count: usize) -> Vec<Vec<f64>> {
        let mut rng = stream(0, 0, "single contacts");
        let Some(press) = &self.axes[PRESS] else { return Vec::new() };
        let mut column = [vec![0.0; self.outputs], vec![0.0; self.outputs]];
        let mut reading = |nth: usize| {
            let CalibratedArea { least, most } = self.area;
            let [x, y]: [f64; 2] = std::array::from_fn(|_| rng.random());
            let along = |least: f64, most: f64, share: f64| least + share * (most - least);
            let place = Place::new(along(least.x_mm, most.x_mm, x), along(least.y_mm, most.y_mm, y));
            let force_n = MOST_FORCE_N;
            press.field.value(place, &mut column[0]);
            press.error(place, &mut column[1]);
            let of_output = |output: usize| {
                let exact = force_n * column[0][output];
                let variance = self.noise.variance(output, exact) * (1.0 + force_n * force_n * column[1][output]);
                let error = match self.held.is_empty() {
                    true => StandardNormal.sample(&mut rng),
                    false => self.held[nth % self.held.len()][output],
                };
                exact + variance.sqrt() * error
            };
            (0..self.outputs).map(of_output).collect()
        };
        // a step that shares no factor with the number of presses, so that all places have their turn
        (0..count).map(|nth| reading(nth * 7919)).collect()
    }

    /// Returns the same map for some of the outputs.
    pub(crate) fn of_outputs(&self, kept: &[usize]) -> Self {
        let select = |row: &[f64]| -> Vec<f64> { kept.iter().map(|output| row[*output]).collect() };
        let axes = self.axes.clone().map(|axis| {
            axis.map(|AxisMap { field, error }| AxisMap {
                field: field.of_channels(kept),
                error: error.map(|error| error.of_channels(kept)),
            })
        });
        let [additive, proportional] = self.noise.parts().map(|part| select(&part));
        let held = self.held.iter().map(|row| select(row)).collect();
        let noise = Noise::of_parts(additive, proportional);
        VectorMap { held, ..Self::with(axes, noise, self.area, kept.len()).with_false_alarms(self.false_alarms) }
    }

    /// Whether a reading can't be distinguished from one without contact.
    pub(crate) fn is_weak(&self, outputs: &[f64]) -> bool {
        let squares =
            outputs.iter().enumerate().map(|(output, value)| value * value / self.noise.variance(output, 0.0));
        squares.sum::<f64>() < self.weak_most
    }

    /// Limit of the decrease of the sum of squares that a place beyond the border gives to a contact in the area.
    pub(crate) fn beyond_most(&self) -> f64 {
        self.beyond_most
    }

    /// Whether a contact in the area explains a reading without these outputs.
    pub(crate) fn fits_without(&self, outputs: &[f64], without: Range<usize>, w: &mut VectorWorkspace) -> bool {
        let prior = if self.knows_shear() { ShearPrior::Usual } else { ShearPrior::Zero };
        let most = chi2_quantile(self.outputs.saturating_sub(without.len() + 3), self.false_alarms);
        let fit = self.best(outputs, prior, without, w);
        fit.is_some_and(|fit| fit.chi2 <= most && fit.beyond <= self.beyond_most())
    }

    /// Returns the sum of squares that a pair leaves, divided by the limit of the accepted false alarms.
    pub(crate) fn pair_misfit(&self, pair: &Pair) -> f64 {
        pair.chi2 / self.pair_most
    }

    /// Whether the places are so far apart that single contacts may be called something else more often than accepted.
    pub fn is_sparse(&self) -> bool {
        self.is_sparse
    }

    /// Accepted fraction of single contacts with a wrong verdict.
    pub fn false_alarms(&self) -> f64 {
        self.false_alarms
    }

    /// Number of outputs of a reading.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Whether the calibration shows the effect of a force along x and along y.
    pub fn knows_shear(&self) -> bool {
        self.axes[..PRESS].iter().all(Option::is_some)
    }

    /// Returns the smallest covariance of an unbiased method for a force at a place, including the map's own error (Cramer-Rao).
    /// `None` if the outputs don't determine the contact.
    pub fn bound(&self, place: Place, force_n: [f64; 3]) -> Option<VectorCovariance> {
        self.fitted(place, force_n)
    }
}

/// Whether places aren't on a line: the smaller variance of a direction is a ten-thousandth of the larger at least.
fn spans_area(places: impl Iterator<Item = Place> + Clone) -> bool {
    let count = places.clone().count() as f64;
    let mean = |of: &dyn Fn(Place) -> f64| places.clone().map(of).sum::<f64>() / count;
    let (x, y) = (mean(&|place| place.x_mm), mean(&|place| place.y_mm));
    let xx = mean(&|place| (place.x_mm - x).powi(2));
    let yy = mean(&|place| (place.y_mm - y).powi(2));
    let xy = mean(&|place| (place.x_mm - x) * (place.y_mm - y));
    let (half, root) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
    half - root > LEAST_WIDTH * (half + root)
}

/// Axis of a calibration with the data for held-out comparisons.
struct SmoothedAxis {
    map: AxisMap,
    /// Row of the regression for each place of the calibration.
    index: Vec<Option<usize>>,
    /// Predictions of the places without themselves, and their variance in units of the noise's, row-major places x outputs.
    predicted: Vec<f64>,
    variance: Vec<f64>,
}

impl SmoothedAxis {
    fn of(calibration: &VectorCalibration, axis: usize, area: CalibratedArea) -> Option<Self> {
        let outputs = calibration.outputs;
        let column = |spot: &VectorSpot| spot.columns[axis].clone();
        let mut rows = 0..;
        let index = |spot: &VectorSpot| column(spot).and_then(|_| rows.next());
        let index: Vec<Option<usize>> = calibration.spots.iter().map(index).collect();
        let known = || calibration.spots.iter().filter_map(|spot| Some((spot.place, column(spot)?)));
        if known().count() < FEWEST_PLACES {
            return None;
        }
        let places = coordinates(known().map(|(place, _)| place).collect::<Vec<_>>().into_iter());
        let values: Vec<f64> = known().flat_map(|(_, column)| column.per_newton).collect();
        let weights: Vec<f64> = known().map(|(_, column)| column.weight).collect();
        let typical = weights.iter().sum::<f64>() / weights.len() as f64;
        let counts: Vec<f64> = weights.iter().map(|weight| weight / typical).collect();
        let hyperparameters = Hyperparameters::weighted(&places, 2, &values, outputs, MANNER, &counts);
        let kriging = Kriging::fit_counting(&places, 2, &values, outputs, MANNER, &hyperparameters, Some(&counts));
        let sample = |places: &[Place]| kriging.predict_all(&coordinates(places.iter().copied()));
        let field = SplineField::new(area, kriging.grain() / CELLS_A_GRAIN, outputs, sample);
        let per_noise = |leverage: Vec<f64>| -> Vec<f64> { leverage.iter().map(|l| l.max(0.0) / typical).collect() };
        // beyond the border the error grows so fast that the table would swing below 0 inside
        let inside = |places: &[Place]| coordinates(places.iter().map(|place| area.clamp(*place)));
        let error = |places: &[Place]| per_noise(kriging.leverage(&inside(places)));
        let error = Some(SplineField::new(area, area.side_mm() / ERROR_CELLS, outputs, error));
        let held = kriging.held_out();
        let predicted = values.iter().zip(&held.residuals).map(|(value, residual)| value - residual).collect();
        Some(SmoothedAxis { map: AxisMap { field, error }, index, predicted, variance: per_noise(held.leverage) })
    }
}

/// Compares the presses at a place with maps made without the place. A press doesn't count if an axis of its force is unknown there.
fn held_rows(calibration: &VectorCalibration, spot: usize, axes: &[Option<SmoothedAxis>; 3]) -> Vec<Vec<Residual>> {
    let outputs = calibration.outputs;
    let VectorSpot { rows, columns, .. } = &calibration.spots[spot];
    let known = [0, 1, PRESS].map(|axis| {
        let of = axes[axis].as_ref().filter(|_| columns[axis].is_some())?;
        Some((of, of.index[spot]? * outputs))
    });
    let compared = |&row: &usize| {
        let row = &calibration.rows[row];
        let length = row.force_n.iter().map(|n| n * n).sum::<f64>().sqrt();
        if (0..3).any(|axis| known[axis].is_none() && row.force_n[axis].abs() > UNKNOWN_SHARE * length) {
            return None;
        }
        let of_output = |output: usize| {
            let (mut predicted, mut leverage) = (0.0, 0.0);
            for (n, (axis, at)) in row.force_n.iter().zip(&known).filter_map(|(n, known)| Some((n, (*known)?))) {
                predicted += n * axis.predicted[at + output];
                leverage += n * n * axis.variance[at + output];
            }
            Residual { predicted, residual: row.outputs[output] - predicted, leverage }
        };
        Some((0..outputs).map(of_output).collect())
    };
    rows.iter().filter_map(compared).collect()
}

/// Largest force along an unknown axis that is ignored, as a fraction of the press' force.
const UNKNOWN_SHARE: f64 = 0.03;
