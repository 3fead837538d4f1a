//! Whether few presses decide about a sensor like a full calibration does.

use super::super::methods::specimen::{FORCES_N, KnownReadings, NoiseReference, Touch, anywhere, grid};
use super::super::{OnProgress, StudyError, carried_out};
use super::design::{SIDE, SensorDesign, cells, mean_errors};
use super::{FewSize, JUDGED_SEEDS, broken};
use palpate_core::quantity::stream;
use palpate_data::acceptance::{
    AcceptanceRule, Decision, Limit, LimitedFigure, Measured, SensorVerdict, TestErrors, judge,
};
use palpate_solver::{Belongs, Prior, SOLVERS, Setting, Solver, Workspace, fit};
use rand::RngExt;
use serde::Serialize;

/// Verdicts by one way of calibrating.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct VerdictRow {
    /// Name of the study.
    pub study: &'static str,
    /// Letter of the noise.
    pub scene: &'static str,
    /// Word of the acceptance rule.
    pub rule: &'static str,
    /// Number of calibration presses; those of a full calibration are used without a prior.
    pub presses: usize,
    /// Number of sensors.
    pub sensors: usize,
    /// Number of sensors whose true mean error exceeds the limit.
    pub bad: usize,
    /// Number of these that are accepted.
    pub accepted_wrongly: usize,
    /// Number of sensors within the limit that are not accepted.
    pub rejected_wrongly: usize,
    /// Number of sensors within the limit that are refused as foreign sensors.
    pub refused_wrongly: usize,
    /// Number of sensors that are not decided.
    pub not_decided: usize,
}

/// Number of test presses of a sensor. The second constant is the number of contacts that show its true mean error.
const TEST_PRESSES: usize = 100;
const CONTACTS: usize = 2000;
/// Range of the factor for the noise of a sensor, so that sensors are better and worse than the limit.
const NOISE: (f64, f64) = (0.8, 1.2);
/// Limits of the mean location error, mm, for both noises: in the middle of the sensors.
const LIMITS_MM: [f64; 2] = [0.23, 0.040];
/// Method of a full calibration without a prior.
const WHOLE: &str = SOLVERS[4];

/// Verdict about one sensor, and whether its true error exceeds the limit.
struct JudgedSensor {
    is_bad: bool,
    is_refused: bool,
    verdict: SensorVerdict,
}

/// Judges sensors by the guarded rule and by the simple rule, after nine presses and after a full calibration.
///
/// # Errors
/// Never in practice: simulated presses are suitable for calibration.
pub fn verdicts(size: FewSize, on_progress: OnProgress<'_>) -> Result<Vec<VerdictRow>, StudyError> {
    let mut rows = Vec::new();
    for (noise, limit_mm) in NoiseReference::ALL.into_iter().zip(LIMITS_MM) {
        let design = SensorDesign::papers(noise);
        let prior = design.prior()?;
        let seeds: Vec<u64> = (0..size.judged as u64).map(|sensor| JUDGED_SEEDS + sensor).collect();
        let judged = carried_out(&seeds, on_progress, |&seed| sensor(&design, &prior, seed, limit_mm))?;
        for (decision, index) in [(Decision::Guarded, 0), (Decision::Simple, 1)] {
            for (presses, way) in [(9, 0), (SIDE * SIDE, 1)] {
                let of_it = || judged.iter().map(|of_sensor| &of_sensor[way][index]);
                let count = |is: &dyn Fn(&JudgedSensor) -> bool| of_it().filter(|judged| is(judged)).count();
                rows.push(VerdictRow {
                    study: "verdicts",
                    scene: noise.name(),
                    rule: decision.word(),
                    presses,
                    sensors: size.judged,
                    bad: count(&|judged| judged.is_bad),
                    accepted_wrongly: count(&|judged| judged.is_bad && judged.verdict == SensorVerdict::Accepted),
                    rejected_wrongly: count(&|judged| !judged.is_bad && judged.verdict == SensorVerdict::NotAccepted),
                    refused_wrongly: count(&|judged| !judged.is_bad && judged.is_refused),
                    not_decided: count(&|judged| judged.verdict == SensorVerdict::NotDecided),
                });
            }
        }
    }
    Ok(rows)
}

/// Judges one sensor: by few presses and by a full calibration, each by both rules.
fn sensor(
    design: &SensorDesign,
    prior: &Prior,
    seed: u64,
    limit_mm: f64,
) -> Result<[[JudgedSensor; 2]; 2], StudyError> {
    let factor = stream(seed, 0, "noise of a sensor").random_range(NOISE.0..=NOISE.1);
    let design = design.with(|skin| {
        let of_units = skin.noise.iter_mut().flat_map(|noise| &mut noise.repeatability_percent);
        of_units.for_each(|percent| *percent *= factor);
    });
    let setting = Setting { appraised: false, ..Setting::of_layout(Some(design.layout())) };
    let family_sensor = prior.family_sensor(&design.calibration(seed, &cells(3, 3))?, &setting).map_err(broken)?;
    let whole = fit(WHOLE, &design.calibration(seed, &grid(SIDE))?, &setting).map_err(broken)?;
    let is_refused = matches!(family_sensor.belongs, Belongs::Outsider(_));
    let contacts = design.read(seed, &touches(seed, CONTACTS), "noise of contacts");
    let test = design.read(seed, &touches(seed + 1, TEST_PRESSES), "noise of the test");
    let judged = |solver: &dyn Solver, is_refused: bool| {
        let is_bad = mean_errors(solver, &contacts).location_mm > limit_mm;
        [Decision::Guarded, Decision::Simple].map(|decision| {
            let verdict =
                if is_refused { SensorVerdict::NotAccepted } else { by_rule(decision, limit_mm, solver, &test) };
            JudgedSensor { is_bad, is_refused, verdict }
        })
    };
    Ok([judged(family_sensor.model.fitted(), is_refused), judged(&whole, false)])
}

fn touches(seed: u64, count: usize) -> Vec<Touch> {
    anywhere(count, FORCES_N, &mut stream(seed, 1, "contacts"))
}

/// Returns the verdict about the mean location error of some test presses.
fn by_rule(decision: Decision, limit_mm: f64, solver: &dyn Solver, test: &KnownReadings) -> SensorVerdict {
    let mut workspace = Workspace::default();
    let sizes = test.iter().filter_map(|(truth, outputs)| {
        Some(solver.solve(outputs, &mut workspace).ok()?.place.distance_mm(truth.place))
    });
    let sizes: Vec<f64> = sizes.collect();
    let rule = AcceptanceRule {
        decision,
        method: solver.name().to_owned(),
        calibration_presses_least: 1,
        test_presses_least: 1,
        holdout: false,
        limits: vec![Limit { figure: LimitedFigure::LocationMean, limit: limit_mm, reach: None }],
        called_sound: false,
        afterwards_by: None,
    };
    let measured = Measured {
        calibration_presses: 9,
        test_presses: sizes.len(),
        location: Some(TestErrors { sizes, u_truth: Some(0.0) }),
        broken_outputs: Some(Vec::new()),
        ..Measured::default()
    };
    judge(&rule, &measured).verdict
}
