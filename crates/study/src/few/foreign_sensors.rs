//! Sensors that aren't of the design, or have a fault: whether few presses show it.

use super::super::methods::specimen::{KnownReadings, NoiseReference, Touch};
use super::super::{OnProgress, StudyError, carried_out};
use super::design::{SensorDesign, cells};
use super::{FewSize, GOOD_SEEDS, broken};
use palpate_core::quantity::{Place, stream};
use palpate_sim::scene::{TaxelFault, TaxelFaultKind};
use palpate_solver::{Belongs, Prior};
use rand::RngExt;
use serde::Serialize;

/// Kinds of sensors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ForeignSensor {
    /// A sensor of the design.
    Good,
    /// The layer is 30 % thicker.
    ThickerLayer,
    /// The layer is 30 % thinner.
    ThinnerLayer,
    /// One unit reads nothing.
    DeadUnit,
    /// One unit reads 0.3 of what it should.
    WeakUnit,
    /// All units read three times what they should.
    AllGains,
    /// The sensor is rotated by this angle, degrees.
    Rotated(f64),
    /// The sensor is mirrored at its middle line.
    Mirrored,
    /// Two channels are swapped.
    Swapped,
}

/// Result of one kind of sensors.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ForeignSensorRow {
    /// Name of the study.
    pub study: &'static str,
    /// Letter of the noise.
    pub scene: &'static str,
    /// Kind of the sensors.
    pub kind: ForeignSensor,
    /// Number of presses.
    pub presses: usize,
    /// Number of sensors.
    pub sensors: usize,
    /// Number of sensors that are refused.
    pub refused: usize,
    /// Number of sensors that need a full calibration.
    pub beyond: usize,
    /// Number of sensors that are typical for the design.
    pub typical: usize,
}

impl ForeignSensor {
    /// All kinds, good sensors first.
    pub const ALL: [ForeignSensor; 11] = [
        ForeignSensor::Good,
        ForeignSensor::ThickerLayer,
        ForeignSensor::ThinnerLayer,
        ForeignSensor::DeadUnit,
        ForeignSensor::WeakUnit,
        ForeignSensor::AllGains,
        ForeignSensor::Rotated(3.0),
        ForeignSensor::Rotated(10.0),
        ForeignSensor::Rotated(180.0),
        ForeignSensor::Mirrored,
        ForeignSensor::Swapped,
    ];

    /// Returns the name for people.
    pub fn text(self) -> String {
        match self {
            ForeignSensor::Good => "good sensors".to_owned(),
            ForeignSensor::ThickerLayer => "layer 30 % thicker".to_owned(),
            ForeignSensor::ThinnerLayer => "layer 30 % thinner".to_owned(),
            ForeignSensor::DeadUnit => "a dead unit".to_owned(),
            ForeignSensor::WeakUnit => "one unit x 0.3".to_owned(),
            ForeignSensor::AllGains => "all gains x 3".to_owned(),
            ForeignSensor::Rotated(deg) => format!("rotated by {deg} degrees"),
            ForeignSensor::Mirrored => "mirrored".to_owned(),
            ForeignSensor::Swapped => "two channels swapped".to_owned(),
        }
    }

    /// Returns the readings of a sensor of this kind.
    pub(super) fn read(self, design: &SensorDesign, seed: u64, touches: &[Touch]) -> KnownReadings {
        let units = design.layout().len();
        let mut rng = stream(seed, 0, "stranger");
        let unit = rng.random_range(0..units);
        let read = |design: &SensorDesign, touches: &[Touch]| design.read(seed, touches, "calibration noise");
        let faulty = |kind| {
            let design = design.with(|skin| skin.faults.push(TaxelFault { unit: unit + 1, kind }));
            read(&design, touches)
        };
        // seen from a rotated sensor, the place rotates the other way
        let seen = |from: &dyn Fn(Place) -> Place| {
            let seen: Vec<Touch> = touches.iter().map(|touch| Touch { place: from(touch.place), ..*touch }).collect();
            let mut readings = read(design, &seen);
            readings.truths.iter_mut().zip(touches).for_each(|(truth, touch)| truth.place = touch.place);
            readings
        };
        match self {
            ForeignSensor::Good => read(design, touches),
            ForeignSensor::ThickerLayer => read(&design.with_layer(1.3), touches),
            ForeignSensor::ThinnerLayer => read(&design.with_layer(0.7), touches),
            ForeignSensor::DeadUnit => faulty(TaxelFaultKind::Dead),
            ForeignSensor::WeakUnit => faulty(TaxelFaultKind::Drifted(-70.0)),
            ForeignSensor::AllGains => {
                let mut readings = read(design, touches);
                readings.outputs.iter_mut().for_each(|output| *output *= 3.0);
                readings
            }
            ForeignSensor::Rotated(deg) => {
                let (sin, cos) = deg.to_radians().sin_cos();
                seen(&|at| Place::new(cos * at.x_mm + sin * at.y_mm, cos * at.y_mm - sin * at.x_mm))
            }
            ForeignSensor::Mirrored => seen(&|at| Place::new(-at.x_mm, at.y_mm)),
            ForeignSensor::Swapped => {
                let other = (unit + 1 + rng.random_range(0..units - 1)) % units;
                let mut readings = read(design, touches);
                readings.outputs.chunks_exact_mut(units).for_each(|row| row.swap(unit, other));
                readings
            }
        }
    }
}

/// Checks sensors of every kind with nine presses.
///
/// # Errors
/// Never in practice: simulated presses are suitable for calibration.
pub fn foreign_sensors(size: FewSize, on_progress: OnProgress<'_>) -> Result<Vec<ForeignSensorRow>, StudyError> {
    let touches = cells(3, 3);
    let mut rows = Vec::new();
    for noise in NoiseReference::ALL {
        let design = SensorDesign::papers(noise);
        let prior = design.prior()?;
        for kind in ForeignSensor::ALL {
            let sensors = if kind == ForeignSensor::Good { size.good } else { size.foreign_sensors };
            let seeds: Vec<u64> = (0..sensors as u64).map(|sensor| GOOD_SEEDS + sensor).collect();
            let found = carried_out(&seeds, on_progress, |&seed| checked(&prior, &kind.read(&design, seed, &touches)))?;
            let count = |is: fn(&Belongs) -> bool| found.iter().filter(|found| is(found)).count();
            rows.push(ForeignSensorRow {
                study: "strangers",
                scene: noise.name(),
                kind,
                presses: touches.len(),
                sensors,
                refused: count(|found| matches!(found, Belongs::Outsider(_))),
                beyond: count(|found| matches!(found, Belongs::Beyond(_))),
                typical: count(|found| *found == Belongs::Typical),
            });
        }
    }
    Ok(rows)
}

fn checked(prior: &Prior, readings: &KnownReadings) -> Result<Belongs, StudyError> {
    prior.belongs(&readings.calibration()?).map_err(broken)
}
