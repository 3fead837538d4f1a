//! Units that are excluded.

use super::Calibration;
use serde::{Deserialize, Serialize};

/// A unit that is excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Broken {
    /// The unit, counted from 0.
    pub unit: usize,
    /// Fault of the unit.
    pub fault: OutputFault,
}

/// Fault of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum OutputFault {
    /// The unit read the same at every place of the calibration.
    Dead,
    /// The unit read its largest value at many places of the calibration, so it must have reached its limit.
    Saturated,
    /// The unit contradicted all others in contact after contact since the calibration.
    Contradicts,
    /// A reading has no output of the unit.
    Missing,
}

impl Broken {
    /// Names the output, counted from 1, and its fault.
    pub fn text(&self) -> String {
        format!("output {} {}", self.unit + 1, self.fault.text())
    }
}

impl OutputFault {
    /// Describes the fault in words.
    pub fn text(self) -> &'static str {
        match self {
            OutputFault::Dead => "has the same output everywhere",
            OutputFault::Saturated => "saturates",
            OutputFault::Contradicts => "contradicts all other outputs",
            OutputFault::Missing => "is missing",
        }
    }
}

/// Fraction of presses at one unit's largest value from which the unit counts as clipped. A peak caused by a converter's coarsest
/// step is much smaller.
const CLIPPED_SHARE: f64 = 0.05;
/// Least number of such presses.
const FEWEST_CLIPPED: usize = 4;
/// Least number of places at which a working unit reads different values.
const FEWEST_PLACES: usize = 4;

/// Returns the units that are dead or saturated in some presses: a calibration, or a calibration with its test.
pub fn broken(calibration: &Calibration) -> Vec<Broken> {
    if calibration.by_place().len() < FEWEST_PLACES {
        return Vec::new();
    }
    (0..calibration.units()).filter_map(|unit| Some(Broken { unit, fault: fault(calibration, unit)? })).collect()
}

/// Returns the units of an array that aren't excluded.
pub(super) fn kept(units: usize, broken: &[Broken]) -> Vec<usize> {
    (0..units).filter(|unit| broken.iter().all(|broken| broken.unit != *unit)).collect()
}

fn fault(calibration: &Calibration, unit: usize) -> Option<OutputFault> {
    let outputs = || calibration.points().map(|point| point.outputs[unit]);
    let (least, most) =
        outputs().fold((f64::MAX, f64::MIN), |(least, most), output| (least.min(output), most.max(output)));
    if least == most {
        return Some(OutputFault::Dead);
    }
    let at = |extreme: f64| outputs().filter(|output| *output == extreme).count();
    let enough = FEWEST_CLIPPED.max((CLIPPED_SHARE * calibration.len() as f64).ceil() as usize);
    // at rest many units read exactly 0, which isn't an end of the range
    let is_clipped = |extreme: f64| extreme != 0.0 && at(extreme) >= enough;
    (is_clipped(most) || is_clipped(least)).then_some(OutputFault::Saturated)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CalibrationPoint;
    use palpate_core::quantity::Place;

    #[test]
    fn dead_and_saturated_units_are_found_and_others_are_not() {
        let rows: Vec<[f64; 4]> = (0..40)
            .map(|i| f64::from(i) / 10.0)
            .map(|x| [x, 0.7, x.min(3.0), if x < 2.0 { 0.0 } else { -x }])
            .collect();
        let point = |(i, outputs): (usize, &'static [f64; 4])| CalibrationPoint {
            place: Place::new(i as f64, 0.0),
            force_n: 1.0,
            outputs,
        };
        let rows: &'static [[f64; 4]] = Vec::leak(rows);
        let points: Vec<CalibrationPoint<'_>> = rows.iter().enumerate().map(point).collect();
        let found = broken(&Calibration::new(&points).unwrap());
        assert_eq!(
            found,
            [Broken { unit: 1, fault: OutputFault::Dead }, Broken { unit: 2, fault: OutputFault::Saturated }]
        );
        assert_eq!(broken(&Calibration::new(&points[..3]).unwrap()), []);
    }
}
