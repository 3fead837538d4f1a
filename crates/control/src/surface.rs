//! Position of the surface, learned from touches.

use super::plane::BayesianPlane;
use palpate_core::quantity::Place;

/// Standard deviation of one touch about a plane, mm. It is assumed until the surface's own roughness is known.
pub const TOUCH_SIGMA_MM: f64 = 0.010;

/// Distance from the origin at which the plane's slope may use up the frame's uncertainty, mm.
const SLOPE_ARM_MM: f64 = 6.0;

/// Factor from the map's standard deviation to a bound.
const BOUND_SIGMAS: f64 = 5.0;

/// Number of touches from which the scatter about the plane is calculated from the touches themselves.
const SCATTER_TOUCHES: usize = 5;

/// Expected position of the surface at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// The most likely z, mm into the specimen.
    pub z_mm: f64,
    /// Earliest z at which contact is possible, mm.
    pub first_mm: f64,
    /// Latest z at which contact must have begun, mm.
    pub last_mm: f64,
    /// Standard deviation of the surface about the most likely z, mm.
    pub sigma_mm: f64,
    /// Whether the value comes from a touch. Without a touch the value comes from the frame only, and no motion may rely on it.
    pub touched: bool,
}

/// Surface learned from touches: a plane with its uncertainty. The prior is the rig's frame (flat, within its uncertainty), so
/// the map is usable before the first touch.
#[derive(Clone, Debug)]
pub(crate) struct SurfaceMap {
    uncertainty_mm: f64,
    plane: BayesianPlane,
}

impl SurfaceMap {
    /// Creates a map that contains only this: the surface is within `uncertainty_mm` of z = 0.
    pub(crate) fn new(uncertainty_mm: f64) -> Self {
        let prior = |sigma: f64| (TOUCH_SIGMA_MM / sigma).powi(2);
        let slope = prior(uncertainty_mm / SLOPE_ARM_MM);
        let plane = BayesianPlane::new(Place::default(), [prior(uncertainty_mm), slope, slope]);
        SurfaceMap { uncertainty_mm, plane }
    }

    /// Adds a touch: contact began at `z_mm` at this place.
    pub(crate) fn learn(&mut self, place: Place, z_mm: f64) {
        self.plane.take(place, z_mm, 1.0);
    }

    /// Number of touches in the map.
    pub(crate) fn touches(&self) -> usize {
        self.plane.count()
    }

    /// Returns the expected position of the surface. The bounds never exceed the bounds of the rig's frame.
    pub(crate) fn expect(&self, place: Place) -> Expected {
        let (z_mm, spread) = self.plane.at(place);
        let sigma_mm = self.scatter_mm() * (spread + 1.0).sqrt();
        let bound_mm = BOUND_SIGMAS * sigma_mm;
        Expected {
            z_mm,
            first_mm: (z_mm - bound_mm).max(-self.uncertainty_mm),
            last_mm: (z_mm + bound_mm).min(self.uncertainty_mm),
            sigma_mm,
            touched: self.touches() > 0,
        }
    }

    /// Scatter of touches about the plane beyond the usual scatter, mm: the specimen's relief.
    pub(super) fn excess_mm(&self) -> f64 {
        let scatter_mm = self.scatter_mm();
        if scatter_mm > TOUCH_SIGMA_MM { scatter_mm } else { 0.0 }
    }

    /// Standard deviation of a touch about the plane, mm. It is never below the assumed value, and is larger on a rough surface.
    fn scatter_mm(&self) -> f64 {
        if self.touches() < SCATTER_TOUCHES { TOUCH_SIGMA_MM } else { self.plane.scatter().sqrt().max(TOUCH_SIGMA_MM) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn untouched_map_uses_the_declared_frame() {
        let expected = SurfaceMap::new(0.3).expect(Place::new(6.0, -6.0));
        assert_eq!((expected.first_mm, expected.last_mm), (-0.3, 0.3));
    }

    #[test]
    fn few_touches_determine_a_plane() {
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
