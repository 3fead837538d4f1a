//! Poses and their algebra, as the functions of URScript have it (document: "URScript manual", module urmath).

use super::turn::{Turn, norm};

/// A pose: m and rad, as a rotation vector.
pub(super) type Pose = [f64; 6];

/// Returns a pose from its position, m, and its orientation.
pub(super) fn pose([x, y, z]: [f64; 3], turn: Turn) -> Pose {
    let [rx, ry, rz] = turn.rotvec_rad();
    [x, y, z, rx, ry, rz]
}

/// Returns the position, m, and the orientation of a pose.
pub(super) fn parts([x, y, z, rx, ry, rz]: Pose) -> ([f64; 3], Turn) {
    ([x, y, z], Turn::of([rx, ry, rz]))
}

/// `pose_add`: adds the positions and multiplies the rotations. So a second pose without a rotation shifts the first one along the axes
/// of the base.
pub(super) fn add(one: Pose, other: Pose) -> Pose {
    let ((a_m, a), (b_m, b)) = (parts(one), parts(other));
    pose(std::array::from_fn(|n| a_m[n] + b_m[n]), a.then(b))
}

/// `pose_sub`: what `pose_add` has to add to `from`. The manual leaves open in which order the rotations of a difference are multiplied.
pub(super) fn difference(to: Pose, from: Pose) -> Pose {
    let ((a_m, a), (b_m, b)) = (parts(to), parts(from));
    pose(std::array::from_fn(|n| a_m[n] - b_m[n]), b.inverse().then(a))
}

/// `pose_trans`: a pose that is given in the frame of another one.
pub(super) fn within(frame: Pose, inner: Pose) -> Pose {
    let ((a_m, a), (b_m, b)) = (parts(frame), parts(inner));
    let turned_m = a.apply(b_m);
    pose(std::array::from_fn(|n| a_m[n] + turned_m[n]), a.then(b))
}

/// `pose_inv`: the frame in which the base has this pose.
pub(super) fn inverse(of: Pose) -> Pose {
    let (at_m, turn) = parts(of);
    let back = turn.inverse();
    pose(back.apply(at_m).map(|part| -part), back)
}

/// `point_dist`: distance of two positions, m.
pub(super) fn distance_m(one: Pose, other: Pose) -> f64 {
    norm(std::array::from_fn(|n| one[n] - other[n]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_near(one: Pose, other: Pose) -> bool {
        one.into_iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn addition_is_that_of_the_manual() {
        // its example, turned a little less
        let sum = add([0.2, 0.5, 0.1, 1.5, 0.0, 0.0], [0.2, 0.5, 0.6, 1.5, 0.0, 0.0]);
        assert!(is_near(sum, [0.4, 1.0, 0.7, 3.0, 0.0, 0.0]), "{sum:?}");
        // a tool that points down moves up in the base all the same
        let down = [0.3, -0.2, 0.1, std::f64::consts::PI, 0.0, 0.0];
        let up = add(down, [0.0, 0.0, 0.001, 0.0, 0.0, 0.0]);
        assert!(is_near(up, [0.3, -0.2, 0.101, std::f64::consts::PI, 0.0, 0.0]), "{up:?}");
        assert!(is_near(difference(up, down), [0.0, 0.0, 0.001, 0.0, 0.0, 0.0]));
    }

    #[test]
    fn a_frame_and_its_inverse_undo_each_other() {
        let (frame, inner) = ([0.3, -0.2, 0.1, 1.0, 2.0, -0.5], [0.01, 0.02, 0.03, 0.3, 0.0, 0.1]);
        let back = within(inverse(frame), within(frame, inner));
        assert!(is_near(back, inner), "{back:?}");
        // along the tool, which points down
        let along = within([0.0, 0.0, 0.1, std::f64::consts::PI, 0.0, 0.0], [0.0, 0.0, 0.01, 0.0, 0.0, 0.0]);
        assert!((along[2] - 0.09).abs() < 1e-12, "{along:?}");
        assert!((distance_m(frame, inner) - norm([0.29, -0.22, 0.07])).abs() < 1e-12);
    }
}
