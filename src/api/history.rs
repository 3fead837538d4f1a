//! Force from a series of readings: `--history` of `evaluate`, `fit` and `solve`.

use super::columns::ColumnsOptions;
use super::recorded::{read_presses, read_run};
use super::{Failure, MethodOptions, Note, Sensor, stdin};
use palpate_data::dataset::Press;
use palpate_data::dataset::sensor_file::SensorModel;
use palpate_solver::{HistoryEvaluation, HistoryRegression, Series, SeriesError, evaluate_history};
use std::path::Path;

/// Evaluates whether earlier readings lower the error of the force in a table with times, or in the run that it was imported to.
pub(super) fn evaluated(source: &Path, columns: &ColumnsOptions, note: Note<'_>) -> Result<HistoryEvaluation, Failure> {
    let (presses, _) = read(source, columns, note)?;
    series(&presses).and_then(|series| evaluate_history(&series)).map_err(refused(source))
}

/// Fits such a table or run.
pub(super) fn fit(source: &Path, options: &MethodOptions, note: Note<'_>) -> Result<Sensor, Failure> {
    let (presses, sensor) = read(source, &options.columns, note)?;
    let fitted = series(&presses).and_then(|series| HistoryRegression::fit(&series)).map_err(refused(source))?;
    let made_from = vec![stdin::fingerprint(source).map_err(Failure::dataset)?];
    Ok(Sensor { model: SensorModel::History(Box::new(fitted)), sensor, made_from })
}

/// Reads the presses of a source, and the ID of its sensor if it has one.
fn read(source: &Path, columns: &ColumnsOptions, note: Note<'_>) -> Result<(Vec<Press>, Option<String>), Failure> {
    if !source.is_dir() {
        return Ok((read_presses(source, &columns.mapping()?.of_series(), None, note)?.presses, None));
    }
    let (recorded, _) = read_run(source, note)?;
    let facts = &recorded.manifest.facts;
    if facts.imported.is_none() {
        let help = "record the outputs and the force of a load cell over time, and give the table";
        let text = format!("{}: a run knows its presses, not what happened between them", source.display());
        return Err(Failure::usage(miette::miette!(help = help, "{text}")));
    }
    let presses = recorded.presses().presses;
    if presses.iter().all(|press| press.t_s.is_none()) {
        let help = "import the table with its time: --columns t_s=time,force_n=Fz,outputs=ch0..ch15";
        return Err(Failure::usage(miette::miette!(help = help, "{}: its readings have no times", source.display())));
    }
    Ok((presses, facts.labels.sensor.clone()))
}

fn series(presses: &[Press]) -> Result<Series, SeriesError> {
    let sound = presses.iter().filter(|press| !press.is_flagged());
    Series::new(sound.filter_map(|press| Some((press.t_s?, press.outputs.as_slice(), press.force_n?))))
}

/// Returns what makes a failure of a series that can't be used.
fn refused(source: &Path) -> impl Fn(SeriesError) -> Failure {
    move |error| {
        let help = "a series has columns for time, force and outputs: --columns t_s=time,force_n=Fz,outputs=ch0..ch15";
        Failure::usage(miette::miette!(help = help, "{}: {error}", source.display()))
    }
}
