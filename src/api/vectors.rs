//! Place and force vector from presses and drags: `--vector` of `evaluate`, `fit` and `solve`.

use super::recorded::{read_presses, read_run};
use super::{Failure, Note, Sensor, stdin};
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_data::dataset::sensor_file::SensorModel;
use palpate_data::dataset::{Mapping, Press, Presses};
use palpate_data::recipe::Phase;
use palpate_solver::vector::{DraggedRow, VectorError, VectorErrors, VectorModel, VectorRow};
use std::collections::HashMap;
use std::path::Path;

/// Evaluates a run, or a table of calibration and a table of test presses.
pub(super) fn evaluated(
    [calibration, test]: [Option<&Path>; 2],
    mapping: &Mapping,
    note: Note<'_>,
) -> Result<VectorErrors, Failure> {
    let Some(calibration) = calibration else {
        return Err(Failure::usage(miette::miette!("--vector needs a run, or two tables")));
    };
    let [calibration, test] = match test {
        Some(_) if calibration.is_dir() => {
            let help = "a run has its own test presses: name it alone";
            return Err(Failure::usage(miette::miette!(help = help, "--vector needs a run, or two tables")));
        }
        Some(test) => [read_presses(calibration, mapping, None, note)?, read_presses(test, mapping, None, note)?],
        None if calibration.is_dir() => {
            let (recorded, _) = read_run(calibration, note)?;
            let all = recorded.presses();
            [Phase::Calibration, Phase::Test].map(|phase| of_phase(&all, phase))
        }
        None => {
            let help = "name a second table with test presses";
            return Err(Failure::usage(miette::miette!(help = help, "--vector needs a run, or two tables")));
        }
    };
    let model = fitted(&calibration, None, note)?;
    VectorErrors::of(model.map(), test.presses.iter().filter_map(row)).ok_or_else(|| {
        Failure::usage(miette::miette!("{}: no test press has three components of the force", test.source))
    })
}

/// Fits presses and drags.
fn fitted(calibration: &Presses, layout: Option<ArrayLayout>, note: Note<'_>) -> Result<VectorModel, Failure> {
    // a press is before its drag; another session may use its number again
    let mut pressed: HashMap<u64, Place> = HashMap::new();
    let dragged = |press: &'_ Press| {
        if !press.is_dragged() {
            pressed.insert(press.press, press.place());
        }
        pressed.get(&press.press).copied().unwrap_or(press.place())
    };
    let places: Vec<Place> = calibration.presses.iter().map(dragged).collect();
    let with_place = |(press, pressed)| Some(DraggedRow { pressed, row: row(press)? });
    let rows: Vec<DraggedRow<'_>> = calibration.presses.iter().zip(places).filter_map(with_place).collect();
    if rows.is_empty() {
        let help =
            "a load cell with three axes records them, see `axes` of [load_cell]; a table names them in --columns";
        let text = format!("{}: no press of the calibration has three components of the force", calibration.source);
        return Err(Failure::usage(miette::miette!(help = help, "{text}")));
    }
    let model = VectorModel::fit(&rows, layout).map_err(|error| {
        let help = match error {
            VectorError::TooFewPlaces { .. } => "press more places, over the whole area",
            _ => "record presses and drags with a load cell with three axes: `drag` of a step of the recipe",
        };
        Failure::usage(miette::miette!(help = help, "{}: {error}", calibration.source))
    })?;
    if !model.map().knows_shear() {
        note(
            "note: no drags show the effect of a force along x and along y: only the press is solved, and its stated errors are those \
             without a force along the surface",
        );
    }
    Ok(model)
}

/// Fits a run folder or a table of presses.
pub(super) fn fit(calibration: &Path, mapping: &Mapping, note: Note<'_>) -> Result<Sensor, Failure> {
    let (presses, layout, sensor) = if calibration.is_dir() {
        let (recorded, bench) = read_run(calibration, note)?;
        let sensor = recorded.manifest.facts.labels.sensor.clone();
        (of_phase(&recorded.presses(), Phase::Calibration), Some(bench.layout), sensor)
    } else {
        let presses = read_presses(calibration, mapping, Some(Phase::Calibration), note)?;
        let layout = mapping.layout_of(presses.channels);
        (presses, layout, None)
    };
    let model = SensorModel::Vector(Box::new(fitted(&presses, layout, note)?));
    Ok(Sensor { model, sensor, made_from: vec![stdin::fingerprint(calibration).map_err(Failure::dataset)?] })
}

/// Returns the presses of a phase, with those after a drag.
fn of_phase(all: &Presses, phase: Phase) -> Presses {
    let mut presses = all.clone();
    presses.presses.retain(|press| press.phase == Some(phase));
    presses
}

/// Returns the row of a press without a fault.
fn row(press: &Press) -> Option<VectorRow<'_>> {
    let force_n = press.force_vector_n()?;
    (!press.is_flagged()).then(|| VectorRow { place: press.place(), force_n, outputs: &press.outputs })
}
