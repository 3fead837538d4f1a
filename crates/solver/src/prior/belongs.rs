//! Whether few presses are those of a sensor of a design.

use super::Prior;
use super::posterior::{UnitEstimate, estimates, inverse};
use super::spread::DesignSpread;
use crate::adapt::{AdaptableMap, Fit, Moved};
use crate::threshold::chi2_quantile;
use crate::{Calibration, CalibrationPoint};
use palpate_core::algebra::Matrix;
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Whether presses are those of a sensor of the design.
#[derive(Clone, Debug, PartialEq)]
pub enum Belongs {
    /// The sensor is like those that made the prior.
    Typical,
    /// All units differ from the design in the same way, by more than its sensors do. Few presses don't suffice.
    Beyond(Vec<Deviation>),
    /// The sensor isn't of this design, or has a fault.
    Outsider(Vec<Deviation>),
}

/// One deviation from the design. Units are counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Deviation {
    /// A unit reads nothing, or nearly nothing: its gain relative to the design.
    Dead {
        /// The unit.
        unit: usize,
    },
    /// The gain of a unit, relative to the design.
    Gain {
        /// The unit.
        unit: usize,
        /// The gain.
        gain: f64,
    },
    /// The displacement of a unit.
    Moved {
        /// The unit.
        unit: usize,
        /// The distance, mm.
        distance_mm: f64,
    },
    /// The width of a unit's response.
    Width {
        /// The unit.
        unit: usize,
        /// The relative increase.
        width: f64,
    },
    /// The response of a unit has another shape than in the design.
    Shape {
        /// The unit.
        unit: usize,
        /// Sum of the squares of the residuals divided by the number of degrees of freedom.
        misfit: f64,
    },
    /// The gain of all units.
    AllGains {
        /// Mean gain relative to the design.
        gain: f64,
    },
    /// The width of all responses, as a layer of another thickness changes it.
    AllWidths {
        /// Mean relative increase.
        width: f64,
    },
    /// The displacement of the complete array.
    AllMoved {
        /// The distance, mm.
        distance_mm: f64,
    },
    /// The array is rotated about its centre.
    Rotated {
        /// The angle, degrees counterclockwise.
        angle_deg: f64,
    },
    /// The readings together are unlikely for a sensor of this design.
    Unlikely {
        /// Sum of the squares of the differences divided by the number of outputs.
        misfit: f64,
    },
}

impl Deviation {
    /// Returns the deviation in words.
    pub fn text(&self) -> String {
        match *self {
            Deviation::Dead { unit } => format!("unit {unit} reads nothing"),
            Deviation::Gain { unit, gain } => format!("unit {unit} reads {gain:.2} times what the design reads"),
            Deviation::Moved { unit, distance_mm } => format!("unit {unit} is {distance_mm:.2} mm away from its place"),
            Deviation::Width { unit, width } => {
                format!("the response of unit {unit} is {:+.0} % wider than the design's", 100.0 * width)
            }
            Deviation::Shape { unit, misfit } => {
                format!("the response of unit {unit} has another shape than the design's (misfit {misfit:.1})")
            }
            Deviation::AllGains { gain } => format!("all units read {gain:.2} times what the design reads"),
            Deviation::AllWidths { width } => {
                format!("all responses are {:+.0} % wider than the design's, as with another layer", 100.0 * width)
            }
            Deviation::AllMoved { distance_mm } => format!("the array is {distance_mm:.2} mm away from its place"),
            Deviation::Rotated { angle_deg } => format!("the array is rotated by {angle_deg:+.1} degrees"),
            Deviation::Unlikely { misfit } => format!("the readings aren't those of the design (misfit {misfit:.1})"),
        }
    }
}

/// Number of standard deviations from which one unit's place or width isn't that of the design.
const UNIT_SIGMAS: f64 = 4.5;
/// Number of standard deviations of the design from which the logarithm of a unit's gain isn't that of the design. The second
/// constant is the number of standard deviations of the measurement that are subtracted first.
const GAIN_SIGMAS: f64 = 3.5;
const GAIN_MARGIN: f64 = 1.5;
/// Number of standard deviations of one unit from which a change of all units isn't that of the design.
const ALL_SIGMAS: f64 = 6.0;
/// Number of standard deviations of the common change from which few presses don't suffice.
const BEYOND_SIGMAS: f64 = 4.0;
/// Number of standard deviations from which an array is rotated.
const ROTATED_SIGMAS: f64 = 4.5;
/// Gain relative to the design below which a unit is dead.
const DEAD_GAIN: f64 = 0.1;
/// Factor by which the search may leave the design's spread.
const WEAK: f64 = 10.0;
/// Rate at which a good sensor may exceed a limit of a sum of squares.
const FALSE_ALARMS: f64 = 1e-4;
/// Factor by which a sum of squares may exceed that of the noise that the prior knows.
const NOISE_MARGIN: f64 = 1.5;
/// Factor for the spread of the design in the sum of squares of all readings, because few sensors show it.
const SPREAD_MARGIN: f64 = 1.5;

impl Belongs {
    pub(super) fn of(fit: &Fit<'_>, units: &[Vec<usize>], spread: &DesignSpread) -> Self {
        let own = spread.own.squares();
        let found = estimates(fit, units, &(own.map(f64::sqrt) * WEAK));
        let (common, covariance_of_common) = common(&found, &own);
        let mut outside = Vec::new();
        for (unit, (moved, covariance)) in found.iter().enumerate() {
            // the common part is checked below
            let alone = *moved - common;
            let sigmas = |index: usize| alone[index].abs() / (own[index] + covariance.rows()[index][index]).sqrt();
            let (unit, gain) = (unit + 1, 1.0 + moved[0]);
            if is_other_gain(gain / (1.0 + common[0]), own[0].sqrt(), covariance.rows()[0][0].sqrt()) {
                outside.push(if gain < DEAD_GAIN { Deviation::Dead { unit } } else { Deviation::Gain { unit, gain } });
            }
            if sigmas(1).max(sigmas(2)) > UNIT_SIGMAS {
                outside.push(Deviation::Moved { unit, distance_mm: moved[1].hypot(moved[2]) });
            }
            if sigmas(3) > UNIT_SIGMAS {
                outside.push(Deviation::Width { unit, width: moved[3] });
            }
        }
        outside.extend(shapes(fit, units, &found));
        outside.extend(rotated(units, &found, &own, fit.map));
        let in_common = |known: &Moved, limit: f64| {
            let is_beyond = |index: usize| {
                common[index].abs() / (known[index] + covariance_of_common.rows()[index][index]).sqrt() > limit
            };
            let gains = is_beyond(0).then_some(Deviation::AllGains { gain: 1.0 + common[0] });
            let distance_mm = common[1].hypot(common[2]);
            let moved = (is_beyond(1) || is_beyond(2)).then_some(Deviation::AllMoved { distance_mm });
            let widths = is_beyond(3).then_some(Deviation::AllWidths { width: common[3] });
            [gains, moved, widths].into_iter().flatten().collect::<Vec<Deviation>>()
        };
        outside.extend(in_common(&own, ALL_SIGMAS));
        let beyond = in_common(&spread.common.squares(), BEYOND_SIGMAS);
        if outside.is_empty() && beyond.is_empty() {
            outside.extend(unlikely(fit, units, spread));
        }
        match (outside.is_empty(), beyond.is_empty()) {
            (false, _) => Belongs::Outsider(outside),
            (true, false) => Belongs::Beyond(beyond),
            (true, true) => Belongs::Typical,
        }
    }
}

/// Ways to mount a sensor wrongly: the name, and the place on the sensor that is under a place of the specimen frame, both
/// relative to the array's centre, as the rows of a matrix.
const ROTATIONS: [(&str, [[f64; 2]; 2]); 5] = [
    ("rotated by 90 degrees", [[0.0, 1.0], [-1.0, 0.0]]),
    ("rotated by 180 degrees", [[-1.0, 0.0], [0.0, -1.0]]),
    ("rotated by 270 degrees", [[0.0, -1.0], [1.0, 0.0]]),
    ("mirrored along x", [[-1.0, 0.0], [0.0, 1.0]]),
    ("mirrored along y", [[1.0, 0.0], [0.0, -1.0]]),
];

impl Prior {
    /// Returns the rotations and mirrors that presses of `press_n` at some places can't detect, because the design's typical sensor
    /// then reads the same within the spread of the design.
    pub fn undetectable(&self, places: &[Place], press_n: f64) -> Vec<&'static str> {
        let (centre, outputs) = (mean_place(&self.map.centres), self.calibration.units());
        let is_alike = |turn: &[[f64; 2]; 2]| {
            let read = |place: &Place| {
                let (x, y) = (place.x_mm - centre.x_mm, place.y_mm - centre.y_mm);
                let [x, y] = turn.map(|[along_x, along_y]| along_x * x + along_y * y);
                let on_sensor = Place::new(centre.x_mm + x, centre.y_mm + y);
                (0..outputs).map(|unit| press_n * self.map.felt(unit, on_sensor, &Moved::ZERO)[0]).collect()
            };
            let readings: Vec<Vec<f64>> = places.iter().map(read).collect();
            let points = places.iter().zip(&readings);
            let points = points.map(|(place, outputs)| CalibrationPoint { place: *place, force_n: press_n, outputs });
            let turned = Calibration::new(&points.collect::<Vec<_>>());
            turned.is_ok_and(|turned| self.belongs(&turned).is_ok_and(|belongs| belongs == Belongs::Typical))
        };
        ROTATIONS.iter().filter(|(_, turn)| is_alike(turn)).map(|(name, _)| *name).collect()
    }
}

fn mean_place(places: &[Place]) -> Place {
    let count = places.len() as f64;
    let sum = places.iter().fold((0.0, 0.0), |(x, y), place| (x + place.x_mm, y + place.y_mm));
    Place::new(sum.0 / count, sum.1 / count)
}

/// Whether a gain isn't that of the design. A gain is a factor, so 0.3 is as far from 1 as 3.3. It is first moved toward 1 by what
/// its measurement may be off.
fn is_other_gain(gain: f64, spread: f64, measured_sd: f64) -> bool {
    let margin = GAIN_MARGIN * measured_sd;
    let nearest = if gain < 1.0 { (gain + margin).min(1.0) } else { (gain - margin).max(1.0) };
    nearest.max(f64::MIN_POSITIVE).ln().abs() > GAIN_SIGMAS * spread
}

/// Returns the units whose residuals are more than noise after the best change.
fn shapes(fit: &Fit<'_>, units: &[Vec<usize>], found: &[UnitEstimate]) -> Vec<Deviation> {
    let misfit = |(unit, (of, (moved, covariance))): (usize, (&Vec<usize>, &UnitEstimate))| {
        let rows = fit.rows(of, moved, *moved);
        let squares: f64 = rows.iter().map(|row| row.left * row.left / row.variance).sum();
        let used: f64 = rows.iter().map(|row| row.slopes.dot(&(*covariance * row.slopes)) / row.variance).sum();
        let free = rows.len() as f64 - used;
        if free < 1.0 {
            return None;
        }
        let limit = NOISE_MARGIN * chi2_quantile(free.round() as usize, FALSE_ALARMS);
        (squares > limit).then_some(Deviation::Shape { unit: unit + 1, misfit: squares / free })
    };
    units.iter().zip(found).enumerate().filter_map(misfit).collect()
}

/// Returns the angle by which the array is rotated about its centre, if it is.
fn rotated(units: &[Vec<usize>], found: &[UnitEstimate], own: &Moved, map: &AdaptableMap<'_>) -> Option<Deviation> {
    let centre = |of: &Vec<usize>| map.centres[of[0]];
    let Place { x_mm: mean_x, y_mm: mean_y } = mean_place(&units.iter().map(centre).collect::<Vec<Place>>());
    let (mut information, mut toward) = (0.0, 0.0);
    for (of, (moved, covariance)) in units.iter().zip(found) {
        let (x, y) = (centre(of).x_mm - mean_x, centre(of).y_mm - mean_y);
        let square = x * x + y * y;
        if square == 0.0 {
            continue;
        }
        // a rotation by a small angle moves a unit by the angle times its distance; the map is displaced the other way
        let along = [y, -x];
        let shown = moved[1] * along[0] + moved[2] * along[1];
        let variance = square * own[1]
            + along[0] * along[0] * covariance.rows()[1][1]
            + 2.0 * along[0] * along[1] * covariance.rows()[1][2]
            + along[1] * along[1] * covariance.rows()[2][2];
        let weight = square / variance;
        information += weight * square;
        toward += weight * shown;
    }
    let angle = toward / information;
    let is_rotated = information > 0.0 && angle.abs() * information.sqrt() > ROTATED_SIGMAS;
    is_rotated.then_some(Deviation::Rotated { angle_deg: angle.to_degrees() })
}

/// Returns the change that all units have in common, as the weighted mean of their changes, and its covariance.
fn common(found: &[UnitEstimate], own: &Moved) -> UnitEstimate {
    let own = Matrix::<4, 4>::from_diagonal(*own);
    let (mut information, mut toward) = (Matrix::ZERO, Moved::ZERO);
    for (moved, covariance) in found {
        let weight = inverse(own + *covariance);
        information += weight;
        toward += weight * *moved;
    }
    let covariance = inverse(information);
    (covariance * toward, covariance)
}

/// Returns the misfit of all readings with the typical sensor, if it is unlikely with the spread of the design.
fn unlikely(fit: &Fit<'_>, units: &[Vec<usize>], spread: &DesignSpread) -> Option<Deviation> {
    let own = (spread.own.squares() + spread.common.squares()) * (SPREAD_MARGIN * SPREAD_MARGIN);
    let (mut squares, mut count) = (0.0, 0);
    for of in units {
        let rows = fit.rows(of, &Moved::ZERO, Moved::ZERO);
        let informed = super::posterior::Information::of(&rows);
        let (moved, _) = informed.with(&own);
        squares += rows.iter().map(|row| row.left * row.left / row.variance).sum::<f64>();
        squares -= informed.vector.dot(&moved);
        count += rows.len();
    }
    let is_unlikely = squares > NOISE_MARGIN * chi2_quantile(count, FALSE_ALARMS);
    is_unlikely.then_some(Deviation::Unlikely { misfit: squares / count as f64 })
}
