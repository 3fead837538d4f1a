//! From a table to a calibration: which rows count, and whose force.

use super::table::{Row, Table};
use crate::solver::{Calibration, CalibrationError, CalibrationPoint, FitError, Load};
use miette::Diagnostic;

/// Why a table is no calibration; all of them are exit code 2.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum CalibrateError {
    /// A table has no press of the kind asked for.
    #[error("{file}: there is no {phase} press to evaluate with ({flagged} are flagged and left out)")]
    #[diagnostic(help(
        "an evaluation needs presses of both phases, or two tables: \
         --calibration runs/calibrate/presses.csv --test runs/test/presses.csv"
    ))]
    NoPresses {
        /// The table.
        file: String,
        /// calibration or test.
        phase: &'static str,
        /// How many of them are flagged.
        flagged: usize,
    },
    /// A row can't be calibrated on.
    #[error("{file}, line {line}, column `{column}`: the press can't be calibrated on")]
    #[diagnostic(help("correct the row, or remove it"))]
    Press {
        /// The calibration's table.
        file: String,
        /// The row's line.
        line: u64,
        /// The column its force comes from.
        column: &'static str,
        /// What is wrong.
        source: CalibrationError,
    },
    /// The method can't be fitted.
    #[error("{file}: can't be calibrated on")]
    Fit {
        /// The calibration's table.
        file: String,
        /// Why.
        source: FitError,
    },
}

/// The calibration presses of a run, by the load cell's force.
pub fn calibration_of_run(table: &Table, load: Load) -> Result<Calibration, CalibrateError> {
    Selection::of_phase(table, "calibration")?.calibration(&LOAD_CELL, load)
}

/// Every press of a table. Without `force_n` the forces are relative, see [`Calibration::without_forces`].
pub fn calibration_of_table(table: &Table, load: Load) -> Result<Calibration, CalibrateError> {
    Selection::new(table, "calibration", |_| true)?.calibration(&LOAD_CELL, load)
}

/// Where a press' true force comes from.
pub(super) struct ForceColumn {
    pub name: &'static str,
    pub of: fn(&Row) -> Option<f64>,
}

/// What the load cell measured, and the force of a plain table if it has one.
pub(super) const LOAD_CELL: ForceColumn = ForceColumn { name: "force_n", of: |row| row.force_n };

/// What was commanded; only a run knows.
pub(super) const COMMANDED: ForceColumn =
    ForceColumn { name: "force_set_n", of: |row| Some(row.record.as_ref()?.force_set_n) };

/// The unflagged presses of one kind.
pub(super) struct Selection<'a> {
    pub file: &'a str,
    pub rows: Vec<&'a Row>,
    pub flagged: usize,
}

impl<'a> Selection<'a> {
    pub fn of_phase(table: &'a Table, phase: &'static str) -> Result<Self, CalibrateError> {
        Self::new(table, phase, |row| row.is_of(phase))
    }

    pub fn new(table: &'a Table, phase: &'static str, is_of_it: impl Fn(&Row) -> bool) -> Result<Self, CalibrateError> {
        let (flagged, rows): (Vec<&Row>, Vec<&Row>) =
            table.rows.iter().filter(|row| is_of_it(row)).partition(|row| row.flagged);
        let flagged = flagged.len();
        if rows.is_empty() {
            return Err(CalibrateError::NoPresses { file: table.file.clone(), phase, flagged });
        }
        Ok(Selection { file: &table.file, rows, flagged })
    }

    /// Whether every press has a force of that kind: newtons, then, and not shares of a typical press.
    pub fn knows(&self, force: &ForceColumn) -> bool {
        self.rows.iter().all(|row| (force.of)(row).is_some())
    }

    /// The presses as a calibration.
    pub fn calibration(&self, force: &ForceColumn, load: Load) -> Result<Calibration, CalibrateError> {
        let force_n = |row: &Row| (force.of)(row).unwrap_or(UNIT_FORCE_N);
        let point = |row: &&'a Row| CalibrationPoint { place: row.place, force_n: force_n(row), outputs: &row.outputs };
        let points: Vec<CalibrationPoint<'_>> = self.rows.iter().map(point).collect();
        let calibration = match load {
            Load::Unknown if !self.knows(force) => Calibration::without_forces(&points),
            _ => Calibration::new(&points),
        };
        calibration.map_err(|source| CalibrateError::Press {
            file: self.file.to_owned(),
            line: source.point().and_then(|point| self.rows.get(point)).map_or(1, |row| row.line),
            column: force.name,
            source,
        })
    }
}

/// What a constant load counts as where it isn't told, N.
const UNIT_FORCE_N: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::super::evaluate::tests::{RUN, table};
    use super::*;

    fn forces(calibration: &Calibration) -> Vec<f64> {
        calibration.points().map(|point| point.force_n).collect()
    }

    #[test]
    fn stated_forces_stand_and_a_constant_load_is_1_n() {
        let stated = table("x_mm,y_mm,force_n,out_1\n0,0,2,1\n1,0,3,9\n", Table::read);
        let silent = table("x_mm,y_mm,out_1\n0,0,1\n1,0,9\n", Table::read);
        for load in [Load::Unknown, Load::Constant] {
            assert_eq!(forces(&calibration_of_table(&stated, load).unwrap()), [2.0, 3.0]);
        }
        assert_eq!(forces(&calibration_of_table(&silent, Load::Constant).unwrap()), [1.0, 1.0]);
        let relative = forces(&calibration_of_table(&silent, Load::Unknown).unwrap());
        assert!((relative[1] / relative[0] - 9.0).abs() < 1e-12, "{relative:?}");
    }

    #[test]
    fn a_runs_calibration_is_its_unflagged_presses_by_the_load_cell() {
        let run = table(RUN, Table::read_run);
        assert_eq!(forces(&calibration_of_run(&run, Load::Unknown).unwrap()), [0.8, 0.8]);
        let without = table(&RUN.replace("calibration", "teach"), Table::read_run);
        let refusal = calibration_of_run(&without, Load::Unknown).unwrap_err();
        assert!(matches!(refusal, CalibrateError::NoPresses { phase: "calibration", flagged: 0, .. }), "{refusal}");
    }
}
