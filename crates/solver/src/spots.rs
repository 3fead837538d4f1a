//! Places of a calibration, with one measurement each.

use super::noise::Residual;
use super::response::LeftOutPress;
use super::{Calibration, correlation::farthest_apart, kriging::MOST_PLACES};
use palpate_core::quantity::Place;

/// Places of a calibration. All presses at one place count as one measurement.
pub(super) struct Spots {
    spots: Vec<Spot>,
    units: usize,
}

struct Spot {
    place: Place,
    presses: Vec<usize>,
    /// Sum of the squares of the presses' forces, N^2.
    weight: f64,
    /// Output of each unit per newton: the mean of the presses, weighted by the square of their force.
    per_newton: Vec<f64>,
}

impl Spots {
    /// Returns the places of a calibration. If there are very many, returns those that are farthest apart.
    pub(crate) fn of(calibration: &Calibration) -> Self {
        let spots = by_spread_place(calibration).into_iter().map(|presses| Spot::of(calibration, presses)).collect();
        Spots { spots, units: calibration.units() }
    }

    /// Returns the places, mm.
    pub(crate) fn places(&self) -> impl Iterator<Item = Place> + Clone {
        self.spots.iter().map(|spot| spot.place)
    }

    /// Returns the output of each unit per newton, row-major, places x units.
    pub(crate) fn per_newton(&self) -> Vec<f64> {
        self.spots.iter().flat_map(|spot| spot.per_newton.iter().copied()).collect()
    }

    /// Returns the number of typical places that each place's measurement counts for. It is the sum of squares of the force of
    /// its presses divided by the mean of this sum.
    pub(crate) fn counts(&self) -> Vec<f64> {
        let typical = self.typical_weight();
        self.spots.iter().map(|spot| spot.weight / typical).collect()
    }

    fn typical_weight(&self) -> f64 {
        self.spots.iter().map(|spot| spot.weight).sum::<f64>() / self.spots.len() as f64
    }

    /// Compares every press with the prediction of a map at its place, made without this place. `residuals` are the places'
    /// outputs per newton minus this prediction. `leverage` is the variance of the prediction divided by the variance of the
    /// noise. The noise is that of each place, or of a typical place if `is_weighted`. Both are row-major, places x units.
    pub(crate) fn hold_out(
        &self,
        calibration: &Calibration,
        residuals: &[f64],
        leverage: &[f64],
        is_weighted: bool,
    ) -> Vec<LeftOutPress> {
        let rows = residuals.chunks_exact(self.units).zip(leverage.chunks_exact(self.units));
        let mut held = Vec::with_capacity(calibration.len());
        let typical = self.typical_weight();
        for (spot, (residuals, leverage)) in self.spots.iter().zip(rows) {
            let weight = if is_weighted { typical } else { spot.weight };
            for &press in &spot.presses {
                let press = calibration.point(press);
                // The map is as certain as the mean of all presses here; a single one is less certain.
                let share = press.force_n * press.force_n / weight;
                let of_unit = |unit: usize| {
                    let predicted = press.force_n * (spot.per_newton[unit] - residuals[unit]);
                    Residual { predicted, residual: press.outputs[unit] - predicted, leverage: leverage[unit] * share }
                };
                let residuals = (0..self.units).map(of_unit).collect();
                held.push(LeftOutPress { place: spot.place, force_n: press.force_n, residuals });
            }
        }
        held
    }
}

impl Spot {
    fn of(calibration: &Calibration, presses: Vec<usize>) -> Self {
        let mut spot = Spot {
            place: calibration.point(presses[0]).place,
            presses,
            weight: 0.0,
            per_newton: vec![0.0; calibration.units()],
        };
        for &press in &spot.presses {
            let press = calibration.point(press);
            spot.weight += press.force_n * press.force_n;
            for (sum, output) in spot.per_newton.iter_mut().zip(press.outputs) {
                *sum += press.force_n * output;
            }
        }
        spot.per_newton.iter_mut().for_each(|sum| *sum /= spot.weight);
        spot
    }
}

/// Returns the presses at each place of a calibration. If there are very many places, only those farthest apart are used.
pub(super) fn by_spread_place(calibration: &Calibration) -> Vec<Vec<usize>> {
    let mut spots = calibration.by_place();
    if spots.len() > MOST_PLACES {
        let places = coordinates(spots.iter().map(|presses| calibration.point(presses[0]).place));
        let mut is_kept = vec![false; spots.len()];
        farthest_apart(&places, 2, MOST_PLACES).into_iter().for_each(|index| is_kept[index] = true);
        let mut is_kept = is_kept.into_iter();
        spots.retain(|_| is_kept.next().unwrap_or(false));
    }
    spots
}

/// x and y of places, row-major.
pub(super) fn coordinates(places: impl Iterator<Item = Place>) -> Vec<f64> {
    places.flat_map(|place| [place.x_mm, place.y_mm]).collect()
}
