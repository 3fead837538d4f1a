//! The rig's coordinates in the robot's: a frame of three taught points, and the tool's orientation.

/// Shortest distance between two taught points, mm. A shorter one doesn't define a direction.
const APART_LEAST_MM: f64 = 10.0;

/// Least sine of the angle between the directions to the second and the third point.
const SINE_LEAST: f64 = 0.5;

/// Frame of the stage in the robot's base, and the tool's orientation in it.
#[derive(Clone, Debug, PartialEq)]
pub struct TaughtFrame {
    /// Zero of the stage's axes in the base, mm.
    origin_mm: [f64; 3],
    /// Unit vectors of the stage's x, y and z in the base.
    axes: [[f64; 3]; 3],
    /// Orientation of the tool in the base, as a rotation vector, rad.
    pub(super) tool_rad: [f64; 3],
}

impl TaughtFrame {
    /// Creates a frame from three points in the base, mm: the zero of the axes, a point in the direction of x, and a point of the plane of
    /// x and y on the side of y. z completes a right-handed frame. `tool_rad` is the tool's orientation as a rotation vector, rad.
    ///
    /// # Errors
    /// The points are too close together, or nearly on one line.
    pub fn new(points_mm: [[f64; 3]; 3], tool_rad: [f64; 3]) -> Result<TaughtFrame, String> {
        let [origin_mm, x_mm, y_mm] = points_mm;
        let (along_x, along_y) = (minus(x_mm, origin_mm), minus(y_mm, origin_mm));
        if length(along_x) < APART_LEAST_MM || length(along_y) < APART_LEAST_MM {
            return Err(format!("the taught points are less than {APART_LEAST_MM} mm apart"));
        }
        let x = scaled(along_x, 1.0 / length(along_x));
        let normal = cross(x, along_y);
        if length(normal) < SINE_LEAST * length(along_y) {
            return Err(
                "the taught points are nearly on one line; the directions to x and y must be at least 30 degrees apart"
                    .to_owned(),
            );
        }
        let z = scaled(normal, 1.0 / length(normal));
        Ok(TaughtFrame { origin_mm, axes: [x, cross(z, x), z], tool_rad })
    }

    /// Returns the zero of the stage's axes in the base, mm.
    pub fn origin_mm(&self) -> [f64; 3] {
        self.origin_mm
    }

    /// Returns the unit vectors of the stage's x, y and z in the base.
    pub fn axes(&self) -> [[f64; 3]; 3] {
        self.axes
    }

    /// Returns the tool's orientation in the base as a rotation vector, rad.
    pub fn tool_rad(&self) -> [f64; 3] {
        self.tool_rad
    }

    /// Returns the angle between the tool's own z and a direction along the stage's z (+1 or -1), degrees.
    pub fn lean_deg(&self, along_z: f64) -> f64 {
        let tool = column_of(rotation(self.tool_rad), 2);
        dot(tool, scaled(self.axes[2], along_z)).clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Returns a checksum of the points and the orientation.
    pub(super) fn checksum(&self) -> u32 {
        let numbers = self.axes.iter().chain([&self.origin_mm, &self.tool_rad]).flatten();
        crc32fast::hash(&numbers.flat_map(|number| number.to_be_bytes()).collect::<Vec<u8>>())
    }

    /// Returns a position of the stage in the base, mm.
    pub fn to_base(&self, at_mm: [f64; 3]) -> [f64; 3] {
        (0..3).fold(self.origin_mm, |sum, axis| plus(sum, scaled(self.axes[axis], at_mm[axis])))
    }

    /// Returns a position of the base in the stage, mm.
    pub(super) fn to_stage(&self, base_mm: [f64; 3]) -> [f64; 3] {
        self.along(minus(base_mm, self.origin_mm))
    }

    /// Returns a vector of the base along the stage's axes.
    pub(super) fn along(&self, vector: [f64; 3]) -> [f64; 3] {
        self.axes.map(|axis| dot(axis, vector))
    }

    /// Returns the angle by which an orientation differs from the tool's, rad.
    pub(super) fn tilt_rad(&self, rotation_rad: [f64; 3]) -> f64 {
        let (taught, now) = (rotation(self.tool_rad), rotation(rotation_rad));
        let trace: f64 = (0..3).map(|row| dot(taught[row], now[row])).sum();
        // near zero the sine is exact, the cosine isn't
        let sine = (0..3).map(|column| cross(column_of(taught, column), column_of(now, column))).fold([0.0; 3], plus);
        (length(sine) / 2.0).atan2((trace - 1.0) / 2.0)
    }
}

/// Returns the distance of a point from the way from one point to another, mm.
pub(super) fn sideways_mm(from_mm: [f64; 3], to_mm: [f64; 3], at_mm: [f64; 3]) -> f64 {
    let (way, off) = (minus(to_mm, from_mm), minus(at_mm, from_mm));
    let along = if length(way) > 0.0 { (dot(off, way) / dot(way, way)).clamp(0.0, 1.0) } else { 0.0 };
    length(minus(off, scaled(way, along)))
}

/// Returns the rows of the rotation of a rotation vector (Rodrigues' formula).
fn rotation(vector_rad: [f64; 3]) -> [[f64; 3]; 3] {
    let angle_rad = length(vector_rad);
    if angle_rad == 0.0 {
        return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    }
    let [x, y, z] = scaled(vector_rad, 1.0 / angle_rad);
    let (sine, cosine) = angle_rad.sin_cos();
    let rest = 1.0 - cosine;
    [
        [cosine + x * x * rest, x * y * rest - z * sine, x * z * rest + y * sine],
        [y * x * rest + z * sine, cosine + y * y * rest, y * z * rest - x * sine],
        [z * x * rest - y * sine, z * y * rest + x * sine, cosine + z * z * rest],
    ]
}

fn column_of(rows: [[f64; 3]; 3], column: usize) -> [f64; 3] {
    rows.map(|row| row[column])
}

pub(super) fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] + b[axis])
}

pub(super) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

pub(super) fn scaled(a: [f64; 3], by: f64) -> [f64; 3] {
    a.map(|a| a * by)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the largest component without its sign.
pub(super) fn longest(a: [f64; 3]) -> f64 {
    a.iter().fold(0.0, |most: f64, each| most.max(each.abs()))
}

pub(super) fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn close(a: [f64; 3], b: [f64; 3]) -> bool {
        length(minus(a, b)) < 1e-9
    }

    #[test]
    fn three_points_make_a_right_handed_frame() {
        // x along the base's y, the plane's third point along -x and up: z is up and a little forward
        let points_mm = [[400.0, -100.0, 50.0], [400.0, 100.0, 50.0], [300.0, 0.0, 60.0]];
        let frame = TaughtFrame::new(points_mm, [0.0, PI, 0.0]).unwrap();
        assert!(close(frame.to_base([0.0; 3]), points_mm[0]));
        assert!(close(frame.to_base([200.0, 0.0, 0.0]), points_mm[1]));
        assert!(frame.to_stage(points_mm[2])[2].abs() < 1e-9 && frame.to_stage(points_mm[2])[1] > 0.0);
        let [x, y, z] = frame.axes;
        assert!(close(cross(x, y), z) && z[2] > 0.9, "{z:?}");
        let at_mm = [1.5, -2.0, 3.0];
        assert!(close(frame.to_stage(frame.to_base(at_mm)), at_mm));
    }

    #[test]
    fn points_without_directions_are_refused() {
        let [a, b] = [[400.0, 0.0, 0.0], [500.0, 0.0, 0.0]];
        assert!(TaughtFrame::new([a, b, [600.0, 10.0, 0.0]], [0.0; 3]).unwrap_err().contains("one line"));
        assert!(TaughtFrame::new([a, [405.0, 0.0, 0.0], b], [0.0; 3]).unwrap_err().contains("apart"));
    }

    #[test]
    fn orientations_differ_by_the_angle_between_them() {
        let points_mm = [[0.0; 3], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0]];
        let down = TaughtFrame::new(points_mm, [0.0, PI, 0.0]).unwrap();
        assert!(down.tilt_rad([0.0, -PI, 0.0]) < 1e-9, "the same orientation as another vector");
        assert!((down.tilt_rad([0.0, PI - 1e-6, 0.0]) - 1e-6).abs() < 1e-9);
        assert!((down.tilt_rad([0.0, FRAC_PI_2, 0.0]) - FRAC_PI_2).abs() < 1e-9);
        assert!((down.tilt_rad([0.0; 3]) - PI).abs() < 1e-9);
    }

    #[test]
    fn a_point_beside_or_beyond_a_way_is_off_it() {
        let (from, to) = ([0.0; 3], [0.0, 0.0, -10.0]);
        assert_eq!(sideways_mm(from, to, [3.0, 4.0, -5.0]), 5.0);
        assert_eq!(sideways_mm(from, to, [0.0, 0.0, -12.0]), 2.0);
        assert_eq!(sideways_mm(from, from, [0.0, 0.5, 0.0]), 0.5);
    }
}
