//! From tables to an evaluation: which rows calibrate, which test, and whose force counts as true.

use super::table::{Row, Table, TableError};
use crate::quantity::ArrayLayout;
use crate::solver::{
    Calibration, CalibrationError, CalibrationPoint, Evaluation, EvaluationError, FitError, Setting, TestPress,
    evaluate, fit,
};
use miette::Diagnostic;

/// Why there is no evaluation; all of them are exit code 2.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum EvaluateError {
    /// A table can't be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Table(#[from] TableError),
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
    /// The two tables come from two arrays.
    #[error("{calibration} has {calibration_units} outputs (out_1..), {test} has {test_units}")]
    #[diagnostic(help("calibrate and test with the same array, and keep all its outputs in both tables"))]
    Units {
        /// The calibration's table.
        calibration: String,
        /// Its outputs.
        calibration_units: usize,
        /// The test's table.
        test: String,
        /// Its outputs.
        test_units: usize,
    },
    /// A row can't be calibrated on.
    #[error("{file}, line {line}, column `{column}`: the press can't be calibrated on")]
    #[diagnostic(help("correct the row, or remove it"))]
    Calibration {
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
    /// The test can't be evaluated.
    #[error("{file}: can't be evaluated")]
    Evaluation {
        /// The test's table.
        file: String,
        /// Why.
        source: EvaluationError,
    },
}

/// A run's calibration presses against its test presses: `force_error_n` by the commanded force throughout, as in the
/// paper, `force_error_load_cell_n` by the load cell throughout. Flagged presses are left out and counted.
pub fn evaluate_run(table: &Table, layout: Option<&ArrayLayout>, solver: &str) -> Result<Evaluation, EvaluateError> {
    let calibration = Selection::of_phase(table, "calibration")?;
    let test = Selection::of_phase(table, "test")?;
    let commanded = ForceColumn { name: "force_set_n", of: |row| Some(row.record.as_ref()?.force_set_n) };
    let load_cell = ForceColumn { name: "force_n", of: |row| row.force_n };
    let by_load_cell = evaluate_selections(&calibration, &test, &load_cell, layout, solver)?;
    let mut evaluation = evaluate_selections(&calibration, &test, &commanded, layout, solver)?;
    evaluation.force_error_load_cell_n = by_load_cell.force_error_n;
    Ok(evaluation)
}

/// A table to calibrate on against a table to solve. Flagged presses are left out and counted.
pub fn evaluate_tables(calibration: &Table, test: &Table, solver: &str) -> Result<Evaluation, EvaluateError> {
    if calibration.units != test.units {
        return Err(EvaluateError::Units {
            calibration: calibration.file.clone(),
            calibration_units: calibration.units,
            test: test.file.clone(),
            test_units: test.units,
        });
    }
    let force = ForceColumn { name: "force_n", of: |row| row.force_n };
    let calibration = Selection::new(calibration, "calibration", |_| true)?;
    evaluate_selections(&calibration, &Selection::new(test, "test", |_| true)?, &force, None, solver)
}

/// Whether a row of a run takes part in its evaluation, flagged or not.
pub fn is_to_evaluate(row: &Row) -> bool {
    row.record.as_ref().is_some_and(|record| matches!(record.phase.as_str(), "calibration" | "test"))
}

/// The unflagged presses of one kind.
struct Selection<'a> {
    file: &'a str,
    rows: Vec<&'a Row>,
    flagged: usize,
}

impl<'a> Selection<'a> {
    fn of_phase(table: &'a Table, phase: &'static str) -> Result<Self, EvaluateError> {
        Self::new(table, phase, |row| row.record.as_ref().is_some_and(|record| record.phase == phase))
    }

    fn new(table: &'a Table, phase: &'static str, is_of_it: impl Fn(&Row) -> bool) -> Result<Self, EvaluateError> {
        let (flagged, rows): (Vec<&Row>, Vec<&Row>) =
            table.rows.iter().filter(|row| is_of_it(row)).partition(|row| row.flagged);
        let flagged = flagged.len();
        if rows.is_empty() {
            return Err(EvaluateError::NoPresses { file: table.file.clone(), phase, flagged });
        }
        Ok(Selection { file: &table.file, rows, flagged })
    }
}

/// What a calibration press counts as where its table has no force, N.
const UNIT_FORCE_N: f64 = 1.0;

/// Where a press' true force comes from.
struct ForceColumn {
    name: &'static str,
    of: fn(&Row) -> Option<f64>,
}

fn evaluate_selections<'a>(
    calibration: &Selection<'a>,
    test: &Selection<'a>,
    force: &ForceColumn,
    layout: Option<&ArrayLayout>,
    solver: &str,
) -> Result<Evaluation, EvaluateError> {
    let point = |row: &&'a Row| {
        let force_n = (force.of)(row).unwrap_or(UNIT_FORCE_N);
        CalibrationPoint { place: row.place, force_n, outputs: &row.outputs }
    };
    let press = |row: &&'a Row| TestPress { place: row.place, force_n: (force.of)(row), outputs: &row.outputs };
    let points: Vec<CalibrationPoint<'_>> = calibration.rows.iter().map(point).collect();
    let presses: Vec<TestPress<'_>> = test.rows.iter().map(press).collect();
    let file = || calibration.file.to_owned();
    let database = Calibration::new(&points).map_err(|source| EvaluateError::Calibration {
        file: file(),
        line: source.point().and_then(|point| calibration.rows.get(point)).map_or(1, |row| row.line),
        column: force.name,
        source,
    })?;
    let solver = fit(solver, &database, &Setting::of_layout(layout))
        .map_err(|source| EvaluateError::Fit { file: file(), source })?;
    let mut evaluation = evaluate(&solver, &presses)
        .map_err(|source| EvaluateError::Evaluation { file: test.file.to_owned(), source })?;
    evaluation.left_out.calibration_flagged = calibration.flagged;
    evaluation.left_out.test_flagged = test.flagged;
    Ok(evaluation)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::path::Path;

    /// Reads what a file of that text holds.
    fn table(text: &str, read: fn(&Path) -> Result<Table, TableError>) -> Table {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.csv"), text).unwrap();
        read(&folder.path().join("a.csv")).unwrap()
    }

    /// A small run: what is flagged, unsolvable or of another phase is in it too.
    pub(crate) const RUN: &str = "\
press,level,phase,x_mm,y_mm,force_set_n,force_n,out_1,out_2,flags
0,0,calibration,-1,0,1,0.8,1,0.5,
1,0,calibration,1,0,1,0.8,0.5,1,
2,0,calibration,1,0,1,1,5,1,trip
3,0,test,-1,0,0.5,0.4,0.55,0.2,
4,0,test,1,0,0.5,0.4,0.2,0.55,trip
5,0,test,1,0,0.5,0.4,0.2,0.2,
6,0,teach,1,0,0.5,0.4,0.2,0.2,
";

    #[test]
    fn a_run_is_held_against_the_commanded_force_and_against_the_load_cell() {
        let table = table(RUN, Table::read_run);
        let layout = ArrayLayout::from_places(vec![crate::quantity::Place::new(-1.0, 0.0); 2]);
        let evaluation = evaluate_run(&table, Some(&layout), "pearson").unwrap();
        assert_eq!((evaluation.points, evaluation.location_error_mm.max), (1, 0.0));
        assert!((evaluation.force_error_n.unwrap().mean - 0.05).abs() < 1e-12); // 0.55 of 1 N against 0.5 N
        assert!((evaluation.force_error_load_cell_n.unwrap().mean - 0.04).abs() < 1e-12); // 0.55 of 0.8 N against 0.4 N
        let left_out = evaluation.left_out;
        assert_eq!((left_out.calibration_flagged, left_out.test_flagged, left_out.test_unsolved), (1, 1, 1));
    }

    #[test]
    fn plain_tables_need_no_force() {
        let calibration = table("x_mm,y_mm,out_1,out_2\n0,0,1,2\n1,0,2,1\n", Table::read);
        let test = table("x_mm,y_mm,force_n,out_1,out_2\n0,0,2,2,4\n", Table::read);
        let evaluation = evaluate_tables(&calibration, &test, "pearson").unwrap();
        assert_eq!(evaluation.force_error_n.unwrap().max, 0.0); // twice what 1 N gave
        let evaluation = evaluate_tables(&test, &calibration, "pearson").unwrap();
        assert_eq!((evaluation.force_error_n, evaluation.within.both), (None, None));
    }

    #[test]
    fn tables_that_do_not_fit_are_refused_by_line() {
        let good = table("x_mm,y_mm,out_1,out_2\n0,0,1,2\n", Table::read);
        let other = table("x_mm,y_mm,out_1\n0,0,1\n", Table::read);
        assert!(matches!(evaluate_tables(&good, &other, "pearson"), Err(EvaluateError::Units { .. })));
        let unloaded = table("x_mm,y_mm,force_n,out_1,out_2\n0,0,1,1,2\n\n0,0,0,1,2\n", Table::read);
        let refusal = evaluate_tables(&unloaded, &good, "pearson").unwrap_err().to_string();
        assert!(refusal.contains("line 4, column `force_n`"), "{refusal}");
        let flagged = table("x_mm,y_mm,out_1,out_2,flags\n0,0,1,2,bad\n", Table::read);
        let refusal = evaluate_tables(&good, &flagged, "pearson").unwrap_err();
        assert!(matches!(refusal, EvaluateError::NoPresses { phase: "test", flagged: 1, .. }));
    }
}
