//! Poses: a position and an orientation. The wire has metres and rotation vectors, this module mm and quaternions.

/// Angle below which a rotation counts as none, rad.
const NO_TURN_RAD: f64 = 1e-12;

/// Position, mm, and orientation, of one frame in another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    pub at_mm: [f64; 3],
    pub turn: Turn,
}

/// Orientation: a unit quaternion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Turn {
    real: f64,
    vector: [f64; 3],
}

impl Pose {
    /// Reads the pose of a script or package: m and rad.
    pub(super) fn from_wire(pose: [f64; 6]) -> Pose {
        let [x, y, z, rx, ry, rz] = pose;
        Pose { at_mm: [x, y, z].map(|m| 1000.0 * m), turn: Turn::of([rx, ry, rz]) }
    }

    /// Returns the pose as scripts and packages have it: m and rad.
    pub(super) fn to_wire(self) -> [f64; 6] {
        let ([x, y, z], [rx, ry, rz]) = (self.at_mm.map(|mm| mm / 1000.0), self.turn.rotvec_rad());
        [x, y, z, rx, ry, rz]
    }

    /// Returns the pose of a frame that has the pose `inner` in this one.
    pub(super) fn then(self, inner: Pose) -> Pose {
        Pose { at_mm: sum(self.at_mm, self.turn.apply(inner.at_mm)), turn: self.turn.then(inner.turn) }
    }

    /// Returns the pose of the outer frame in this one.
    pub(super) fn inverse(self) -> Pose {
        let back = self.turn.inverse();
        Pose { at_mm: back.apply(self.at_mm.map(|mm| -mm)), turn: back }
    }
}

impl Turn {
    /// Creates the rotation by the length of a vector, rad, about its direction.
    pub(super) fn of(rotvec_rad: [f64; 3]) -> Turn {
        let angle_rad = norm(rotvec_rad);
        if angle_rad < NO_TURN_RAD {
            return Turn { real: 1.0, vector: [0.0; 3] };
        }
        let (sine, real) = (angle_rad / 2.0).sin_cos();
        Turn { real, vector: rotvec_rad.map(|part| part * sine / angle_rad) }
    }

    /// Returns the rotation vector of at most half a turn, rad.
    pub(super) fn rotvec_rad(self) -> [f64; 3] {
        let sine = norm(self.vector);
        if sine < NO_TURN_RAD {
            return [0.0; 3];
        }
        // both signs of a quaternion are the same orientation; that with a positive real part turns by less
        let sign = if self.real < 0.0 { -1.0 } else { 1.0 };
        let angle_rad = 2.0 * sine.atan2(self.real.abs());
        self.vector.map(|part| sign * part * angle_rad / sine)
    }

    /// Returns this rotation after `inner`, which is given in the turned frame.
    pub(super) fn then(self, inner: Turn) -> Turn {
        let (a, b) = (self.vector, inner.vector);
        let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        let cross = cross(a, b);
        Turn {
            real: self.real * inner.real - dot,
            vector: std::array::from_fn(|n| self.real * b[n] + inner.real * a[n] + cross[n]),
        }
    }

    pub(super) fn inverse(self) -> Turn {
        Turn { real: self.real, vector: self.vector.map(|part| -part) }
    }

    /// Turns a vector.
    pub(super) fn apply(self, vector: [f64; 3]) -> [f64; 3] {
        let twice = cross(self.vector, vector).map(|part| 2.0 * part);
        let again = cross(self.vector, twice);
        std::array::from_fn(|n| vector[n] + self.real * twice[n] + again[n])
    }
}

pub(super) fn norm(vector: [f64; 3]) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}

pub(super) fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|n| a[n] + b[n])
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
