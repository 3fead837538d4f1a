use super::{Locate, Solution, SolveError, Solver, Verdict, Workspace};

/// A method that only locates, with what its calibration tells of its errors.
pub(super) struct Appraised<L> {
    method: L,
}

impl<L: Locate> Appraised<L> {
    pub fn new(method: L) -> Self {
        Appraised { method }
    }
}

impl<L: Locate> Solver for Appraised<L> {
    fn name(&self) -> &'static str {
        self.method.name()
    }

    fn solve(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Solution, SolveError> {
        let located = self.method.locate(outputs, workspace)?;
        Ok(Solution {
            place: located.place,
            force_n: located.force_n,
            covariance: None,
            misfit: None,
            verdict: Verdict::Ok,
        })
    }
}
