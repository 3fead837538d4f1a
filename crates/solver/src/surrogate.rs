//! Map computed by regression.

use super::correlation::Smoothness;
use super::field::{CalibratedArea, SplineField};
use super::hyperparameters::{Hyperparameters, Regression};
use super::kriging::Kriging;
use super::response::ForwardResponse;
use super::spots::{Spots, coordinates};
use super::{Calibration, FitError};
use palpate_core::quantity::Place;

/// Number of cells of the response's table in the distance over which the response is smooth. The spline then deviates from the
/// process by less than a ten-thousandth of the output, below any noise.
pub(super) const CELLS_A_GRAIN: f64 = 6.0;

/// Regression of the outputs, which fall to 0 far away. With this number of places, the search for the correlation takes a fifth
/// of the fit's time.
pub(super) const MANNER: Regression =
    Regression { about_mean: false, most_to_seek_with: 144, of: &Smoothness::WITH_SLOPES };

/// Returns the response as measured by the calibration, without assumptions about the material under the cover. Each unit's
/// output per newton is smoothed over the places by kriging.
pub(super) fn surrogate(calibration: &Calibration) -> Result<ForwardResponse, FitError> {
    let (spots, units) = (Spots::of(calibration), calibration.units());
    let places = coordinates(spots.places());
    let hyperparameters = Hyperparameters::weighted(&places, 2, &spots.per_newton(), units, MANNER, &spots.counts());
    map(calibration, &spots, &hyperparameters)
}

/// Returns the same response with the correlation of a larger calibration.
pub(super) fn surrogate_with(
    calibration: &Calibration,
    hyperparameters: Option<&Hyperparameters>,
) -> Result<ForwardResponse, FitError> {
    match hyperparameters {
        Some(hyperparameters) => map(calibration, &Spots::of(calibration), hyperparameters),
        None => surrogate(calibration),
    }
}

fn map(
    calibration: &Calibration,
    spots: &Spots,
    hyperparameters: &Hyperparameters,
) -> Result<ForwardResponse, FitError> {
    let units = calibration.units();
    let (places, counts) = (coordinates(spots.places()), spots.counts());
    let kriging = Kriging::fit_counting(&places, 2, &spots.per_newton(), units, MANNER, hyperparameters, Some(&counts));
    let held_out = kriging.held_out();
    let area = CalibratedArea::around(spots.places()).ok_or(FitError::NothingToTellApart)?;
    let sample = |places: &[Place]| kriging.predict_all(&coordinates(places.iter().copied()));
    let field = SplineField::of_process(area, kriging.grain() / CELLS_A_GRAIN, kriging.process(), sample);
    let held = spots.hold_out(calibration, &held_out.residuals, &held_out.leverage, kriging.is_weighted());
    let leverage = |places: &[Place]| kriging.leverage(&coordinates(places.iter().copied()));
    Ok(ForwardResponse {
        hyperparameters: Some(hyperparameters.clone()),
        ..ForwardResponse::new(field, leverage, held, calibration)
    })
}
