//! View of a reading: the input of a regression.

use super::centred::column_means;
use super::{Calibration, ForceKnown};
use faer::Mat;
use serde::{Deserialize, Serialize};

/// Coordinates of a reading that a regression from readings to places uses.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct View {
    kind: ViewKind,
    /// Factor by which each output is multiplied first.
    scale: Vec<f64>,
    /// Factor by which each coordinate is multiplied at the end; empty if there are no factors.
    stretch: Vec<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum ViewKind {
    /// The reading divided by its length, and the logarithm of the length times a weight. With weight 0 the length isn't used.
    Direction(f64),
    /// The outputs, unchanged.
    Outputs,
    /// The inverse hyperbolic sines of the outputs. Near 0 they equal the outputs; far from 0 they are the outputs' logarithms
    /// with sign.
    Logarithms,
    /// The principal components of another view, each divided by its standard deviation.
    Components(Box<Components>),
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Components {
    of: ViewKind,
    /// Mean of each coordinate of the other view.
    mean: Vec<f64>,
    /// Directions divided by the standard deviation along them, row-major, components x coordinates.
    rows: Vec<f64>,
}

/// Weights of the length that are tried. They are some tenths, like the distances between coordinates of directions.
const WEIGHTS: [f64; 3] = [0.03, 0.1, 0.3];

/// Factor of an output, divided by the output's root mean square, before the inverse hyperbolic sine is taken. The logarithm
/// begins at a tenth of the typical output.
const LOGARITHMIC_FROM: f64 = 10.0;

/// Least standard deviation of a principal component, relative to the largest one. Smaller ones are rounding errors.
const LEAST_COMPONENT: f64 = 1e-6;

/// Least spread of the lengths at one place (standard deviation of their logarithm) that is more than noise.
const SEVERAL_LENGTHS: f64 = 0.2;

impl View {
    /// Returns the views that may suit a calibration, the simplest first.
    pub(crate) fn suitable(calibration: &Calibration, load: ForceKnown) -> Vec<View> {
        let alike = vec![1.0 / root_mean_square(calibration, None).max(f64::MIN_POSITIVE); calibration.units()];
        let of_unit = |unit| match root_mean_square(calibration, Some(unit)) {
            0.0 => alike[0],
            rms => 1.0 / rms,
        };
        let each: Vec<f64> = (0..calibration.units()).map(of_unit).collect();
        let view = |kind: ViewKind, scale: &[f64]| View { kind, scale: scale.to_vec(), stretch: Vec::new() };
        let sees_amplitude =
            load == ForceKnown::Constant || calibration.has_several_forces() || has_several_lengths(calibration);
        let first = match load {
            ForceKnown::Unknown => view(ViewKind::Direction(0.0), &alike),
            ForceKnown::Constant => view(ViewKind::Outputs, &alike),
        };
        let mut views = vec![first];
        if sees_amplitude {
            views.extend(WEIGHTS.map(|weight| view(ViewKind::Direction(weight), &alike)));
            views.extend([view(ViewKind::Outputs, &each), view(ViewKind::Logarithms, &each)]);
        }
        views
    }

    /// Returns the view of only the direction.
    pub(crate) fn of_direction(calibration: &Calibration) -> View {
        View { kind: ViewKind::Direction(0.0), scale: vec![1.0; calibration.units()], stretch: Vec::new() }
    }

    /// Returns the number of coordinates of a reading.
    pub(crate) fn dimensions(&self) -> usize {
        match &self.kind {
            ViewKind::Direction(weight) => self.scale.len() + usize::from(*weight > 0.0),
            ViewKind::Outputs | ViewKind::Logarithms => self.scale.len(),
            ViewKind::Components(components) => components.rows.len() / components.mean.len(),
        }
    }

    /// Returns a view of the principal components of these rows of this view, at most so many; `None` if they can't be found.
    pub(crate) fn components(&self, rows: &[f64], most: usize) -> Option<View> {
        let mean = column_means(rows, self.dimensions());
        let count = rows.len() / mean.len();
        let centred = Mat::from_fn(count, mean.len(), |row, column| rows[row * mean.len() + column] - mean[column]);
        let svd = centred.thin_svd().ok()?;
        let (lengths, directions) = (svd.S().column_vector(), svd.V());
        let least = LEAST_COMPONENT * lengths.iter().copied().reduce(f64::max)?;
        let kept = (0..lengths.nrows().min(most)).filter(|&i| lengths[i] > least);
        let of_component = |i: usize| {
            let over_sd = (count as f64).sqrt() / lengths[i];
            directions.col(i).iter().map(move |direction| direction * over_sd)
        };
        let rows: Vec<f64> = kept.flat_map(of_component).collect();
        let components = Components { of: self.kind.clone(), mean, rows };
        let kind = ViewKind::Components(Box::new(components));
        Some(View { kind, scale: self.scale.clone(), stretch: Vec::new() })
    }

    /// Multiplies each coordinate by its own factor.
    pub(crate) fn stretch(&mut self, factors: impl Iterator<Item = f64>) {
        self.stretch = factors.collect();
    }

    /// Returns the length of a reading with scaled outputs.
    pub(crate) fn length(&self, outputs: &[f64]) -> f64 {
        outputs.iter().zip(&self.scale).map(|(output, scale)| (output * scale).powi(2)).sum::<f64>().sqrt()
    }

    /// Appends the view of a reading of that length.
    pub(crate) fn see(&self, outputs: &[f64], length: f64, seen: &mut Vec<f64>) {
        let first = seen.len();
        self.kind.see(outputs.iter().zip(&self.scale).map(|(output, scale)| output * scale), length, seen);
        seen[first..].iter_mut().zip(&self.stretch).for_each(|(value, stretch)| *value *= stretch);
    }

    /// Returns the logarithm of the force for a reading of that length, if outputs are proportional to the force. Returns 0 in
    /// views that don't need this proportionality.
    pub(crate) fn log_proportional(&self, length: f64) -> f64 {
        self.kind.log_proportional(length)
    }
}

impl ViewKind {
    /// Appends the coordinates of a reading with scaled outputs and this length.
    fn see(&self, scaled: impl Iterator<Item = f64>, length: f64, seen: &mut Vec<f64>) {
        match self {
            ViewKind::Direction(weight) => {
                seen.extend(scaled.map(|output| output / length));
                if *weight > 0.0 {
                    seen.push(weight * length.ln());
                }
            }
            ViewKind::Outputs => seen.extend(scaled),
            ViewKind::Logarithms => seen.extend(scaled.map(|output| (LOGARITHMIC_FROM * output).asinh())),
            ViewKind::Components(components) => components.see(scaled, length, seen),
        }
    }

    fn log_proportional(&self, length: f64) -> f64 {
        match self {
            ViewKind::Direction(_) => length.ln(),
            ViewKind::Outputs | ViewKind::Logarithms => 0.0,
            ViewKind::Components(components) => components.of.log_proportional(length),
        }
    }
}

impl Components {
    fn see(&self, scaled: impl Iterator<Item = f64>, length: f64, seen: &mut Vec<f64>) {
        // the other view's coordinates, then the components, which replace them
        let first = seen.len();
        self.of.see(scaled, length, seen);
        seen[first..].iter_mut().zip(&self.mean).for_each(|(value, mean)| *value -= mean);
        let past = seen.len();
        for row in self.rows.chunks_exact(self.mean.len()) {
            let sum = seen[first..past].iter().zip(row).map(|(value, weight)| value * weight).sum();
            seen.push(sum);
        }
        seen.drain(first..past);
    }
}

/// Root mean square of a calibration's outputs, for one unit or for all.
fn root_mean_square(calibration: &Calibration, unit: Option<usize>) -> f64 {
    let squares = |outputs: &[f64]| match unit {
        Some(unit) => outputs[unit] * outputs[unit],
        None => outputs.iter().map(|output| output * output).sum::<f64>() / outputs.len() as f64,
    };
    (calibration.points().map(|point| squares(point.outputs)).sum::<f64>() / calibration.len() as f64).sqrt()
}

/// Whether readings at one place have several lengths, in the mean of all places. Then the length alone doesn't determine the
/// place.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn principal_components_are_uncorrelated_with_variance_1() {
        let view = View { kind: ViewKind::Outputs, scale: vec![2.0; 3], stretch: Vec::new() };
        // the third output is the sum of the others
        let readings: Vec<[f64; 3]> = (0..40)
            .map(|i| {
                let (a, b) = (f64::from(i % 8), 3.0 + 0.1 * f64::from(i / 8));
                [a, b, a + b]
            })
            .collect();
        let mut rows = Vec::new();
        readings.iter().for_each(|reading| view.see(reading, 1.0, &mut rows));
        let components = view.components(&rows, 32).unwrap();
        assert_eq!(components.dimensions(), 2);
        let mut seen = Vec::new();
        readings.iter().for_each(|reading| components.see(reading, 1.0, &mut seen));
        let mean = |of: &dyn Fn(&[f64]) -> f64| seen.chunks_exact(2).map(of).sum::<f64>() / 40.0;
        for (found, expected) in [
            (mean(&|row| row[0]), 0.0),
            (mean(&|row| row[1]), 0.0),
            (mean(&|row| row[0] * row[0]), 1.0),
            (mean(&|row| row[1] * row[1]), 1.0),
            (mean(&|row| row[0] * row[1]), 0.0),
        ] {
            assert!((found - expected).abs() < 1e-9, "{found} for {expected}");
        }
        assert_eq!(components.log_proportional(2.0), view.log_proportional(2.0));
    }
}
