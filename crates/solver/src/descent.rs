//! Finds the place where a map fits a reading best.

use super::ForceKnown;
use super::normal::NormalEquations;
use super::response::ForwardResponse;
use super::workspace::{Buffers, Workspace};
use palpate_core::quantity::Place;

/// Finds where a [`Response`] fits a reading best, from a start near the best place. It uses Gauss-Newton steps in the place.
/// After each step it eliminates the force, in which the response is linear. Places stay in the response's area.
pub(super) struct Descent<'a> {
    pub response: &'a ForwardResponse,
    pub load: ForceKnown,
    /// Whether a common offset of all units is eliminated too.
    pub common_offset: bool,
    /// Outputs, one for each unit.
    pub outputs: &'a [f64],
    /// Units that are excluded.
    pub without: &'a [usize],
}

/// Best fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct BestFit {
    pub place: Place,
    pub force_n: f64,
    /// Weighted sum of squares of reading minus response.
    pub chi2: f64,
    /// Information about x (mm), y (mm) and force (N).
    pub information: [[f64; 3]; 3],
    /// Reduction of `chi2`, to first order, if the place could leave the area.
    pub beyond: f64,
    /// Variance of the map at the place divided by the variance of the noise, mean of all units.
    pub leverage: f64,
}

/// Largest number of steps from a start. Two to four are usually enough.
pub(super) const MOST_STEPS: usize = 12;
/// Longest step, as a fraction of the area's longer side.
pub(super) const LONGEST_STEP: f64 = 0.1;
/// Number of times that a step without improvement is halved.
pub(super) const MOST_HALVINGS: usize = 4;
/// Expected decrease of the sum of squares below which a step is the last. Its effect is a thirtieth of the error from noise.
pub(super) const LAST_GAIN: f64 = 1e-3;

impl Descent<'_> {
    /// Returns the best fit near a place; `None` if nothing can be fitted.
    pub(crate) fn from(&self, start: Place, workspace: &mut Workspace) -> Option<BestFit> {
        let area = self.response.field.area();
        let side = (area.most.x_mm - area.least.x_mm).max(area.most.y_mm - area.least.y_mm);
        let b = &mut workspace.buffers;
        b.resize(self.response.field.channels());
        let mut place = start;
        self.respond(place, b);
        self.response.leverage.value(place, &mut b.leverage);
        b.weight.fill(1.0);
        let mut force_n = self.force_n(b);
        let mut steps = 0;
        loop {
            self.weigh(force_n, b);
            force_n = self.force_n(b);
            let (normal, chi2) = self.normal(force_n, b);
            let known = self.load == ForceKnown::Constant;
            let freely = normal.step([true, true, !known]);
            let step = self.inside(&normal, place, freely);
            let estimate = |place| {
                let beyond = normal.gain(freely) - normal.gain(step);
                let leverage = b.leverage.iter().sum::<f64>() / b.leverage.len() as f64;
                BestFit { place, force_n: force_n + step[2], chi2, information: normal.information, beyond, leverage }
            };
            if !(chi2.is_finite() && step.iter().all(|value| value.is_finite())) {
                return None;
            }
            let length = step[0].hypot(step[1]);
            let mut share = if length > LONGEST_STEP * side { LONGEST_STEP * side / length } else { 1.0 };
            let along = |share: f64| area.clamp(Place::new(place.x_mm + share * step[0], place.y_mm + share * step[1]));
            steps += 1;
            if normal.gain(step) < LAST_GAIN || steps == MOST_STEPS {
                return Some(estimate(along(share)));
            }
            for _ in 0..=MOST_HALVINGS {
                self.respond(along(share), b);
                force_n = self.force_n(b);
                if self.chi2(force_n, b) <= chi2 {
                    break;
                }
                share *= 0.5;
            }
            place = along(share);
            if steps == 1 {
                // the map's error changes slowly: after the first step it stays
                self.response.leverage.value(place, &mut b.leverage);
            }
        }
    }

    fn respond(&self, place: Place, b: &mut Buffers) {
        self.response.field.value_and_gradient(place, &mut b.value, &mut b.along_x, &mut b.along_y);
    }

    fn weigh(&self, force_n: f64, b: &mut Buffers) {
        for (unit, weight) in b.weight.iter_mut().enumerate() {
            *weight = 1.0 / self.response.variance(unit, force_n, b.value[unit], b.leverage[unit]);
        }
        self.without.iter().for_each(|&unit| b.weight[unit] = 0.0);
    }

    /// Force that fits best with the weights.
    fn force_n(&self, b: &Buffers) -> f64 {
        if self.load == ForceKnown::Constant {
            return self.response.force_n;
        }
        let (output_0, value_0) = (self.offset(self.outputs, b), self.offset(&b.value, b));
        let (mut projected, mut length) = (0.0, 0.0);
        for ((output, value), weight) in self.outputs.iter().zip(&b.value).zip(&b.weight) {
            let (output, value) = (output - output_0, value - value_0);
            projected += weight * output * value;
            length += weight * value * value;
        }
        if length > 0.0 { projected / length } else { 0.0 }
    }

    /// Weighted mean of a column, which an offset common to all units removes; 0 if there is no such offset.
    fn offset(&self, column: &[f64], b: &Buffers) -> f64 {
        if !self.common_offset {
            return 0.0;
        }
        let sum: f64 = column.iter().zip(&b.weight).map(|(value, weight)| value * weight).sum();
        sum / b.weight.iter().sum::<f64>()
    }

    fn chi2(&self, force_n: f64, b: &Buffers) -> f64 {
        let offset = self.offset(self.outputs, b) - force_n * self.offset(&b.value, b);
        let terms = self.outputs.iter().zip(&b.value).zip(&b.weight);
        terms.map(|((output, value), weight)| weight * (output - offset - force_n * value).powi(2)).sum()
    }

    fn normal(&self, force_n: f64, b: &Buffers) -> (NormalEquations, f64) {
        let (mut normal, mut chi2) = (NormalEquations::default(), 0.0);
        let [x_0, y_0, value_0] = [&b.along_x, &b.along_y, &b.value].map(|column| self.offset(column, b));
        let offset = self.offset(self.outputs, b) - force_n * value_0;
        for (unit, output) in self.outputs.iter().enumerate() {
            let residual = output - offset - force_n * b.value[unit];
            let (along_x, along_y) = (b.along_x[unit] - x_0, b.along_y[unit] - y_0);
            let jacobian = [force_n * along_x, force_n * along_y, b.value[unit] - value_0];
            normal.add(b.weight[unit], jacobian, residual);
            chi2 += b.weight[unit] * residual * residual;
        }
        normal.finish();
        (normal, chi2)
    }

    /// Returns the step, or the best step along the border if the free step would leave the area.
    fn inside(&self, normal: &NormalEquations, place: Place, freely: [f64; 3]) -> [f64; 3] {
        let area = self.response.field.area();
        let leaves =
            |at: f64, least: f64, most: f64, step: f64| (at <= least && step < 0.0) || (at >= most && step > 0.0);
        let mut free = [true, true, self.load == ForceKnown::Unknown];
        let mut step = freely;
        for _ in 0..2 {
            let x = free[0] && leaves(place.x_mm, area.least.x_mm, area.most.x_mm, step[0]);
            let y = free[1] && leaves(place.y_mm, area.least.y_mm, area.most.y_mm, step[1]);
            if !x && !y {
                break;
            }
            free = [free[0] && !x, free[1] && !y, free[2]];
            step = normal.step(free);
        }
        step
    }
}

impl Buffers {
    pub(super) fn resize(&mut self, units: usize) {
        for buffer in [&mut self.value, &mut self.along_x, &mut self.along_y, &mut self.weight, &mut self.leverage] {
            buffer.resize(units, 0.0);
        }
    }
}
