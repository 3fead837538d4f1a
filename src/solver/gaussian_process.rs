//! A Gaussian process from outputs to the place.

use super::kriging::{Kriging, MOST_PLACES, Regression, Sought, farthest_apart};
use super::{Calibration, FitError, ForceKnown, Locate, Located, SolveError, Workspace};
use crate::quantity::Place;

/// The regression that a user would otherwise reach for: a Gaussian process straight from what was read to where it was pressed.
///
/// Its coordinates are the reading scaled to length 1, so that the force doesn't count; it answers x, y and the logarithm of
/// the reading's length a newton. Under a constant load the reading counts as it is. Where the calibration was pressed with several
/// forces, the logarithm of the length is one more coordinate, weighted as the calibration makes it likely: outputs then needn't be
/// proportional to the force. Nothing is assumed of how the pattern moves with the contact, which makes it the method for skins
/// whose pattern changes with the depth.
pub(super) struct GaussianProcess {
    process: Kriging,
    view: View,
    /// The calibration's force where the load is constant, N.
    force_n: f64,
}

/// What the process sees of a reading.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    load: ForceKnown,
    /// What the logarithm of the reading's length is multiplied by; 0: it isn't seen.
    weight_of_length: f64,
}

/// What the process answers: x, y, logarithm of length a newton.
const ANSWERS: usize = 3;

/// The correlation decides, so it is sought with most of the places that there are.
const MANNER: Regression = Regression { about_mean: true, most_to_seek_with: 320 };

/// Weights of the length that are tried: a direction's coordinates are some tenths apart, so are these.
const WEIGHTS: [f64; 4] = [0.0, 0.03, 0.1, 0.3];

impl GaussianProcess {
    pub fn fit(calibration: &Calibration, load: ForceKnown) -> Result<Self, FitError> {
        Self::fit_with(calibration, Self::seek(calibration, load)?)
    }

    /// The view and the correlation that make a calibration likeliest.
    pub fn seek(calibration: &Calibration, load: ForceKnown) -> Result<(View, Sought), FitError> {
        let has_several_forces = load == ForceKnown::Unknown && calibration.has_several_forces();
        let weights = if has_several_forces { &WEIGHTS[..] } else { &WEIGHTS[..1] };
        let tried = weights.iter().filter_map(|&weight_of_length| {
            let view = View { load, weight_of_length };
            let Seen { inputs, dimensions, answers } = Seen::of(calibration, view)?;
            Some((view, Kriging::seek(&inputs, dimensions, &answers, ANSWERS, MANNER)))
        });
        let better = |a: (View, Sought), b: (View, Sought)| if b.1.likelihood > a.1.likelihood { b } else { a };
        tried.reduce(better).ok_or(FitError::NothingToTellApart)
    }

    /// The same with a view and a correlation that are known.
    pub fn fit_with(calibration: &Calibration, (view, sought): (View, Sought)) -> Result<Self, FitError> {
        let Seen { inputs, dimensions, answers } = Seen::of(calibration, view).ok_or(FitError::NothingToTellApart)?;
        let process = Kriging::fit_with(&inputs, dimensions, &answers, ANSWERS, MANNER, sought);
        Ok(GaussianProcess { process, view, force_n: calibration.typical_force_n() })
    }
}

/// What a calibration looks like to the process.
struct Seen {
    /// Row-major, presses x dimensions.
    inputs: Vec<f64>,
    dimensions: usize,
    /// Row-major, presses x `ANSWERS`.
    answers: Vec<f64>,
}

impl Seen {
    /// None where no press reads anything.
    fn of(calibration: &Calibration, view: View) -> Option<Self> {
        let dimensions = view.dimensions(calibration.units());
        let (mut inputs, mut answers) = (Vec::new(), Vec::new());
        for point in calibration.points() {
            let length = length(point.outputs);
            if length > 0.0 {
                view.see(point.outputs, length, &mut inputs);
                answers.extend([point.place.x_mm, point.place.y_mm, (length / point.force_n).ln()]);
            }
        }
        if answers.len() > MOST_PLACES * ANSWERS {
            let kept = farthest_apart(&inputs, dimensions, MOST_PLACES);
            inputs = kept.iter().flat_map(|&row| &inputs[row * dimensions..][..dimensions]).copied().collect();
            answers = kept.iter().flat_map(|&row| &answers[row * ANSWERS..][..ANSWERS]).copied().collect();
        }
        (!inputs.is_empty()).then_some(Seen { inputs, dimensions, answers })
    }
}

impl Locate for GaussianProcess {
    fn name(&self) -> &'static str {
        "gaussian-process"
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Located, SolveError> {
        let length = length(outputs);
        if length == 0.0 {
            return Err(SolveError::AllEqual);
        }
        workspace.row.clear();
        self.view.see(outputs, length, &mut workspace.row);
        let mut answer = [0.0; ANSWERS];
        let nearest = self.process.predict(&workspace.row, &mut answer);
        let force_n = match self.view.load {
            ForceKnown::Unknown => length / answer[2].exp(),
            ForceKnown::Constant => self.force_n,
        };
        if !force_n.is_finite() {
            return Err(SolveError::OutOfProportion);
        }
        Ok(Located { place: Place::new(answer[0], answer[1]), force_n, residue: nearest * nearest, ..Located::PLAIN })
    }
}

impl View {
    fn dimensions(self, units: usize) -> usize {
        units + usize::from(self.weight_of_length > 0.0)
    }

    /// Appends what is seen of a reading of that length.
    fn see(self, outputs: &[f64], length: f64, seen: &mut Vec<f64>) {
        let scale = match self.load {
            ForceKnown::Unknown => 1.0 / length,
            ForceKnown::Constant => 1.0,
        };
        seen.extend(outputs.iter().map(|output| output * scale));
        if self.weight_of_length > 0.0 {
            seen.push(self.weight_of_length * length.ln());
        }
    }
}

fn length(outputs: &[f64]) -> f64 {
    outputs.iter().map(|output| output * output).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::CalibrationPoint;

    /// Two units that go on reading less and less of more force.
    fn outputs(x_mm: f64, force_n: f64) -> [f64; 2] {
        [1.0 - x_mm, 1.0 + x_mm].map(|near| (0.5 * near * force_n).tanh())
    }

    #[test]
    fn outputs_of_several_forces_need_not_be_proportional() {
        let presses: Vec<(f64, f64, [f64; 2])> = (0..11)
            .flat_map(|i| [0.25, 0.5, 1.0, 1.5, 2.0].map(|force_n| (-0.5 + 0.1 * f64::from(i), force_n)))
            .map(|(x_mm, force_n)| (x_mm, force_n, outputs(x_mm, force_n)))
            .collect();
        let point = |(x_mm, force_n, outputs)| CalibrationPoint { place: Place::new(x_mm, 0.0), force_n, outputs };
        let points: Vec<_> = presses.iter().map(|(x_mm, force_n, outputs)| point((*x_mm, *force_n, outputs))).collect();
        let process = GaussianProcess::fit(&Calibration::new(&points).unwrap(), ForceKnown::Unknown).unwrap();
        assert!(process.view.weight_of_length > 0.0);
        let located = process.locate(&outputs(0.13, 1.7), &mut Workspace::default()).unwrap();
        assert!((located.place.x_mm - 0.13).abs() < 0.02 && (located.force_n - 1.7).abs() < 0.05, "{located:?}");
    }

    #[test]
    fn under_a_constant_load_the_amplitude_tells_the_place() {
        let rows: Vec<[f64; 1]> = (0..11).map(|i| [1.0 + 0.1 * f64::from(i)]).collect();
        let point = |(i, outputs)| CalibrationPoint { place: Place::new(i as f64, 0.0), force_n: 1.0, outputs };
        let points: Vec<_> = rows.iter().map(|row| row.as_slice()).enumerate().map(point).collect();
        let calibration = Calibration::new(&points).unwrap();
        let process = GaussianProcess::fit(&calibration, ForceKnown::Constant).unwrap();
        let located = process.locate(&[1.45], &mut Workspace::default()).unwrap();
        assert!((located.place.x_mm - 4.5).abs() < 0.1 && located.force_n == 1.0, "{located:?}");
    }
}
