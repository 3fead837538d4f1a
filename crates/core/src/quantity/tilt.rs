//! Tilt of the specimen's surface against the stage's x and y.

use super::Place;

/// Largest tilt that a rig may have, degrees. There the tip travels 87 um sideways over the surface per mm of depth, about as much
/// as the location errors of a good sensor. The cosine changes a force by 0.4 %, and a contact that sticks makes this correction too
/// large by up to 0.8 %.
pub const TILT_MOST_DEG: f64 = 5.0;

/// Plane of the specimen's surface: its slopes in the specimen frame, mm into the specimen per mm of x and of y. z is the direction
/// in which the stage presses; x and y are at right angles to it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tilt {
    /// Slope along x; positive if the surface is deeper at larger x.
    pub per_x: f64,
    /// Slope along y.
    pub per_y: f64,
}

impl Tilt {
    /// A surface at right angles to z.
    pub const LEVEL: Tilt = Tilt { per_x: 0.0, per_y: 0.0 };

    /// Sideways travel of the tip over the surface per mm of depth along z, mm: the tangent of the tilt.
    pub fn tangent(&self) -> f64 {
        self.per_x.hypot(self.per_y)
    }

    /// Angle between the surface and the plane of x and y, degrees.
    pub fn degrees(&self) -> f64 {
        self.tangent().atan().to_degrees()
    }

    /// Direction in which the surface gets deeper, from x toward y, 0 to 360 degrees.
    pub fn direction_deg(&self) -> f64 {
        self.per_y.atan2(self.per_x).to_degrees().rem_euclid(360.0)
    }

    /// Cosine of the tilt: depth along the surface's normal per depth along z, and force along z per force along the normal. It is
    /// exactly 1 for a level surface.
    pub fn cosine(&self) -> f64 {
        1.0 / (1.0 + self.tangent().powi(2)).sqrt()
    }

    /// Force along the surface's normal of a contact without friction, N. The load cell measures its part along z, `along_z_n`.
    pub fn normal_n(&self, along_z_n: f64) -> f64 {
        along_z_n / self.cosine()
    }

    /// Depth along the surface's normal, mm, of a depth along z.
    pub fn normal_mm(&self, along_z_mm: f64) -> f64 {
        along_z_mm * self.cosine()
    }

    /// Depth along z, mm, of a depth along the surface's normal.
    pub fn along_z_mm(&self, normal_mm: f64) -> f64 {
        normal_mm / self.cosine()
    }

    /// Height of the surface at a place, from the origin, mm into the specimen.
    pub fn height_mm(&self, place: Place) -> f64 {
        self.per_x * place.x_mm + self.per_y * place.y_mm
    }

    /// Whether a rig may have this tilt; false for what isn't a number.
    pub fn is_allowed(&self) -> bool {
        self.degrees() <= TILT_MOST_DEG
    }

    /// Returns the same plane in a frame that is rotated by `degrees`, from x toward y.
    #[must_use]
    pub fn in_frame_turned(self, degrees: f64) -> Tilt {
        let Place { x_mm: per_x, y_mm: per_y } = Place::new(self.per_x, self.per_y).turned(-degrees);
        Tilt { per_x, per_y }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_surface_changes_no_bit() {
        for number in [1.0 / 3.0, -0.0, 0.1, -7e-9, 1.234_567_89] {
            let kept = [Tilt::LEVEL.normal_n(number), Tilt::LEVEL.normal_mm(number), Tilt::LEVEL.along_z_mm(number)];
            assert!(kept.iter().all(|kept| kept.to_bits() == number.to_bits()), "{kept:?}");
        }
        assert!(Tilt::LEVEL.is_allowed());
    }

    #[test]
    fn surface_tilt_is_allowed_up_to_five_degrees() {
        let tilted = |degrees: f64| Tilt { per_x: 0.0, per_y: -degrees.to_radians().tan() };
        let five = tilted(TILT_MOST_DEG - 1e-9);
        assert!(five.is_allowed() && !tilted(5.001).is_allowed());
        assert!(!Tilt { per_x: f64::NAN, per_y: 0.0 }.is_allowed());
        assert!((five.tangent() - 0.0875).abs() < 1e-4 && (five.direction_deg() - 270.0).abs() < 1e-9);
        let cosine = 5f64.to_radians().cos();
        assert!((five.normal_n(1.0) - 1.0 / cosine).abs() < 1e-9, "a normal force is larger than its part along z");
        assert!((five.normal_mm(1.0) - cosine).abs() < 1e-9, "a normal depth is smaller than the way along z");
        assert!((five.along_z_mm(five.normal_mm(0.7)) - 0.7).abs() < 1e-12);
    }

    #[test]
    fn a_plane_has_the_same_heights_in_a_turned_frame() {
        let tilt = Tilt { per_x: 0.03, per_y: -0.01 };
        let place = Place::new(1.0, 2.0);
        let turned = tilt.in_frame_turned(30.0);
        assert!((turned.height_mm(place) - tilt.height_mm(place.turned(30.0))).abs() < 1e-12);
        assert!((turned.tangent() - tilt.tangent()).abs() < 1e-12);
    }
}
