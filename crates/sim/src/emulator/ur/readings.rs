//! What the controller reports of the arm.

use super::pose::{Pose, Turn, cross, sum};
use super::robot::{Robot, Runtime, Safety};
use crate::scene::Scene;
use palpate_core::quantity::Axis;

/// What a stream reports of the arm: m, rad, m/s, rad/s, N and N m, in the base frame.
pub(super) struct Readings {
    pub pose: [f64; 6],
    pub planned_pose: [f64; 6],
    pub speed: [f64; 6],
    pub planned_speed: [f64; 6],
    pub force: [f64; 6],
}

impl Robot {
    /// Present values of what the arm does.
    pub(super) fn readings(&self, scene: &mut Scene, now_s: f64) -> Readings {
        let [axes_mm, speeds_mm_s] = stage(scene, now_s);
        let tip = Pose { at_mm: self.arm.tip_mm(axes_mm), turn: self.turn(now_s) };
        let [planned_mm_s, turning] = self.path.as_ref().map_or([[0.0; 3]; 2], |path| path.speeds(now_s));
        let (pose, speed_mm_s) = (tip.then(self.tool), self.arm.along(speeds_mm_s));
        let force_n = self.arm.reaction_n(scene.true_force_n(now_s));
        let lever_mm: [f64; 3] = std::array::from_fn(|n| tip.at_mm[n] - pose.at_mm[n]);
        let error_n = std::array::from_fn(|n| self.arm.force_error(n, now_s));
        let [torque, force] = [cross(lever_mm, force_n).map(|n_mm| n_mm / 1000.0), sum(force_n, error_n)];
        Readings {
            pose: pose.to_wire(),
            planned_pose: self.planned(scene, now_s).then(self.tool).to_wire(),
            speed: six(speed_mm_s.map(|mm| mm / 1000.0), turning),
            planned_speed: six(planned_mm_s.map(|mm| mm / 1000.0), turning),
            force: six(force, torque),
        }
    }

    /// Safety mode and status of the guides, which are equal here, and their name.
    pub(super) fn safety_status(&self) -> (i32, &'static str) {
        match self.safety {
            Safety::Normal => (1, "NORMAL"),
            Safety::ProtectiveStop(_) => (3, "PROTECTIVE_STOP"),
            Safety::EmergencyStop => (7, "ROBOT_EMERGENCY_STOP"),
        }
    }

    /// Whether a program runs. One that is paused doesn't.
    pub(super) fn is_running(&self) -> bool {
        !matches!(self.runtime, Runtime::Stopped | Runtime::Paused)
    }

    pub(super) fn pose(&self, scene: &mut Scene, now_s: f64) -> Pose {
        let at_mm = self.arm.tip_mm(stage(scene, now_s)[0]);
        Pose { at_mm, turn: self.turn(now_s) }.then(self.tool)
    }

    /// Planned pose of the tip.
    pub(super) fn planned(&self, scene: &Scene, now_s: f64) -> Pose {
        match &self.path {
            Some(path) => path.planned(now_s),
            None => Pose {
                at_mm: self.arm.tip_mm(Axis::ALL.map(|axis| scene.motion(axis).position_mm(now_s))),
                turn: Turn::of(self.arm.rotvec_rad),
            },
        }
    }

    pub(super) fn turn(&self, now_s: f64) -> Turn {
        self.path.as_ref().map_or_else(|| Turn::of(self.arm.rotvec_rad), |path| path.turn(now_s))
    }
}

/// Places, mm, and speeds, mm/s, of the stage axes.
fn stage(scene: &mut Scene, now_s: f64) -> [[f64; 3]; 2] {
    let axes = Axis::ALL.map(|axis| scene.axis(axis, now_s));
    [axes.map(|(place_mm, _)| place_mm), axes.map(|(_, speed_mm_s)| speed_mm_s)]
}

fn six(first: [f64; 3], second: [f64; 3]) -> [f64; 6] {
    let ([a, b, c], [d, e, f]) = (first, second);
    [a, b, c, d, e, f]
}
