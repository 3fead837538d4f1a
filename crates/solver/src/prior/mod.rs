//! The prior of a design: what full calibrations of some sensors show about the next one, so that few presses calibrate it.
//!
//! Every sensor of a design reads like the design's mean map, with the gain, place and width of each unit changed: the model of
//! [`Change`]. A [`Prior`] knows the mean map, and how much sensors differ (`spread`). The change of a new sensor is the mean of a
//! normal posterior (`posterior`). Its map is the mean map after this change; where the change is uncertain, so is the map.
//! `belongs` checks whether the presses are those of a sensor of the design, and `order` chooses where to press.

mod aligned;
mod belongs;
mod order;
mod posterior;
mod sensor;
mod spread;

pub(crate) use aligned::Aligned;
pub use belongs::{Belongs, Deviation};
pub use spread::DesignSpread;
pub use spread::Deviations;

use super::adapt::{AdaptableMap, Fit, Moved};
use super::correction::Correction;
use super::field::SplineField;
use super::forward::{Forward, MapKind};
use super::response::ForwardResponse;
use super::surrogate::surrogate;
use super::{ArrayChange, Calibration, CalibrationPoint, FitError, Model, Setting, TriedUpdate, Update};
use palpate_core::algebra::Matrix;
use palpate_core::quantity::{ArrayLayout, Place};
use sensor::{ChosenModel, NewSensor};
use std::borrow::Cow;

/// What full calibrations of some sensors show about the next sensor of their design.
pub struct Prior {
    /// Presses of all sensors, as the design's typical sensor would have read them.
    calibration: Calibration,
    map: AdaptableMap<'static>,
    /// Outputs of each unit. All outputs of a unit change in common.
    units: Vec<Vec<usize>>,
    spread: DesignSpread,
    sensors: usize,
}

/// Few presses of a new sensor, with the prior of its design.
pub struct FamilySensor {
    /// The method for this sensor.
    pub model: Model,
    /// Way in which the method was made: [`Update::GainsAndPlaces`], the design's map after a change of gains, places and widths, unless
    /// another one leads it on held-out presses by more than chance.
    pub update: Update,
    /// Every way that was tried, the design's map first; empty with few presses, and for a sensor that isn't typical.
    pub tried: Vec<TriedUpdate>,
    /// Change of each output, compared with the design's typical sensor.
    pub change: ArrayChange,
    /// Whether the presses are those of a sensor of this design.
    pub belongs: Belongs,
    /// Expected mean location error for contacts in the calibrated area, mm.
    pub expected_mm: f64,
    /// Force of these contacts, N.
    contact_n: f64,
}

/// Reason why calibrations don't make a prior, or presses can't be used with it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PriorError {
    /// There are too few sensors.
    #[error("{sensors} sensors were calibrated; a design needs at least {SENSORS_LEAST}")]
    TooFew {
        /// Number of sensors.
        sensors: usize,
    },
    /// The sensors have different numbers of outputs.
    #[error("sensor {sensor} has {found} outputs per press, the first one has {expected}")]
    Outputs {
        /// Number of the sensor, counted from 1.
        sensor: usize,
        /// Number of its outputs.
        found: usize,
        /// Number of outputs of the first sensor, or of the design.
        expected: usize,
    },
    /// The sensors don't differ.
    #[error(
        "the sensors don't differ at all, as if one sensor was calibrated again and again; give simulated ones different seeds"
    )]
    SameSensor,
    /// The forces of some presses are unknown.
    #[error("the forces of the presses must be known, in newtons: without them, a change of the gain can't be seen")]
    NoForces,
    /// The map can't be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// Least number of calibrated sensors for a prior. Fewer don't show how sensors differ.
pub const SENSORS_LEAST: usize = 3;

/// Least standard deviation of the gain from sensor to sensor. Below it the calibrations are of one sensor.
const LEAST_SPREAD: f64 = 1e-6;

impl Prior {
    /// Makes the prior from full calibrations, one for each sensor.
    ///
    /// # Errors
    /// There are too few sensors, they are of different arrays, or forces are unknown.
    pub fn new(calibrations: &[Calibration], layout: Option<&ArrayLayout>) -> Result<Self, PriorError> {
        let sensors = calibrations.len();
        if sensors < SENSORS_LEAST {
            return Err(PriorError::TooFew { sensors });
        }
        let aligned = Aligned::of(calibrations, layout)?;
        let spread = DesignSpread::of(&aligned.moved);
        if spread.own.gain < LEAST_SPREAD {
            return Err(PriorError::SameSensor);
        }
        let (calibration, units) = (aligned.joined(), aligned.units);
        let map = AdaptableMap::of(&calibration, layout)?;
        Ok(Prior { calibration, map, spread, units, sensors })
    }

    /// Returns how the sensors of the design differ.
    pub fn spread(&self) -> &DesignSpread {
        &self.spread
    }

    /// Returns the number of outputs of a sensor.
    pub fn outputs(&self) -> usize {
        self.calibration.units()
    }

    /// Returns the number of sensors that made the prior.
    pub fn sensors(&self) -> usize {
        self.sensors
    }

    /// Returns how the means over all units differ from sensor to sensor, without the error of the design's own mean.
    pub fn spread_of_means(&self) -> Deviations {
        let DesignSpread { own, common } = self.spread;
        let units = (self.units.len() as f64).sqrt();
        let further = (1.0 + 1.0 / self.sensors as f64).sqrt();
        let of = |own: f64, common: f64| common.max(own / units) / further;
        Deviations {
            gain: of(own.gain, common.gain),
            place_mm: of(own.place_mm, common.place_mm),
            width: of(own.width, common.width),
        }
    }

    /// Calibrates a new sensor with few presses. From 20 presses of a typical sensor on, three ways compete: the changed map of
    /// the design, this map with a correction, and the presses alone. Half-widths and the limit of a misfit then come from the presses, each
    /// held out.
    ///
    /// # Errors
    /// The presses are of another array, or their forces are unknown.
    pub fn family_sensor(&self, new: &Calibration, setting: &Setting<'_>) -> Result<FamilySensor, PriorError> {
        let fit = self.fit(new)?;
        let belongs = Belongs::of(&fit, &self.units, &self.spread);
        let sensor = NewSensor { prior: self, new, setting };
        let (forward, calibration, change) = sensor.map(Update::GainsAndPlaces, new);
        let contact_n = new.typical_force_n();
        let mut expected_mm = forward.expected_mean_mm(contact_n);
        let ChosenModel { model, update, tried } = sensor.chosen()?.unwrap_or_else(|| ChosenModel {
            model: Model::of_forward(forward, calibration, setting),
            update: Update::GainsAndPlaces,
            tried: Vec::new(),
        });
        let found = tried.iter().find(|tried| tried.update == update && update != Update::GainsAndPlaces);
        if let Some(found) = found {
            expected_mm = found.held_out.location_mm;
        }
        Ok(FamilySensor { model: model.with_own_presses(new), update, tried, change, belongs, expected_mm, contact_n })
    }

    /// Calibrates a new sensor in one way, without a competition.
    ///
    /// # Errors
    /// The presses are of another array, or their forces are unknown; or no method can be fitted to them alone.
    pub fn sensor_by(&self, update: Update, new: &Calibration, setting: &Setting<'_>) -> Result<Model, PriorError> {
        self.fit(new)?;
        let (fitted, presses) = NewSensor { prior: self, new, setting }.fit(update, new)?;
        Ok(Model::of(fitted, presses, setting).with_own_presses(new))
    }

    /// Returns the expected mean location error of a sensor if its change were known exactly, mm. More presses can't reduce the error
    /// below it.
    pub fn least_mm(&self, family_sensor: &FamilySensor) -> f64 {
        let known = self.response(&family_sensor.change, &vec![Matrix::ZERO; self.units.len()], None);
        let calibration = self.map.changed(&self.calibration, &family_sensor.change);
        let forward = Forward::new(MapKind::Smooth, known, &calibration, &family_sensor.model.setting());
        forward.expected_mean_mm(family_sensor.contact_n)
    }

    /// Checks whether presses are those of a sensor of the design.
    ///
    /// # Errors
    /// The presses are of another array, or their forces are unknown.
    pub fn belongs(&self, new: &Calibration) -> Result<Belongs, PriorError> {
        Ok(Belongs::of(&self.fit(new)?, &self.units, &self.spread))
    }

    fn fit<'a>(&'a self, new: &'a Calibration) -> Result<Fit<'a>, PriorError> {
        let expected = self.calibration.units();
        if new.units() != expected {
            return Err(PriorError::Outputs { sensor: 1, found: new.units(), expected });
        }
        if !new.is_in_newtons() {
            return Err(PriorError::NoForces);
        }
        Ok(Fit { map: &self.map, new, forces_are_known: true })
    }

    /// Returns the map after a change, whose own error contains the covariance of each unit's change.
    fn response(
        &self,
        change: &ArrayChange,
        covariances: &[Matrix<4, 4>],
        correction: Option<&Correction>,
    ) -> ForwardResponse {
        let (typical, outputs) = (&*self.map.response, self.calibration.units());
        let moved: Vec<Moved> = change.units.iter().map(super::UnitChange::moved).collect();
        let mut unit_of = vec![0; outputs];
        self.units.iter().enumerate().for_each(|(unit, of)| of.iter().for_each(|&output| unit_of[output] = unit));
        let value = |place: &Place| {
            let of = |(output, moved): (usize, &Moved)| (1.0 + moved[0]) * self.map.felt(output, *place, moved)[0];
            moved.iter().enumerate().map(of).collect::<Vec<f64>>()
        };
        let leverage = |place: &Place| {
            let mut known = vec![0.0; outputs];
            typical.leverage.value(*place, &mut known);
            let of = |(output, moved): (usize, &Moved)| {
                let (value, slopes) = self.map.slopes(output, *place, moved);
                let variance = slopes.dot(&(covariances[unit_of[output]] * slopes));
                let force_n = typical.force_n;
                known[output].max(0.0) + variance * force_n * force_n / typical.noise.variance(output, force_n * value)
            };
            moved.iter().enumerate().map(of).collect::<Vec<f64>>()
        };
        let tabulated = |like: &SplineField, rows: &dyn Fn(&[Place]) -> Vec<f64>| {
            SplineField::new(like.area(), like.step_mm(), outputs, |places| rows(places))
        };
        let field = tabulated(&typical.field, &|places| {
            let mut values: Vec<f64> = places.iter().flat_map(value).collect();
            if let Some(correction) = correction {
                let added = correction.per_newton(places.iter().copied());
                values.iter_mut().zip(added).for_each(|(value, added)| *value += added);
            }
            values
        });
        let leverage = tabulated(&typical.leverage, &|places| places.iter().flat_map(leverage).collect());
        ForwardResponse { field, leverage, ..typical.clone() }.known_within()
    }
}

/// Returns the change of each output from that of each unit.
fn each_output(moved: &[Moved], units: &[Vec<usize>], outputs: usize) -> ArrayChange {
    let mut each = vec![Moved::ZERO; outputs];
    units.iter().zip(moved).for_each(|(of, moved)| of.iter().for_each(|&output| each[output] = *moved));
    ArrayChange::of(&each)
}

/// Returns the outputs of each unit; without a layout each output is a unit.
fn units_of(layout: Option<&ArrayLayout>, outputs: usize) -> Vec<Vec<usize>> {
    match layout.filter(|layout| layout.len() == outputs) {
        Some(layout) => layout.units().map(Iterator::collect).collect(),
        None => (0..outputs).map(|output| vec![output]).collect(),
    }
}

impl AdaptableMap<'static> {
    /// Returns the smooth map of a calibration, with the centres of the layout. Without a layout a unit is centred where it reads
    /// most.
    fn of(calibration: &Calibration, layout: Option<&ArrayLayout>) -> Result<Self, FitError> {
        let response = surrogate(calibration)?;
        let outputs = calibration.units();
        let centres = match layout.filter(|layout| layout.len() == outputs) {
            Some(layout) => layout.places().to_vec(),
            None => loudest(&response),
        };
        Ok(AdaptableMap { response: Cow::Owned(response), centres: Cow::Owned(centres) })
    }
}

/// Number of places along a side of the area where the largest reading is searched for.
const SIDE: usize = 25;

fn loudest(response: &ForwardResponse) -> Vec<Place> {
    let places = response.field.area().grid(SIDE);
    let size = |output: usize, place: &Place| response.field.channel(output, *place)[0].abs();
    let of = |output: usize| {
        let largest = places.iter().max_by(|a, b| size(output, a).total_cmp(&size(output, b)));
        largest.copied().unwrap_or_default()
    };
    (0..response.field.channels()).map(of).collect()
}

impl Calibration {
    /// Returns the presses of several calibrations of one array as one calibration.
    fn joined(parts: &[Calibration]) -> Calibration {
        let points: Vec<CalibrationPoint<'_>> = parts.iter().flat_map(Calibration::points).collect();
        Calibration::new(&points).unwrap_or_else(|_| parts[0].clone())
    }
}
