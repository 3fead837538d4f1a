//! Medium that the load presses on.

/// Medium that the load presses on. It determines the spread of the stress on the way to the taxels. The load at the surface is
/// normal and frictionless.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Medium {
    /// An elastic half-space (Boussinesq), which continues without end below the taxels. Poisson's ratio has no effect.
    HalfSpace,
    /// An elastic layer bonded to a rigid base, with the taxels at the bond.
    BondedLayer {
        /// Poisson's ratio, 0 to [`MOST_POISSON_RATIO`]; silicone rubber has some 0.49.
        poisson_ratio: f64,
    },
}

/// Largest Poisson's ratio that is used, 1: nearly incompressible.
pub const MOST_POISSON_RATIO: f64 = 0.4999;

impl Medium {
    /// Fraction that remains at depth H of a pressure that varies along the surface as J0(h r / H). It is the Hankel transform
    /// (order 0) of the normal stress under a unit load. It is 1 at h = 0, because the complete load arrives.
    ///
    /// Half-space: `(1 + h) e^-h`. Bonded layer: `U` and `W` are the transforms of the radial (order 1) and the normal
    /// displacement, and `s` is the height over the base in units of H / h. Navier's equations then have this solution, which is
    /// at rest at the base:
    ///
    /// ```text
    /// U =  s (A sinh s + B cosh s) + (3 - 4 nu) B sinh s
    /// W = -s (A cosh s + B sinh s) + (3 - 4 nu) A sinh s
    /// ```
    ///
    /// Zero shear and unit pressure at the top (s = h) determine A and B; the stress at the base is proportional to 2 (1 - nu) A.
    /// (This is the classical method: Burmister 1945; Johnson, Contact Mechanics, 1985, chapter 5, for the plane counterpart.)
    pub(super) fn transform(self, h: f64) -> f64 {
        match self {
            Medium::HalfSpace => (1.0 + h) * (-h).exp(),
            Medium::BondedLayer { poisson_ratio: nu } => {
                let (sinh, cosh) = (h.sinh(), h.cosh());
                let twice = 2.0 * (1.0 - nu);
                twice * (h * sinh + twice * cosh) / (h * h + twice * twice + (3.0 - 4.0 * nu) * sinh * sinh)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_layers_transform_meets_its_boundary_conditions() {
        for nu in [0.0, 0.3, 0.49, MOST_POISSON_RATIO] {
            for h in [0.1, 1.0, 3.0, 8.0f64] {
                // the solution of the document with A from the transform, and B such that there is no shear at the top
                let a = Medium::BondedLayer { poisson_ratio: nu }.transform(h) / (2.0 * (1.0 - nu));
                let b =
                    -a * (h * h.cosh() - (1.0 - 2.0 * nu) * h.sinh()) / (h * h.sinh() + 2.0 * (1.0 - nu) * h.cosh());
                let kappa = 3.0 - 4.0 * nu;
                let u = |s: f64| s * (a * s.sinh() + b * s.cosh()) + kappa * b * s.sinh();
                let w = |s: f64| -s * (a * s.cosh() + b * s.sinh()) + kappa * a * s.sinh();
                let slope = |f: &dyn Fn(f64) -> f64, s: f64| (f(s + 1e-5) - f(s - 1e-5)) / 2e-5;
                // in units of 2 G h: sigma_z = W' + nu / (1 - 2 nu) (U + W'), tau = (U' - W) / 2
                let normal = |s: f64| slope(&w, s) + nu / (1.0 - 2.0 * nu) * (u(s) + slope(&w, s));
                let shear = (slope(&u, h) - w(h)) / 2.0;
                assert_eq!((u(0.0), w(0.0)), (0.0, 0.0));
                // a finite difference over 1 - 2 nu knows no more than some 1e-6
                assert!(shear.abs() < 1e-6, "nu {nu}, h {h}: shear {shear}");
                assert!((normal(h) - 1.0).abs() < 1e-5, "nu {nu}, h {h}: pressure {}", normal(h));
                let arrives = Medium::BondedLayer { poisson_ratio: nu }.transform(h);
                assert!((normal(0.0) - arrives).abs() < 1e-5, "nu {nu}, h {h}: base {} {arrives}", normal(0.0));
            }
        }
    }

    #[test]
    fn layer_carries_the_whole_load() {
        for medium in [Medium::HalfSpace, Medium::BondedLayer { poisson_ratio: 0.3 }] {
            assert_eq!(medium.transform(0.0), 1.0);
        }
    }
}
