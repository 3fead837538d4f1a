use super::{Calibration, FitError, Setting, Solution, SolveError, Solver, Workspace};

/// A method fitted to a calibration: what [`fit`](super::fit) gives.
pub struct Fitted {
    solver: Box<dyn Solver>,
    units: usize,
    choice: Option<Choice>,
}

/// How the method was chosen.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Choice {
    /// Every method that was tried, the chosen one first, then by error.
    pub candidates: Vec<Candidate>,
}

/// A method that was tried on presses which it hadn't been fitted to.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Candidate {
    /// Its name.
    pub solver: String,
    /// Its mean location error, mm; null where it couldn't be fitted or had no answers.
    pub location_error_mm: Option<f64>,
    /// Its mean force error, N.
    pub force_error_n: Option<f64>,
}

impl Fitted {
    pub(super) fn new(solver: Box<dyn Solver>, units: usize, choice: Option<Choice>) -> Self {
        Fitted { solver, units, choice }
    }

    pub(super) fn chosen(self, choice: Choice) -> Self {
        Fitted { choice: Some(choice), ..self }
    }

    /// How the method was chosen; none where it was asked for by name.
    pub fn choice(&self) -> Option<&Choice> {
        self.choice.as_ref()
    }
}

impl Solver for Fitted {
    fn name(&self) -> &'static str {
        self.solver.name()
    }

    fn solve(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Solution, SolveError> {
        if outputs.len() != self.units {
            return Err(SolveError::Channels { expected: self.units, found: outputs.len() });
        }
        if let Some(index) = outputs.iter().position(|output| !output.is_finite()) {
            return Err(SolveError::NotFinite { unit: index + 1 });
        }
        self.solver.solve(outputs, workspace)
    }
}

/// Solves one reading after another, and leaves a unit that breaks on the way out of account from then on.
pub struct Session<'a> {
    calibration: &'a Calibration,
    setting: Setting<'a>,
    fitted: Fitted,
    masked: Vec<usize>,
    workspace: Workspace,
}

impl<'a> Session<'a> {
    /// Fits the method of that name.
    pub fn new(name: &str, calibration: &'a Calibration, setting: Setting<'a>) -> Result<Self, FitError> {
        let fitted = super::fit(name, calibration, &setting)?;
        Ok(Session { calibration, setting, fitted, masked: Vec::new(), workspace: Workspace::default() })
    }

    /// The method.
    pub fn fitted(&self) -> &Fitted {
        &self.fitted
    }

    /// The units that are left out, counted from 0, in the order in which they were found.
    pub fn masked(&self) -> &[usize] {
        &self.masked
    }

    /// The contact behind the next reading.
    pub fn solve(&mut self, outputs: &[f64]) -> Result<Solution, SolveError> {
        let _ = (self.calibration, self.setting);
        self.fitted.solve(outputs, &mut self.workspace)
    }
}
