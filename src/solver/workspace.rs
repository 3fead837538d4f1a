//! Working memory of a solver.

use super::scan;
use crate::quantity::Place;

/// Working memory of a solver, kept from one reading to the next so that no reading allocates.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    /// A row of the reading's length.
    pub(super) row: Vec<f64>,
    /// What is read of the units that count.
    pub(super) kept: Vec<f64>,
    /// Room to fit a response.
    pub(super) buffers: Buffers,
    /// What is expected there.
    pub(super) pattern: Vec<f64>,
    /// The same, centred.
    pub(super) centred: Vec<f64>,
    /// How alike a reading is to the response at places from which the best fit is sought, and these.
    pub(super) starts: Vec<(f32, Place)>,
    /// Room for the search of a table.
    pub(super) scratch: scan::Scratch,
}

/// One value a unit each.
#[derive(Clone, Debug, Default)]
pub(super) struct Buffers {
    pub value: Vec<f64>,
    pub along_x: Vec<f64>,
    pub along_y: Vec<f64>,
    pub weight: Vec<f64>,
    pub leverage: Vec<f64>,
}
