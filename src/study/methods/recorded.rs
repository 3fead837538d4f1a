//! A trial from what was recorded: a run, or two plain tables.

use super::cramer_rao::Least;
use super::specimen::{Readings, Truth};
use super::speed_accuracy::Trial;
use super::trial::{CRAMER_RAO, STATED};
use crate::dataset::calibration::{CalibrateError, calibration_of_run, calibration_of_table};
use crate::dataset::evaluate::{EvaluateError, check_units};
use crate::dataset::table::{Row, Table};
use crate::quantity::ArrayLayout;
use crate::rig::RigSpec;
use crate::scene::Skin;
use crate::solver::{Calibration, Load, Setting, Solver, Workspace, fit};

/// A run's calibration presses and its test presses, flagged ones left out, by the load cell's forces. `seed` is the run's: of a
/// simulated rig it tells the bound.
///
/// # Errors
/// A run without presses of both kinds, or with one that can't be calibrated on.
pub fn of_run(name: &str, table: &Table, spec: &RigSpec, seed: u64) -> Result<Trial, EvaluateError> {
    let layout = &spec.array.layout;
    let calibration = calibration_of_run(table, Load::default())?;
    let knows = knows_forces(table, |row| row.is_of("calibration"));
    let test = readings(table, knows, |row| row.is_of("test"))?;
    let mut trial = trial(name.to_owned(), calibration, test, Some(layout));
    if spec.is_simulated() {
        let full_scale_n = spec.limits.force_n;
        let skin = Skin::new(&spec.scene.skin, layout, full_scale_n, seed);
        let least = Least::over(&skin, &spec.scene.skin, full_scale_n, &trial.test);
        trial.least = least.map(|least| (least, CRAMER_RAO));
    }
    Ok(trial)
}

/// A table to calibrate on and one to solve, flagged presses left out. Where one of them has no forces, the location alone counts.
///
/// # Errors
/// Tables of two arrays, without presses, or with one that can't be calibrated on.
pub fn of_tables(calibration: &Table, test: &Table) -> Result<Trial, EvaluateError> {
    check_units(calibration, test)?;
    let readings = readings(test, knows_forces(calibration, |_| true), |_| true)?;
    Ok(trial(test.file.clone(), calibration_of_table(calibration, Load::default())?, readings, None))
}

/// Whether a calibration is in newtons: against one that isn't, no force can be held.
fn knows_forces(calibration: &Table, is_of_it: impl Fn(&Row) -> bool) -> bool {
    calibration.rows.iter().filter(|row| is_of_it(row) && !row.flagged).all(|row| row.force_n.is_some())
}

/// The unflagged presses to solve.
fn readings(test: &Table, knows: bool, is_of_it: impl Fn(&Row) -> bool) -> Result<Readings, EvaluateError> {
    let (flagged, rows): (Vec<&Row>, Vec<&Row>) =
        test.rows.iter().filter(|row| is_of_it(row)).partition(|row| row.flagged);
    if rows.is_empty() {
        let (file, flagged) = (test.file.clone(), flagged.len());
        return Err(CalibrateError::NoPresses { file, phase: "test", flagged }.into());
    }
    let truth = |row: &&Row| Truth { place: row.place, force_n: row.force_n.filter(|_| knows), second: None };
    Ok(Readings {
        units: test.units,
        truths: rows.iter().map(truth).collect(),
        outputs: rows.iter().flat_map(|row| &row.outputs).copied().collect(),
    })
}

fn trial(scene: String, calibration: Calibration, test: Readings, layout: Option<&ArrayLayout>) -> Trial {
    let least = stated(&calibration, &test, layout).map(|least| (least, STATED));
    Trial { told: scene.clone(), scene, layout: layout.cloned(), calibration, test, least }
}

/// The errors that `surrogate` states of its answers, on the average of those that state any; none if it has none.
fn stated(calibration: &Calibration, test: &Readings, layout: Option<&ArrayLayout>) -> Option<Least> {
    let solver = fit("surrogate", calibration, &Setting::of_layout(layout)).ok()?;
    let mut workspace = Workspace::default();
    let solutions = test.iter().filter_map(|(_, outputs)| solver.solve(outputs, &mut workspace).ok());
    Least::mean(solutions.filter_map(|solution| solution.covariance).map(Some))
}
