//! Result of a fit: a method ready to solve.

use super::appraised::Appraised;
use super::broken::kept;
use super::by_load::{ByLoad, Lengths, LoadGain};
use super::forward::Forward;
use super::pearson::check;
use super::rescaled::Rescaled;
use super::solution::SolvedDepth;
use super::{
    Broken, Calibration, ContactVerdict, Covariance, DepthCurve, HalfWidths, Solution, SolveError, Solver, Workspace,
};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// A method fitted to a calibration: the result of [`fit`](super::fit).
#[derive(Serialize, Deserialize)]
pub struct Fitted {
    solver: Answering,
    units: usize,
    /// Units that the method uses, in its order; `None` if it uses all.
    kept: Option<Vec<usize>>,
    broken: Vec<Broken>,
    choice: Option<Choice>,
    /// Factors by which the stated errors of location and of force are multiplied.
    widened: [f64; 2],
    /// Factors that are already in the half-widths and the limits, and that another fit to these presses needs too. A sensor file has
    /// them after the model.
    #[serde(skip)]
    rescaled: Option<Rescaled>,
    /// Lengths of the calibration's readings, if all have one unknown load and no second method has them.
    lengths: Option<Lengths>,
    /// Curve by which solved forces are intensities of depths. A sensor file has it after the model.
    #[serde(skip)]
    depth: Option<DepthCurve>,
}

/// Method that states the uncertainty of its answers, from its own map or from held-out presses.
#[derive(Serialize, Deserialize)]
pub(super) enum Answering {
    Forward(Box<Forward>),
    Appraised(Box<Appraised>),
    ByLoad(ByLoad),
}

impl Answering {
    pub(super) fn solver(&self) -> &dyn Solver {
        match self {
            Answering::Forward(forward) => &**forward,
            Answering::Appraised(appraised) => &**appraised,
            Answering::ByLoad(by_load) => by_load,
        }
    }

    /// Multiplies the half-widths and the limits of a misfit.
    pub(super) fn rescale(&mut self, rescaled: &Rescaled) {
        match self {
            Answering::Forward(forward) => forward.rescale(rescaled),
            Answering::Appraised(appraised) => appraised.rescale(rescaled),
            Answering::ByLoad(by_load) => by_load.rescale(rescaled),
        }
    }

    /// Part of a solution's stated variance of location that is due to the map's error.
    fn of_map(&self, outputs: &[f64], solution: &Solution, workspace: &mut Workspace) -> f64 {
        match self {
            Answering::Forward(forward) => forward.of_map_stated(outputs, workspace),
            Answering::Appraised(appraised) => appraised.of_map(solution.force_n),
            Answering::ByLoad(by_load) if solution.is_calibrated_load => {
                by_load.calibrated.of_map(outputs, solution, workspace)
            }
            Answering::ByLoad(by_load) => by_load.any.of_map(outputs, solution, workspace),
        }
    }

    /// Largest residue of one contact, under the calibration's force.
    pub(super) fn most_residue(&self) -> f64 {
        match self {
            Answering::Forward(forward) => forward.limits.one_contact,
            Answering::Appraised(appraised) => appraised.most_residue(),
            Answering::ByLoad(by_load) => by_load.any.most_residue(),
        }
    }
}

/// How the method was chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// Every method that was tried: the chosen one first, then the others by error.
    pub candidates: Vec<TriedMethod>,
    /// Methods that are nearly as good as the chosen one. A sensor file doesn't keep them.
    #[serde(skip)]
    pub ties: Vec<Tie>,
    /// Mean location error of an answer that is always the mean place, mm, on the same presses. A sensor file doesn't keep it.
    #[serde(skip)]
    pub mean_place_error_mm: Option<f64>,
    /// What a second method gains that assumes the load of the calibration, if it is used. A sensor file doesn't keep it.
    #[serde(skip)]
    pub load_gain: Option<LoadGain>,
}

impl Choice {
    /// Mean location error of the chosen method on held-out presses, mm.
    pub fn location_error_mm(&self) -> Option<f64> {
        self.candidates.first()?.location_error_mm
    }
}

/// A method with nearly the same location error as the chosen one.
#[derive(Clone, Debug, PartialEq)]
pub struct Tie {
    /// Name of the method.
    pub solver: String,
    /// Difference of both mean errors, in standard errors of this difference.
    pub sigmas: f64,
}

/// A method that was tried on presses to which it hadn't been fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TriedMethod {
    /// Name of the method.
    pub solver: String,
    /// Mean location error, mm; null if the method couldn't be fitted or had no answers.
    pub location_error_mm: Option<f64>,
    /// Mean force error, N.
    pub force_error_n: Option<f64>,
}

impl Fitted {
    /// Returns a method for an array of `units`, all of which are used.
    pub(super) fn new(solver: Answering, units: usize) -> Self {
        Fitted {
            solver,
            units,
            kept: None,
            broken: Vec::new(),
            choice: None,
            widened: [1.0; 2],
            rescaled: None,
            lengths: None,
            depth: None,
        }
    }

    /// Returns the same method for an array of `units`, of which some are left out.
    pub(super) fn without(self, broken: Vec<Broken>, units: usize) -> Self {
        let kept = (!broken.is_empty()).then(|| kept(units, &broken));
        Fitted { units, kept, broken, ..self }
    }

    /// Returns the same method for a calibration with one unknown load.
    pub(super) fn of_one_load(self, calibration: &Calibration) -> Self {
        match self.solver {
            Answering::ByLoad(_) => self,
            Answering::Forward(_) | Answering::Appraised(_) => {
                Fitted { lengths: Some(Lengths::of(calibration)), ..self }
            }
        }
    }

    /// Returns the same method, whose forces are intensities of depths if there is a curve.
    pub(super) fn with_depth_curve(self, depth: Option<DepthCurve>) -> Self {
        Fitted { depth, ..self }
    }

    /// Returns the curve from depth to intensity, if the method solves depths instead of forces.
    pub fn depth_curve(&self) -> Option<&DepthCurve> {
        self.depth.as_ref()
    }

    pub(super) fn chosen(self, choice: Choice) -> Self {
        Fitted { choice: Some(choice), ..self }
    }

    /// Returns an inverted map with half-widths from presses to which it wasn't fitted.
    pub(super) fn with_half_widths_of(mut self, test: &Calibration) -> Self {
        if let Answering::Forward(forward) = &mut self.solver {
            forward.learn_half_widths(test);
        }
        self
    }

    /// Returns an inverted map without half-widths.
    pub(super) fn without_half_widths(mut self) -> Self {
        if let Answering::Forward(forward) = &mut self.solver {
            forward.forget_half_widths();
        }
        self
    }

    /// Part of a solution's stated variance of location that is due to the map's error, 0 to 1.
    pub(super) fn of_map(&self, outputs: &[f64], solution: &Solution, workspace: &mut Workspace) -> f64 {
        let row: Vec<f64> = self.kept().into_iter().map(|unit| outputs[unit]).collect();
        self.solver.of_map(&row, solution, workspace)
    }

    /// Returns the same method with other half-widths and limits of a misfit.
    pub(super) fn rescaled(mut self, rescaled: &Rescaled) -> Self {
        self.solver.rescale(rescaled);
        self
    }

    /// Returns the method with the factors that another fit to its presses needs, which aren't applied here.
    pub(super) fn needing(self, rescaled: Option<Rescaled>) -> Self {
        Fitted { rescaled, ..self }
    }

    /// Returns the factors that another fit to the presses needs; `None` if what its trials show is right.
    pub(super) fn needed(&self) -> Option<&Rescaled> {
        self.rescaled.as_ref()
    }

    /// Returns the same fit with another fit's factors for the stated errors.
    pub(super) fn stating_as(self, other: &Fitted) -> Self {
        let fitted = Fitted { widened: other.widened, ..self };
        match &other.rescaled {
            Some(rescaled) => fitted.rescaled(rescaled),
            None => fitted,
        }
    }

    /// Returns the factor of the stated errors of a contact that doesn't have the load of the calibration. The pattern of a skin may
    /// change with the load, and held-out presses can't show it. The errors grow with the ratio of both loads.
    fn other_load(&self, place: Place, outputs: &[f64]) -> f64 {
        let lengths = match &self.solver {
            Answering::ByLoad(by_load) => Some(&by_load.lengths),
            Answering::Forward(_) | Answering::Appraised(_) => self.lengths.as_ref(),
        };
        1.0 + lengths.and_then(|lengths| lengths.off(place, outputs)).unwrap_or(0.0)
    }

    /// Returns the solution with the stated errors widened. Numbers that aren't finite end here: a reading with such a solution
    /// has no answer, and such an error isn't stated.
    fn stated(&self, solution: Solution, outputs: &[f64]) -> Result<Solution, SolveError> {
        let Solution { place, force_n, covariance, half_widths, misfit, .. } = solution;
        if !(place.x_mm.is_finite() && place.y_mm.is_finite() && force_n.is_finite()) {
            return Err(SolveError::OutOfProportion);
        }
        let other_load = self.other_load(place, outputs);
        let [location, force] = self.widened.map(|by| by * other_load);
        let covariance = covariance.map(|sd| sd.widened([location, location, force]));
        let covariance = covariance.filter(|sd| sd.0.iter().flatten().all(|value| value.is_finite()));
        let half_widths = half_widths.map(|half| half.times(location, force)).filter(HalfWidths::is_finite);
        let misfit = misfit.filter(|misfit| misfit.is_finite());
        let solution = Solution { covariance, half_widths, misfit, ..solution };
        let depth = self.depth.as_ref().map(|curve| SolvedDepth::of(&solution, curve));
        Ok(Solution { depth, ..solution })
    }

    pub(super) fn answering(&self) -> &Answering {
        &self.solver
    }

    /// Returns the units that the method uses, in its order.
    pub(super) fn kept(&self) -> Vec<usize> {
        self.kept.clone().unwrap_or_else(|| (0..self.units).collect())
    }

    /// Returns the name of the method that answers readings with the load of the calibration, if it is a second one.
    pub fn at_calibrated_load(&self) -> Option<&'static str> {
        match &self.solver {
            Answering::ByLoad(by_load) => Some(by_load.calibrated.solver().name()),
            Answering::Forward(_) | Answering::Appraised(_) => None,
        }
    }

    /// Returns how the method was chosen; `None` if it was requested by name.
    pub fn choice(&self) -> Option<&Choice> {
        self.choice.as_ref()
    }

    /// Returns the units that are excluded. Their readings change nothing.
    pub fn broken(&self) -> &[Broken] {
        &self.broken
    }
}

impl Solver for Fitted {
    fn name(&self) -> &'static str {
        self.solver.solver().name()
    }

    fn solve(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Solution, SolveError> {
        let Some(kept) = &self.kept else {
            check(outputs, self.units)?;
            return self.stated(self.solver.solver().solve(outputs, workspace)?, outputs);
        };
        if outputs.len() != self.units {
            return Err(SolveError::Channels { expected: self.units, found: outputs.len() });
        }
        let mut row = std::mem::take(&mut workspace.kept);
        row.clear();
        row.extend(kept.iter().map(|&unit| outputs[unit]));
        let solved = check(&row, row.len()).and_then(|()| self.solver.solver().solve(&row, workspace));
        workspace.kept = row;
        let mut solution = solved.map_err(|error| match error {
            SolveError::NotFinite { unit } => SolveError::NotFinite { unit: kept[unit - 1] + 1 },
            other => other,
        })?;
        if let ContactVerdict::ChannelFault(unit) = &mut solution.verdict {
            *unit = kept[*unit];
        }
        self.stated(solution, &workspace.kept)
    }

    fn expected(&self, place: Place, force_n: f64) -> Option<Covariance> {
        let [location, force] = self.widened;
        self.solver.solver().expected(place, force_n).map(|sd| sd.widened([location, location, force]))
    }
}
