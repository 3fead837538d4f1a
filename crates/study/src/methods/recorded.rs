//! A trial from recorded data: a run, or two plain tables.

use super::cramer_rao::MeanBound;
use super::specimen::{KnownContact, KnownReadings};
use super::speed_accuracy::MethodTrial;
use super::trial::{CRAMER_RAO, STATED};
use palpate_core::quantity::ArrayLayout;
use palpate_data::dataset::Presses;
use palpate_data::dataset::calibration::{LOAD_CELL, Selection};
use palpate_data::dataset::evaluate::{EvaluateError, check_channels};
use palpate_data::recipe::Phase;
use palpate_run::rig::Bench;
use palpate_sim::scene::Skin;
use palpate_solver::{Calibration, ForceKnown, Setting, Solver, TestPress, Workspace, fit};

/// Creates a trial from a run's calibration presses and test presses, without flagged presses, with the load cell's forces.
/// `seed` is the run's seed; for a simulated rig it gives the bound.
///
/// # Errors
/// The run lacks presses of one kind, or contains a press that is unsuitable for calibration.
pub fn of_run(name: &str, presses: &Presses, bench: &Bench, seed: u64) -> Result<MethodTrial, EvaluateError> {
    let calibration = Selection::of_phase(presses, Phase::Calibration)?;
    let test = readings(&Selection::of_phase(presses, Phase::Test)?, &calibration, presses.channels);
    let mut trial =
        trial(name.to_owned(), calibration.calibration(&LOAD_CELL, ForceKnown::default())?, test, bench.placed());
    if let Some(spec) = bench.rig.as_ref().filter(|spec| spec.is_simulated()) {
        let full_scale_n = spec.limits.force_n;
        let skin = Skin::new(&spec.scene.skin, &bench.layout, full_scale_n, seed);
        let least = MeanBound::over(&skin, &spec.scene.skin, full_scale_n, &trial.test);
        trial.least = least.map(|least| (least, CRAMER_RAO));
    }
    Ok(trial)
}

/// Creates a trial from one table for calibration and one table to solve, without flagged presses. If one of them has no forces,
/// only the location counts.
///
/// # Errors
/// The tables are from two arrays, contain no presses, or contain a press that is unsuitable for calibration.
pub fn of_tables(calibration: &Presses, test: &Presses) -> Result<MethodTrial, EvaluateError> {
    check_channels(calibration, test)?;
    let selection = Selection::of_all(calibration, Phase::Calibration)?;
    let readings = readings(&Selection::of_all(test, Phase::Test)?, &selection, test.channels);
    Ok(trial(test.source.clone(), selection.calibration(&LOAD_CELL, ForceKnown::default())?, readings, None))
}

/// Returns the presses to solve, with their true values.
fn readings(test: &Selection<'_>, calibration: &Selection<'_>, channels: usize) -> KnownReadings {
    let presses = test.to_solve(&LOAD_CELL, calibration.knows(&LOAD_CELL));
    let truth = |press: &TestPress<'_>| KnownContact { place: press.place, force_n: press.force_n, second: None };
    KnownReadings {
        units: channels,
        truths: presses.iter().map(truth).collect(),
        outputs: presses.iter().flat_map(|press| press.outputs).copied().collect(),
    }
}

fn trial(scene: String, calibration: Calibration, test: KnownReadings, layout: Option<&ArrayLayout>) -> MethodTrial {
    let least = stated(&calibration, &test, layout).map(|least| (least, STATED));
    MethodTrial { text: scene.clone(), scene, layout: layout.cloned(), calibration, test, least }
}

/// Mean of the errors that `surrogate` states for its answers; `None` if it states none.
fn stated(calibration: &Calibration, test: &KnownReadings, layout: Option<&ArrayLayout>) -> Option<MeanBound> {
    let solver = fit("surrogate", calibration, &Setting::of_layout(layout)).ok()?;
    let mut workspace = Workspace::default();
    let solutions = test.iter().filter_map(|(_, outputs)| solver.solve(outputs, &mut workspace).ok());
    MeanBound::mean(
        solutions.filter_map(|solution| solution.covariance).map(|covariance| Some(MeanBound::of(covariance))),
    )
}
