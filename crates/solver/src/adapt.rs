//! Updates a calibration with few presses.

use super::response::ForwardResponse;
use super::surrogate::surrogate;
use super::{Calibration, CalibrationPoint, FitError};
use palpate_core::algebra::{Matrix, Vector, cholesky, substitute};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Difference between the present calibration and an older one, of the same array or of a sensor of the same family.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrayChange {
    /// Change of each output.
    pub units: Vec<UnitChange>,
}

/// Change of one output: its gain, and the place and the width of its response.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnitChange {
    /// Factor by which the output is multiplied.
    pub gain: f64,
    /// Displacement of the unit along x, specimen frame, mm.
    pub x_mm: f64,
    /// Displacement along y, mm.
    pub y_mm: f64,
    /// Relative increase of the width of the response. A unit that is deeper has a wider response.
    pub width: f64,
}

/// Standard deviations that are tried, first for the change common to all units, then for each unit's own change. The first list
/// is for the gain, the second for the place as a fraction of the area's longer side. 0 means no change.
const GAINS: [f64; 6] = [0.0, 0.01, 0.03, 0.1, 0.3, 1.0];
const MOVES: [f64; 6] = [0.0, 0.001, 0.003, 0.01, 0.03, 0.1];

/// Number of tried ratios of the new presses' variance about the map to the old presses' variance: powers of two.
const STRAYS: i32 = 14;

/// Number of rounds in which a nonlinear map is linearised.
const ROUNDS: usize = 4;

/// Change of one unit or of all units: relative gain, displacement of the map in x and in y, mm, and relative width.
pub(super) type Moved = Vector<4>;

/// Way in which an old calibration and few new presses of the array make a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Update {
    /// The old calibration is used as it is.
    Unchanged,
    /// The gain that all units have in common changes. Places are solved as before.
    CommonGain,
    /// The gain of each unit changes.
    Gains,
    /// The gain and the place of each unit change.
    GainsAndPlaces,
    /// A smooth function of the place is added to the old presses, beside a common gain: what the new presses show.
    Corrected,
    /// The old calibration isn't used.
    NewAlone,
}

impl Update {
    /// All ways, those that change less first.
    pub const ALL: [Update; 6] = [
        Update::Unchanged,
        Update::CommonGain,
        Update::Gains,
        Update::GainsAndPlaces,
        Update::Corrected,
        Update::NewAlone,
    ];
}

impl ArrayChange {
    /// Returns no change.
    pub(super) fn none(units: usize) -> Self {
        ArrayChange::of(&vec![Moved::ZERO; units])
    }

    pub(super) fn of(moved: &[Moved]) -> Self {
        let unit =
            |moved: &Moved| UnitChange { gain: 1.0 + moved[0], x_mm: -moved[1], y_mm: -moved[2], width: moved[3] };
        ArrayChange { units: moved.iter().map(unit).collect() }
    }
}

impl UnitChange {
    /// Returns the same change as parameters of the map.
    pub(super) fn moved(&self) -> Moved {
        Moved::column([self.gain - 1.0, -self.x_mm, -self.y_mm, self.width])
    }
}

/// An old calibration and its smooth map.
pub(super) struct Older<'a> {
    calibration: &'a Calibration,
    map: AdaptableMap<'a>,
}

/// A smooth map whose units can be moved, scaled and widened.
#[derive(Clone)]
pub(super) struct AdaptableMap<'a> {
    pub response: Cow<'a, ForwardResponse>,
    /// Centre of each output's response. A response that is wider is stretched about it.
    pub centres: Cow<'a, [Place]>,
}

impl<'a> Older<'a> {
    pub(crate) fn new(calibration: &'a Calibration) -> Result<Self, FitError> {
        let response = surrogate(calibration)?;
        // widths don't change here
        let centres = vec![Place::default(); calibration.units()];
        Ok(Older { calibration, map: AdaptableMap { response: Cow::Owned(response), centres: Cow::Owned(centres) } })
    }

    /// Returns the change between the old calibration and new presses of the same units. For each unit, the smooth map of the old
    /// presses is moved and scaled as far as the new presses make this likely. The result is a mean over all standard deviations
    /// of these changes that are tried. Each is weighted by its marginal likelihood (Rasmussen and Williams 2006, equation 2.30,
    /// of a linear model with three weights per unit).
    pub(crate) fn change(&self, new: &Calibration, update: Update) -> ArrayChange {
        let fit = self.fit(new);
        let all: Vec<usize> = (0..new.units()).collect();
        let side_mm = self.map.response.field.area().side_mm();
        let places =
            if update == Update::GainsAndPlaces { MOVES.map(|place| place * side_mm).to_vec() } else { vec![0.0] };
        // without forces nothing shows a common gain
        let common_gains = if fit.forces_are_known { &GAINS[..] } else { &[0.0] };
        let own_gains = if matches!(update, Update::CommonGain | Update::Corrected) { &[0.0] } else { &GAINS[..] };
        // first what all have in common, then what each has for itself
        let common = fit.likeliest(std::slice::from_ref(&all), Moved::ZERO, common_gains, &places);
        let each: Vec<Vec<usize>> = all.into_iter().map(|unit| vec![unit]).collect();
        let own = fit.likeliest(&each, common[0], own_gains, &places);
        ArrayChange::of(&own)
    }

    /// Returns new presses with the map of the old ones.
    pub(super) fn fit<'b>(&'b self, new: &'b Calibration) -> Fit<'b> {
        let forces_are_known = self.calibration.forces_are_known() && new.forces_are_known();
        Fit { map: &self.map, new, forces_are_known }
    }

    /// Returns the old calibration as the array would have read it after a change.
    pub(crate) fn changed(&self, change: &ArrayChange) -> Calibration {
        self.map.changed(self.calibration, change)
    }
}

impl AdaptableMap<'_> {
    /// Returns presses of the map's array as the array would have read them after a change.
    pub(crate) fn changed(&self, calibration: &Calibration, change: &ArrayChange) -> Calibration {
        self.each(calibration, change, |output, gain, moved| gain * (output + moved))
    }

    /// Returns presses of the changed array as the array would have read them before the change.
    pub(crate) fn unchanged(&self, calibration: &Calibration, change: &ArrayChange) -> Calibration {
        self.each(calibration, change, |output, gain, moved| output / gain - moved)
    }

    /// Returns presses with new outputs: a function of the output, of the gain, and of what the displacement adds to the output.
    fn each(&self, calibration: &Calibration, change: &ArrayChange, new: impl Fn(f64, f64, f64) -> f64) -> Calibration {
        let row = |point: CalibrationPoint<'_>| {
            let of_unit = |(unit, change): (usize, &UnitChange)| {
                let [there, ..] = self.felt(unit, point.place, &change.moved());
                let [here, ..] = self.response.field.channel(unit, point.place);
                new(point.outputs[unit], change.gain, point.force_n * (there - here))
            };
            change.units.iter().enumerate().map(of_unit).collect::<Vec<f64>>()
        };
        calibration.with_outputs(calibration.points().flat_map(row).collect())
    }

    /// Returns the response to 1 N at a place after a change.
    pub(super) fn changed_response(&self, place: Place, change: &ArrayChange) -> Vec<f64> {
        self.response_at(place, |unit| change.units[unit].moved())
    }

    fn response_at(&self, place: Place, moved: impl Fn(usize) -> Moved) -> Vec<f64> {
        let of_unit = |unit: usize| (1.0 + moved(unit)[0]) * self.felt(unit, place, &moved(unit))[0];
        (0..self.centres.len()).map(of_unit).collect()
    }

    /// Returns the response of a displaced unit to 1 N at a place, without its gain, and the derivatives of the output with respect
    /// to its change.
    pub(crate) fn slopes(&self, unit: usize, place: Place, moved: &Moved) -> (f64, Moved) {
        let [value, along_x, along_y, wider] = self.felt(unit, place, moved);
        let gain = 1.0 + moved[0];
        (value, Moved::column([value, gain * along_x, gain * along_y, gain * wider]))
    }

    /// Returns the response of a displaced unit to 1 N at a place, and its derivatives with respect to the displacement along x
    /// and y and to the width. Outside the area the map is continued linearly.
    pub(crate) fn felt(&self, unit: usize, place: Place, moved: &Moved) -> [f64; 4] {
        let (centre, narrow) = (self.centres[unit], 1.0 - moved[3]);
        let (x_mm, y_mm) = (place.x_mm + moved[1] - centre.x_mm, place.y_mm + moved[2] - centre.y_mm);
        let there = Place::new(centre.x_mm + narrow * x_mm, centre.y_mm + narrow * y_mm);
        let known = self.response.field.area().clamp(there);
        let [value, along_x, along_y] = self.response.field.channel(unit, known);
        let (dx, dy) = (there.x_mm - known.x_mm, there.y_mm - known.y_mm);
        let value = value + along_x * dx + along_y * dy;
        [value, narrow * along_x, narrow * along_y, -(along_x * x_mm + along_y * y_mm)]
    }
}

/// New presses, and the map with which they are compared.
pub(super) struct Fit<'a> {
    pub map: &'a AdaptableMap<'a>,
    pub new: &'a Calibration,
    pub forces_are_known: bool,
}

/// One output: its derivatives with respect to a change, its residual, and the residual's variance.
pub(super) struct LinearRow {
    pub slopes: Moved,
    pub left: f64,
    pub variance: f64,
}

impl Fit<'_> {
    /// Returns the most likely changes of groups of units, relative to a known change.
    fn likeliest(&self, groups: &[Vec<usize>], about: Moved, gains: &[f64], places: &[f64]) -> Vec<Moved> {
        let mut moved = vec![about; groups.len()];
        let sds =
            gains.iter().flat_map(|&gain| places.iter().map(move |&place| Moved::column([gain, place, place, 0.0])));
        let tried: Vec<_> = sds.flat_map(|sd| (0..STRAYS).map(move |doubled| (sd, 2f64.powi(doubled)))).collect();
        for _ in 0..ROUNDS {
            let rows: Vec<Vec<LinearRow>> =
                groups.iter().zip(&moved).map(|(of, moved)| self.rows(of, moved, about)).collect();
            let found: Vec<Vec<ChangePosterior>> = tried
                .iter()
                .map(|(sd, times)| rows.iter().map(|rows| ChangePosterior::of(rows, *sd, *times)).collect())
                .collect();
            let evidence: Vec<f64> = found.iter().map(|of| of.iter().map(|of_group| of_group.evidence).sum()).collect();
            let most = evidence.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let weights: Vec<f64> = evidence.iter().map(|evidence| (evidence - most).exp()).collect();
            let sum: f64 = weights.iter().sum();
            for (group, moved) in moved.iter_mut().enumerate() {
                let weighed = found.iter().zip(&weights).map(|(of, weight)| of[group].moved * *weight);
                *moved = about + weighed.sum::<Moved>() / sum;
            }
        }
        moved
    }

    /// Returns the outputs of some units as linear functions of a change relative to `about`, linearised at `at`.
    pub(crate) fn rows(&self, units: &[usize], at: &Moved, about: Moved) -> Vec<LinearRow> {
        let response = &self.map.response;
        let mut leverage = vec![0.0; self.new.units()];
        let mut rows = Vec::with_capacity(units.len() * self.new.len());
        for point in self.new.points() {
            response.leverage.value(point.place, &mut leverage);
            let force_n = if self.forces_are_known {
                point.force_n
            } else {
                self.force_n(&point, &self.map.response_at(point.place, |_| *at))
            };
            for &unit in units {
                let (value, slopes) = self.map.slopes(unit, point.place, at);
                let (gain, slopes) = (1.0 + at[0], slopes * force_n);
                let left = point.outputs[unit] - force_n * gain * value + slopes.dot(&(*at - about));
                let variance = response.variance(unit, force_n, gain * value, leverage[unit]);
                rows.push(LinearRow { slopes, left, variance });
            }
        }
        rows
    }

    /// Returns the force that the map gives for a press of unknown force. `per_newton` is the response of the map there.
    pub(super) fn force_n(&self, point: &CalibrationPoint<'_>, per_newton: &[f64]) -> f64 {
        let (mut along, mut square) = (0.0, f64::MIN_POSITIVE);
        for (unit, (output, &value)) in point.outputs.iter().zip(per_newton).enumerate() {
            let weight = 1.0 / self.map.response.noise.variance(unit, point.force_n * value);
            along += weight * output * value;
            square += weight * value * value;
        }
        (along / square).max(f64::MIN_POSITIVE)
    }
}

/// Change that follows from some rows, and its likelihood.
struct ChangePosterior {
    moved: Moved,
    /// Logarithm of the marginal likelihood.
    evidence: f64,
}

impl ChangePosterior {
    /// Returns the posterior of changes with these standard deviations about 0. The rows' variance is multiplied by `times`.
    fn of(rows: &[LinearRow], sd: Moved, times: f64) -> Self {
        let (mut normal, mut right) = (Matrix::<4, 4>::identity(), Moved::ZERO);
        let (mut squares, mut logs) = (0.0, 0.0);
        for LinearRow { slopes, left, variance } in rows {
            let variance = times * variance;
            let scaled = slopes.times(sd);
            normal += scaled * scaled.transpose() / variance;
            right += scaled * (left / variance);
            squares += left * left / variance;
            logs += variance.ln();
        }
        let Some(factor) = cholesky(normal.rows()) else {
            return ChangePosterior { moved: Moved::ZERO, evidence: f64::NEG_INFINITY };
        };
        let solved = Moved::column(substitute(&factor, right.values()));
        let determinant = 2.0 * (0..4).map(|i| factor[i][i].ln()).sum::<f64>();
        let evidence = -0.5 * (logs + determinant + squares - right.dot(&solved));
        ChangePosterior { moved: solved.times(sd), evidence }
    }
}
