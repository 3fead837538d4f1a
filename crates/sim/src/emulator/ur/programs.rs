//! The controller's programs: they start, wait, pause and end.

use super::motion::{Line, Path};
use super::pose::{Pose, norm};
use super::robot::{EARLY_S, Robot, RobotMode, Runtime, Safety};
use super::script::{Command, Condition, Program, Step};
use crate::scene::Scene;
use std::collections::VecDeque;

/// Time from the last byte of a program until it is compiled, and from then to its first statement, s.
const COMPILE_S: f64 = 0.06;
const START_S: f64 = 0.04;
/// Time for which a program that has ended is still stopping, and a continued one is still resuming, s.
const STOPPING_S: f64 = 0.01;
const RESUMING_S: f64 = 0.1;
/// Deceleration when a program is ended or paused, mm/s^2.
const PROGRAM_STOP_MM_S2: f64 = 4000.0;

impl Robot {
    /// Takes the text of a program. A robot in local control ignores it.
    pub(super) fn receive(&mut self, text: &[u8], now_s: f64) {
        if !self.is_remote {
            return;
        }
        match Program::read(text) {
            Some(Program { steps, is_secondary: true }) => self.secondary.push_back((now_s + COMPILE_S, steps)),
            Some(Program { steps, .. }) => self.next = Some((now_s + COMPILE_S, steps)),
            None => self.syntax_errors += 1,
        }
    }

    /// Ends the program. Returns whether there was one.
    pub(super) fn stop(&mut self, scene: &mut Scene, now_s: f64) -> bool {
        let runs = !matches!(self.runtime, Runtime::Stopped | Runtime::Stopping);
        if runs {
            self.end_program(PROGRAM_STOP_MM_S2, scene, now_s);
        }
        runs
    }

    /// Pauses the program. Returns whether one ran.
    pub(super) fn pause(&mut self, scene: &mut Scene, now_s: f64) -> bool {
        let runs = self.runtime == Runtime::Playing;
        self.pause_with(PROGRAM_STOP_MM_S2, scene, now_s);
        runs
    }

    /// Continues a paused program. Returns whether there was one that can be continued.
    pub(super) fn resume(&mut self, now_s: f64) -> bool {
        let can = self.runtime == Runtime::Paused && self.can_run();
        if can {
            (self.runtime, self.wake_s) = (Runtime::Resuming, now_s + RESUMING_S);
        }
        can
    }

    fn can_run(&self) -> bool {
        self.mode == RobotMode::Running && self.safety == Safety::Normal
    }

    pub(super) fn pause_with(&mut self, deceleration_mm_s2: f64, scene: &mut Scene, now_s: f64) {
        if !matches!(self.runtime, Runtime::Playing | Runtime::Resuming) {
            return;
        }
        self.left_s = if self.runtime == Runtime::Playing { self.wake_s - now_s } else { self.left_s };
        self.runtime = Runtime::Pausing;
        self.wake_s = self.brake(deceleration_mm_s2, scene, now_s);
    }

    pub(super) fn end_program(&mut self, deceleration_mm_s2: f64, scene: &mut Scene, now_s: f64) {
        self.steps.clear();
        self.line = None;
        if self.runtime != Runtime::Stopped {
            self.runtime = Runtime::Stopping;
            self.wake_s = self.brake(deceleration_mm_s2, scene, now_s) + STOPPING_S;
        }
    }

    /// Brakes the arm. Returns the time at which it rests, s.
    fn brake(&mut self, deceleration_mm_s2: f64, scene: &mut Scene, now_s: f64) -> f64 {
        let Some(path) = &mut self.path else { return now_s };
        path.brake(deceleration_mm_s2, scene, now_s);
        path.end_s(scene).max(now_s)
    }

    /// Starts the program that is compiled, or ends the one before it first.
    pub(super) fn start_next(&mut self, scene: &mut Scene, now_s: f64) {
        match self.runtime {
            Runtime::Stopped => {
                let Some((_, steps)) = self.next.take() else { return };
                if self.can_run() {
                    (self.runtime, self.wake_s, self.steps) = (Runtime::Playing, now_s + START_S, steps.into());
                } else {
                    self.runtime_errors += 1;
                }
                return;
            }
            Runtime::Stopping => {}
            _ => self.end_program(PROGRAM_STOP_MM_S2, scene, now_s),
        }
        if let Some(next) = &mut self.next {
            // the program before it comes to its end first
            next.0 = self.wake_s + EARLY_S;
        }
    }

    /// Does what the program does next.
    pub(super) fn wake(&mut self, scene: &mut Scene, now_s: f64) {
        self.wake_s = f64::INFINITY;
        match self.runtime {
            Runtime::Playing => {
                self.line = None;
                self.step(scene, now_s);
            }
            Runtime::Stopping => self.runtime = Runtime::Stopped,
            Runtime::Pausing => self.runtime = Runtime::Paused,
            Runtime::Resuming => {
                self.runtime = Runtime::Playing;
                self.wake_s = match self.line {
                    Some(line) => self.begin(line, scene, now_s),
                    None => now_s + self.left_s,
                };
            }
            Runtime::Stopped | Runtime::Paused => {}
        }
    }

    /// Carries out steps until one takes time.
    fn step(&mut self, scene: &mut Scene, now_s: f64) {
        while let Some(step) = self.steps.pop_front() {
            let done = match step {
                Step::If(condition, yes, no) => {
                    let chosen = if self.holds(&condition, scene, now_s) { yes } else { no };
                    chosen.into_iter().rev().for_each(|step| self.steps.push_front(step));
                    continue;
                }
                Step::Do(Command::MoveLinear(pose, limits)) => self.move_linear(pose, limits, scene, now_s),
                Step::Do(Command::Sleep(for_s)) => Some(now_s + for_s),
                Step::Do(command) => self.set(&command).then_some(now_s),
            };
            match done {
                Some(until_s) if until_s <= now_s => {}
                Some(until_s) => {
                    self.wake_s = until_s;
                    return;
                }
                None => {
                    self.runtime_errors += 1;
                    self.steps.clear();
                }
            }
        }
        (self.runtime, self.wake_s) = (Runtime::Stopping, now_s + STOPPING_S);
    }

    /// Runs a secondary program, which takes no time. It can't move the arm or wait.
    pub(super) fn run_secondary(&mut self, mut steps: VecDeque<Step>, scene: &mut Scene, now_s: f64) {
        while let Some(step) = steps.pop_front() {
            match step {
                Step::If(condition, yes, no) => {
                    let chosen = if self.holds(&condition, scene, now_s) { yes } else { no };
                    chosen.into_iter().rev().for_each(|step| steps.push_front(step));
                }
                Step::Do(command) if self.set(&command) => {}
                Step::Do(_) => {
                    self.runtime_errors += 1;
                    return;
                }
            }
        }
    }

    /// Carries out a statement that takes no time. Returns whether it is one and can be carried out.
    fn set(&mut self, command: &Command) -> bool {
        let registers = &mut self.registers;
        match *command {
            Command::WriteInteger(n, value) => match registers.integers.get_mut(n) {
                Some(register) => *register = value,
                None => return false,
            },
            Command::WriteFloat(n, value) => match registers.doubles.get_mut(n) {
                Some(register) => *register = value,
                None => return false,
            },
            Command::WriteBit(n, value) if n < 128 => {
                registers.bits = registers.bits & !(1 << n) | u128::from(value) << n;
            }
            Command::SetTcp(offset) => (self.tcp, self.tool) = (offset, self.arm.tool(offset)),
            Command::SetPayload(kg, cog_m) if kg >= 0.0 => (self.payload_kg, self.cog_m) = (kg, cog_m),
            Command::Nothing => {}
            _ => return false,
        }
        true
    }

    /// Begins a motion. Returns the time of its end, s; `None` if the robot can't make it.
    fn move_linear(
        &mut self,
        pose: Option<[f64; 6]>,
        [acceleration_m_s2, speed_m_s, time_s]: [f64; 3],
        scene: &mut Scene,
        now_s: f64,
    ) -> Option<f64> {
        let pose = pose.unwrap_or_else(|| self.pose(scene, now_s).to_wire());
        if !self.can_reach(Some(pose), scene, now_s) || acceleration_m_s2 <= 0.0 || speed_m_s <= 0.0 {
            return None;
        }
        let to = Pose::from_wire(pose).then(self.tool.inverse());
        let mut line = Line { to, speed: 1000.0 * speed_m_s, acceleration: 1000.0 * acceleration_m_s2 };
        if time_s > 0.0 {
            let from = self.planned(scene, now_s);
            let way_mm = norm(std::array::from_fn(|n| to.at_mm[n] - from.at_mm[n]));
            let turn_mrad = 1000.0 * norm(from.turn.inverse().then(to.turn).rotvec_rad());
            let way = if way_mm > 0.0 { way_mm } else { turn_mrad }.max(f64::MIN_POSITIVE);
            (line.speed, line.acceleration) = (2.0 * way / time_s, 4.0 * way / (time_s * time_s));
        }
        Some(self.begin(line, scene, now_s))
    }

    fn begin(&mut self, line: Line, scene: &mut Scene, now_s: f64) -> f64 {
        let turn = self.planned(scene, now_s).turn;
        let path = Path::begin(&self.arm, line, turn, (self.slider, self.deviation), scene, now_s);
        let end_s = path.end_s(scene);
        (self.path, self.line) = (Some(path), Some(line));
        end_s
    }

    fn holds(&self, condition: &Condition, scene: &mut Scene, now_s: f64) -> bool {
        condition.iter().all(|&(within, pose)| self.can_reach(pose, scene, now_s) == within)
    }

    fn can_reach(&self, pose: Option<[f64; 6]>, scene: &mut Scene, now_s: f64) -> bool {
        let [x, y, z, ..] = pose.unwrap_or_else(|| self.pose(scene, now_s).to_wire());
        norm([x, y, z]) <= self.arm.reach_m
    }
}
