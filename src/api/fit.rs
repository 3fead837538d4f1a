//! Calibrated sensors: a method fitted to a run or a table, and its sensor file.

use super::method::{FitSource, MethodOptions};
use super::solutions::Measure;
use super::{Failure, Note, history, vectors};
use palpate_data::dataset::Fingerprint;
use palpate_data::dataset::sensor_file::{
    Card, SensorFile, SensorFileError, SensorModel, check_replaceable, read_any_sensor_file,
};
use palpate_solver::{
    Calibration, CalibrationPoint, Fitted, ForceKnown, Model, PreparedCalibration, Setting, Solver as _,
};
use std::path::Path;

/// Largest ratio of two errors whose gain is worth a note.
const LESS: f64 = 0.9;

/// What is noted about a calibration by depth.
pub(crate) const DEPTH_IS_SOLVED: &str =
    "depth is solved instead of force: the calibration's presses are known by depth";

/// What the forces of a calibration without forces are.
pub(crate) const FORCES_ARE_RELATIVE: &str =
    "no force_n in the calibration: relative_force is relative to its typical press";

/// A model with what its sensor file states.
pub struct Sensor {
    /// The fitted method.
    pub model: SensorModel,
    /// ID of the sensor, if its run has one.
    pub sensor: Option<String>,
    /// Sources of the fit.
    pub made_from: Vec<Fingerprint>,
}

/// Fits a method to a run folder or to a table of presses, like `palpate fit`. Forces are those of the load cell.
///
/// # Errors
/// Bad input.
pub fn fit(calibration: &Path, options: &MethodOptions, note: Note<'_>) -> Result<Sensor, Failure> {
    options.check()?;
    if options.vector {
        return vectors::fit(calibration, options, note);
    }
    if options.history {
        return history::fit(calibration, options, note);
    }
    let source = FitSource::read(calibration, options, note)?;
    let model = options.fit(&source)?;
    note_forces(&model, note);
    note_left_out(calibration, model.fitted(), note);
    Ok(Sensor { made_from: vec![source.fingerprint()?], sensor: source.sensor, model: model.into() })
}

/// Reads a sensor file.
///
/// # Errors
/// The file can't be read, or isn't a sensor file.
pub fn read_sensor(path: &Path, note: Note<'_>) -> Result<Sensor, Failure> {
    let (Card { sensor, made_from, .. }, model) = read_any_sensor_file(path).map_err(Failure::usage)?;
    if let SensorModel::Contact(model) = &model {
        note_forces(model, note);
        note_left_out(path, model.fitted(), note);
    }
    Ok(Sensor { model, sensor, made_from })
}

/// Writes a sensor file. Replaces an existing sensor file, but nothing else.
///
/// # Errors
/// Something else is at the path, or the file can't be written.
pub fn write_sensor(
    model: SensorModel,
    sensor: Option<String>,
    made_from: Vec<Fingerprint>,
    path: &Path,
) -> Result<(), Failure> {
    check_replaceable(path).map_err(Failure::usage)?;
    place(&SensorFile::new(model, sensor, made_from).map_err(Failure::usage)?, path)
}

/// Writes a prepared sensor file.
pub(crate) fn place(file: &SensorFile, path: &Path) -> Result<(), Failure> {
    file.write(path).map_err(|error| match error {
        SensorFileError::Taken { .. } => Failure::usage(error),
        error => Failure::unwritten(error),
    })
}

/// Returns the errors on held-out presses without and with `--constant-load`, mm, if that would lower them. `None` if the forces of
/// the calibration are known, or contacts are already assumed to have one load.
pub(crate) fn constant_load_gain_mm(model: &Model) -> Option<(f64, f64)> {
    let setting = model.setting();
    let is_relative = !(model.forces_are_known() || model.depths_are_known());
    if !is_relative || setting.load == ForceKnown::Constant || model.fitted().at_calibrated_load().is_some() {
        return None;
    }
    let error_mm = |calibration: Calibration, load: ForceKnown| {
        let prepared = PreparedCalibration::new(calibration, &Setting { load, ..setting }).ok()?;
        prepared.candidates(model.fitted().name()).ok()?.first()?.location_error_mm
    };
    let calibration = model.calibration()?;
    let points: Vec<_> = calibration.points().map(|point| CalibrationPoint { force_n: 1.0, ..point }).collect();
    let alike = Calibration::new(&points).ok()?.with_unknown_forces();
    let constant_mm = error_mm(alike, ForceKnown::Constant)?;
    // `best` has compared the methods already
    let any_mm = match model.fitted().choice().and_then(|choice| choice.candidates.first()) {
        Some(chosen) => chosen.location_error_mm,
        None => error_mm(calibration.clone(), ForceKnown::Unknown),
    }?;
    (constant_mm <= LESS * any_mm).then_some((any_mm, constant_mm))
}

/// Notes that forces are relative, or that there are depths instead.
fn note_forces(model: &Model, note: Note<'_>) {
    match Measure::of(model) {
        Measure::RelativeForce if model.setting().load != ForceKnown::Constant => note(FORCES_ARE_RELATIVE),
        Measure::Depth => note(DEPTH_IS_SOLVED),
        _ => {}
    }
}

/// Notes each unit of a calibration that is excluded.
pub(crate) fn note_left_out(path: &Path, fitted: &Fitted, note: Note<'_>) {
    for broken in fitted.broken() {
        note(&format!("{}: {}, excluded", path.display(), broken.text()));
    }
}
