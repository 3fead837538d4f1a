//! What a regression sees of a reading.

use super::{Calibration, ForceKnown};
use serde::{Deserialize, Serialize};

/// What a regression from readings to places sees of a reading: its coordinates.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct View {
    kind: Kind,
    /// What each output is multiplied by first.
    scale: Vec<f64>,
    /// What each coordinate is multiplied by in the end; empty: nothing.
    stretch: Vec<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Kind {
    /// The reading over its length, and the logarithm of the length times a weight; of weight 0 it isn't seen.
    Direction(f64),
    /// The outputs as they are.
    Outputs,
    /// Their inverse hyperbolic sines: near 0 as they are, far from it their logarithms, with their sign.
    Logarithms,
}

/// Weights of the length that are tried: a direction's coordinates are some tenths apart, so are these.
const WEIGHTS: [f64; 3] = [0.03, 0.1, 0.3];

/// What an output is multiplied by, over its root mean square, before its inverse hyperbolic sine is taken: a tenth of the typical
/// output is where the logarithm begins.
const LOGARITHMIC_FROM: f64 = 10.0;

/// The spread of the lengths at one place, a standard deviation of their logarithm, from which they are more than noise.
const SEVERAL_LENGTHS: f64 = 0.2;

impl View {
    /// The views that may suit a calibration, the plainest first.
    pub fn suitable(calibration: &Calibration, load: ForceKnown) -> Vec<View> {
        let alike = vec![1.0 / root_mean_square(calibration, None).max(f64::MIN_POSITIVE); calibration.units()];
        let of_unit = |unit| match root_mean_square(calibration, Some(unit)) {
            0.0 => alike[0],
            rms => 1.0 / rms,
        };
        let each: Vec<f64> = (0..calibration.units()).map(of_unit).collect();
        let view = |kind, scale: &[f64]| View { kind, scale: scale.to_vec(), stretch: Vec::new() };
        let sees_amplitude =
            load == ForceKnown::Constant || calibration.has_several_forces() || has_several_lengths(calibration);
        let first = match load {
            ForceKnown::Unknown => view(Kind::Direction(0.0), &alike),
            ForceKnown::Constant => view(Kind::Outputs, &alike),
        };
        let mut views = vec![first];
        if sees_amplitude {
            views.extend(WEIGHTS.map(|weight| view(Kind::Direction(weight), &alike)));
            views.extend([view(Kind::Outputs, &each), view(Kind::Logarithms, &each)]);
        }
        views
    }

    /// The direction alone.
    pub fn of_direction(calibration: &Calibration) -> View {
        View { kind: Kind::Direction(0.0), scale: vec![1.0; calibration.units()], stretch: Vec::new() }
    }

    /// How many coordinates a reading has.
    pub fn dimensions(&self) -> usize {
        self.scale.len() + usize::from(matches!(self.kind, Kind::Direction(weight) if weight > 0.0))
    }

    /// Multiplies each coordinate by a factor of its own.
    pub fn stretch(&mut self, factors: impl Iterator<Item = f64>) {
        self.stretch = factors.collect();
    }

    /// The length of a reading, its outputs scaled.
    pub fn length(&self, outputs: &[f64]) -> f64 {
        outputs.iter().zip(&self.scale).map(|(output, scale)| (output * scale).powi(2)).sum::<f64>().sqrt()
    }

    /// Appends what is seen of a reading of that length.
    pub fn see(&self, outputs: &[f64], length: f64, seen: &mut Vec<f64>) {
        let first = seen.len();
        let scaled = outputs.iter().zip(&self.scale).map(|(output, scale)| output * scale);
        match self.kind {
            Kind::Direction(weight) => {
                seen.extend(scaled.map(|output| output / length));
                if weight > 0.0 {
                    seen.push(weight * length.ln());
                }
            }
            Kind::Outputs => seen.extend(scaled),
            Kind::Logarithms => seen.extend(scaled.map(|output| (LOGARITHMIC_FROM * output).asinh())),
        }
        seen[first..].iter_mut().zip(&self.stretch).for_each(|(value, stretch)| *value *= stretch);
    }

    /// The logarithm of the force that a reading of that length stands for, were outputs proportional to the force; 0 in views for
    /// which they needn't be.
    pub fn log_proportional(&self, length: f64) -> f64 {
        match self.kind {
            Kind::Direction(_) => length.ln(),
            Kind::Outputs | Kind::Logarithms => 0.0,
        }
    }
}

/// The root mean square of a calibration's outputs: of one unit, or of all.
fn root_mean_square(calibration: &Calibration, unit: Option<usize>) -> f64 {
    let squares = |outputs: &[f64]| match unit {
        Some(unit) => outputs[unit] * outputs[unit],
        None => outputs.iter().map(|output| output * output).sum::<f64>() / outputs.len() as f64,
    };
    (calibration.points().map(|point| squares(point.outputs)).sum::<f64>() / calibration.len() as f64).sqrt()
}

/// Whether readings at one place are of several lengths, in the mean of all places, so that the length alone doesn't determine the place.
pub(super) fn has_several_lengths(calibration: &Calibration) -> bool {
    let (mut squares, mut free) = (0.0, 0usize);
    for presses in calibration.by_place() {
        let square =
            |&press: &usize| calibration.point(press).outputs.iter().map(|output| output * output).sum::<f64>();
        let logs: Vec<f64> = presses.iter().map(square).filter(|sum| *sum > 0.0).map(|sum| 0.5 * sum.ln()).collect();
        let mean = logs.iter().sum::<f64>() / logs.len().max(1) as f64;
        squares += logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>();
        free += logs.len().saturating_sub(1);
    }
    free > 0 && squares / free as f64 > SEVERAL_LENGTHS * SEVERAL_LENGTHS
}
