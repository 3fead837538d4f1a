//! Linear elasticity: the effect of a surface load at the depth of the taxels.
//!
//! [`lambda`] is the shape of a point load's stress in a half-space, in closed form. A [`TaxelResponse`] is the reading of a taxel for
//! a load on the sensor's material: a half-space or a bonded layer, with an indenter and a taxel of some size.

mod hankel;
mod layer;
mod response;
mod spread;

pub use layer::{MOST_POISSON_RATIO, Medium};
pub use response::{MOST_RADIUS_DEPTHS, Passage, TaxelResponse};

/// Shape of the stress under a point load, lambda = (k^2 + 1)^(-5/2) (paper equation 4); `k` = distance over depth. The value is
/// 1 straight above.
pub fn lambda(k: f64) -> f64 {
    let base = k * k + 1.0;
    1.0 / (base * base * base.sqrt())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Normal stress in an elastic half-space under a normal point load, N/mm^2 = MPa, compression negative (paper equation 1).
    /// `force_n` acts on the surface; the point is `distance_mm` sideways and `depth_mm` below it.
    pub(crate) fn half_space_stress_mpa(force_n: f64, distance_mm: f64, depth_mm: f64) -> f64 {
        -3.0 * force_n / (2.0 * PI * depth_mm * depth_mm) * lambda(distance_mm / depth_mm)
    }

    #[test]
    fn lambda_has_its_golden_values() {
        for (k, golden) in [
            (0.0, 1.0),
            (0.25, 0.8593649828276988),
            (0.5, 0.5724334022399462),
            (1.0, 0.1767766952966369),
            (1.5, 0.05251599490889743),
            (2.0, 0.01788854381999832),
            (2.5, 0.007065696577485921),
            (3.0, 0.0031622776601683794),
        ] {
            assert!((lambda(k) - golden).abs() < 1e-12, "k = {k}");
        }
    }

    #[test]
    fn the_stress_matches_the_papers_first_equation() {
        // 1 N straight above 5 mm: 3 / (2 pi 25) MPa; off to the side, z^3 / (rho^2 + z^2)^(5/2) directly.
        assert!((half_space_stress_mpa(1.0, 0.0, 5.0) + 0.019_098_593_171).abs() < 1e-12);
        let (rho, z) = (3.0f64, 5.0f64);
        let direct = -3.0 * 2.0 / (2.0 * PI) * z.powi(3) / (rho * rho + z * z).powf(2.5);
        assert!((half_space_stress_mpa(2.0, rho, z) - direct).abs() < 1e-15);
    }
}
