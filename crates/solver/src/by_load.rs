//! Two fits to presses of unknown force: one for any load, and one for the load of the calibration.

use super::fitted::Answering;
use super::heldout::HeldPress;
use super::method::FittedMethod;
use super::rescaled::Rescaled;
use super::threshold::upper;
use super::{Calibration, Locate as _, LocatedContact, Solution, SolveError, Solver, Workspace};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Answers with the fit for the load of the calibration where the reading is one that the calibration may have given, and with the fit
/// for any load elsewhere. Only the fit for the load of the calibration uses the amplitude of a reading.
///
/// A reading with nearly the load of the calibration may look like one of another place under this load. So that fit answers only in a
/// session where few readings have another load.
#[derive(Serialize, Deserialize)]
pub(super) struct ByLoad {
    /// Method that doesn't use the amplitude.
    pub any: Box<Answering>,
    /// Method that assumes the load of the calibration.
    pub calibrated: Box<Answering>,
    /// Largest misfit of an answer of the second method that counts, and the fraction of readings with the calibration's load that
    /// exceed it.
    most_misfit: f64,
    refused: f64,
    pub lengths: Lengths,
}

/// Mean location error of answers to held-out presses, with and without the assumption of the calibration's load.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadGain {
    /// Name of the method that assumes the load of the calibration.
    pub solver: String,
    /// Mean error of the method for any load, mm.
    pub any_mm: f64,
    /// Mean error if the other method answers readings that have the calibration's load, mm.
    pub by_load_mm: f64,
}

/// Factors by which held-out presses are scaled, the calibration's load first.
pub(super) const LOADS: [f64; 4] = [1.0, 0.3, 0.5, 2.0];

/// Largest ratio of both mean errors at the calibration's load with which the second method is used.
const WORTH_IT: f64 = 0.9;
/// Largest ratio of both mean errors under other loads: the mean of these loads, and for any of them.
const LOSS_IN_MEAN: f64 = 1.02;
const LOSS_AT_ANY: f64 = 1.05;

/// Fractions of the presses with the calibration's load whose answer by the second method may be refused for its residue: one of them is
/// used.
const REFUSED: [f64; 3] = [0.01, 0.1, 0.3];

/// Weight of the newest reading in the fraction of readings with another load, and its largest excess over the refused fraction.
const NEWEST_WEIGHT: f64 = 0.1;
const MOST_OTHER_LOADS: f64 = 0.25;

/// Number of calibration presses near a place with which the length of a reading is compared, and its largest distance from their
/// mean, in their standard deviations.
const NEAREST: usize = 8;
const LENGTH_SIGMAS: f64 = 3.0;

impl ByLoad {
    pub(crate) fn new(any: Answering, calibrated: Answering, earned: &Earned, calibration: &Calibration) -> Self {
        ByLoad {
            most_misfit: earned.most_residue / calibrated.most_residue(),
            refused: earned.refused,
            lengths: Lengths::of(calibration),
            any: Box::new(any),
            calibrated: Box::new(calibrated),
        }
    }
}

impl ByLoad {
    /// Rescales both methods. The second one answers the same readings as before.
    pub(crate) fn rescale(&mut self, rescaled: &Rescaled) {
        self.any.rescale(rescaled);
        self.calibrated.rescale(rescaled);
        self.most_misfit /= rescaled.misfit;
    }
}

impl Solver for ByLoad {
    fn name(&self) -> &'static str {
        self.any.solver().name()
    }

    fn solve(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Solution, SolveError> {
        let calibrated = self.calibrated.solver().solve(outputs, workspace).ok().and_then(|solution| {
            let fits = solution.misfit.is_some_and(|misfit| misfit <= self.most_misfit);
            let force = self.lengths.force_at(solution.place, outputs).filter(|_| fits)?;
            Some(Solution { force_n: force, is_calibrated_load: true, ..solution })
        });
        let is_other = f64::from(u8::from(calibrated.is_none()));
        workspace.other_loads += NEWEST_WEIGHT * (is_other - workspace.other_loads);
        if let Some(solution) = calibrated.filter(|_| workspace.other_loads <= self.refused + MOST_OTHER_LOADS) {
            return Ok(solution);
        }
        self.any.solver().solve(outputs, workspace)
    }
}

/// Both methods, fitted to a part of the presses.
pub(super) struct Both {
    pub any: FittedMethod,
    pub calibrated: FittedMethod,
    pub lengths: Lengths,
}

/// Answers of both methods to one reading.
pub(super) struct BothAnswers {
    any: Result<LocatedContact, SolveError>,
    calibrated: Result<LocatedContact, SolveError>,
    /// Whether the calibration had readings of this length near the place that the second method finds.
    has_length: bool,
}

impl BothAnswers {
    /// Whether the answer of the second method counts.
    fn counts(&self, most_residue: f64) -> bool {
        self.has_length && self.calibrated.as_ref().is_ok_and(|found| found.residue <= most_residue)
    }
}

impl Both {
    pub(crate) fn answers(&self, outputs: &[f64], workspace: &mut Workspace) -> BothAnswers {
        let any = self.any.locate(outputs, workspace);
        let calibrated = self.calibrated.locate(outputs, workspace);
        let has_length = calibrated.as_ref().is_ok_and(|found| self.lengths.force_at(found.place, outputs).is_some());
        BothAnswers { any, calibrated, has_length }
    }
}

/// A second method that is worth using.
pub(super) struct Earned {
    pub gain: LoadGain,
    /// Trials under the calibration's load that the second method answers.
    pub answered: Vec<HeldPress>,
    /// Largest residue of an answer of the second method that counts, and the fraction of the presses that exceed it.
    most_residue: f64,
    refused: f64,
}

impl Earned {
    /// Returns the second method with the limit of its residue that gives the least error under the calibration's load, among the limits
    /// that cost little under other loads; `None` if there is no such limit. `trials` has a trial for each of [`LOADS`], press
    /// after press.
    pub(crate) fn of(trials: &[HeldPress<BothAnswers>], solver: &str) -> Option<Self> {
        let at = |load: usize| trials.iter().skip(load).step_by(LOADS.len()).collect::<Vec<_>>();
        let residues =
            || at(0).into_iter().filter_map(|trial| Some(trial.answer.calibrated.as_ref().ok()?.residue)).collect();
        let limits = REFUSED.into_iter().filter_map(|refused| Some((refused, upper(residues(), refused)?)));
        let tried = limits.filter_map(|(refused, most_residue)| {
            let errors: Vec<[f64; 2]> =
                (0..LOADS.len()).map(|load| mean_errors_mm(&at(load), refused, most_residue)).collect();
            let [any_mm, by_load_mm] = errors[0];
            let losses = || errors[1..].iter().map(|[any_mm, by_load_mm]| by_load_mm / any_mm);
            let mean = losses().sum::<f64>() / (LOADS.len() - 1) as f64;
            let costs_little = mean <= LOSS_IN_MEAN && losses().all(|loss| loss <= LOSS_AT_ANY);
            let is_earned = by_load_mm <= WORTH_IT * any_mm && costs_little;
            is_earned.then(|| (refused, most_residue, LoadGain { solver: solver.to_owned(), any_mm, by_load_mm }))
        });
        let (refused, most_residue, gain) = tried.min_by(|(.., a), (.., b)| a.by_load_mm.total_cmp(&b.by_load_mm))?;
        let answered = at(0).into_iter().filter(|trial| trial.answer.counts(most_residue)).map(|trial| HeldPress {
            place: trial.place,
            force_n: 1.0,
            is_inside: trial.is_inside,
            loudness: trial.loudness,
            answer: trial.answer.calibrated.clone(),
        });
        Some(Earned { gain, answered: answered.collect(), most_residue, refused })
    }
}

/// Returns the mean location errors of trials inside the area, mm: of the method for any load alone, and of a session with the second
/// method. A session in which many readings have another load doesn't use it.
fn mean_errors_mm(trials: &[&HeldPress<BothAnswers>], refused: f64, most_residue: f64) -> [f64; 2] {
    let others = trials.iter().filter(|trial| !trial.answer.counts(most_residue)).count();
    let is_used = others as f64 <= (refused + MOST_OTHER_LOADS) * trials.len() as f64;
    let (mut any_mm, mut by_load_mm, mut count) = (0.0, 0.0, 0.0);
    for HeldPress { place, answer, .. } in trials.iter().filter(|trial| trial.is_inside) {
        let Ok(any) = &answer.any else { continue };
        let found = answer.calibrated.as_ref().ok().filter(|_| is_used && answer.counts(most_residue)).unwrap_or(any);
        any_mm += any.place.distance_mm(*place);
        by_load_mm += found.place.distance_mm(*place);
        count += 1.0;
    }
    [any_mm, by_load_mm].map(|sum| sum / count)
}

/// Lengths of the calibration's readings.
#[derive(Serialize, Deserialize)]
pub(super) struct Lengths {
    places: Vec<Place>,
    /// Logarithms of the lengths.
    logs: Vec<f64>,
    /// Root mean square of the lengths.
    typical: f64,
}

impl Lengths {
    pub(crate) fn of(calibration: &Calibration) -> Self {
        let lengths: Vec<f64> = calibration.points().map(|point| length(point.outputs)).collect();
        let typical = (lengths.iter().map(|length| length * length).sum::<f64>() / lengths.len() as f64).sqrt();
        let places = calibration.points().map(|point| point.place).collect();
        Lengths { places, logs: lengths.into_iter().map(f64::ln).collect(), typical }
    }

    /// Returns the length of a reading relative to the typical one, if it is a length that the calibration had near a place.
    fn force_at(&self, place: Place, outputs: &[f64]) -> Option<f64> {
        (self.off(place, outputs) == Some(0.0)).then(|| length(outputs) / self.typical)
    }

    /// Returns the difference of the logarithms of a reading's length and of the mean length of the calibration's readings near a place;
    /// 0 if the calibration had such lengths there. `None` if they aren't known.
    pub(crate) fn off(&self, place: Place, outputs: &[f64]) -> Option<f64> {
        let mut nearest = [(f64::INFINITY, f64::NAN); NEAREST];
        for (other, &log) in self.places.iter().zip(&self.logs) {
            let square_mm2 = (other.x_mm - place.x_mm).powi(2) + (other.y_mm - place.y_mm).powi(2);
            if square_mm2 < nearest[NEAREST - 1].0 {
                let rank = nearest.partition_point(|(known, _)| *known <= square_mm2);
                nearest[rank..].rotate_right(1);
                nearest[rank] = (square_mm2, log);
            }
        }
        let count = NEAREST as f64;
        let mean = nearest.iter().map(|(_, log)| log).sum::<f64>() / count;
        let sd = (nearest.iter().map(|(_, log)| (log - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
        let off = (length(outputs).ln() - mean).abs();
        off.is_finite().then_some(if off <= LENGTH_SIGMAS * sd { 0.0 } else { off })
    }
}

fn length(outputs: &[f64]) -> f64 {
    outputs.iter().map(|output| output * output).sum::<f64>().sqrt()
}
