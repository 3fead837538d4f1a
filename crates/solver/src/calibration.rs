//! Presses of known place and force, validated.

use super::DepthCurve;
use super::depth_curve::DepthPress;
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Presses of known place and force with the array's readings: the paper's calibration database (its step 2), validated.
///
/// It has at least one point and at least one unit. Every value is finite and every force is positive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    units: usize,
    places: Vec<Place>,
    force_n: Vec<f64>,
    forces_known: bool,
    outputs: Vec<f64>,
    /// Curve by which the forces are intensities of depths. A sensor file has it after the model.
    #[serde(skip)]
    depth: Option<DepthCurve>,
}

/// Largest ratio of forces that count as one force. A loop is within 5 % of the requested force, careless presses are within 20
/// %.
const ONE_FORCE: f64 = 1.5;

/// Number of places below which they are few.
const FEW_PLACES: usize = 150;

/// One press of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationPoint<'a> {
    /// Place of the press, specimen frame, mm.
    pub place: Place,
    /// Force, N; positive.
    pub force_n: f64,
    /// Outputs, one for each unit.
    pub outputs: &'a [f64],
}

impl Calibration {
    /// Takes the points in the order given. An error names the first invalid point, counted from 0.
    pub fn new(points: &[CalibrationPoint<'_>]) -> Result<Self, CalibrationError> {
        let units = points.first().ok_or(CalibrationError::NoPoints)?.outputs.len();
        if units == 0 {
            return Err(CalibrationError::NoUnits);
        }
        for (point, press) in points.iter().enumerate() {
            check(point, press, units)?;
        }
        Ok(Calibration {
            units,
            places: points.iter().map(|press| press.place).collect(),
            force_n: points.iter().map(|press| press.force_n).collect(),
            forces_known: true,
            outputs: points.iter().flat_map(|press| press.outputs).copied().collect(),
            depth: None,
        })
    }

    /// Takes points of which the depths, mm, are known, and ignores their `force_n`. A force solved with this calibration is the
    /// intensity of a press, which its [`DepthCurve`] converts to a depth. If the presses have nearly one depth, there is no curve, and
    /// the calibration is one [without forces](Self::without_forces).
    ///
    /// # Errors
    /// The first invalid point, counted from 0. Depths must be positive, one for each point.
    pub fn by_depth(points: &[CalibrationPoint<'_>], depths_mm: &[f64]) -> Result<Self, CalibrationError> {
        let mut calibration = Self::without_forces(points)?;
        for point in 0..points.len() {
            let depth_mm = depths_mm.get(point).copied().unwrap_or(f64::NAN);
            if !(depth_mm > 0.0 && depth_mm.is_finite()) {
                return Err(CalibrationError::Depth { point, depth_mm });
            }
        }
        // their lengths, but for a row of zeros
        let length = |press: &CalibrationPoint<'_>, relative: f64| {
            if press.outputs.iter().all(|output| *output == 0.0) { 0.0 } else { relative }
        };
        let presses = points.iter().zip(depths_mm).zip(&calibration.force_n).map(|((press, &depth_mm), &relative)| {
            DepthPress { place: press.place, depth_mm, length: length(press, relative) }
        });
        if let Some(curve) = DepthCurve::fit(&presses.collect::<Vec<_>>()) {
            calibration.force_n = depths_mm.iter().map(|depth_mm| curve.intensity(*depth_mm)).collect();
            calibration.forces_known = true;
            calibration.depth = Some(curve);
        }
        Ok(calibration)
    }

    /// Returns the curve from depth to intensity, if presses are known by their depths.
    pub fn depth_curve(&self) -> Option<&DepthCurve> {
        self.depth.as_ref()
    }

    /// Returns the same calibration with a curve that was stored beside it.
    pub(super) fn with_depth_curve(self, depth: Option<DepthCurve>) -> Self {
        Calibration { depth, ..self }
    }

    /// Takes points whose forces are unknown and ignores their `force_n`. The length of a row of outputs replaces the force; 1 is
    /// the root mean square of all lengths. Methods that separate place from force then see only the direction. A force solved
    /// with this calibration is in that measure, not in newtons.
    pub fn without_forces(points: &[CalibrationPoint<'_>]) -> Result<Self, CalibrationError> {
        let unit: Vec<CalibrationPoint<'_>> =
            points.iter().map(|press| CalibrationPoint { force_n: 1.0, ..*press }).collect();
        let mut calibration = Self::new(&unit)?;
        // over the largest output of all, so that no square is beyond what a number can hold
        let largest = calibration.outputs.iter().fold(0.0f64, |largest, output| largest.max(output.abs()));
        let square = |row: &[f64]| row.iter().map(|output| (output / largest).powi(2)).sum::<f64>();
        let squares: Vec<f64> = points.iter().map(|press| square(press.outputs)).collect();
        let typical = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        // a row of zeros has no proportions: a typical press that no unit felt
        let relative = |square: f64| if square > 0.0 { square.sqrt() / typical } else { 1.0 };
        calibration.force_n = squares.into_iter().map(relative).collect();
        calibration.forces_known = false;
        Ok(calibration)
    }

    /// Returns the same calibration with forces that are only assumed. A force solved with it isn't in newtons.
    #[must_use]
    pub fn with_unknown_forces(self) -> Self {
        Calibration { forces_known: false, depth: None, ..self }
    }

    /// Returns the same presses with unknown forces that are all equal, 1.
    #[must_use]
    pub fn with_equal_forces(&self) -> Self {
        Calibration { force_n: vec![1.0; self.len()], forces_known: false, depth: None, ..self.clone() }
    }

    /// Returns the number of units of the array.
    pub fn units(&self) -> usize {
        self.units
    }

    /// Returns the number of points; never 0.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Always returns false, because a calibration has at least one point.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Returns one point; `index` counts from 0 and is below [`len`](Self::len).
    pub fn point(&self, index: usize) -> CalibrationPoint<'_> {
        let outputs = &self.outputs[index * self.units..][..self.units];
        CalibrationPoint { place: self.places[index], force_n: self.force_n[index], outputs }
    }

    /// Returns a calibration of some of the points; at least one.
    pub fn subset(&self, points: &[usize]) -> Calibration {
        Calibration {
            units: self.units,
            places: points.iter().map(|&point| self.places[point]).collect(),
            force_n: points.iter().map(|&point| self.force_n[point]).collect(),
            forces_known: self.forces_known,
            outputs: points.iter().flat_map(|&point| self.point(point).outputs).copied().collect(),
            depth: self.depth.clone(),
        }
    }

    /// Returns a calibration of the same presses with other outputs, row-major points x units.
    pub(super) fn with_outputs(&self, outputs: Vec<f64>) -> Calibration {
        Calibration { outputs, ..self.clone() }
    }

    /// Returns a calibration of some of the units, in this order.
    pub(super) fn of_units(&self, units: &[usize]) -> Calibration {
        let row = |point: usize| units.iter().map(move |&unit| self.outputs[point * self.units + unit]);
        Calibration { units: units.len(), outputs: (0..self.len()).flat_map(row).collect(), ..self.clone() }
    }

    /// Returns the points grouped by place, to the micrometre, in the order in which each place first occurs.
    pub(super) fn by_place(&self) -> Vec<Vec<usize>> {
        let mut spots: Vec<Vec<usize>> = Vec::new();
        let mut known = HashMap::new();
        for (index, place) in self.places.iter().enumerate() {
            let key = ((place.x_mm * 1000.0).round() as i64, (place.y_mm * 1000.0).round() as i64);
            let spot = *known.entry(key).or_insert_with(|| {
                spots.push(Vec::new());
                spots.len() - 1
            });
            spots[spot].push(index);
        }
        spots
    }

    /// Whether the presses have few places: then a map without a fifth of them is much worse.
    pub(super) fn has_few_places(&self) -> bool {
        self.by_place().len() < FEW_PLACES
    }

    /// Whether the forces are known, or stand for known depths.
    pub(super) fn forces_are_known(&self) -> bool {
        self.forces_known
    }

    /// Whether the forces are known, in newtons.
    pub fn is_in_newtons(&self) -> bool {
        self.forces_known && self.depth.is_none()
    }

    /// Whether the forces are known and there are several forces.
    pub(super) fn has_several_forces(&self) -> bool {
        let (least, most) = self.force_n.iter().fold((f64::MAX, 0.0f64), |(l, m), f| (l.min(*f), m.max(*f)));
        self.forces_known && most >= ONE_FORCE * least
    }

    /// Typical force of the points, root mean square, N.
    pub(super) fn typical_force_n(&self) -> f64 {
        (self.force_n.iter().map(|force_n| force_n * force_n).sum::<f64>() / self.len() as f64).sqrt()
    }

    /// Returns the points in order.
    pub fn points(&self) -> impl Iterator<Item = CalibrationPoint<'_>> {
        let outputs = self.outputs.chunks_exact(self.units);
        let known = self.places.iter().zip(&self.force_n);
        known.zip(outputs).map(|((&place, &force_n), outputs)| CalibrationPoint { place, force_n, outputs })
    }
}

/// Reason why presses don't make a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// There is no press.
    #[error("a calibration requires at least one point")]
    NoPoints,
    /// The presses have no outputs.
    #[error("a calibration requires at least one output per point")]
    NoUnits,
    /// The number of outputs changes between points.
    #[error("the point has {found} outputs, the first point has {expected}")]
    Ragged {
        /// Index of the point, from 0.
        point: usize,
        /// Number of outputs of the first point.
        expected: usize,
        /// Number of outputs of this point.
        found: usize,
    },
    /// A coordinate or an output is NaN or infinite.
    #[error("a coordinate or an output of the point is not a finite number")]
    NotFinite {
        /// Index of the point, from 0.
        point: usize,
    },
    /// The force isn't positive, so dividing by it would be meaningless.
    #[error("a calibration force must be above 0 N, but this is {force_n} N")]
    Force {
        /// Index of the point, from 0.
        point: usize,
        /// The force, N.
        force_n: f64,
    },
    /// The depth isn't positive.
    #[error("a calibration depth must be above 0 mm, but this is {depth_mm} mm")]
    Depth {
        /// Index of the point, from 0.
        point: usize,
        /// The depth, mm.
        depth_mm: f64,
    },
}

impl CalibrationError {
    /// Returns the index of the invalid point, from 0, if the error concerns one point.
    pub fn point(&self) -> Option<usize> {
        match *self {
            CalibrationError::NoPoints | CalibrationError::NoUnits => None,
            CalibrationError::Ragged { point, .. }
            | CalibrationError::NotFinite { point }
            | CalibrationError::Force { point, .. }
            | CalibrationError::Depth { point, .. } => Some(point),
        }
    }
}

fn check(point: usize, press: &CalibrationPoint<'_>, units: usize) -> Result<(), CalibrationError> {
    if press.outputs.len() != units {
        return Err(CalibrationError::Ragged { point, expected: units, found: press.outputs.len() });
    }
    let place_is_finite = press.place.x_mm.is_finite() && press.place.y_mm.is_finite();
    if !place_is_finite || !press.outputs.iter().all(|output| output.is_finite()) {
        return Err(CalibrationError::NotFinite { point });
    }
    if !(press.force_n > 0.0 && press.force_n.is_finite()) {
        return Err(CalibrationError::Force { point, force_n: press.force_n });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: CalibrationPoint<'static> =
        CalibrationPoint { place: Place { x_mm: 1.0, y_mm: 2.0 }, force_n: 1.0, outputs: &[0.5, 0.25] };

    #[test]
    fn points_come_back_in_order() {
        let other = CalibrationPoint { force_n: 2.0, outputs: &[3.0, 4.0], ..GOOD };
        let calibration = Calibration::new(&[GOOD, other]).unwrap();
        assert_eq!((calibration.len(), calibration.units()), (2, 2));
        assert_eq!(calibration.points().collect::<Vec<_>>(), [GOOD, other]);
    }

    #[test]
    fn each_kind_of_wrong_point_is_refused_and_named() {
        let second = |press| Calibration::new(&[GOOD, press]).unwrap_err();
        let refused = [
            second(CalibrationPoint { outputs: &[1.0], ..GOOD }),
            second(CalibrationPoint { outputs: &[1.0, f64::NAN], ..GOOD }),
            second(CalibrationPoint { place: Place::new(f64::INFINITY, 0.0), ..GOOD }),
            second(CalibrationPoint { force_n: 0.0, ..GOOD }),
            second(CalibrationPoint { force_n: -1.0, ..GOOD }),
            second(CalibrationPoint { force_n: f64::NAN, ..GOOD }),
        ];
        for error in refused {
            assert_eq!(error.point(), Some(1), "{error}");
        }
        assert_eq!(Calibration::new(&[]), Err(CalibrationError::NoPoints));
        assert_eq!(Calibration::new(&[CalibrationPoint { outputs: &[], ..GOOD }]), Err(CalibrationError::NoUnits));
    }

    #[test]
    fn without_forces_only_directions_count() {
        let forces = |rows: &[&[f64]]| {
            let points: Vec<_> = rows.iter().map(|row| CalibrationPoint { outputs: row, ..GOOD }).collect();
            Calibration::without_forces(&points).unwrap().force_n
        };
        let typical = (150.0f64 / 4.0).sqrt();
        let relative = forces(&[&[3.0, 4.0], &[0.0, -10.0], &[5.0, 0.0], &[0.0, 0.0]]);
        for (force, expected) in relative.iter().zip([5.0 / typical, 10.0 / typical, 5.0 / typical, 1.0]) {
            assert!((force - expected).abs() < 1e-12, "{relative:?}");
        }
        assert_eq!(forces(&[&[0.0]]), [1.0]);
        assert_eq!(forces(&[&[1e300, 0.0], &[0.0, 1e300]]), [1.0, 1.0]);
    }
}
