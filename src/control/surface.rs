use crate::quantity::Place;

/// Standard deviation of one touch about a plane, mm: how well a surface is known before its own roughness is.
const TOUCH_SIGMA_MM: f64 = 0.010;

/// The distance from the origin at which the plane's slope may use up the frame's uncertainty, mm.
const SLOPE_ARM_MM: f64 = 6.0;

/// What the map's own standard deviation is multiplied with to be a bound.
const BOUND_SIGMAS: f64 = 5.0;

/// Touches after which the scatter about the plane is taken from the touches themselves.
const SCATTER_TOUCHES: usize = 6;

/// Where the surface is expected at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// The most likely z, mm into the specimen.
    pub z_mm: f64,
    /// The earliest z at which there can be contact, mm.
    pub first_mm: f64,
    /// The latest z at which contact must have begun, mm.
    pub last_mm: f64,
}

/// The surface as learned from touches: a plane, with the certainty it has earned.
///
/// A Bayesian linear fit of height, slope in x and slope in y; the prior is the rig's frame (flat, within its uncertainty), so
/// that the map is usable from no touch on.
#[derive(Clone, Debug)]
pub struct SurfaceMap {
    uncertainty_mm: f64,
    /// Diagonal of the prior's precision, in units of 1/TOUCH_SIGMA^2.
    prior: [f64; 3],
    /// Sums over the touches: basis times basis, basis times height, height squared.
    moments: [[f64; 3]; 3],
    weighted: [f64; 3],
    squares: f64,
    touches: usize,
}

impl SurfaceMap {
    /// A map that knows only that the surface is within `uncertainty_mm` of z = 0.
    pub fn new(uncertainty_mm: f64) -> Self {
        let prior = |sigma: f64| (TOUCH_SIGMA_MM / sigma).powi(2);
        let slope = prior(uncertainty_mm / SLOPE_ARM_MM);
        SurfaceMap {
            uncertainty_mm,
            prior: [prior(uncertainty_mm), slope, slope],
            moments: [[0.0; 3]; 3],
            weighted: [0.0; 3],
            squares: 0.0,
            touches: 0,
        }
    }

    /// Takes in a touch: contact began at `z_mm` at this place.
    pub fn learn(&mut self, place: Place, z_mm: f64) {
        let basis = basis(place);
        for (row, weight) in basis.iter().enumerate() {
            for (column, other) in basis.iter().enumerate() {
                self.moments[row][column] += weight * other;
            }
            self.weighted[row] += weight * z_mm;
        }
        self.squares += z_mm * z_mm;
        self.touches += 1;
    }

    /// Where the surface is expected. The bounds never exceed what the rig's frame says.
    pub fn expect(&self, place: Place) -> Expected {
        let basis = basis(place);
        let mut precision = self.moments;
        for (i, prior) in self.prior.iter().enumerate() {
            precision[i][i] += prior;
        }
        let plane = solve(precision, self.weighted);
        let z_mm = dot(basis, plane);
        let spread = dot(basis, solve(precision, basis)).max(0.0);
        let sigma_mm = self.scatter_mm(plane) * (spread + 1.0).sqrt();
        let bound_mm = BOUND_SIGMAS * sigma_mm;
        Expected {
            z_mm,
            first_mm: (z_mm - bound_mm).max(-self.uncertainty_mm),
            last_mm: (z_mm + bound_mm).min(self.uncertainty_mm),
        }
    }

    /// Standard deviation of a touch about the plane, mm: never under the one assumed, and larger on a rough surface.
    fn scatter_mm(&self, plane: [f64; 3]) -> f64 {
        if self.touches < SCATTER_TOUCHES {
            return TOUCH_SIGMA_MM;
        }
        let explained = 2.0 * dot(plane, self.weighted) - dot(plane, self.moments.map(|row| dot(row, plane)));
        let residual = (self.squares - explained).max(0.0);
        (residual / (self.touches - 3) as f64).sqrt().max(TOUCH_SIGMA_MM)
    }
}

fn basis(place: Place) -> [f64; 3] {
    [1.0, place.x_mm, place.y_mm]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cramer's rule; the matrix is positive definite by its prior.
fn solve(m: [[f64; 3]; 3], right: [f64; 3]) -> [f64; 3] {
    let determinant = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    // symmetric, so rows are columns
    let [a, b, c] = m;
    let whole = determinant(a, b, c);
    [determinant(right, b, c) / whole, determinant(a, right, c) / whole, determinant(a, b, right) / whole]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_touch_it_knows_what_the_frame_says() {
        let expected = SurfaceMap::new(0.3).expect(Place::new(6.0, -6.0));
        assert_eq!((expected.first_mm, expected.last_mm), (-0.3, 0.3));
    }

    #[test]
    fn a_few_touches_pin_a_plane_down() {
        let truth = |place: Place| 0.05 + 0.01 * place.x_mm - 0.02 * place.y_mm;
        let mut map = SurfaceMap::new(0.3);
        for (x, y) in [(-6.0, -6.0), (6.0, -6.0), (-6.0, 6.0), (6.0, 6.0), (0.0, 0.0)] {
            map.learn(Place::new(x, y), truth(Place::new(x, y)));
        }
        let place = Place::new(3.0, -2.0);
        let expected = map.expect(place);
        assert!((expected.z_mm - truth(place)).abs() < 0.002);
        assert!(expected.first_mm < truth(place) && truth(place) < expected.last_mm);
        assert!(expected.last_mm - expected.first_mm < 0.15, "{expected:?}");
    }

    #[test]
    fn a_rough_surface_widens_the_bounds() {
        let mut map = SurfaceMap::new(0.3);
        for i in 0..20 {
            let place = Place::new(f64::from(i % 5) - 2.0, f64::from(i / 5) - 2.0);
            map.learn(place, if i % 2 == 0 { 0.04 } else { -0.04 });
        }
        let expected = map.expect(Place::default());
        assert!(expected.first_mm < -0.15 && expected.last_mm > 0.15, "{expected:?}");
    }
}
