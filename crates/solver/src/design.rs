//! One map for the sensors of a design, for a sensor that wasn't calibrated.

use super::adapt::Moved;
use super::field::CalibratedArea;
use super::fitted::Answering;
use super::heldout::{GOLDEN_SHARE, shuffle};
use super::prior::Aligned;
use super::rescaled::{HeldAnswer, Rescaled};
use super::{
    ArrayChange, Calibration, CalibrationPoint, ContactVerdict, ErrorSummary, FitError, Fitted, HalfWidths, MeanErrors,
    Model, PreparedCalibration, PriorError, Setting, Solver as _, Workspace,
};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::{Place, stream};
use rand::Rng;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use serde::Serialize;

/// A method fitted to the presses of several sensors, each aligned to the design's typical sensor as in [`Prior`](super::Prior).
pub struct DesignMap {
    /// The method. Its half-widths and its limits of a misfit are those of a further sensor: each sensor was solved by the method
    /// fitted to the others.
    pub model: Model,
    /// The sensors, in the given order.
    pub sensors: Vec<DesignSensor>,
}

/// A sensor that contributed to the map of its design.
#[derive(Clone, Debug)]
pub struct DesignSensor {
    /// Number of its presses.
    pub presses: usize,
    /// Change of each output, compared with the design's typical sensor.
    pub change: ArrayChange,
    /// Mean errors on its presses of the method fitted to the other sensors.
    pub by_the_others: MeanErrors,
}

/// The presses of a sensor.
#[derive(Clone, Debug)]
pub struct SensorPresses {
    /// Its calibration.
    pub calibration: Calibration,
    /// Its test; without one, the presses of the calibration are solved.
    pub test: Option<Calibration>,
}

/// Errors of a sensor that the fitted sensors don't include.
#[derive(Clone, Debug, Serialize)]
pub struct LeftOutSensor {
    /// Errors of the map of the others.
    pub by_the_others: SensorErrors,
    /// Errors on the same presses of a method of that name fitted to the sensor's own calibration, without the place of the press.
    pub by_its_own: SensorErrors,
}

/// Errors on presses that weren't fitted.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SensorErrors {
    /// Number of presses that were solved.
    pub presses: usize,
    /// Distance between true and solved place, mm.
    pub location_error_mm: ErrorSummary,
    /// Absolute difference between true and solved force, N.
    pub force_error_n: ErrorSummary,
    /// Fraction of location errors within `half68_mm`, and within `half95_mm`.
    pub location_within: [f64; 2],
    /// Fraction of force errors within `half68_n`, and within `half95_n`.
    pub force_within: [f64; 2],
    /// Fraction of single contacts with another verdict than ok.
    pub flagged: f64,
}

/// Number of parts into which the places of a sensor are divided. One part at a time is unknown to the method.
const PARTS: usize = 5;

/// Presses of a calibration that are nearer to a press than this fraction of the distance of its places are at the same place.
const SAME_PLACE: f64 = 0.25;
/// Least of this distance, mm.
const SAME_MM: f64 = 1e-3;

impl DesignMap {
    /// Fits the method of that name to the calibrations of at least two sensors.
    ///
    /// # Errors
    /// The calibrations are of different arrays, forces are unknown, or the method can't be fitted.
    pub fn new(name: &str, calibrations: &[Calibration], setting: &Setting<'_>) -> Result<Self, PriorError> {
        let JointFit { fitted, presses, changes, by_the_others, .. } =
            JointFit::of_design(name, calibrations, setting)?;
        let sensor = |((calibration, change), answers): ((&Calibration, ArrayChange), &Vec<HeldAnswer>)| {
            let SensorErrors { location_error_mm, force_error_n, .. } = SensorErrors::of(answers)?;
            let by_the_others = MeanErrors { location_mm: location_error_mm.mean, force_n: force_error_n.mean };
            Ok(DesignSensor { presses: calibration.len(), change, by_the_others })
        };
        let sensors = calibrations.iter().zip(changes).zip(&by_the_others).map(sensor);
        let sensors = sensors.collect::<Result<Vec<_>, PriorError>>()?;
        Ok(DesignMap { model: Model::of(fitted, presses, setting), sensors })
    }
}

/// Solves the presses of each of at least two sensors by the map of the others, and returns the errors of each and of all.
///
/// # Errors
/// As [`DesignMap::new`].
pub fn leave_one_sensor_out(
    name: &str,
    sensors: &[SensorPresses],
    setting: &Setting<'_>,
) -> Result<(Vec<LeftOutSensor>, SensorErrors), PriorError> {
    let (mut each, mut all) = (Vec::new(), Vec::new());
    for (index, SensorPresses { calibration, test }) in sensors.iter().enumerate() {
        let answers = |fit: JointFit<'_>, is_own: bool| match test {
            Some(test) => Ok::<_, PriorError>(answers(&fit.fitted, test, 0..test.len())),
            None => Ok(fit.answers(calibration, is_own)?.0),
        };
        let calibrations: Vec<Calibration> = sensors.iter().map(|sensor| sensor.calibration.clone()).collect();
        let others = answers(JointFit::of_design(name, &without(&calibrations, index), setting)?, false)?;
        let own = answers(JointFit::of(name, std::slice::from_ref(calibration), setting)?, true)?;
        each.push(LeftOutSensor { by_the_others: SensorErrors::of(&others)?, by_its_own: SensorErrors::of(&own)? });
        all.extend(others);
    }
    Ok((each, SensorErrors::of(&all)?))
}

/// A method fitted to the aligned presses of some sensors.
struct JointFit<'a> {
    prepared: PreparedCalibration<'a>,
    fitted: Fitted,
    presses: Calibration,
    changes: Vec<ArrayChange>,
    /// Answers to the presses of each sensor by the method fitted to the others.
    by_the_others: Vec<Vec<HeldAnswer>>,
    rescaled: Option<Rescaled>,
}

impl<'a> JointFit<'a> {
    /// Fits the method, whose half-widths are those of the sensors that it knows.
    fn of(name: &str, calibrations: &[Calibration], setting: &Setting<'a>) -> Result<Self, PriorError> {
        let aligned = Aligned::of(calibrations, setting.layout)?;
        let (presses, changes) = (joined(&aligned), aligned.changes());
        let prepared = PreparedCalibration::new(presses.clone(), setting)?;
        let fitted = prepared.fit(name)?;
        Ok(JointFit { prepared, fitted, presses, changes, by_the_others: Vec::new(), rescaled: None })
    }

    /// Fits the method, whose half-widths and limits are those of a further sensor, as far as there are two sensors that show them.
    fn of_design(name: &str, calibrations: &[Calibration], setting: &Setting<'a>) -> Result<Self, PriorError> {
        let all = JointFit::of(name, calibrations, setting)?;
        if calibrations.len() < 2 {
            return Ok(all);
        }
        let chosen = all.fitted.name();
        let left_out = |&index: &usize| {
            JointFit::of(chosen, &without(calibrations, index), setting)?.answers(&calibrations[index], false)
        };
        let each = in_parallel(&(0..calibrations.len()).collect::<Vec<_>>(), left_out);
        let each = each.into_iter().collect::<Result<Vec<_>, PriorError>>()?;
        let (by_the_others, scaled): (Vec<_>, Vec<_>) = each.into_iter().unzip();
        let rescaled = Rescaled::of(&scaled.concat(), true);
        Ok(JointFit { fitted: all.fitted.rescaled(&rescaled), rescaled: Some(rescaled), by_the_others, ..all })
    }

    /// Solves presses as they were measured, and scaled to the expected forces as in [`Folds`](super::heldout::Folds). Presses of its
    /// own sensor, and all presses by a method that learned from readings, are solved by the method fitted without their places: it could
    /// recognise a place. An inverted map can't, and without a place it would be less certain than it is in use.
    fn answers(&self, new: &Calibration, is_own: bool) -> Result<(Vec<HeldAnswer>, Vec<HeldAnswer>), PriorError> {
        let mut rng = stream(0, 0, "presses of a further sensor");
        let scaled = self.scaled(new, &mut rng)?;
        if !is_own && matches!(self.fitted.answering(), Answering::Forward(_)) {
            return Ok((answers(&self.fitted, new, 0..new.len()), answers(&self.fitted, &scaled, 0..new.len())));
        }
        let (mut spots, same_mm) = (new.by_place(), same_place_mm(&self.presses));
        shuffle(&mut spots, &mut rng);
        let mut found = (Vec::new(), Vec::new());
        for part in 0..PARTS.min(spots.len()) {
            let held: Vec<usize> = spots.iter().skip(part).step_by(PARTS).flatten().copied().collect();
            let is_held = |known: &usize| {
                let place = self.presses.point(*known).place;
                held.iter().any(|&press| new.point(press).place.distance_mm(place) < same_mm)
            };
            let known: Vec<usize> = (0..self.presses.len()).filter(|press| !is_held(press)).collect();
            if known.is_empty() {
                return Err(FitError::NothingToTellApart.into());
            }
            let fitted = self.prepared.fit_again(self.fitted.name(), &self.presses.subset(&known))?;
            let fitted = match &self.rescaled {
                Some(rescaled) => fitted.rescaled(rescaled),
                None => fitted,
            };
            found.0.extend(answers(&fitted, new, held.iter().copied()));
            found.1.extend(answers(&fitted, &scaled, held));
        }
        Ok(found)
    }

    /// Returns presses scaled to the expected forces, as noisy as measured ones.
    fn scaled(&self, new: &Calibration, rng: &mut impl Rng) -> Result<Calibration, PriorError> {
        let (response, (least, most)) = (self.prepared.response()?, self.prepared.setting().shares(new));
        let mut row = |(index, point): (usize, CalibrationPoint<'_>)| {
            let share = least + (most - least) * (index as f64 * GOLDEN_SHARE).fract();
            let output = |(unit, output): (usize, &f64)| {
                let normal: f64 = StandardNormal.sample(rng);
                share * output + response.missing_noise(unit, share) * normal
            };
            (point.place, share * point.force_n, point.outputs.iter().enumerate().map(output).collect::<Vec<f64>>())
        };
        let rows: Vec<_> = new.points().enumerate().map(&mut row).collect();
        Ok(calibration(&rows).unwrap_or_else(|| new.clone()))
    }
}

fn without(calibrations: &[Calibration], index: usize) -> Vec<Calibration> {
    let others = calibrations.iter().enumerate().filter(|(other, _)| *other != index);
    others.map(|(_, calibration)| calibration.clone()).collect()
}

/// Returns the answers to some presses; those without an answer are missing.
fn answers(fitted: &Fitted, new: &Calibration, presses: impl IntoIterator<Item = usize>) -> Vec<HeldAnswer> {
    let mut workspace = Workspace::default();
    presses.into_iter().filter_map(|press| HeldAnswer::of(fitted, &new.point(press), &mut workspace)).collect()
}

/// Returns the presses of all sensors as one calibration. A press that is near a place of an earlier sensor is moved onto it, with the
/// difference of the outputs by the map, so that presses at measured places are held out together too.
fn joined(aligned: &Aligned) -> Calibration {
    let (Some(map), [first, others @ ..]) = (&aligned.map, aligned.calibrations.as_slice()) else {
        return aligned.joined();
    };
    let same_mm = same_place_mm(first);
    let mut rows: Vec<_> = first.points().map(|point| (point.place, point.force_n, point.outputs.to_vec())).collect();
    for sensor in others {
        let places: Vec<Place> = rows.iter().map(|(place, ..)| *place).collect();
        rows.extend(sensor.points().map(|CalibrationPoint { place, force_n, outputs }| {
            let nearest = places.iter().min_by(|a, b| a.distance_mm(place).total_cmp(&b.distance_mm(place)));
            let onto = nearest.filter(|other| other.distance_mm(place) < same_mm).copied().unwrap_or(place);
            let read = |unit: usize, at: Place| map.felt(unit, at, &Moved::ZERO)[0];
            let moved = |(unit, output): (usize, &f64)| output + force_n * (read(unit, onto) - read(unit, place));
            (onto, force_n, outputs.iter().enumerate().map(moved).collect())
        }));
    }
    calibration(&rows).unwrap_or_else(|| aligned.joined())
}

/// Returns a calibration of places, forces and outputs.
fn calibration(rows: &[(Place, f64, Vec<f64>)]) -> Option<Calibration> {
    let points =
        rows.iter().map(|(place, force_n, outputs)| CalibrationPoint { place: *place, force_n: *force_n, outputs });
    Calibration::new(&points.collect::<Vec<_>>()).ok()
}

/// Distance below which presses are at one place, mm: a fraction of the distance between the places of a calibration if they are evenly
/// distributed.
fn same_place_mm(calibration: &Calibration) -> f64 {
    let area = CalibratedArea::around(calibration.points().map(|point| point.place)).unwrap_or_default();
    let area_mm2 = (area.most.x_mm - area.least.x_mm) * (area.most.y_mm - area.least.y_mm);
    (SAME_PLACE * (area_mm2 / calibration.by_place().len() as f64).sqrt()).max(SAME_MM)
}

impl SensorErrors {
    /// Summarises answers, of which there must be one at least.
    fn of(answers: &[HeldAnswer]) -> Result<Self, FitError> {
        let summary = |error: fn(&MeanErrors) -> f64| {
            let errors: Vec<f64> = answers.iter().map(|answer| error(&answer.errors)).collect();
            ErrorSummary::of(&errors).ok_or(FitError::NothingToTellApart)
        };
        let share = |is_counted: &dyn Fn(&HeldAnswer) -> bool| {
            answers.iter().filter(|answer| is_counted(answer)).count() as f64 / answers.len() as f64
        };
        let within = |is_within: fn(&MeanErrors, &HalfWidths) -> bool| {
            share(&|answer| answer.solution.half_widths.is_some_and(|half| is_within(&answer.errors, &half)))
        };
        Ok(SensorErrors {
            presses: answers.len(),
            location_error_mm: summary(|errors| errors.location_mm)?,
            force_error_n: summary(|errors| errors.force_n)?,
            location_within: [
                within(|errors, half| errors.location_mm <= half.half68_mm),
                within(|errors, half| errors.location_mm <= half.half95_mm),
            ],
            force_within: [
                within(|errors, half| errors.force_n <= half.half68_n),
                within(|errors, half| errors.force_n <= half.half95_n),
            ],
            flagged: share(&|answer| answer.solution.verdict != ContactVerdict::Ok),
        })
    }
}
