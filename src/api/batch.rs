//! The state of a batch.

use super::Failure;
use palpate_run::batch::{BatchState, read_state};
use std::path::Path;

/// Reads what became of each sensor of a batch, like `palpate batch status`. A batch can be read while it is in use.
///
/// # Errors
/// The path isn't a batch, or its journal is damaged.
pub fn batch_status(batch: &Path) -> Result<BatchState, Failure> {
    read_state(batch).map_err(Failure::batch)
}
