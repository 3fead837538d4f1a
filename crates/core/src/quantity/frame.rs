//! Axes, places, and the position of the specimen in stage coordinates.

use super::Tilt;
use serde::{Deserialize, Serialize};

/// One of the stage's three axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Axis {
    /// Along the specimen's first edge.
    X,
    /// Along the specimen's second edge.
    Y,
    /// The axis that presses.
    Z,
}

impl Axis {
    /// The three axes, in the order x, y, z.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// 0, 1 or 2 for x, y or z.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Letter of the axis in a rig file.
    pub fn name(self) -> &'static str {
        ["x", "y", "z"][self.index()]
    }
}

/// A point of the stage frame, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// Stage x, mm.
    pub x_mm: f64,
    /// Stage y, mm.
    pub y_mm: f64,
    /// Stage z, mm.
    pub z_mm: f64,
}

impl Position {
    /// The coordinate along one axis, mm.
    pub fn along(&self, axis: Axis) -> f64 {
        [self.x_mm, self.y_mm, self.z_mm][axis.index()]
    }
}

/// A point on the specimen's surface, in the specimen frame, mm: the origin is the surface's centre (PAPER S8).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// Specimen x, mm.
    pub x_mm: f64,
    /// Specimen y, mm.
    pub y_mm: f64,
}

impl Place {
    /// Creates a place from its two coordinates, mm.
    pub fn new(x_mm: f64, y_mm: f64) -> Self {
        Place { x_mm, y_mm }
    }

    /// Returns the place rotated about the origin, from x toward y, degrees.
    #[must_use]
    pub fn turned(self, degrees: f64) -> Place {
        if degrees == 0.0 {
            return self;
        }
        let (sin, cos) = degrees.to_radians().sin_cos();
        Place::new(cos * self.x_mm - sin * self.y_mm, sin * self.x_mm + cos * self.y_mm)
    }

    /// Returns the distance to another place, mm.
    pub fn distance_mm(&self, other: Place) -> f64 {
        (self.x_mm - other.x_mm).hypot(self.y_mm - other.y_mm)
    }
}

/// Direction of the specimen along the stage's z axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Down {
    /// The stage coordinate grows as the indenter approaches the specimen (`down = "+z"`).
    Plus,
    /// The stage coordinate falls as the indenter approaches the specimen (`down = "-z"`).
    Minus,
}

impl Down {
    /// Change of the stage coordinate per mm toward the specimen: +1 or -1.
    pub fn sign(self) -> f64 {
        match self {
            Down::Plus => 1.0,
            Down::Minus => -1.0,
        }
    }
}

/// Position of the specimen in stage coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Stage x and y of the specimen's origin, mm.
    pub origin: Place,
    /// Rotation of the specimen's x axis from the stage's x axis toward the stage's y axis, degrees.
    pub rotation_deg: f64,
    /// Stage z of the nominal surface, mm.
    pub surface_z_mm: f64,
    /// Largest distance of the true surface from the nominal surface, anywhere on it, mm.
    pub uncertainty_mm: f64,
    /// Direction of the specimen.
    pub down: Down,
    /// Tilt of the surface. The places and z of this frame don't contain it; the uncertainty of the surface does.
    pub tilt: Tilt,
}

impl Frame {
    /// Returns the frame of a level specimen whose middle is at the origin of the stage's x and y, with its edges along them.
    pub fn level(surface_z_mm: f64, uncertainty_mm: f64, down: Down) -> Self {
        let (origin, tilt) = (Place::default(), Tilt::LEVEL);
        Frame { origin, rotation_deg: 0.0, surface_z_mm, uncertainty_mm, down, tilt }
    }

    /// Stage coordinates of a point of the specimen frame; `z_mm` grows into the specimen.
    pub fn to_stage(&self, place: Place, z_mm: f64) -> Position {
        let turned = place.turned(self.rotation_deg);
        Position {
            x_mm: self.origin.x_mm + turned.x_mm,
            y_mm: self.origin.y_mm + turned.y_mm,
            z_mm: self.surface_z_mm + self.down.sign() * z_mm,
        }
    }

    /// The specimen frame's z (into the specimen) of a stage z, mm.
    pub fn z_from_stage(&self, stage_z_mm: f64) -> f64 {
        (stage_z_mm - self.surface_z_mm) * self.down.sign()
    }

    /// The specimen frame's place under a stage x and y.
    pub fn place_from_stage(&self, x_mm: f64, y_mm: f64) -> Place {
        Place::new(x_mm - self.origin.x_mm, y_mm - self.origin.y_mm).turned(-self.rotation_deg)
    }

    /// Returns the frame of a specimen that is at `origin` in this frame, rotated by `turned_deg` and deeper by `z_mm`.
    #[must_use]
    pub fn moved(&self, origin: Place, turned_deg: f64, z_mm: f64) -> Frame {
        let Position { x_mm, y_mm, z_mm } = self.to_stage(origin, z_mm);
        let rotation_deg = self.rotation_deg + turned_deg;
        let tilt = self.tilt.in_frame_turned(turned_deg);
        Frame { origin: Place::new(x_mm, y_mm), rotation_deg, surface_z_mm: z_mm, tilt, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_conversion_is_inverted_on_either_side() {
        for down in [Down::Plus, Down::Minus] {
            let origin = Place::new(1.0, -2.0);
            let tilt = Tilt { per_x: 0.02, per_y: 0.0 };
            let frame = Frame { origin, rotation_deg: 0.0, surface_z_mm: 3.0, uncertainty_mm: 0.3, down, tilt };
            let stage = frame.to_stage(Place::new(0.5, 0.25), 0.75);
            assert_eq!(stage.z_mm, 3.0 + down.sign() * 0.75);
            assert_eq!(frame.z_from_stage(stage.z_mm), 0.75);
            assert_eq!(frame.place_from_stage(stage.x_mm, stage.y_mm), Place::new(0.5, 0.25));
            let turned = frame.moved(Place::new(0.2, 0.1), 90.0, 0.25);
            let stage = turned.to_stage(Place::new(0.5, 0.25), 0.75);
            assert!((stage.x_mm - 0.95).abs() < 1e-12 && (stage.y_mm + 1.4).abs() < 1e-12, "{stage:?}");
            assert_eq!(turned.z_from_stage(stage.z_mm), 0.75);
            assert!((turned.tilt.per_y + 0.02).abs() < 1e-12, "{:?}", turned.tilt);
            assert!(turned.place_from_stage(stage.x_mm, stage.y_mm).distance_mm(Place::new(0.5, 0.25)) < 1e-12);
        }
    }
}
