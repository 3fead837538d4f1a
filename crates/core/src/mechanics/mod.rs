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

/// Traction on a plane below a point load, relative to the normal traction straight below 1 N: `[i][j]` along i (x, y, z) for a force
/// along j, with z into the material. `from_load` is the position of the point relative to the load, x, y and depth, in the unit of
/// the depth. Boussinesq's and Cerruti's solutions give t = 3 z r (r . F) / (2 pi R^5), for any Poisson's ratio.
pub fn traction(from_load: [f64; 3]) -> [[f64; 3]; 3] {
    let [x, y, depth] = from_load;
    let along = [x / depth, y / depth, 1.0];
    let normal = lambda(along[0].hypot(along[1]));
    along.map(|i| along.map(|j| normal * i * j))
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
    fn traction_has_its_golden_values() {
        let t = traction([4.5, 0.0, 5.0]);
        let golden =
            [(t[2][0], 0.204_195_46), (t[2][2], 0.226_883_84), (t[0][0], 0.183_775_91), (t[0][2], 0.204_195_46)];
        assert!(golden.iter().all(|(value, golden)| (value - golden).abs() < 5e-9), "{golden:?}");
        assert_eq!((t[1], t[2][1]), ([0.0; 3], 0.0), "nothing along y");
        assert!((t[2][2] - lambda(0.9)).abs() < 1e-15);
    }

    /// A plane below a load carries the load: the traction, in MPa for 1 N, has the identity as its integral.
    #[test]
    fn a_plane_carries_the_load() {
        let (depth_mm, most_mm, steps) = (5.0, 2000.0, 4000);
        let mut sums = [[0.0; 3]; 3];
        // rings whose radii grow geometrically, and 16 directions
        let ratio = (most_mm / 1e-3f64).ln() / f64::from(steps);
        for step in 0..steps {
            let (inner, outer) = (1e-3 * (ratio * f64::from(step)).exp(), 1e-3 * (ratio * f64::from(step + 1)).exp());
            let (radius, area) = ((inner * outer).sqrt(), PI * (outer * outer - inner * inner) / 16.0);
            for direction in 0..16 {
                let (sin, cos) = (PI * f64::from(direction) / 8.0).sin_cos();
                let t = traction([radius * cos, radius * sin, depth_mm]);
                let peak_mpa = 3.0 / (2.0 * PI * depth_mm * depth_mm);
                for (row, t) in sums.iter_mut().zip(t) {
                    row.iter_mut().zip(t).for_each(|(sum, t)| *sum += peak_mpa * t * area);
                }
            }
        }
        for (i, row) in sums.iter().enumerate() {
            for (j, sum) in row.iter().enumerate() {
                let expected = f64::from(u8::from(i == j));
                assert!((sum - expected).abs() < 5e-3, "[{i}][{j}]: {sum}");
            }
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
