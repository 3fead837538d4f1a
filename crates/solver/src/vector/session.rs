//! Solves one reading after another as force vectors, with missing outputs.

use super::map::FEWEST_OUTPUTS;
use super::{VectorModel, VectorSolution, VectorWorkspace};
use crate::causes::Causes;
use crate::fits::MOST_FITS;
use crate::{SolveError, Unanswered};
use palpate_core::parallel::lock;
use palpate_core::quantity::Place;
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock};

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
    made: Arc<OnceLock<Arc<Causes>>>,
}

/// Solves one reading after another. A missing output is NaN: such a reading is solved by the same map without this output.
pub struct VectorSession {
    fits: Arc<VectorFits>,
    workspace: VectorWorkspace,
    /// Last two contacts. The first of the next ones is the one that is nearer to the first of these.
    last: Option<[Place; 2]>,
}

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

    /// Returns the map for some of the outputs, with limits of its own. It is kept; beyond [`MOST_FITS`] it replaces the one that wasn't
    /// needed for longest. Sessions that need the same map wait for it.
    fn of_outputs(&self, kept: &[usize]) -> Arc<Causes> {
        let made = {
            let mut partial = lock(&self.partial);
            let known = partial.iter().position(|partial| partial.kept == kept).map(|at| partial.remove(at));
            let latest = known.unwrap_or_else(|| Partial { kept: kept.to_vec(), made: Arc::default() });
            if partial.len() >= MOST_FITS {
                partial.remove(0);
            }
            partial.push(latest.clone());
            latest.made
        };
        made.get_or_init(|| {
            let position = |output: usize| kept.partition_point(|kept| *kept < output);
            let units = self.model.layout.units().enumerate();
            let units = units.map(|(unit, outputs)| (unit, position(outputs.start)..position(outputs.end)));
            let units: Vec<(usize, Range<usize>)> = units.filter(|(_, outputs)| !outputs.is_empty()).collect();
            Arc::new(Causes::of(Arc::new(self.model.map.of_outputs(kept)), units, None))
        })
        .clone()
    }
}

impl VectorSession {
    /// Creates a session.
    pub fn new(fits: Arc<VectorFits>) -> Self {
        VectorSession { fits, workspace: VectorWorkspace::default(), last: None }
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
        let mut solution = self.solve_known(outputs)?;
        if let Some(pair) = &mut solution.pair {
            let way_mm = |[a, b]: [Place; 2], last: [Place; 2]| a.distance_mm(last[0]) + b.distance_mm(last[1]);
            let [first, second] = pair.places;
            if self.last.is_some_and(|last| way_mm([second, first], last) < way_mm([first, second], last)) {
                pair.places.swap(0, 1);
                pair.forces_n.swap(0, 1);
                pair.errors_mm.swap(0, 1);
                pair.errors_n.swap(0, 1);
            }
            self.last = Some(pair.places);
        }
        Ok(solution)
    }

    /// Solves a reading by the outputs that it has.
    fn solve_known(&mut self, outputs: &[f64]) -> Result<VectorSolution, Unanswered> {
        let found = outputs.len();
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
