//! Place and force vector from presses and drags: `--vector` of `evaluate`, `fit` and `solve`.

use super::recorded::{read_presses, read_run};
use super::{Failure, MethodOptions, Note, Sensor, stdin};
use palpate_data::dataset::sensor_file::SensorModel;
use palpate_data::dataset::{Mapping, Presses};
use palpate_data::recipe::Phase;
use palpate_solver::vector::{SuperposedPresses, VectorError, VectorErrors, VectorMap, VectorModel};
use serde::Serialize;
use std::path::Path;

/// Errors of test presses, and answers to pairs of them.
#[derive(Clone, Debug, Serialize)]
pub struct VectorEvaluation {
    /// Errors of place and force vector.
    #[serde(flatten)]
    pub errors: VectorErrors,
    /// Two contacts: the outputs of two test presses added, by the distance of their places.
    pub two_contacts: Vec<SuperposedPresses>,
}

/// Evaluates a run, or a table of calibration and a table of test presses.
pub(super) fn evaluated(
    [calibration, test]: [Option<&Path>; 2],
    mapping: &Mapping,
    note: Note<'_>,
) -> Result<VectorEvaluation, Failure> {
    let mapping = &mapping.clone().with_force_vector();
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
            [Phase::Calibration, Phase::Test].map(|phase| all.of_phase(phase))
        }
        None => {
            let help = "name a second table with test presses";
            return Err(Failure::usage(miette::miette!(help = help, "--vector needs a run, or two tables")));
        }
    };
    let map = fitted(&calibration, note)?;
    let errors = VectorErrors::of(&map, test.vector_rows()).ok_or_else(|| {
        Failure::usage(miette::miette!("{}: no test press has three components of the force", test.source))
    })?;
    Ok(VectorEvaluation { errors, two_contacts: SuperposedPresses::of(&map, test.vector_rows()) })
}

/// Fits a run folder or a table of presses.
pub(super) fn fit(calibration: &Path, options: &MethodOptions, note: Note<'_>) -> Result<Sensor, Failure> {
    let mapping = options.mapping()?.with_force_vector();
    let (presses, layout, sensor) = if calibration.is_dir() {
        let (recorded, bench) = read_run(calibration, note)?;
        let sensor = recorded.manifest.facts.labels.sensor.clone();
        (recorded.presses().of_phase(Phase::Calibration), Some(bench.layout), sensor)
    } else {
        let all = read_presses(calibration, &mapping, None, note)?;
        let of_calibration = all.of_phase(Phase::Calibration); // with those after a drag
        let presses = if of_calibration.presses.is_empty() { all } else { of_calibration };
        let layout = mapping.layout_of(presses.channels);
        (presses, layout, None)
    };
    let map = fitted(&presses, note)?.with_false_alarms(options.false_alarms);
    let model = SensorModel::Vector(Box::new(VectorModel::new(map, &presses.dragged_rows(), layout)));
    Ok(Sensor { model, sensor, made_from: vec![stdin::fingerprint(calibration).map_err(Failure::dataset)?] })
}

/// Fits presses and drags.
fn fitted(calibration: &Presses, note: Note<'_>) -> Result<VectorMap, Failure> {
    let rows = calibration.dragged_rows();
    if rows.is_empty() {
        let help =
            "a load cell with three axes records them, see `axes` of [load_cell]; a table names them in --columns";
        let text = format!("{}: no press of the calibration has three components of the force", calibration.source);
        return Err(Failure::usage(miette::miette!(help = help, "{text}")));
    }
    let map = VectorMap::fit_dragged(&rows).map_err(|error| {
        let help = match error {
            VectorError::TooFewPlaces { .. } => "press more places, over the whole area",
            VectorError::TooFewOutputs { .. } => "fit it without --vector",
            VectorError::Pulls => "set force_n = -1 in [scale] of a columns file",
            _ => "record presses and drags with a load cell with three axes: `drag` of a step of the recipe",
        };
        Failure::usage(miette::miette!(help = help, "{}: {error}", calibration.source))
    })?;
    if !map.knows_shear() {
        note(
            "note: no place has a press and drags along x and along y (a drag counts at the place where it began): only the press is solved, \
             and its stated errors are those without a force along the surface",
        );
    }
    if map.is_sparse() {
        note(
            "note: between its places the map is less certain than a reading: press places that are closer, or single contacts are often \
             called faults",
        );
    }
    Ok(map)
}
