//! Place and force vector from presses and drags: `evaluate --vector`.

use super::recorded::{read_presses, read_run};
use super::{Failure, Note};
use palpate_core::quantity::Place;
use palpate_data::dataset::{Mapping, Press, Presses};
use palpate_data::recipe::Phase;
use palpate_solver::vector::{DraggedRow, VectorErrors, VectorMap, VectorRow};
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
    let pressed = pressed_places(&calibration.presses);
    let rows: Vec<DraggedRow<'_>> = calibration
        .presses
        .iter()
        .filter_map(|press| {
            let row = row(press)?;
            Some(DraggedRow { pressed: pressed.get(&press.press).copied().unwrap_or(row.place), row })
        })
        .collect();
    if rows.is_empty() {
        let help =
            "a load cell with three axes records them, see `axes` of [load_cell]; a table names them in --columns";
        let text = format!("{}: no press of the calibration has three components of the force", calibration.source);
        return Err(Failure::usage(miette::miette!(help = help, "{text}")));
    }
    let map = VectorMap::fit_dragged(&rows).map_err(|error| {
        let help = "drag in at least two directions at each place: `drag` of a step of the recipe";
        Failure::usage(miette::miette!(help = help, "{}: {error}", calibration.source))
    })?;
    if !map.knows_shear() {
        note("note: no drags show the effect of a force along x and y: only the press is solved");
    }
    VectorErrors::of(&map, test.presses.iter().filter_map(row)).ok_or_else(|| {
        Failure::usage(miette::miette!("{}: no test press has three components of the force", test.source))
    })
}

/// Returns the presses of a phase, with those after a drag.
fn of_phase(all: &Presses, phase: Phase) -> Presses {
    let mut presses = all.clone();
    presses.presses.retain(|press| press.phase == Some(phase));
    presses
}

/// Returns where each press was before its drag.
fn pressed_places(presses: &[Press]) -> HashMap<u64, Place> {
    let before = presses.iter().filter(|press| !press.is_dragged());
    before.map(|press| (press.press, press.place())).collect()
}

/// Returns the row of a press without a fault.
fn row(press: &Press) -> Option<VectorRow<'_>> {
    let force_n = [press.force_x_n?, press.force_y_n?, press.force_n?];
    (!press.is_flagged()).then(|| VectorRow { place: press.place(), force_n, outputs: &press.outputs })
}
