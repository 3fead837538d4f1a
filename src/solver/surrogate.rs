use super::field::{Area, Field};
use super::kriging::{Kriging, MOST_PLACES, farthest_apart};
use super::noise::{Noise, Residual};
use super::response::{Held, Response};
use super::{Calibration, FitError};
use crate::quantity::Place;

/// Cells of the response's table along one correlation length: the spline then strays from the process by some 1e-5 of the
/// output, far below any noise.
const CELLS_A_LENGTH: f64 = 16.0;

/// Cells along each side of the table that holds the map's own error.
const ERROR_CELLS: f64 = 12.0;

/// The response as the calibration has it, free of any idea of what is under the cover: each unit's output a newton, smoothed
/// over the places by kriging.
///
/// Presses at one place are one measurement, weighted by the square of their force. What each place would have been predicted
/// to read without it gives the noise.
pub(super) fn surrogate(calibration: &Calibration) -> Result<Response, FitError> {
    let mut spots = Spot::of(calibration);
    if spots.len() > MOST_PLACES {
        let all: Vec<f64> = spots.iter().flat_map(|spot| [spot.place.x_mm, spot.place.y_mm]).collect();
        let mut kept = farthest_apart(&all, 2, MOST_PLACES);
        kept.sort_unstable();
        spots = kept.into_iter().map(|index| spots[index].clone()).collect();
    }
    let units = calibration.units();
    let places: Vec<f64> = spots.iter().flat_map(|spot| [spot.place.x_mm, spot.place.y_mm]).collect();
    let per_newton: Vec<f64> = spots.iter().flat_map(|spot| spot.per_newton.iter().copied()).collect();
    let kriging = Kriging::fit(&places, 2, &per_newton, units, false);

    let held = hold_out(calibration, &spots, &kriging);
    let of_unit = |unit: usize| held.iter().map(|held| held.residuals[unit]).collect();
    let noise = Noise::fit(&(0..units).map(of_unit).collect::<Vec<Vec<Residual>>>());

    let Some(area) = Area::around(spots.iter().map(|spot| spot.place)) else {
        return Err(FitError::NothingToTellApart);
    };
    let sample = |place: Place, outputs: &mut [f64]| {
        kriging.predict(&[place.x_mm, place.y_mm], outputs);
    };
    let field = Field::new(area, kriging.length() / CELLS_A_LENGTH, units, sample);
    let leverage = leverage_field(area, units, |places| kriging.leverage(places));
    Ok(Response { field, leverage, noise, force_n: calibration.typical_force_n(), held })
}

/// Tabulates the map's own error, which is asked for at many places at once.
pub(super) fn leverage_field(area: Area, units: usize, leverage: impl FnOnce(&[f64]) -> Vec<f64>) -> Field {
    let side = (area.most.x_mm - area.least.x_mm).max(area.most.y_mm - area.least.y_mm).max(f64::MIN_POSITIVE);
    let step = side / ERROR_CELLS;
    let mut places = Vec::new();
    Field::new(area, step, 1, |place, _| places.extend([place.x_mm, place.y_mm]));
    let values = leverage(&places);
    let mut rows = values.chunks_exact(units);
    Field::new(area, step, units, |_, out| {
        if let Some(row) = rows.next() {
            out.copy_from_slice(row);
        }
    })
}

/// All presses at one place.
#[derive(Clone)]
struct Spot {
    place: Place,
    presses: Vec<usize>,
    /// Sum of the squares of their forces, N^2.
    weight: f64,
    per_newton: Vec<f64>,
}

impl Spot {
    fn of(calibration: &Calibration) -> Vec<Spot> {
        let mut spots: Vec<Spot> = Vec::new();
        for (index, same) in calibration.by_place() {
            let mut spot = Spot {
                place: calibration.point(index).place,
                presses: same,
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
            spots.push(spot);
        }
        spots
    }
}

/// Every press against what the map says at its place without it.
fn hold_out(calibration: &Calibration, spots: &[Spot], kriging: &Kriging) -> Vec<Held> {
    let units = calibration.units();
    let held_out = kriging.held_out();
    let rows = held_out.residuals.chunks_exact(units).zip(held_out.leverage.chunks_exact(units));
    let mut held = Vec::with_capacity(calibration.len());
    for (spot, (residuals, leverage)) in spots.iter().zip(rows) {
        for &press in &spot.presses {
            let press = calibration.point(press);
            let of_unit = |unit: usize| {
                let predicted = press.force_n * (spot.per_newton[unit] - residuals[unit]);
                // The map is as sure as the mean of all presses here makes it; one of them alone is less so.
                let share = press.force_n * press.force_n / spot.weight;
                Residual { predicted, residual: press.outputs[unit] - predicted, leverage: leverage[unit] * share }
            };
            held.push(Held { place: spot.place, force_n: press.force_n, residuals: (0..units).map(of_unit).collect() });
        }
    }
    held
}
