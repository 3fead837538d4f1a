//! Smooth change of an array's outputs that gains and places don't explain.

use super::adapt::{ArrayChange, Older};
use super::hyperparameters::Hyperparameters;
use super::kriging::Kriging;
use super::spots::{Spots, coordinates};
use super::surrogate::MANNER;
use super::{Calibration, CalibrationPoint};

impl Older<'_> {
    /// Returns the old calibration as the array would read it now. Each output is that after a change of gains and places, plus a smooth
    /// function of the place times the force: a Gaussian process of the residuals of the new presses. It is the autoregressive model of
    /// Kennedy and O'Hagan (2000, equation 1). Far from the new presses the function is 0.
    pub(crate) fn corrected(&self, change: &ArrayChange, new: &Calibration) -> Calibration {
        let changed = self.changed(change);
        let Some(residuals) = self.residuals(change, new) else { return changed };
        let (spots, units) = (Spots::of(&residuals), new.units());
        let (places, counts, values) = (coordinates(spots.places()), spots.counts(), spots.per_newton());
        let hyperparameters = Hyperparameters::weighted(&places, 2, &values, units, MANNER, &counts);
        let kriging = Kriging::fit_counting(&places, 2, &values, units, MANNER, &hyperparameters, Some(&counts));
        let per_newton = kriging.predict_all(&coordinates(changed.points().map(|point| point.place)));
        let rows = changed.points().zip(per_newton.chunks_exact(units));
        let row = |(point, per_newton): (CalibrationPoint<'_>, &[f64])| {
            let of_unit = |(output, per_newton): (&f64, &f64)| output + point.force_n * per_newton;
            point.outputs.iter().zip(per_newton).map(of_unit).collect::<Vec<f64>>()
        };
        changed.with_outputs(rows.flat_map(row).collect())
    }

    /// Returns the new presses, of whose outputs the changed map explains a part, without this part.
    fn residuals(&self, change: &ArrayChange, new: &Calibration) -> Option<Calibration> {
        let fit = self.fit(new);
        let residual = |point: &CalibrationPoint<'_>| {
            let per_newton = fit.map.changed_response(point.place, change);
            let force_n = if fit.forces_are_known { point.force_n } else { fit.force_n(point, &per_newton) };
            let outputs: Vec<f64> =
                point.outputs.iter().zip(per_newton).map(|(output, value)| output - force_n * value).collect();
            (point.place, force_n, outputs)
        };
        let rows: Vec<_> = new.points().map(|point| residual(&point)).collect();
        let points =
            rows.iter().map(|(place, force_n, outputs)| CalibrationPoint { place: *place, force_n: *force_n, outputs });
        Calibration::new(&points.collect::<Vec<_>>()).ok()
    }
}
