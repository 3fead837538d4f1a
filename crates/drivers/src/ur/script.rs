//! Programs that the robot runs, in URScript.

use super::rtde::{BEGUN_REGISTER, ENDED_REGISTER, OUTSIDE_REGISTER};

/// Returns a pose as URScript: metres and radians.
fn pose(at_mm: [f64; 3], rotation_rad: [f64; 3]) -> String {
    let [x, y, z] = at_mm.map(|mm| mm / 1000.0);
    let [rx, ry, rz] = rotation_rad;
    format!("p[{x:.7},{y:.7},{z:.7},{rx:.6},{ry:.6},{rz:.6}]")
}

/// Returns a program that reports its number when it begins and when it ends. One that comes late, after another one, does nothing.
fn program(number: i32, lines: &str) -> String {
    format!(
        "def palpate():\n  if (read_output_integer_register({BEGUN_REGISTER}) < {number}):\n  \
         write_output_integer_register({BEGUN_REGISTER}, {number})\n{lines}  \
         write_output_integer_register({ENDED_REGISTER}, {number})\n  end\nend\n"
    )
}

/// A straight motion, mm in the base.
pub(super) struct StraightMotion {
    /// Where the tool came to rest, and how far it may be from there.
    pub from_mm: ([f64; 3], f64),
    pub to_mm: [f64; 3],
    pub rotation_rad: [f64; 3],
    /// Displacement that is made from anywhere else, because it only leads away from the specimen.
    pub otherwise_mm: Option<[f64; 3]>,
}

/// Returns a program with one straight motion, mm/s and mm/s^2. The robot itself compares where the tool is: another client may set
/// another TCP at any moment before the motion, and the target would be another place. From elsewhere only the way out is made, as a
/// displacement (script manual, `pose_add`). The target pose has no noise, which would turn the tool a little in each motion.
pub(super) fn motion(number: i32, way: &StraightMotion, speed_mm_s: f64, acceleration_mm_s2: f64) -> String {
    let StraightMotion { from_mm: (from_mm, most_mm), to_mm, rotation_rad, otherwise_mm } = *way;
    let (from, to) = (pose(from_mm, rotation_rad), pose(to_mm, rotation_rad));
    let profile = format!("a={:.6}, v={:.6}", acceleration_mm_s2 / 1000.0, speed_mm_s / 1000.0);
    let otherwise = otherwise_mm.map(|by_mm| {
        format!("  else:\n  movel(pose_add(get_target_tcp_pose(), {}), {profile})\n", pose(by_mm, [0.0; 3]))
    });
    let lines = format!(
        "  if (point_dist(get_target_tcp_pose(), {from}) < {:.6}):\n  movel({to}, {profile})\n{}  end\n",
        most_mm / 1000.0,
        otherwise.unwrap_or_default()
    );
    program(number, &lines)
}

/// Returns a program that replaces the one under way and brings the arm to rest.
pub(super) fn stop(number: i32, deceleration_mm_s2: f64) -> String {
    program(number, &format!("  stopl({:.6})\n", deceleration_mm_s2 / 1000.0))
}

/// Returns a program without a motion that reports the number of the last point, from 1 on, that the arm can't reach within its safety
/// limits; 0 if it reaches all.
pub(super) fn reach(number: i32, points_mm: &[[f64; 3]], rotation_rad: [f64; 3]) -> String {
    let mut lines = format!("  write_output_integer_register({OUTSIDE_REGISTER}, 0)\n");
    for (nth, point_mm) in (1..).zip(points_mm) {
        let point = pose(*point_mm, rotation_rad);
        lines += &format!(
            "  if (not is_within_safety_limits({point})):\n    write_output_integer_register({OUTSIDE_REGISTER}, {nth})\n  end\n"
        );
    }
    program(number, &lines)
}
