//! Finds place and force of a contact with a map of columns.

use super::descent::{ShearPrior, VectorDescent, VectorFit};
use super::map::{AxisMap, VectorMap};
use super::{PRESS, Shear, USUAL_SHEAR_SHARE, VectorContact, VectorCovariance};
use crate::SolveError;
use crate::field::CalibratedArea;
use crate::noise::Noise;
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_1_SQRT_2;
use std::ops::Range;

/// Working memory of a solve, kept from one reading to the next so that no reading allocates.
#[derive(Clone, Debug, Default)]
pub struct VectorWorkspace {
    pub(crate) axes: [AxisBuffers; 3],
    pub(crate) weight: Vec<f64>,
    pub(crate) scores: Vec<f32>,
    pub(crate) starts: Vec<(f32, usize)>,
}

/// Column of one axis at a place: its values, their changes with x and with y, and their variance.
#[derive(Clone, Debug, Default)]
pub(crate) struct AxisBuffers {
    pub value: Vec<f64>,
    pub along_x: Vec<f64>,
    pub along_y: Vec<f64>,
    pub error: Vec<f64>,
}

/// Grid of places, each with an orthonormal basis of its columns in units of the outputs' noise.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Coarse {
    pub places: Vec<Place>,
    pub noise_sd: Vec<f64>,
    /// Bases, outputs x (axes x places): first the directions of all presses, then what the other axes add to them.
    pub bases: Vec<f32>,
    /// Length of what each of the other axes adds, relative to the length of the press, axes x places.
    added: [Vec<f32>; 2],
}

/// Number of places along each side of the grid.
const COARSE_A_SIDE: usize = 13;
/// Largest number of places from which the best fit is searched for, and the largest difference of the sums of squares that they
/// explain.
const MOST_STARTS: usize = 3;
const NEARLY_AS_LIKELY: f32 = 9.0;

impl Coarse {
    pub(super) fn of(axes: &[Option<AxisMap>; 3], noise: &Noise, area: CalibratedArea, outputs: usize) -> Self {
        let places = area.grid(COARSE_A_SIDE);
        let column = |axis: usize, place: Place| {
            let mut value = vec![0.0; outputs];
            if let Some(axis) = &axes[axis] {
                axis.field.value(place, &mut value);
            }
            value
        };
        let typical = |output: usize| {
            let squares: f64 = places.iter().map(|place| column(PRESS, *place)[output].powi(2)).sum();
            noise.variance(output, (squares / places.len() as f64).sqrt()).sqrt()
        };
        let noise_sd: Vec<f64> = (0..outputs).map(typical).collect();
        let mut bases = vec![0.0; outputs * 3 * places.len()];
        let mut added = [vec![0.0; places.len()], vec![0.0; places.len()]];
        for (at, place) in places.iter().enumerate() {
            let mut basis: Vec<Vec<f64>> = Vec::new();
            let mut press = 0.0;
            for (nth, axis) in [PRESS, 0, 1].into_iter().enumerate() {
                let mut row: Vec<f64> = column(axis, *place).iter().zip(&noise_sd).map(|(v, sd)| v / sd).collect();
                for other in &basis {
                    let along: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                    row.iter_mut().zip(other).for_each(|(value, other)| *value -= along * other);
                }
                let length = row.iter().map(|value| value * value).sum::<f64>().sqrt();
                row.iter_mut().for_each(|value| *value = if length > 0.0 { *value / length } else { 0.0 });
                for (output, value) in row.iter().enumerate() {
                    bases[(output * 3 + nth) * places.len() + at] = *value as f32;
                }
                match nth {
                    0 => press = length,
                    _ => added[nth - 1][at] = if press > 0.0 { (length / press) as f32 } else { 0.0 },
                }
                basis.push(row);
            }
        }
        Coarse { places, noise_sd, bases, added }
    }

    /// Multiplies a reading with all bases: `scores` gets axes x places.
    pub(crate) fn multiply(&self, outputs: &[f64], scores: &mut Vec<f32>) {
        let wide = 3 * self.places.len();
        scores.clear();
        scores.resize(wide, 0.0);
        for ((output, sd), row) in outputs.iter().zip(&self.noise_sd).zip(self.bases.chunks_exact(wide)) {
            let output = (output / sd) as f32;
            scores.iter_mut().zip(row).for_each(|(score, value)| *score += output * value);
        }
    }

    /// Fills `starts` with the places whose columns explain most of a reading, the best first. Of neighbours, only the best is a
    /// start. A shear counts as far as it is likely for the press.
    fn seek(&self, outputs: &[f64], prior: ShearPrior, without: Range<usize>, w: &mut VectorWorkspace) {
        let VectorWorkspace { scores, starts, .. } = w;
        self.multiply(outputs, scores);
        let (press, others) = scores.split_at_mut(self.places.len());
        let (along_x, along_y) = others.split_at(self.places.len());
        for (at, press) in press.iter_mut().enumerate().filter(|_| !without.is_empty()) {
            let (mut along, mut left) = (*press, 1.0f32);
            for output in without.clone() {
                let value = self.bases[output * 3 * self.places.len() + at];
                along -= value * (outputs[output] / self.noise_sd[output]) as f32;
                left -= value * value;
            }
            *press = along / left.max(f32::EPSILON).sqrt();
        }
        for (at, press) in press.iter_mut().enumerate() {
            let usual = if prior == ShearPrior::Zero { 0.0 } else { ShearPrior::SHARE as f32 * press.max(0.0) };
            let gain = |side: f32, added: f32| {
                let variance = (usual * added).powi(2);
                side * side * variance / (1.0 + variance)
            };
            let sides = gain(along_x[at], self.added[0][at]) + gain(along_y[at], self.added[1][at]);
            *press = if *press > 0.0 { *press * *press + sides } else { f32::NEG_INFINITY };
        }
        starts.clear();
        for (at, &score) in press.iter().enumerate() {
            let worst = starts.last().filter(|_| starts.len() == MOST_STARTS).map_or(f32::NEG_INFINITY, |last| last.0);
            let (column, line) = (at % COARSE_A_SIDE, at / COARSE_A_SIDE);
            let around = |middle: usize| middle.saturating_sub(1)..=(middle + 1).min(COARSE_A_SIDE - 1);
            let is_peak =
                || around(line).all(|line| around(column).all(|column| press[line * COARSE_A_SIDE + column] <= score));
            if score > worst && is_peak() {
                starts.truncate(MOST_STARTS - 1);
                starts.insert(starts.partition_point(|other| other.0 >= score), (score, at));
            }
        }
        let least = starts.first().map_or(0.0, |best| best.0 - NEARLY_AS_LIKELY);
        starts.retain(|start| start.0 >= least);
    }
}

impl VectorMap {
    /// Returns the contact that caused one reading.
    ///
    /// The place is searched for with a shear of the usual size. If the outputs show the shear there, the fit is refined without
    /// this assumption.
    ///
    /// # Errors
    /// The reading has another number of outputs, a number isn't finite, or no press explains any of it.
    pub fn solve(&self, outputs: &[f64], workspace: &mut VectorWorkspace) -> Result<VectorContact, SolveError> {
        self.check(outputs)?;
        let assumed = self.best(outputs, ShearPrior::Usual, 0..0, workspace);
        let assumed = assumed.ok_or_else(|| self.unexplained(outputs, workspace))?;
        let freely = VectorDescent::new(self, outputs, ShearPrior::None);
        let bound = freely.information_at(&assumed, workspace).and_then(|information| covariance(&information));
        let bound_n = bound.map_or(f64::INFINITY, |bound| bound.shear_n());
        let is_shown = bound_n < USUAL_SHEAR_SHARE * FRAC_1_SQRT_2 * assumed.force_n[PRESS];
        let free = if is_shown { freely.from(assumed.place, workspace) } else { None };
        let free = free.and_then(|fit| Some((fit, covariance(&fit.information)?)));
        let (fit, covariance, shear) = match free {
            Some((fit, covariance)) => (fit, covariance, Shear::Force([fit.force_n[0], fit.force_n[1]])),
            None => {
                let covariance = covariance(&assumed.information).ok_or(SolveError::NoPress)?;
                (assumed, covariance, Shear::NotDeterminable { bound_n })
            }
        };
        let VectorFit { place, force_n, chi2, beyond, .. } = fit;
        let misfit = chi2 / self.misfit_most[usize::from(free.is_some())];
        Ok(VectorContact { place, press_n: force_n[PRESS], shear, covariance, chi2, misfit, beyond })
    }

    /// Returns the reason why no press explains a reading.
    pub(crate) fn unexplained(&self, outputs: &[f64], w: &mut VectorWorkspace) -> SolveError {
        self.coarse.multiply(outputs, &mut w.scores);
        match () {
            () if w.scores.iter().any(|score| !score.is_finite()) => SolveError::OutOfProportion,
            () if outputs.iter().all(|output| *output == outputs[0]) => SolveError::AllEqual,
            () => SolveError::NoPress,
        }
    }

    pub(crate) fn check(&self, outputs: &[f64]) -> Result<(), SolveError> {
        if outputs.len() != self.outputs {
            return Err(SolveError::Channels { expected: self.outputs, found: outputs.len() });
        }
        let bad = outputs.iter().position(|output| !output.is_finite());
        bad.map_or(Ok(()), |unit| Err(SolveError::NotFinite { unit: unit + 1 }))
    }

    /// Returns the best fit over all starts, with some outputs left out.
    pub(crate) fn best(
        &self,
        outputs: &[f64],
        prior: ShearPrior,
        without: Range<usize>,
        w: &mut VectorWorkspace,
    ) -> Option<VectorFit> {
        self.coarse.seek(outputs, prior, without.clone(), w);
        let descent = VectorDescent::new(self, outputs, prior).without(without);
        let starts = std::mem::take(&mut w.starts);
        let fits = starts.iter().filter_map(|(_, at)| descent.from(self.coarse.places[*at], w));
        let best = fits.min_by(|a, b| a.chi2.total_cmp(&b.chi2));
        w.starts = starts;
        best
    }

    /// Returns the covariance for a known contact.
    pub(super) fn fitted(&self, place: Place, force_n: [f64; 3]) -> Option<VectorCovariance> {
        let outputs = vec![0.0; self.outputs];
        let descent = VectorDescent::new(self, &outputs, ShearPrior::None);
        let fit = VectorFit { place, force_n, chi2: 0.0, information: [[0.0; 5]; 5], beyond: 0.0 };
        covariance(&descent.information_at(&fit, &mut VectorWorkspace::default())?)
    }
}

fn covariance(information: &[[f64; 5]; 5]) -> Option<VectorCovariance> {
    crate::normal::inverse(information).map(VectorCovariance)
}
