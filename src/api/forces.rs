//! Force vectors without a place: `evaluate --folds-by`.

use super::columns::ColumnsOptions;
use super::recorded::{read_presses, read_run};
use super::{Failure, Note};
use palpate_data::dataset::{Mapping, Press};
use palpate_solver::{ForceEvaluation, ForceTable, evaluate_forces};
use std::path::Path;

/// Number of parts in which rows are left out, in their order, if nothing groups them.
const BLOCKS: usize = 5;

/// Number of rows from which a note announces that it takes long.
const MANY_ROWS: usize = 5000;

/// Column name of the groups in a run.
const GROUP: &str = "group";

/// Errors of force vectors, and what was left out in turn.
pub struct ForcesEvaluated {
    /// The errors.
    pub errors: ForceEvaluation,
    /// What was left out.
    pub left_out: String,
}

/// Evaluates the force vectors of a table or of an imported run. Returns `None` if neither groups were named nor places are missing.
pub(super) fn evaluated(
    source: &Path,
    folds_by: Option<&str>,
    columns: &ColumnsOptions,
    note: Note<'_>,
) -> Result<Option<ForcesEvaluated>, Failure> {
    let mapping = columns.mapping()?;
    let is_run = source.is_dir();
    if folds_by.is_none() && !is_run && !mapping.has_force_vector() {
        return Ok(None);
    }
    let presses = if is_run {
        let (recorded, _) = read_run(source, &|_| {})?;
        if folds_by.is_none() && recorded.manifest.facts.imported.is_none() {
            return Ok(None);
        }
        if let Some(folds_by) = folds_by {
            check_group(recorded.texts.columns(), folds_by)?;
        }
        recorded.presses().presses
    } else {
        let mapping = folds_by.map_or(mapping.clone(), |column| mapping.grouped_by(column));
        read_presses(source, &mapping, None, note)?.presses
    };
    let has_places = presses.iter().any(|press| press.place() != presses[0].place());
    if folds_by.is_none() && (has_places || !presses.iter().any(|press| press.force_vector_n().is_some())) {
        return Ok(None);
    }
    let sound = presses.iter().filter(|press| !press.is_flagged());
    let used: Vec<(&Press, [f64; 3])> = sound.filter_map(|press| Some((press, press.force_vector_n()?))).collect();
    if used.is_empty() {
        let help = "name them in --columns: force_x_n=Fx,force_y_n=Fy,force_n=Fz,outputs=ch0..ch15";
        return Err(Failure::usage(miette::miette!(help = help, "--folds-by needs three columns with forces")));
    }
    let is_grouped = used.iter().all(|(press, _)| press.group.is_some());
    if folds_by.is_some() && !is_grouped {
        let help = "import the table with `group` in its columns file";
        return Err(Failure::usage(miette::miette!(help = help, "{}: its presses have no groups", source.display())));
    }
    if used.len() > MANY_ROWS {
        note(&format!("note: {} rows: the regressions take some minutes", used.len()));
    }
    let size = used.len().div_ceil(BLOCKS);
    let rows = used.iter().enumerate().map(|(row, (press, force_n))| {
        (press.outputs.as_slice(), *force_n, press.group.map_or((row / size) as u64, |group| group as u64))
    });
    let errors = ForceTable::new(rows).and_then(|table| evaluate_forces(&table)).map_err(|error| {
        let help = "a group is left out as a whole: name a column with several values, and enough rows without each";
        Failure::usage(miette::miette!(help = help, "{}: {error}", source.display()))
    })?;
    let left_out = match (folds_by, is_grouped) {
        (Some(column), _) => format!("groups by `{column}`"),
        (None, true) => format!("groups by `{GROUP}`"),
        (None, false) => "in their order".to_owned(),
    };
    Ok(Some(ForcesEvaluated { errors, left_out }))
}

/// Checks that the presses of a run were grouped by this column when they were imported.
fn check_group(columns: &str, folds_by: &str) -> Result<(), Failure> {
    let mapping = Mapping::parse("columns.toml", columns).map_err(Failure::usage)?;
    match mapping.group() {
        Some(group) if folds_by == group || folds_by == GROUP => Ok(()),
        Some(group) => {
            let help = format!("write --folds-by {group}");
            Err(Failure::usage(miette::miette!(help = help, "--folds-by {folds_by}: this run is grouped by `{group}`")))
        }
        None => {
            let help = "import the table with `group` in its columns file, or evaluate the table";
            Err(Failure::usage(miette::miette!(help = help, "--folds-by {folds_by}: this run has no groups")))
        }
    }
}
