//! One solved contact and its uncertainty.

use super::{DepthCurve, HalfWidths};
use palpate_core::quantity::Place;
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

/// One solved contact and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Place of the contact, specimen frame, mm.
    pub place: Place,
    /// Force, N; if [`Model::forces_are_known`](super::Model::forces_are_known) is false, relative to the typical press. Noise can make the
    /// force of a very light contact negative; the force is reported unchanged.
    pub force_n: f64,
    /// Depth of the contact, if the calibration knows its presses by depth. `force_n` is then an intensity, see [`DepthCurve`].
    pub depth: Option<SolvedDepth>,
    /// Expected errors of place and force; `None` if the calibration can't show them.
    pub covariance: Option<Covariance>,
    /// Errors of place and force that 68 and 95 of 100 cases don't exceed; `None` if the calibration can't show them.
    pub half_widths: Option<HalfWidths>,
    /// Another place that explains the reading nearly as well, if there is one.
    pub other: Option<Place>,
    /// Misfit between the reading and one contact there. 0 is a perfect fit; 1 is the threshold that a single contact exceeds
    /// only at the false-alarm rate. `None` if the calibration can't show it.
    pub misfit: Option<f64>,
    /// Whether the solution is credible.
    pub verdict: ContactVerdict,
    /// Whether the answer is that of a fit that assumes the load of the calibration, because the reading has this load. Always false if
    /// the model has only one fit.
    pub is_calibrated_load: bool,
}

impl Solution {
    /// Returns the word for the load that the answer assumes, of two methods of a model.
    pub fn load(&self) -> &'static str {
        if self.is_calibrated_load { "calibrated" } else { "any" }
    }

    /// Returns a solution of a place and a force whose errors are unknown.
    pub(super) fn plain(place: Place, force_n: f64, verdict: ContactVerdict) -> Self {
        Solution {
            place,
            force_n,
            depth: None,
            covariance: None,
            half_widths: None,
            other: None,
            misfit: None,
            verdict,
            is_calibrated_load: false,
        }
    }
}

/// Depth of a contact, below the surface, and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolvedDepth {
    /// Depth, mm. Noise can make the depth of a very light contact negative.
    pub depth_mm: f64,
    /// One-sigma error, mm; `None` if the calibration can't show it.
    pub sd_mm: Option<f64>,
    /// Errors that 68 and 95 of 100 depths don't exceed, mm; `None` if the calibration can't show them.
    pub half_widths_mm: Option<[f64; 2]>,
}

impl SolvedDepth {
    /// Returns the depth of a solution whose force is an intensity.
    pub(super) fn of(solution: &Solution, curve: &DepthCurve) -> Self {
        let intensity = solution.force_n;
        let half_mm = |half_width: f64| curve.half_width_mm(intensity, half_width);
        SolvedDepth {
            depth_mm: curve.depth_mm(intensity),
            sd_mm: solution.covariance.map(|sd| half_mm(sd.force_n())),
            half_widths_mm: solution.half_widths.map(|half| [half.half68_n, half.half95_n].map(half_mm)),
        }
    }
}

/// Covariance of x (mm), y (mm) and force (N), in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance(pub [[f64; 3]; 3]);

impl Covariance {
    /// Returns the same covariance with the standard deviations of x, y and force multiplied.
    pub(super) fn widened(self, by: [f64; 3]) -> Self {
        let Covariance(mut covariance) = self;
        for (i, row) in covariance.iter_mut().enumerate() {
            row.iter_mut().zip(by).for_each(|(value, other)| *value *= by[i] * other);
        }
        Covariance(covariance)
    }

    /// Returns the one-sigma error of x, mm.
    pub fn x_mm(&self) -> f64 {
        self.0[0][0].sqrt()
    }

    /// Returns the one-sigma error of y, mm.
    pub fn y_mm(&self) -> f64 {
        self.0[1][1].sqrt()
    }

    /// Returns the one-sigma error of the force, N.
    pub fn force_n(&self) -> f64 {
        self.0[2][2].sqrt()
    }

    /// Returns the mean distance from the truth, mm, of a place with this covariance and no bias.
    ///
    /// With the variances l1 >= l2 along its axes: E|e| = sqrt(2 l1 / pi) E(1 - l2/l1). E is the complete elliptic integral of
    /// the second kind, as a function of its parameter. An isotropic covariance gives sqrt(pi/2) sd, a line gives sqrt(2/pi) sd.
    pub fn mean_distance_mm(&self) -> f64 {
        let [[xx, xy, _], [_, yy, _], _] = self.0;
        let (middle, half) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
        let (most, least) = (middle + half, (middle - half).max(0.0));
        if most <= 0.0 { 0.0 } else { (FRAC_2_PI * most).sqrt() * elliptic_e(1.0 - least / most) }
    }

    /// Returns the mean absolute error, N, of a force with this covariance and no bias.
    pub fn mean_force_error_n(&self) -> f64 {
        FRAC_2_PI.sqrt() * self.force_n()
    }
}

/// Whether a solution is credible, and the reason if it isn't.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactVerdict {
    /// No reason for doubt was found.
    Ok,
    /// The reading can't be distinguished from a reading without contact.
    WeakSignal,
    /// The contact lies outside the calibrated area.
    OutsideArea,
    /// No single contact gives this reading.
    NotOneContact,
    /// One unit, counted from 0, contradicts all others.
    ChannelFault(usize),
}

/// Returns the complete elliptic integral of the second kind of a parameter m, 0 to 1. It uses the arithmetic-geometric mean
/// (Abramowitz and Stegun 1964, 17.6.4).
fn elliptic_e(m: f64) -> f64 {
    if m >= 1.0 {
        return 1.0;
    }
    let (mut a, mut b, mut weight, mut sum) = (1.0, (1.0 - m).sqrt(), 0.5, 0.5 * m);
    // it doubles its digits each time
    for _ in 0..8 {
        let c: f64 = (a - b) / 2.0;
        (a, b) = ((a + b) / 2.0, f64::sqrt(a * b));
        weight *= 2.0;
        sum += weight * c * c;
    }
    FRAC_PI_2 / a * (1.0 - sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_distance_is_the_integral_over_the_angle() {
        let covariance = |xx: f64, xy: f64, yy: f64| Covariance([[xx, xy, 0.0], [xy, yy, 0.0], [0.0; 3]]);
        for (xx, xy, yy) in [(1.0, 0.0, 1.0), (4.0, 0.0, 0.01), (1.0, 0.6, 0.5), (2.0, 0.0, 0.0)] {
            // |e| = r(angle) times the length of a normal vector of two parts, whose mean is sqrt(pi / 2)
            let steps = 100_000;
            let length = |i: usize| {
                let (sin, cos) = (std::f64::consts::TAU * (i as f64 + 0.5) / steps as f64).sin_cos();
                // the columns of a square root of the covariance
                let a = f64::sqrt(xx);
                let (b, c) = (xy / a, f64::sqrt(yy - xy * xy / xx));
                (a * cos).hypot(b * cos + c * sin)
            };
            let mean = (0..steps).map(length).sum::<f64>() / steps as f64 * FRAC_PI_2.sqrt();
            let ours = covariance(xx, xy, yy).mean_distance_mm();
            assert!((ours - mean).abs() < 1e-6, "{xx} {xy} {yy}: {ours}, {mean}");
        }
    }
}
