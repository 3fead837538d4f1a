//! Smooth change of an array's outputs that gains and places don't explain.

use super::adapt::{ArrayChange, Fit, Older};
use super::hyperparameters::Hyperparameters;
use super::kriging::Kriging;
use super::spots::{Spots, coordinates};
use super::surrogate::MANNER;
use super::{Calibration, CalibrationPoint};
use palpate_core::quantity::Place;

/// Smooth function of the place, for each output, that is added to a changed map: a Gaussian process of the residuals of new presses. It
/// is the autoregressive model of Kennedy and O'Hagan (2000, equation 1). Far from the new presses the function is 0.
pub(super) struct Correction(Kriging);

impl Older<'_> {
    /// Returns the old calibration as the array would read it now, after a change of gains and places and a correction.
    pub(crate) fn corrected(&self, change: &ArrayChange, new: &Calibration) -> Calibration {
        let changed = self.changed(change);
        self.fit(new).correction(change).map_or_else(|| changed.clone(), |correction| correction.added_to(&changed))
    }
}

impl Correction {
    /// Returns the correction under 1 N at some places, row-major, places x outputs.
    pub(crate) fn per_newton(&self, places: impl Iterator<Item = Place>) -> Vec<f64> {
        self.0.predict_all(&coordinates(places))
    }

    /// Returns presses as the corrected array would read them.
    pub(crate) fn added_to(&self, changed: &Calibration) -> Calibration {
        let per_newton = self.per_newton(changed.points().map(|point| point.place));
        let rows = changed.points().zip(per_newton.chunks_exact(changed.units()));
        let row = |(point, per_newton): (CalibrationPoint<'_>, &[f64])| {
            let of_unit = |(output, per_newton): (&f64, &f64)| output + point.force_n * per_newton;
            point.outputs.iter().zip(per_newton).map(of_unit).collect::<Vec<f64>>()
        };
        changed.with_outputs(rows.flat_map(row).collect())
    }
}

impl Fit<'_> {
    /// Returns what the new presses show beside a change of the map; `None` if they show nothing.
    pub(crate) fn correction(&self, change: &ArrayChange) -> Option<Correction> {
        let residuals = self.residuals(change)?;
        let (spots, units) = (Spots::of(&residuals), residuals.units());
        let (places, counts, values) = (coordinates(spots.places()), spots.counts(), spots.per_newton());
        let hyperparameters = Hyperparameters::weighted(&places, 2, &values, units, MANNER, &counts);
        let kriging = Kriging::fit_counting(&places, 2, &values, units, MANNER, &hyperparameters, Some(&counts));
        Some(Correction(kriging))
    }

    /// Returns the new presses, of whose outputs the changed map explains a part, without this part.
    fn residuals(&self, change: &ArrayChange) -> Option<Calibration> {
        let residual = |point: &CalibrationPoint<'_>| {
            let per_newton = self.map.changed_response(point.place, change);
            let force_n = if self.forces_are_known { point.force_n } else { self.force_n(point, &per_newton) };
            let outputs: Vec<f64> =
                point.outputs.iter().zip(per_newton).map(|(output, value)| output - force_n * value).collect();
            (point.place, force_n, outputs)
        };
        let rows: Vec<_> = self.new.points().map(|point| residual(&point)).collect();
        let points =
            rows.iter().map(|(place, force_n, outputs)| CalibrationPoint { place: *place, force_n: *force_n, outputs });
        Calibration::new(&points.collect::<Vec<_>>()).ok()
    }
}
