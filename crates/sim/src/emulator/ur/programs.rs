//! The controller's programs: they begin, wait, pause and end.

use super::motion::Path;
use super::robot::{EARLY_S, Robot, Runtime, Safety};
use super::script::{Condition, Pose, Step};
use super::turn::{Turn, norm};
use crate::scene::Scene;
use palpate_core::quantity::Axis;

/// Time from when a program is compiled to its first statement, s.
const START_S: f64 = 0.04;
/// Time for which a program is still stopping or pausing when the arm rests, s.
const STOPPING_S: f64 = 0.01;
/// Deceleration when a program is ended, mm/s^2.
const PROGRAM_STOP_MM_S2: f64 = 4000.0;

impl Robot {
    /// Ends the program. Returns whether there was one.
    pub(super) fn stop(&mut self, scene: &mut Scene, now_s: f64) -> bool {
        let runs = !matches!(self.runtime, Runtime::Stopped | Runtime::Stopping);
        if runs {
            self.end_program(PROGRAM_STOP_MM_S2, scene, now_s);
        }
        runs
    }

    /// Stops the arm and ends the program.
    pub(super) fn end_program(&mut self, deceleration_mm_s2: f64, scene: &mut Scene, now_s: f64) {
        self.steps.clear();
        if self.runtime != Runtime::Stopped {
            self.halt(Runtime::Stopping, deceleration_mm_s2, scene, now_s);
        }
    }

    /// Brakes the arm. Until it rests and a little longer the program is in a state.
    pub(super) fn halt(&mut self, state: Runtime, deceleration_mm_s2: f64, scene: &mut Scene, now_s: f64) {
        self.path.brake(deceleration_mm_s2, scene, now_s);
        (self.runtime, self.wake_s) = (state, self.path.end_s(scene).max(now_s) + STOPPING_S);
    }

    /// Begins the next program, or ends the one before it first. A robot that can't move drops it.
    pub(super) fn begin_next(&mut self, scene: &mut Scene, now_s: f64) {
        if self.runtime == Runtime::Stopped {
            self.begin_s = f64::INFINITY;
            if self.is_on && self.safety == Safety::Normal {
                (self.runtime, self.wake_s) = (Runtime::Playing, now_s + START_S);
                self.steps = self.next.drain(..).rev().collect();
            }
        } else {
            self.stop(scene, now_s);
            self.begin_s = self.wake_s + EARLY_S;
        }
    }

    /// Does what the program does next.
    pub(super) fn wake(&mut self, scene: &mut Scene, now_s: f64) {
        self.wake_s = f64::INFINITY;
        match self.runtime {
            Runtime::Playing => self.step(scene, now_s),
            Runtime::Stopping => self.runtime = Runtime::Stopped,
            Runtime::Pausing => self.runtime = Runtime::Paused,
            Runtime::Stopped | Runtime::Paused => {}
        }
    }

    /// Carries out steps until one takes time. A pose out of reach ends the program.
    fn step(&mut self, scene: &mut Scene, now_s: f64) {
        while let Some(step) = self.steps.pop() {
            match step {
                Step::If { wanted, condition, yes, no } => {
                    let is_so = match condition {
                        Condition::Within(pose) => self.reaches(pose),
                        Condition::Below(register, limit) => self.registers[register] < limit,
                    };
                    let chosen = if is_so == wanted { yes } else { no };
                    self.steps.extend(chosen.into_iter().rev());
                }
                Step::Write(register, value) => self.registers[register] = value,
                Step::Sleep(for_s) => self.wake_s = now_s + for_s,
                Step::MoveLinear(pose, _) if !self.reaches(pose) => self.steps.clear(),
                Step::MoveLinear(pose, limits) => self.move_linear(pose, limits, scene, now_s),
            }
            if self.wake_s.is_finite() {
                return;
            }
        }
        (self.runtime, self.wake_s) = (Runtime::Stopping, now_s + STOPPING_S);
    }

    /// Begins a motion with a speed, m/s, and an acceleration, m/s^2.
    fn move_linear(&mut self, pose: Pose, limits: [f64; 2], scene: &mut Scene, now_s: f64) {
        let [x, y, z, rx, ry, rz] = pose;
        let step_mm = self.arm.step_mm;
        let rounded = |mm: f64| if step_mm > 0.0 { (mm / step_mm).round() * step_mm } else { mm };
        let from_mm = Axis::ALL.map(|axis| scene.motion(axis).position_mm(now_s));
        let to_mm = self.arm.stage_mm([x, y, z].map(|m| 1000.0 * m)).map(|mm| scene.target_mm(rounded(mm)));
        let (from, to) = ((from_mm, self.path.planned(now_s).1), (to_mm, Turn::of([rx, ry, rz])));
        self.path = Path::between(from, to, limits.map(|m| 1000.0 * m), self.deviation.1);
        self.path.drive(self.slider, scene, now_s);
        self.path.deviate(self.deviation.0, scene, now_s);
        self.wake_s = self.path.end_s(scene);
    }

    fn reaches(&self, [x, y, z, ..]: Pose) -> bool {
        norm([x, y, z]) <= self.arm.reach_m
    }
}
