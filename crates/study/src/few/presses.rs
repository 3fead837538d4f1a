//! Error of a new sensor as a function of the number of its presses.

use super::super::bench::{StudyBench, executed};
use super::super::condition::{WINDOW_S, last_s};
use super::super::methods::specimen::{CALIBRATION_N, FORCES_N, NoiseReference, Touch, grid};
use super::super::minutes::{HANDLING_MIN, TOLERANCE_N};
use super::super::{OnProgress, StudyError, carried_out};
use super::design::{SENSORS, SIDE, SensorDesign, cells, mean_errors, presses_at};
use super::{FewSize, NEW_SEEDS, broken};
use palpate_control::Strategy;
use palpate_core::quantity::round;
use palpate_data::recipe::{Manner, Phase, Places, Plan, Recipe, Step, StepLoad};
use palpate_solver::{BEST, Belongs, MeanErrors, Prior, Setting, fit};
use serde::Serialize;

/// How a new sensor is calibrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// With the prior, at the centres of equal cells.
    PriorCells,
    /// With the prior, at places of which each lowers the expected error most.
    PriorChosen,
    /// With the prior, on a grid up to the borders of the area.
    PriorGrid,
    /// With the prior of a design whose layer is 10 % thinner, at the centres of equal cells.
    WrongPrior,
    /// Without a prior, at the centres of equal cells.
    Cells,
    /// Without a prior, on a grid up to the borders of the area.
    Grid,
    /// Without a prior, on a full grid, by the paper's method.
    Paper,
}

/// Result of one way with one number of presses.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FewRow {
    /// Name of the study.
    pub study: &'static str,
    /// Letter of the noise.
    pub scene: &'static str,
    /// How the sensors are calibrated.
    pub way: Way,
    /// Number of presses.
    pub presses: usize,
    /// Minutes at the bench, of which [`HANDLING_MIN`] are handling.
    pub minutes: Option<f64>,
    /// Number of sensors.
    pub sensors: usize,
    /// Mean location error, mm, and the standard error of this mean.
    pub location_error_mm: f64,
    /// Standard error of the mean location error, mm.
    pub within_mm: f64,
    /// Mean force error, N.
    pub force_error_n: f64,
    /// Mean of the location errors that the prior expects for contacts of the presses' force, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_mm: Option<f64>,
    /// Fraction of the sensors that are typical for the design. The others need a full calibration, or are refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub typical: Option<f64>,
}

/// Numbers of cells along x and y.
const CELLS: [(usize, usize); 9] = [(1, 1), (2, 1), (2, 2), (3, 2), (3, 3), (4, 3), (4, 4), (5, 5), (7, 7)];
/// Numbers of chosen places.
const CHOSEN: [usize; 10] = [1, 2, 3, 4, 5, 6, 9, 12, 16, 25];
/// Numbers of places along a side of a grid, with a prior and without one.
const PRIOR_SIDES: [usize; 4] = [2, 3, 4, 5];
const SIDES: [usize; 6] = [3, 4, 5, 7, 13, SIDE];
/// Sides of grids of cells without a prior.
const CELL_SIDES: [usize; 5] = [3, 4, 5, 7, 13];
/// Thickness of the wrong prior's layer, relative to that of the sensors.
const WRONG_LAYER: f64 = 0.9;
/// Force of contacts for which places are chosen, N: the middle of the test.
const CONTACT_N: f64 = 0.5 * (FORCES_N.0 + FORCES_N.1);

/// One way with one list of presses.
struct FewTry {
    noise: NoiseReference,
    way: Way,
    touches: Vec<Touch>,
}

/// The result of one sensor.
struct SensorResult {
    errors: MeanErrors,
    expected_mm: Option<f64>,
    is_typical: Option<bool>,
}

/// Calibrates new sensors in every way.
///
/// # Errors
/// Never in practice: simulated presses are suitable for calibration.
pub fn presses(size: FewSize, on_progress: OnProgress<'_>) -> Result<Vec<FewRow>, StudyError> {
    let mut rows = Vec::new();
    let designs = NoiseReference::ALL.map(|noise| (noise, SensorDesign::papers(noise)));
    let mut jobs: Vec<FewTry> = Vec::new();
    let mut priors: Vec<[Prior; 2]> = Vec::new();
    for (noise, design) in &designs {
        let prior = design.prior()?;
        let mut add = |way, touches| jobs.push(FewTry { noise: *noise, way, touches });
        for (columns, count) in CELLS {
            add(Way::PriorCells, cells(columns, count));
            add(Way::WrongPrior, cells(columns, count));
        }
        let order = prior.chosen_places(CHOSEN[CHOSEN.len() - 1], CALIBRATION_N, CONTACT_N);
        CHOSEN.iter().for_each(|&count| add(Way::PriorChosen, presses_at(&order[..count])));
        PRIOR_SIDES.iter().for_each(|&side| add(Way::PriorGrid, grid(side)));
        CELL_SIDES.iter().for_each(|&side| add(Way::Cells, cells(side, side)));
        SIDES.iter().for_each(|&side| add(Way::Grid, grid(side)));
        add(Way::Paper, grid(SIDE));
        priors.push([prior, design.with_layer(WRONG_LAYER).prior()?]);
    }
    let minutes = carried_out(&jobs, &|_, _| {}, |job| minutes(&job.touches))?;
    let tries: Vec<(usize, u64)> = (0..jobs.len())
        .flat_map(|job| (0..size.of(jobs[job].way)).map(move |sensor| (job, NEW_SEEDS + sensor as u64)))
        .collect();
    let tried = carried_out(&tries, on_progress, |&(index, seed)| {
        let job = &jobs[index];
        let nth = designs.iter().position(|(noise, _)| *noise == job.noise).unwrap_or(0);
        job.try_on(&designs[nth].1, &priors[nth], seed, size.tests)
    })?;
    for (index, job) in jobs.iter().enumerate() {
        let of_it: Vec<&SensorResult> =
            tries.iter().zip(&tried).filter(|((job, _), _)| *job == index).map(|(_, tried)| tried).collect();
        rows.push(job.row(&of_it, minutes[index]));
    }
    Ok(rows)
}

impl FewSize {
    fn of(&self, way: Way) -> usize {
        match way {
            Way::Cells | Way::Grid => self.without,
            _ => self.sensors,
        }
    }
}

impl FewTry {
    fn try_on(
        &self,
        design: &SensorDesign,
        [prior, wrong]: &[Prior; 2],
        seed: u64,
        tests: usize,
    ) -> Result<SensorResult, StudyError> {
        let (new, test) = (design.calibration(seed, &self.touches)?, design.test(seed, tests));
        let setting = Setting::of_layout(Some(design.layout()));
        let alone = |name| -> Result<SensorResult, StudyError> {
            let fitted = fit(name, &new, &setting).map_err(broken)?;
            Ok(SensorResult { errors: mean_errors(&fitted, &test), expected_mm: None, is_typical: None })
        };
        let prior = match self.way {
            Way::Cells | Way::Grid => return alone(BEST),
            Way::Paper => return alone(palpate_solver::SOLVERS[0]),
            Way::WrongPrior => wrong,
            Way::PriorCells | Way::PriorChosen | Way::PriorGrid => prior,
        };
        let family_sensor = prior.family_sensor(&new, &setting).map_err(broken)?;
        Ok(SensorResult {
            errors: mean_errors(family_sensor.model.fitted(), &test),
            expected_mm: Some(family_sensor.expected_mm),
            is_typical: Some(family_sensor.belongs == Belongs::Typical),
        })
    }

    fn row(&self, tried: &[&SensorResult], minutes: Option<f64>) -> FewRow {
        let count = tried.len() as f64;
        let mean = |of: &dyn Fn(&SensorResult) -> f64| tried.iter().map(|tried| of(tried)).sum::<f64>() / count;
        let location_mm = mean(&|tried| tried.errors.location_mm);
        let variance = mean(&|tried| (tried.errors.location_mm - location_mm).powi(2));
        let expected_mm = tried.iter().all(|tried| tried.expected_mm.is_some());
        let expected_mm = expected_mm.then(|| round(mean(&|tried| tried.expected_mm.unwrap_or(0.0)), 4));
        let typical = tried.iter().all(|tried| tried.is_typical.is_some());
        let typical = typical.then(|| round(mean(&|tried| f64::from(u8::from(tried.is_typical == Some(true)))), 4));
        FewRow {
            study: "few",
            scene: self.noise.name(),
            way: self.way,
            presses: self.touches.len(),
            minutes: minutes.map(|minutes| round(minutes, 2)),
            sensors: tried.len(),
            location_error_mm: round(location_mm, 4),
            within_mm: round((variance / (count - 1.0).max(1.0)).sqrt(), 4),
            force_error_n: round(mean(&|tried| tried.errors.force_n), 5),
            expected_mm,
            typical,
        }
    }
}

/// Returns the minutes at the bench for presses at some places, from a run in virtual time on the fast bench; `None` if a rule
/// ended the run.
fn minutes(touches: &[Touch]) -> Result<Option<f64>, StudyError> {
    let spec = StudyBench::XpsLike.spec()?;
    let manner =
        Manner { force_tolerance_n: TOLERANCE_N, sample_s: WINDOW_S, strategy: Strategy::Map, ..Manner::PAPER };
    let places = touches.iter().map(|touch| (touch.place, 0..0)).collect();
    let step = Step::new(Phase::Calibration, Places::List(places), StepLoad::Force(CALIBRATION_N), manner);
    let plan = Plan::new(&Recipe::new("few", vec![step]), &spec.ground(), SENSORS)?;
    let (contacts, ending) = executed(&plan, &spec)?;
    let run_min = last_s(&contacts.iter().collect::<Vec<_>>()).map(|seconds| seconds / 60.0);
    Ok(run_min.filter(|_| ending.halt.is_none()).map(|run_min| HANDLING_MIN + run_min))
}
