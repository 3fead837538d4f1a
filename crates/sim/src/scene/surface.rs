//! Plane of the true surface.

use palpate_core::quantity::{Frame, Tilt, stream};
use rand::RngExt;

/// Plane of the specimen's true surface, near the nominal plane.
#[derive(Clone)]
pub(super) struct Surface {
    frame: Frame,
    /// Distance of the surface beyond the nominal surface, into the specimen: at the origin (mm) and per mm of x and y.
    plane: [f64; 3],
    /// Depth along the normal per depth along z; 1 if the cosine isn't modelled.
    cosine: f64,
}

/// Depth of the indenter below the true surface, as a quadratic function of the time from now: mm, mm/s, mm/s^2.
#[derive(Clone, Copy)]
pub(super) struct Depth {
    pub mm: f64,
    pub speed_mm_s: f64,
    pub acceleration_mm_s2: f64,
}

impl Surface {
    /// Creates a plane with a height error of at most `tilt_mm` within `half_extent_mm` of the origin. It depends on the seed
    /// alone, because it belongs to the specimen.
    pub(super) fn tilted(frame: &Frame, tilt_mm: f64, half_extent_mm: f64, seed: u64) -> Self {
        let mut rng = stream(seed, 0, "surface");
        let mut third = || rng.random_range(-1.0..=1.0) * tilt_mm / 3.0;
        let plane = [third(), third() / half_extent_mm, third() / half_extent_mm];
        Surface { frame: *frame, plane, cosine: 1.0 }
    }

    /// Returns the plane with a further tilt. The cosine of the whole tilt is then modelled.
    pub(super) fn further(self, tilt: Tilt) -> Self {
        if tilt == Tilt::LEVEL {
            return self;
        }
        let [height, per_x, per_y] = self.plane;
        let whole = Tilt { per_x: per_x + tilt.per_x, per_y: per_y + tilt.per_y };
        Surface { plane: [height, whole.per_x, whole.per_y], cosine: whole.cosine(), ..self }
    }

    /// Depth along the surface's normal per depth along z, and force along z per force along the normal.
    pub(super) fn cosine(&self) -> f64 {
        self.cosine
    }

    /// Forces along x and y per force along z, without friction: the tip presses along the normal.
    pub(super) fn side_per_force(&self) -> [f64; 2] {
        let [_, per_x, per_y] = self.plane;
        [-per_x, -per_y]
    }

    /// Returns the depth below the surface, along z, from the axes' (position, speed, acceleration) in the stage frame.
    pub(super) fn depth(&self, x: (f64, f64, f64), y: (f64, f64, f64), z: (f64, f64, f64)) -> Depth {
        let [height, per_x, per_y] = self.plane;
        let place = self.frame.place_from_stage(x.0, y.0);
        let down = self.frame.down.sign();
        Depth {
            mm: self.frame.z_from_stage(z.0) - height - per_x * place.x_mm - per_y * place.y_mm,
            speed_mm_s: down * z.1 - per_x * x.1 - per_y * y.1,
            acceleration_mm_s2: down * z.2 - per_x * x.2 - per_y * y.2,
        }
    }
}

impl Depth {
    /// Returns the depth, its speed and its acceleration multiplied by a factor.
    pub(super) fn times(self, factor: f64) -> Depth {
        Depth {
            mm: factor * self.mm,
            speed_mm_s: factor * self.speed_mm_s,
            acceleration_mm_s2: factor * self.acceleration_mm_s2,
        }
    }

    /// Returns the same motion, with its time counted from `dt_s` later.
    pub(super) fn later(self, dt_s: f64) -> Depth {
        Depth { mm: self.after(dt_s), speed_mm_s: self.speed_after(dt_s), ..self }
    }

    pub(super) fn after(&self, dt_s: f64) -> f64 {
        self.mm + dt_s * (self.speed_mm_s + dt_s * self.acceleration_mm_s2 / 2.0)
    }

    pub(super) fn speed_after(&self, dt_s: f64) -> f64 {
        self.speed_mm_s + dt_s * self.acceleration_mm_s2
    }

    pub(super) fn at_rest(&self) -> bool {
        self.speed_mm_s == 0.0 && self.acceleration_mm_s2 == 0.0
    }

    /// Returns the times in (0, `within_s`) at which the depth is `level_mm`, earliest first.
    pub(super) fn crossings(&self, level_mm: f64, within_s: f64) -> impl Iterator<Item = f64> {
        let (c, b, half_a) = (self.mm - level_mm, self.speed_mm_s, self.acceleration_mm_s2 / 2.0);
        let mut roots = [f64::NAN; 2];
        if half_a == 0.0 {
            roots[0] = -c / b;
        } else {
            let root = (b * b - 4.0 * half_a * c).sqrt();
            // the stable pair of a quadratic's roots: no difference of like numbers
            let q = -(b + root.copysign(b)) / 2.0;
            roots = [q / half_a, c / q];
            roots.sort_by(f64::total_cmp);
        }
        roots.into_iter().filter(move |&t| t > 0.0 && t < within_s)
    }
}
