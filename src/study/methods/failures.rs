//! Where each method fails, and whether it says so.

use super::Rows;
use super::conditions::{CONDITIONS, ConditionValue, Harm};
use super::cramer_rao::MeanBound;
use super::specimen::{FULL_SCALE_N, KnownReadings, NoiseReference, Specimen, grid};
use super::trial::{CRAMER_RAO, Method, MethodRow, Tally};
use crate::quantity::stream;
use crate::solver::Setting;
use crate::study::{StudyError, Told, carried_out};

/// How much is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FailuresSize {
    /// Calibration presses along a side.
    pub side: usize,
    /// Contacts at each value of each condition.
    pub tests: usize,
    /// Whether only the first and the last value of each condition are tried.
    pub ends_only: bool,
}

impl FailuresSize {
    /// The whole study.
    pub const WHOLE: FailuresSize = FailuresSize { side: 25, tests: 1000, ends_only: false };
    /// For a first look, and for tests.
    pub const QUICK: FailuresSize = FailuresSize { side: 5, tests: 40, ends_only: true };
}

/// What is calibrated once, and all that is tried on it.
struct Job {
    noise: NoiseReference,
    calibrated: Specimen,
    cases: Vec<(Harm, f64, ConditionValue)>,
}

/// Tries every method under every condition with both noises.
///
/// # Errors
/// None in practice: simulated presses can be calibrated on.
pub fn failures(size: FailuresSize, seed: u64, told: Told<'_>) -> Result<Rows, StudyError> {
    let jobs = jobs(size.ends_only);
    let mut rows = carried_out(&jobs, told, |job| job.rows(size, seed))?.concat();
    // as the conditions are listed, not as calibrations are shared
    let rank = |row: &MethodRow| {
        let harm = CONDITIONS.iter().position(|harm| harm.name == row.condition);
        let value = harm.and_then(|harm| CONDITIONS[harm].values.iter().position(|value| *value == row.value));
        (row.scene.clone(), harm, value)
    };
    rows.sort_by_key(rank); // methods stay in their order
    rows.sort_by_key(|row| row.scene != NoiseReference::T.name());
    Ok(Rows { rows })
}

fn jobs(ends_only: bool) -> Vec<Job> {
    let mut jobs: Vec<Job> = Vec::new();
    for noise in NoiseReference::ALL {
        for harm in CONDITIONS {
            let is_end = |index: usize| index == 0 || index + 1 == harm.values.len();
            for (_, &value) in harm.values.iter().enumerate().filter(|(index, _)| !ends_only || is_end(*index)) {
                let case = harm.case(noise, value);
                let is_same = |job: &&mut Job| job.noise == noise && job.calibrated == case.calibrated;
                match jobs.iter_mut().find(is_same) {
                    Some(job) => job.cases.push((harm, value, case)),
                    None => {
                        jobs.push(Job { noise, calibrated: case.calibrated.clone(), cases: vec![(harm, value, case)] })
                    }
                }
            }
        }
    }
    // what takes longest first, so that no processor waits for another at the end
    jobs.sort_by_key(|job| std::cmp::Reverse((job.cases.len(), job.calibrated.layout.len())));
    jobs
}

impl Job {
    fn rows(&self, size: FailuresSize, seed: u64) -> Result<Vec<MethodRow>, StudyError> {
        let mut skin = self.calibrated.skin(seed);
        let presses = KnownReadings::of(&mut skin, &grid(size.side), &mut stream(seed, 0, "calibration noise"));
        let calibration = presses.calibration()?;
        let methods = Method::all(&calibration, &Setting::of_layout(Some(&self.calibrated.layout)));
        let mut rows = Vec::new();
        for (harm, value, case) in &self.cases {
            let touches = harm.touches(*value, size.tests, &mut stream(seed, 0, "test contacts"));
            let mut skin = case.tested.skin(seed);
            let test = KnownReadings::of(&mut skin, &touches, &mut stream(seed, 0, "test noise"));
            let least =
                case.map_is_known.then(|| MeanBound::over(&skin, &case.tested.skin, FULL_SCALE_N, &test)).flatten();
            rows.extend(methods.iter().map(|method| MethodRow {
                study: "failures",
                scene: self.noise.name().to_owned(),
                condition: harm.name,
                value: *value,
                told: harm.words(*value),
                calibration_presses: calibration.len(),
                ..Tally::of(method, &test).row(method.name, least.map(|least| (least, CRAMER_RAO)))
            }));
        }
        Ok(rows)
    }
}
