use super::field::{Area, Field};
use super::kriging::Kriging;
use super::response::Response;
use super::spots::Spots;
use super::{Calibration, FitError};
use crate::quantity::Place;

/// Cells of the response's table along one correlation length: the spline then strays from the process by some 1e-5 of the
/// output, far below any noise.
const CELLS_A_LENGTH: f64 = 8.0;

/// The response as the calibration has it, free of any idea of what is under the cover: each unit's output a newton, smoothed
/// over the places by kriging.
pub(super) fn surrogate(calibration: &Calibration) -> Result<Response, FitError> {
    let (spots, units) = (Spots::of(calibration), calibration.units());
    let places: Vec<f64> = spots.places().flat_map(|place| [place.x_mm, place.y_mm]).collect();
    let kriging = Kriging::fit(&places, 2, &spots.per_newton(), units, false);
    let held_out = kriging.held_out();
    let area = Area::around(spots.places()).ok_or(FitError::NothingToTellApart)?;
    let field = Field::new(area, kriging.length() / CELLS_A_LENGTH, units, |place: Place, outputs: &mut [f64]| {
        kriging.predict(&[place.x_mm, place.y_mm], outputs);
    });
    let held = spots.hold_out(calibration, &held_out.residuals, &held_out.leverage);
    let leverage = |places: &[Place]| {
        kriging.leverage(&places.iter().flat_map(|place| [place.x_mm, place.y_mm]).collect::<Vec<_>>())
    };
    Ok(Response::new(field, leverage, held, calibration))
}
