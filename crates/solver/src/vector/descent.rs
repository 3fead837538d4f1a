//! Finds the place and the force at which columns fit a reading best.

use super::map::{AxisMap, VectorMap};
use super::solve::VectorWorkspace;
use super::{PRESS, USUAL_SHEAR_SHARE};
use crate::descent::{LAST_GAIN, LONGEST_STEP, MOST_HALVINGS, MOST_STEPS};
use crate::normal::NormalEquations;
use palpate_core::quantity::Place;
use std::ops::Range;

/// Best fit of a contact.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VectorFit {
    pub place: Place,
    pub force_n: [f64; 3],
    /// Weighted sum of squares of reading minus columns times force, and the shear's own if its size is assumed.
    pub chi2: f64,
    /// Information about x, y (mm) and the force (N).
    pub information: [[f64; 5]; 5],
    /// Decrease of `chi2` if the place could lie beyond the border of the area, to first order.
    pub beyond: f64,
}

/// Assumption about the force along the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ShearPrior {
    /// It can have any size.
    None,
    /// Along each axis it is a fraction of the press, with [`SHARE`](Self::SHARE) as its standard deviation.
    Usual,
    /// There is none.
    Zero,
}

impl ShearPrior {
    /// Standard deviation along an axis of a shear that is evenly distributed in all directions and up to
    /// [`USUAL_SHEAR_SHARE`](super::USUAL_SHEAR_SHARE) of the press.
    pub(crate) const SHARE: f64 = 0.5 * USUAL_SHEAR_SHARE;
}

/// Searches for the best fit from a start: Gauss-Newton steps in the place. After each step the force, in which a reading is linear,
/// is solved again.
pub(crate) struct VectorDescent<'a> {
    map: &'a VectorMap,
    outputs: &'a [f64],
    prior: ShearPrior,
    /// Outputs that are left out.
    without: Range<usize>,
}

impl<'a> VectorDescent<'a> {
    pub(crate) fn new(map: &'a VectorMap, outputs: &'a [f64], prior: ShearPrior) -> Self {
        VectorDescent { map, outputs, prior, without: 0..0 }
    }

    /// Returns the same search with some outputs left out.
    pub(crate) fn without(self, outputs: Range<usize>) -> Self {
        VectorDescent { without: outputs, ..self }
    }

    /// Returns the best fit near a place; `None` if nothing can be fitted.
    pub(crate) fn from(&self, start: Place, w: &mut VectorWorkspace) -> Option<VectorFit> {
        let area = self.map.area;
        let longest_mm = LONGEST_STEP * area.side_mm();
        let mut place = start;
        self.respond(place, w);
        self.read_errors(place, w);
        let noise_sd = self.map.coarse.noise_sd.iter();
        w.weight.clear();
        w.weight.extend(noise_sd.map(|sd| 1.0 / (sd * sd)));
        self.leave_out(w);
        let mut force_n = self.force_n(0.0, w);
        let mut steps = 0;
        loop {
            self.weigh(force_n, w);
            let precision = self.precision(force_n);
            force_n = self.force_n(precision, w);
            let (normal, chi2) = self.normal(force_n, precision, w);
            let [step, free_step] = self.steps(&normal, place);
            if !(chi2.is_finite() && step.iter().all(|value| value.is_finite())) {
                return None;
            }
            let length_mm = step[0].hypot(step[1]);
            let mut share = if length_mm > longest_mm { longest_mm / length_mm } else { 1.0 };
            let along = |share: f64| area.clamp(Place::new(place.x_mm + share * step[0], place.y_mm + share * step[1]));
            steps += 1;
            let gain = normal.gain(step);
            if gain < LAST_GAIN || steps == MOST_STEPS {
                let force_n = std::array::from_fn(|axis| force_n[axis] + step[2 + axis]);
                return Some(VectorFit {
                    place: along(share),
                    force_n,
                    chi2: chi2 - gain,
                    information: normal.information,
                    beyond: normal.gain(free_step) - gain,
                });
            }
            for _ in 0..=MOST_HALVINGS {
                self.respond(along(share), w);
                force_n = self.force_n(precision, w);
                if self.chi2(force_n, precision, w) <= chi2 {
                    break;
                }
                share *= 0.5;
            }
            place = along(share);
            if steps == 1 {
                // the map's error changes slowly: after the first step it stays
                self.read_errors(place, w);
            }
        }
    }

    /// Returns the information about a known contact; `None` if it has no press.
    pub(crate) fn information_at(&self, fit: &VectorFit, w: &mut VectorWorkspace) -> Option<[[f64; 5]; 5]> {
        self.respond(fit.place, w);
        self.read_errors(fit.place, w);
        w.weight.resize(self.map.outputs, 0.0);
        self.weigh(fit.force_n, w);
        let known = self.map.axes.iter().all(Option::is_some);
        known.then(|| self.normal(fit.force_n, self.precision(fit.force_n), w).0.information)
    }

    fn respond(&self, place: Place, w: &mut VectorWorkspace) {
        for (axis, b) in self.axes().zip(&mut w.axes) {
            for buffer in [&mut b.value, &mut b.along_x, &mut b.along_y] {
                buffer.resize(self.map.outputs, 0.0);
            }
            match axis {
                Some(axis) => axis.field.value_and_gradient(place, &mut b.value, &mut b.along_x, &mut b.along_y),
                None => [&mut b.value, &mut b.along_x, &mut b.along_y].into_iter().for_each(|buffer| buffer.fill(0.0)),
            }
        }
    }

    fn read_errors(&self, place: Place, w: &mut VectorWorkspace) {
        for (axis, b) in self.axes().zip(&mut w.axes) {
            b.error.resize(self.map.outputs, 0.0);
            match axis {
                Some(axis) => axis.error(place, &mut b.error),
                None => b.error.fill(0.0),
            }
        }
    }

    /// Axes that count: without shear only the press.
    fn axes(&self) -> impl Iterator<Item = Option<&AxisMap>> {
        let counts = |axis: usize| axis == PRESS || self.prior != ShearPrior::Zero;
        self.map.axes.iter().enumerate().map(move |(nth, axis)| axis.as_ref().filter(|_| counts(nth)))
    }

    fn weigh(&self, force_n: [f64; 3], w: &mut VectorWorkspace) {
        let [x, y, z] = &w.axes;
        for (output, weight) in w.weight.iter_mut().enumerate() {
            let sum = |a: f64, b: f64, c: f64| force_n[0] * a + force_n[1] * b + force_n[2] * c;
            let of_noise = self.map.noise.variance(output, sum(x.value[output], y.value[output], z.value[output]));
            let [a, b, c] = [&x.error, &y.error, &z.error].map(|error| error[output]);
            let of_map = force_n[0] * force_n[0] * a + force_n[1] * force_n[1] * b + force_n[2] * force_n[2] * c;
            *weight = 1.0 / (of_noise * (1.0 + of_map));
        }
        self.leave_out(w);
    }

    fn leave_out(&self, w: &mut VectorWorkspace) {
        w.weight[self.without.clone()].fill(0.0);
    }

    /// Inverse of the variance of each shear, 1/N^2; 0 if nothing is assumed about it.
    fn precision(&self, force_n: [f64; 3]) -> f64 {
        match self.prior {
            ShearPrior::Usual if force_n[PRESS] != 0.0 => (ShearPrior::SHARE * force_n[PRESS]).powi(-2),
            _ => 0.0,
        }
    }

    fn is_free(&self) -> [bool; 3] {
        let mut axes = self.axes().map(|axis| axis.is_some());
        std::array::from_fn(|_| axes.next().unwrap_or(false))
    }

    /// Force that fits best with the weights.
    fn force_n(&self, precision: f64, w: &VectorWorkspace) -> [f64; 3] {
        let mut normal = NormalEquations::<3>::default();
        let [x, y, z] = &w.axes;
        for (output, value) in self.outputs.iter().enumerate() {
            normal.add(w.weight[output], [x.value[output], y.value[output], z.value[output]], *value);
        }
        normal.finish();
        normal.information[0][0] += precision;
        normal.information[1][1] += precision;
        normal.step(self.is_free())
    }

    fn chi2(&self, force_n: [f64; 3], precision: f64, w: &VectorWorkspace) -> f64 {
        let [x, y, z] = &w.axes;
        let of_output = |output: usize| {
            let fitted = force_n[0] * x.value[output] + force_n[1] * y.value[output] + force_n[2] * z.value[output];
            w.weight[output] * (self.outputs[output] - fitted).powi(2)
        };
        let of_shear = precision * (force_n[0] * force_n[0] + force_n[1] * force_n[1]);
        (0..self.outputs.len()).map(of_output).sum::<f64>() + of_shear
    }

    fn normal(&self, force_n: [f64; 3], precision: f64, w: &VectorWorkspace) -> (NormalEquations<5>, f64) {
        let mut normal = NormalEquations::<5>::default();
        let [x, y, z] = &w.axes;
        let mut chi2 = precision * (force_n[0] * force_n[0] + force_n[1] * force_n[1]);
        for (output, value) in self.outputs.iter().enumerate() {
            let sum = |a: f64, b: f64, c: f64| force_n[0] * a + force_n[1] * b + force_n[2] * c;
            let columns = [x.value[output], y.value[output], z.value[output]];
            let residual = value - sum(columns[0], columns[1], columns[2]);
            let along_x = sum(x.along_x[output], y.along_x[output], z.along_x[output]);
            let along_y = sum(x.along_y[output], y.along_y[output], z.along_y[output]);
            normal.add(w.weight[output], [along_x, along_y, columns[0], columns[1], columns[2]], residual);
            chi2 += w.weight[output] * residual * residual;
        }
        normal.finish();
        for axis in [0, 1] {
            normal.information[2 + axis][2 + axis] += precision;
            normal.slope[2 + axis] -= precision * force_n[axis];
        }
        (normal, chi2)
    }

    /// Returns the best step that doesn't leave the area, and the free step.
    fn steps(&self, normal: &NormalEquations<5>, place: Place) -> [[f64; 5]; 2] {
        let area = self.map.area;
        let leaves =
            |at: f64, least: f64, most: f64, step: f64| (at <= least && step < 0.0) || (at >= most && step > 0.0);
        let axes = self.is_free();
        let mut free = [true, true, axes[0], axes[1], axes[2]];
        let free_step = normal.step(free);
        let mut step = free_step;
        for _ in 0..2 {
            let x = free[0] && leaves(place.x_mm, area.least.x_mm, area.most.x_mm, step[0]);
            let y = free[1] && leaves(place.y_mm, area.least.y_mm, area.most.y_mm, step[1]);
            if !x && !y {
                break;
            }
            (free[0], free[1]) = (free[0] && !x, free[1] && !y);
            step = normal.step(free);
        }
        [step, free_step]
    }
}
