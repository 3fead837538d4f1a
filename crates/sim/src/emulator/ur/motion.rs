//! A straight motion of the tip, as planned and as the scene's axes make it.

use super::arm::UrArm;
use super::pose::{Pose, Turn, norm};
use crate::scene::{Scene, Trajectory};
use palpate_core::quantity::Axis;
use std::f64::consts::PI;

/// Distance that counts as rounding, mm, or mrad of a turn in place.
const ROUNDING: f64 = 1e-9;

/// Motion that a program asks for: a pose of the tip, the speed, mm/s, and the acceleration, mm/s^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    pub to: Pose,
    pub speed: f64,
    pub acceleration: f64,
}

/// Deviations of a motion from its line: largest distance, mm, and largest angle, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Deviation {
    pub sideways_mm: f64,
    pub tilt_rad: f64,
}

/// A motion along a line, from its begin on. After its end it says where the tip was left.
pub(super) struct Path {
    from: Pose,
    to: Pose,
    /// Rotation on the way, in the frame at the begin.
    turns_rad: [f64; 3],
    /// Target and distance of each stage axis, mm.
    targets_mm: [f64; 3],
    ways_mm: [f64; 3],
    /// Length of the way, mm; of a turn in place its angle, mrad.
    length: f64,
    along: Trajectory,
    line: Line,
    tilt_rad: f64,
}

impl Path {
    /// Begins a motion. The arm is at rest with the orientation `turn`. `slider` scales the time, so that the motion
    /// takes its inverse longer.
    pub(super) fn begin(
        arm: &UrArm,
        line: Line,
        turn: Turn,
        (slider, deviation): (f64, Deviation),
        scene: &mut Scene,
        now_s: f64,
    ) -> Path {
        let stands_mm = Axis::ALL.map(|axis| scene.motion(axis).position_mm(now_s));
        let targets_mm = arm.stage_mm(line.to.at_mm).map(|mm| scene.target_mm(rounded(mm, arm.step_mm)));
        let ways_mm: [f64; 3] = std::array::from_fn(|n| targets_mm[n] - stands_mm[n]);
        let turns_rad = turn.inverse().then(line.to.turn).rotvec_rad();
        let is_shift = norm(ways_mm) > ROUNDING;
        let length = if is_shift { norm(ways_mm) } else { 1000.0 * norm(turns_rad) };
        let (speed, acceleration) = (line.speed * slider, line.acceleration * slider * slider);
        let path = Path {
            from: Pose { at_mm: arm.tip_mm(stands_mm), turn },
            to: Pose { at_mm: arm.tip_mm(targets_mm), turn: line.to.turn },
            turns_rad,
            targets_mm,
            ways_mm,
            length,
            along: if length > ROUNDING {
                Trajectory::to(now_s, (0.0, 0.0), length, speed, acceleration)
            } else {
                Trajectory::at_rest(length)
            },
            line,
            tilt_rad: deviation.tilt_rad,
        };
        path.drive(speed, acceleration, scene, now_s);
        if is_shift && deviation.sideways_mm != 0.0 {
            path.deviate(deviation.sideways_mm, scene, now_s);
        }
        path
    }

    /// Continues at another position of the slider.
    pub(super) fn rescale(&mut self, slider: f64, scene: &mut Scene, now_s: f64) {
        if self.along.moving(now_s) {
            let state = (self.along.position_mm(now_s), self.along.speed_mm_s(now_s));
            let (speed, acceleration) = (self.line.speed * slider, self.line.acceleration);
            self.along = Trajectory::to(now_s, state, self.length, speed, acceleration);
            self.drive(speed, acceleration, scene, now_s);
        }
    }

    /// Brakes along the line, with mm/s^2.
    pub(super) fn brake(&mut self, deceleration: f64, scene: &mut Scene, now_s: f64) {
        if self.end_s(scene) <= now_s {
            return;
        }
        let state = (self.along.position_mm(now_s), self.along.speed_mm_s(now_s));
        self.along = Trajectory::stop(now_s, state, deceleration);
        for (n, axis) in Axis::ALL.into_iter().enumerate() {
            let state = (scene.motion(axis).position_mm(now_s), scene.motion(axis).speed_mm_s(now_s));
            if state.1 != 0.0 {
                let share = Some(self.share(n)).filter(|&share| share > ROUNDING).unwrap_or(1.0);
                scene.set_motion(axis, Trajectory::stop(now_s, state, deceleration * share), now_s);
            } else if scene.motion(axis).moving(now_s) {
                scene.set_motion(axis, Trajectory::at_rest(state.0), now_s);
            }
        }
    }

    /// Time at which the tip rests, s.
    pub(super) fn end_s(&self, scene: &Scene) -> f64 {
        Axis::ALL.iter().map(|&axis| scene.motion(axis).end_s()).fold(self.along.end_s(), f64::max)
    }

    /// Pose of the tip on the line.
    pub(super) fn planned(&self, now_s: f64) -> Pose {
        let done = self.done(now_s);
        let at_mm = std::array::from_fn(|n| self.from.at_mm[n] + done * (self.to.at_mm[n] - self.from.at_mm[n]));
        Pose { at_mm, turn: self.from.turn.then(Turn::of(self.turns_rad.map(|part| done * part))) }
    }

    /// Orientation of the tip with its deviation.
    pub(super) fn turn(&self, now_s: f64) -> Turn {
        let turn = self.planned(now_s).turn;
        if self.tilt_rad == 0.0 || !self.along.moving(now_s) {
            return turn;
        }
        turn.then(Turn::of([self.tilt_rad * (PI * self.done(now_s)).sin(), 0.0, 0.0]))
    }

    /// Planned speed in the base frame: mm/s and rad/s.
    pub(super) fn speeds(&self, now_s: f64) -> [[f64; 3]; 2] {
        if !self.along.moving(now_s) {
            return [[0.0; 3]; 2];
        }
        let rate = self.along.speed_mm_s(now_s) / self.length;
        let speed_mm_s = std::array::from_fn(|n| rate * (self.to.at_mm[n] - self.from.at_mm[n]));
        [speed_mm_s, self.from.turn.apply(self.turns_rad.map(|part| rate * part))]
    }

    /// Fraction of the way.
    fn done(&self, now_s: f64) -> f64 {
        if self.length > ROUNDING { self.along.position_mm(now_s) / self.length } else { 1.0 }
    }

    /// Share of the way along a stage axis.
    fn share(&self, axis: usize) -> f64 {
        self.ways_mm[axis].abs() / norm(self.ways_mm).max(ROUNDING)
    }

    /// Sets the axes in motion, all with the same course in time.
    fn drive(&self, speed: f64, acceleration: f64, scene: &mut Scene, now_s: f64) {
        for (n, axis) in Axis::ALL.into_iter().enumerate() {
            let state = (scene.motion(axis).position_mm(now_s), scene.motion(axis).speed_mm_s(now_s));
            if (state.0 - self.targets_mm[n]).abs() > ROUNDING || state.1 != 0.0 {
                // an axis beside the line has no share of the way, and returns slowly
                let share = Some(self.share(n)).filter(|&share| share > ROUNDING).unwrap_or(0.1);
                let leg = Trajectory::to(now_s, state, self.targets_mm[n], speed * share, acceleration * share);
                scene.set_motion(axis, leg, now_s);
            }
        }
    }

    /// Lets the axis with the least share of the way go aside and return, within the time of the motion.
    fn deviate(&self, sideways_mm: f64, scene: &mut Scene, now_s: f64) {
        let least = (0..3).min_by(|&a, &b| self.share(a).total_cmp(&self.share(b))).unwrap_or(0);
        let half_s = (self.along.end_s() - now_s) / 2.0;
        let from_mm = self.targets_mm[least] - self.ways_mm[least];
        let middle_mm = from_mm + self.ways_mm[least] / 2.0 + sideways_mm;
        let leg = |at_s: f64, from_mm: f64, to_mm: f64| {
            let way_mm = (to_mm - from_mm).abs().max(ROUNDING);
            Trajectory::to(at_s, (from_mm, 0.0), to_mm, 2.0 * way_mm / half_s, 4.0 * way_mm / (half_s * half_s))
        };
        let out = leg(now_s, from_mm, middle_mm);
        let back = leg(out.end_s(), middle_mm, self.targets_mm[least]);
        scene.set_motion(Axis::ALL[least], out.then(&back), now_s);
    }
}

fn rounded(mm: f64, step_mm: f64) -> f64 {
    if step_mm > 0.0 { (mm / step_mm).round() * step_mm } else { mm }
}
