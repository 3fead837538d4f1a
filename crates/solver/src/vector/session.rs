//! Solves one reading after another as force vectors, with missing outputs.

use super::{VectorModel, VectorSolution, VectorWorkspace};
use crate::causes::Causes;
use crate::fits::MOST_FITS;
use crate::{SolveError, Unanswered};
use palpate_core::parallel::lock;
use std::ops::Range;
use std::sync::{Arc, Mutex};

/// A model ready to solve, with its maps without some outputs. Sessions share it.
pub struct VectorFits {
    model: VectorModel,
    whole: Causes,
    partial: Mutex<Vec<Partial>>,
}

/// Map without some outputs.
#[derive(Clone)]
struct Partial {
    kept: Vec<usize>,
    causes: Arc<Causes>,
}

/// Solves one reading after another. A missing output is NaN: such a reading is solved by the same map without this output.
pub struct VectorSession {
    fits: Arc<VectorFits>,
    workspace: VectorWorkspace,
}

/// Least number of outputs of a solved reading: as many as the unknowns of a press.
const FEWEST_OUTPUTS: usize = 3;

impl VectorFits {
    /// Prepares a model.
    pub fn new(model: VectorModel) -> Self {
        let units = model.layout.units().enumerate().collect();
        let whole = Causes::of(Arc::new(model.map.clone()), units, Some(model.limits));
        VectorFits { model, whole, partial: Mutex::default() }
    }

    /// Returns the model.
    pub fn model(&self) -> &VectorModel {
        &self.model
    }

    /// Returns the map for some of the outputs, with limits of its own. It is kept; beyond [`MOST_FITS`] it replaces the oldest one.
    fn of_outputs(&self, kept: &[usize]) -> Arc<Causes> {
        let known = |partial: &[Partial]| partial.iter().find(|made| made.kept == kept).map(|made| made.causes.clone());
        if let Some(causes) = known(&lock(&self.partial)) {
            return causes;
        }
        // other sessions continue meanwhile
        let position = |output: usize| kept.partition_point(|kept| *kept < output);
        let units = self.model.layout.units().enumerate();
        let units = units.map(|(unit, outputs)| (unit, position(outputs.start)..position(outputs.end)));
        let units: Vec<(usize, Range<usize>)> = units.filter(|(_, outputs)| !outputs.is_empty()).collect();
        let causes = Arc::new(Causes::of(Arc::new(self.model.map.of_outputs(kept)), units, None));
        let mut partial = lock(&self.partial);
        if partial.len() >= MOST_FITS {
            partial.remove(0);
        }
        partial.push(Partial { kept: kept.to_vec(), causes: causes.clone() });
        causes
    }
}

impl VectorSession {
    /// Creates a session.
    pub fn new(fits: Arc<VectorFits>) -> Self {
        VectorSession { fits, workspace: VectorWorkspace::default() }
    }

    /// Returns the model.
    pub fn model(&self) -> &VectorModel {
        &self.fits.model
    }

    /// Solves the next reading; a missing output is NaN.
    ///
    /// # Errors
    /// The reading has no answer, or too few outputs are left.
    pub fn solve(&mut self, outputs: &[f64]) -> Result<VectorSolution, Unanswered> {
        let (expected, found) = (self.fits.model.map.outputs(), outputs.len());
        if found != expected {
            return Err(SolveError::Channels { expected, found }.into());
        }
        if !outputs.iter().any(|output| output.is_nan()) {
            return Ok(self.fits.whole.solve(outputs, &mut self.workspace)?);
        }
        let kept: Vec<usize> = (0..found).filter(|output| !outputs[*output].is_nan()).collect();
        if kept.len() < FEWEST_OUTPUTS {
            return Err(if kept.is_empty() { Unanswered::NoOutputs } else { Unanswered::TooFewOutputs });
        }
        let left: Vec<f64> = kept.iter().map(|output| outputs[*output]).collect();
        Ok(self.fits.of_outputs(&kept).solve(&left, &mut self.workspace)?)
    }
}
