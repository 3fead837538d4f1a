//! Working memory of a solver.

use super::scan;
use palpate_core::quantity::Place;

/// Working memory of a solver, kept from one reading to the next so that no reading allocates. A workspace belongs to the readings of one
/// session.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    /// Row with the reading's length.
    pub(super) row: Vec<f64>,
    /// Outputs of the units that count.
    pub(super) kept: Vec<f64>,
    /// Buffers for fitting a response.
    pub(super) buffers: Buffers,
    /// Expected pattern at the place.
    pub(super) pattern: Vec<f64>,
    /// Starting places for the best fit, each with the similarity of the reading to the response there.
    pub(super) starts: Vec<(f32, Place)>,
    /// Buffers for the search of a table.
    pub(super) scratch: scan::Scratch,
    /// Fraction of the last readings that don't have the load of the calibration. Only a solver with a second method for this load
    /// keeps it.
    pub(super) other_loads: f64,
}

/// Buffers with one value for each unit.
#[derive(Clone, Debug, Default)]
pub(super) struct Buffers {
    pub value: Vec<f64>,
    pub along_x: Vec<f64>,
    pub along_y: Vec<f64>,
    pub weight: Vec<f64>,
    pub leverage: Vec<f64>,
}
