//! Orientations. The wire has rotation vectors, this module quaternions.

/// Angle below which a rotation counts as none, rad.
const NO_TURN_RAD: f64 = 1e-12;

/// Orientation: a unit quaternion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    real: f64,
    vector: [f64; 3],
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
        let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        Turn {
            real: self.real * inner.real - (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]),
            vector: std::array::from_fn(|n| self.real * b[n] + inner.real * a[n] + cross[n]),
        }
    }

    /// Returns the rotation back.
    pub(super) fn inverse(self) -> Turn {
        Turn { real: self.real, vector: self.vector.map(|part| -part) }
    }

    /// Turns a vector.
    pub(super) fn apply(self, vector: [f64; 3]) -> [f64; 3] {
        self.then(Turn { real: 0.0, vector }).then(self.inverse()).vector
    }
}

/// Length of a vector.
pub(super) fn norm(vector: [f64; 3]) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}
