use super::kriging::{Kriging, MOST_PLACES, Manner, farthest_apart};
use super::{Calibration, FitError, Load, Locate, Located, SolveError, Workspace};
use crate::quantity::Place;

/// The regression that a user would otherwise reach for: a Gaussian process straight from what was read to where it was pressed.
///
/// Its coordinates are the reading scaled to length 1, so that the force doesn't count; it answers x, y and the logarithm of
/// the reading's length a newton. Under a constant load the reading counts as it is. Nothing is assumed of how the pattern
/// moves with the contact, which makes it the method for skins whose pattern changes with the depth.
pub(super) struct GaussianProcess {
    process: Kriging,
    load: Load,
    /// The calibration's force where the load is constant, N.
    force_n: f64,
}

/// The correlation decides, so it is sought with most of the places that there are.
const MANNER: Manner = Manner { about_mean: true, most_to_seek_with: 320 };

/// What the process answers: x, y, logarithm of length a newton.
const ANSWERS: usize = 3;

impl GaussianProcess {
    pub fn fit(calibration: &Calibration, load: Load) -> Result<Self, FitError> {
        let units = calibration.units();
        let (mut inputs, mut answers) = (Vec::new(), Vec::new());
        for point in calibration.points() {
            let length = length(point.outputs);
            if length > 0.0 {
                let scale = scale(load, length);
                inputs.extend(point.outputs.iter().map(|output| output * scale));
                answers.extend([point.place.x_mm, point.place.y_mm, (length / point.force_n).ln()]);
            }
        }
        if inputs.is_empty() {
            return Err(FitError::NothingToTellApart);
        }
        if answers.len() > MOST_PLACES * ANSWERS {
            let kept = farthest_apart(&inputs, units, MOST_PLACES);
            inputs = kept.iter().flat_map(|&row| &inputs[row * units..][..units]).copied().collect();
            answers = kept.iter().flat_map(|&row| &answers[row * ANSWERS..][..ANSWERS]).copied().collect();
        }
        let process = Kriging::fit(&inputs, units, &answers, ANSWERS, MANNER);
        Ok(GaussianProcess { process, load, force_n: calibration.typical_force_n() })
    }
}

impl Locate for GaussianProcess {
    fn name(&self) -> &'static str {
        "gaussian-process"
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Located, SolveError> {
        let length = length(outputs);
        if !(length > 0.0) {
            return Err(SolveError::AllEqual);
        }
        let scale = scale(self.load, length);
        workspace.row.clear();
        workspace.row.extend(outputs.iter().map(|output| output * scale));
        let mut answer = [0.0; ANSWERS];
        let nearest = self.process.predict(&workspace.row, &mut answer);
        let force_n = match self.load {
            Load::Unknown => length / answer[2].exp(),
            Load::Constant => self.force_n,
        };
        if !force_n.is_finite() {
            return Err(SolveError::OutOfProportion);
        }
        Ok(Located { place: Place::new(answer[0], answer[1]), force_n, residue: nearest * nearest })
    }
}

/// What a reading of that length is multiplied by.
fn scale(load: Load, length: f64) -> f64 {
    match load {
        Load::Unknown => 1.0 / length,
        Load::Constant => 1.0,
    }
}

fn length(outputs: &[f64]) -> f64 {
    outputs.iter().map(|output| output * output).sum::<f64>().sqrt()
}
