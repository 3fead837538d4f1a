//! Force from a series of readings: `evaluate --history`.

use super::columns::ColumnsOptions;
use super::recorded::read_presses;
use super::{Failure, Note};
use palpate_solver::{HistoryEvaluation, Series, evaluate_history};
use std::path::Path;

/// Evaluates whether earlier readings lower the error of the force in a table with times.
pub(super) fn evaluated(source: &Path, columns: &ColumnsOptions, note: Note<'_>) -> Result<HistoryEvaluation, Failure> {
    let presses = read_presses(source, &columns.mapping()?.of_series(), None, note)?.presses;
    let sound = presses.iter().filter(|press| !press.is_flagged());
    let rows = sound.filter_map(|press| Some((press.t_s?, press.outputs.as_slice(), press.force_n?)));
    Series::new(rows).and_then(|series| evaluate_history(&series)).map_err(|error| {
        let help = "a series has columns for time, force and outputs: --columns t_s=time,force_n=Fz,outputs=ch0..ch15";
        Failure::usage(miette::miette!(help = help, "{}: {error}", source.display()))
    })
}
