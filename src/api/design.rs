//! Several sensors of a design: one map for all of them, and the errors of each by the map of the others.

use super::evaluate::EvaluateOptions;
use super::fit::Sensor;
use super::method::{FitSource, MethodOptions};
use super::recorded::read_run;
use super::{Failure, Note};
use miette::{IntoDiagnostic, WrapErr, miette};
use palpate_data::dataset::calibration::{LOAD_CELL, Selection, check_places};
use palpate_data::recipe::Phase;
use palpate_solver::{
    Calibration, DesignMap, DesignSensor, ForceKnown, LeftOutSensor, PriorError, SensorErrors, SensorPresses, broken,
    leave_one_sensor_out,
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// One map for several sensors.
pub struct FittedDesign {
    /// The map, as a sensor that may be any of the design.
    pub sensor: Sensor,
    /// The sensors that made it.
    pub sensors: Vec<Named<DesignSensor>>,
}

/// A result about a sensor, with the sensor's ID or its file.
#[derive(Debug, Serialize)]
pub struct Named<T> {
    /// The ID or the file.
    pub sensor: String,
    /// The result.
    #[serde(flatten)]
    pub of: T,
}

/// Errors of sensors, each solved by the map of the others.
#[derive(Debug, Serialize)]
pub struct LeftOutSensors {
    /// Errors of each sensor.
    pub sensors: Vec<Named<LeftOutSensor>>,
    /// Errors of the presses of all sensors.
    pub all: SensorErrors,
}

/// Fits one map to runs or tables of at least two sensors of a design, like `palpate fit A B`.
///
/// # Errors
/// Bad input.
pub fn fit_design(sources: &[PathBuf], options: &MethodOptions, note: Note<'_>) -> Result<FittedDesign, Failure> {
    options.check()?;
    for (is_given, option) in [(options.vector, "--vector"), (options.history, "--history")] {
        if is_given {
            let help = format!("fit each sensor alone: palpate fit RUN {option} --out FILE");
            return Err(Failure::usage(miette!(help = help, "{option} fits one sensor, not a design")));
        }
    }
    let sources = read(sources, options, note)?;
    let calibrations: Vec<Calibration> = sources.iter().map(|source| source.calibration.clone()).collect();
    let map = DesignMap::new(options.solver(), &calibrations, &options.setting(&sources[0])?);
    let DesignMap { model, sensors } = unfitted(map)?;
    let made_from = sources.iter().map(FitSource::fingerprint).collect::<Result<_, _>>()?;
    let sensors = sources.iter().zip(sensors).map(|(source, of)| Named { sensor: name(source), of }).collect();
    Ok(FittedDesign { sensor: Sensor { model: model.into(), sensor: None, made_from }, sensors })
}

/// Solves the presses of each sensor by the map of the others.
pub(super) fn evaluated(options: &EvaluateOptions, note: Note<'_>) -> Result<LeftOutSensors, Failure> {
    let EvaluateOptions { solver, columns, .. } = options;
    let method = MethodOptions { solver: solver.clone(), columns: columns.clone(), ..MethodOptions::default() };
    method.check()?;
    let sources = read(&options.run, &method, note)?;
    let presses = |source: &FitSource| {
        let test = if source.path.is_dir() { test_of(&source.path)? } else { None };
        Ok(SensorPresses { calibration: source.calibration.clone(), test })
    };
    let presses = sources.iter().map(presses).collect::<Result<Vec<_>, Failure>>()?;
    let (each, all) = unfitted(leave_one_sensor_out(solver, &presses, &method.setting(&sources[0])?))?;
    let sensors = sources.iter().zip(each).map(|(source, of)| Named { sensor: name(source), of }).collect();
    Ok(LeftOutSensors { sensors, all })
}

/// Returns the test presses of a run, if there are any. Its files were checked when its calibration was read.
fn test_of(run: &Path) -> Result<Option<Calibration>, Failure> {
    let presses = read_run(run, &|_| ())?.0.presses();
    let Ok(selection) = Selection::of_phase(&presses, Phase::Test) else { return Ok(None) };
    selection.calibration(&LOAD_CELL, ForceKnown::Unknown).map(Some).map_err(Failure::usage)
}

fn unfitted<T>(result: Result<T, PriorError>) -> Result<T, Failure> {
    result.into_diagnostic().wrap_err("these sensors can't be fitted as a design").map_err(Failure::usage)
}

fn name(source: &FitSource) -> String {
    source.sensor.clone().unwrap_or_else(|| source.path.display().to_string())
}

/// Reads the sources, and checks that they are different sensors of one design.
fn read(paths: &[PathBuf], method: &MethodOptions, note: Note<'_>) -> Result<Vec<FitSource>, Failure> {
    if paths.len() < 2 {
        let help = "name a run or a table of each sensor of the design";
        return Err(Failure::usage(miette!(help = help, "a design needs at least two sensors")));
    }
    let mut sources: Vec<FitSource> = Vec::new();
    for path in paths {
        let source = FitSource::read(path, method, note)?;
        let shown = path.display();
        check_places(&shown.to_string(), &source.calibration).map_err(Failure::usage)?;
        let refused = |problem: String, help: &str| Err(Failure::usage(miette!(help = help, "{shown}: {problem}")));
        if !source.calibration.is_in_newtons() {
            let help = "a map of several sensors needs `force_n`, because a change of the gain can't be seen without it; fit each alone";
            return refused("the forces of its presses aren't known, in newtons".to_owned(), help);
        }
        if let Some(broken) = broken(&source.calibration).first() {
            return refused(broken.text(), "leave out this sensor");
        }
        for other in &sources {
            let ([units, others], named) =
                ([&source, other].map(|source| source.calibration.units()), other.path.display());
            if units != others {
                let problem = format!("{units} outputs per press, {named} has {others}");
                return refused(problem, "the sensors of a design have the same outputs");
            }
            if source.layout != other.layout {
                return refused(format!("its units are at other places than those of {named}"), "use one array file");
            }
            let is_same = source.sensor.is_some() && source.sensor == other.sensor;
            if is_same || source.fingerprint()?.sha256 == other.fingerprint()?.sha256 {
                return refused(format!("it is the same sensor as {named}"), "name each sensor once");
            }
        }
        sources.push(source);
    }
    Ok(sources)
}
