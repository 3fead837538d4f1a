//! A straight motion of the tip, as planned and as the scene's axes make it.

use super::turn::{Turn, norm};
use crate::scene::{Scene, Trajectory};
use palpate_core::quantity::Axis;
use std::f64::consts::PI;

/// Distance that counts as rounding, mm, or mrad of a turn in place. Also the share of the way that counts as none.
const ROUNDING: f64 = 1e-9;

/// A place of the stage, mm, and the orientation of the tool.
type Place = ([f64; 3], Turn);

/// A motion along a line, from its begin on. After its end it says where the tip was left.
pub(super) struct Path {
    /// Ends of the line, in the stage frame.
    from_mm: [f64; 3],
    to_mm: [f64; 3],
    /// Orientation at the begin, and the rotation on the way, in the frame at the begin.
    turn: Turn,
    turns_rad: [f64; 3],
    /// Length of the way, mm; of a turn in place its angle, mrad.
    length: f64,
    along: Trajectory,
    /// Speed, mm/s, and acceleration, mm/s^2, with the slider at its end; of a turn in place mrad/s and mrad/s^2.
    limits: [f64; 2],
    /// Largest tilt of the tool on the way, rad.
    tilt_rad: f64,
}

impl Path {
    /// Creates a path whose motion isn't begun. The limits are those of [`Path::limits`].
    pub(super) fn between(from: Place, to: Place, limits: [f64; 2], tilt_rad: f64) -> Path {
        let (from_mm, turn) = from;
        let turns_rad = turn.inverse().then(to.1).rotvec_rad();
        let way_mm = norm(std::array::from_fn(|n| to.0[n] - from_mm[n]));
        let length = if way_mm > ROUNDING { way_mm } else { 1000.0 * norm(turns_rad) };
        Path { from_mm, to_mm: to.0, turn, turns_rad, length, along: Trajectory::at_rest(0.0), limits, tilt_rad }
    }

    /// Whether the motion is under way.
    pub(super) fn is_moving(&self, now_s: f64) -> bool {
        self.along.moving(now_s)
    }

    /// Begins the motion, or continues it at another position of the slider. A slider at the begin scales the time, so
    /// that the motion takes the inverse of `slider` longer. All axes have the same course in time.
    pub(super) fn drive(&mut self, slider: f64, scene: &mut Scene, now_s: f64) {
        let slower = if self.is_moving(now_s) { 1.0 } else { slider * slider };
        let (speed, acceleration) = (slider * self.limits[0], slower * self.limits[1]);
        self.along = Trajectory::to(now_s, state(&self.along, now_s), self.length, speed, acceleration);
        for (n, axis) in Axis::ALL.into_iter().enumerate() {
            let (share, state) = (self.share(n), state(scene.motion(axis), now_s));
            if share > ROUNDING {
                let leg = Trajectory::to(now_s, state, self.to_mm[n], speed * share, acceleration * share);
                scene.set_motion(axis, leg, now_s);
            }
        }
    }

    /// Brakes along the line, with mm/s^2.
    pub(super) fn brake(&mut self, deceleration: f64, scene: &mut Scene, now_s: f64) {
        self.along = Trajectory::stop(now_s, state(&self.along, now_s), deceleration);
        let speed_mm_s = norm(Axis::ALL.map(|axis| scene.motion(axis).speed_mm_s(now_s)));
        for axis in Axis::ALL {
            let state = state(scene.motion(axis), now_s);
            if scene.motion(axis).moving(now_s) {
                let share = state.1.abs() / speed_mm_s;
                scene.set_motion(axis, Trajectory::stop(now_s, state, (deceleration * share).max(ROUNDING)), now_s);
            }
        }
    }

    /// Lets the axis with the least share of the way go aside by at most `sideways_mm` and return, within the time of
    /// the motion.
    pub(super) fn deviate(&self, sideways_mm: f64, scene: &mut Scene, now_s: f64) {
        if sideways_mm == 0.0 || self.from_mm == self.to_mm || !self.is_moving(now_s) {
            return;
        }
        let least = (0..3).min_by(|&a, &b| self.share(a).total_cmp(&self.share(b))).unwrap_or(0);
        let half_s = (self.along.end_s() - now_s) / 2.0;
        let (from_mm, to_mm) = (self.from_mm[least], self.to_mm[least]);
        let leg = |at_s: f64, from_mm: f64, to_mm: f64| {
            let way_mm = (to_mm - from_mm).abs().max(ROUNDING);
            Trajectory::to(at_s, (from_mm, 0.0), to_mm, 2.0 * way_mm / half_s, 4.0 * way_mm / (half_s * half_s))
        };
        let middle_mm = (from_mm + to_mm) / 2.0 + sideways_mm;
        let out = leg(now_s, from_mm, middle_mm);
        let back = leg(out.end_s(), middle_mm, to_mm);
        scene.set_motion(Axis::ALL[least], out.then(&back), now_s);
    }

    /// Time at which the tip rests, s.
    pub(super) fn end_s(&self, scene: &Scene) -> f64 {
        Axis::ALL.iter().map(|&axis| scene.motion(axis).end_s()).fold(self.along.end_s(), f64::max)
    }

    /// Planned place of the stage, mm, and orientation.
    pub(super) fn planned(&self, now_s: f64) -> Place {
        let done = self.done(now_s);
        let at_mm = std::array::from_fn(|n| self.from_mm[n] + done * (self.to_mm[n] - self.from_mm[n]));
        (at_mm, self.turn.then(Turn::of(self.turns_rad.map(|part| done * part))))
    }

    /// Orientation with its deviation.
    pub(super) fn turn(&self, now_s: f64) -> Turn {
        let tilt_rad = if self.is_moving(now_s) { self.tilt_rad * (PI * self.done(now_s)).sin() } else { 0.0 };
        self.planned(now_s).1.then(Turn::of([tilt_rad, 0.0, 0.0]))
    }

    /// Planned speed: that of the stage, mm/s, and that of the turn in the base frame, rad/s.
    pub(super) fn speeds(&self, now_s: f64) -> [[f64; 3]; 2] {
        let rate = self.along.speed_mm_s(now_s) / self.length.max(ROUNDING);
        let speed_mm_s = std::array::from_fn(|n| rate * (self.to_mm[n] - self.from_mm[n]));
        [speed_mm_s, self.turn.apply(self.turns_rad.map(|part| rate * part))]
    }

    /// Fraction of the way.
    fn done(&self, now_s: f64) -> f64 {
        if self.length > ROUNDING { self.along.position_mm(now_s) / self.length } else { 1.0 }
    }

    /// Share of the way along a stage axis.
    fn share(&self, axis: usize) -> f64 {
        (self.to_mm[axis] - self.from_mm[axis]).abs() / self.length
    }
}

/// Position, mm, and speed, mm/s.
fn state(motion: &Trajectory, now_s: f64) -> (f64, f64) {
    (motion.position_mm(now_s), motion.speed_mm_s(now_s))
}
