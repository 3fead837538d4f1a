//! Conditions under which each method fails, and whether the method reports the failure.

use super::conditions::{CONDITIONS, ConditionValue, Harm};
use super::cramer_rao::MeanBound;
use super::specimen::{FULL_SCALE_N, KnownReadings, NoiseReference, StudySpecimen, grid};
use super::trial::{CRAMER_RAO, MethodRow, StudiedMethod, Tally};
use crate::{OnProgress, StudyError, carried_out};
use palpate_core::quantity::stream;
use palpate_solver::Setting;

/// Number of calibration presses along a side, and number of contacts at each value of each condition.
const SIZE: (usize, usize) = (25, 1000);
/// Numbers for a quick look, which tries only the first and the last value of each condition.
const QUICK: (usize, usize) = (5, 40);

/// Specimen that is calibrated once, and all conditions that are tried on it.
struct FailureTry {
    noise: NoiseReference,
    calibrated: StudySpecimen,
    cases: Vec<(Harm, f64, ConditionValue)>,
}

/// Tries every method under every condition with both noises.
///
/// # Errors
/// Never in practice: simulated presses are suitable for calibration.
pub fn failures(quick: bool, seed: u64, on_progress: OnProgress<'_>) -> Result<Vec<MethodRow>, StudyError> {
    let jobs = jobs(quick);
    let size = if quick { QUICK } else { SIZE };
    let mut rows = carried_out(&jobs, on_progress, |job| job.rows(size, seed))?.concat();
    // as the conditions are listed, not as calibrations are shared
    let rank = |row: &MethodRow| {
        let harm = CONDITIONS.iter().position(|harm| harm.name == row.condition);
        let value = harm.and_then(|harm| CONDITIONS[harm].values.iter().position(|value| *value == row.value));
        (row.scene.clone(), harm, value)
    };
    rows.sort_by_key(rank); // methods stay in their order
    rows.sort_by_key(|row| row.scene != NoiseReference::T.name());
    Ok(rows)
}

fn jobs(ends_only: bool) -> Vec<FailureTry> {
    let mut jobs: Vec<FailureTry> = Vec::new();
    for noise in NoiseReference::ALL {
        for harm in CONDITIONS {
            let is_end = |index: usize| index == 0 || index + 1 == harm.values.len();
            for (_, &value) in harm.values.iter().enumerate().filter(|(index, _)| !ends_only || is_end(*index)) {
                let case = harm.case(noise, value);
                let is_same = |job: &&mut FailureTry| job.noise == noise && job.calibrated == case.calibrated;
                match jobs.iter_mut().find(is_same) {
                    Some(job) => job.cases.push((harm, value, case)),
                    None => jobs.push(FailureTry {
                        noise,
                        calibrated: case.calibrated.clone(),
                        cases: vec![(harm, value, case)],
                    }),
                }
            }
        }
    }
    // the longest first, so that no processor waits at the end
    jobs.sort_by_key(|job| std::cmp::Reverse((job.cases.len(), job.calibrated.layout.len())));
    jobs
}

impl FailureTry {
    fn rows(&self, (side, tests): (usize, usize), seed: u64) -> Result<Vec<MethodRow>, StudyError> {
        let mut skin = self.calibrated.skin(seed);
        let presses = KnownReadings::of(&mut skin, &grid(side), &mut stream(seed, 0, "calibration noise"));
        let calibration = presses.calibration()?;
        let methods = StudiedMethod::all(&calibration, &Setting::of_layout(Some(&self.calibrated.layout)));
        let mut rows = Vec::new();
        for (harm, value, case) in &self.cases {
            let touches = harm.touches(*value, tests, &mut stream(seed, 0, "test contacts"));
            let mut skin = case.tested.skin(seed);
            let mut test = KnownReadings::of(&mut skin, &touches, &mut stream(seed, 0, "test noise"));
            harm.spoil(*value, &mut test, &mut stream(seed, 0, harm.name));
            let least =
                case.map_is_known.then(|| MeanBound::over(&skin, &case.tested.skin, FULL_SCALE_N, &test)).flatten();
            rows.extend(methods.iter().map(|method| MethodRow {
                study: "failures",
                scene: self.noise.name().to_owned(),
                condition: harm.name,
                value: *value,
                text: harm.words(*value),
                calibration_presses: calibration.len(),
                ..Tally::of(method, &test).row(method.name, least.map(|least| (least, CRAMER_RAO)))
            }));
        }
        Ok(rows)
    }
}
