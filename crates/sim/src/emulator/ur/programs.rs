//! The controller's programs: they begin, wait, pause and end.

use super::motion::Path;
use super::pose::{self, Pose};
use super::robot::{EARLY_S, Robot, Runtime, Safety};
use super::script::{Call, Expression, Program, Statement, Value};
use super::turn::norm;
use crate::scene::Scene;
use palpate_core::quantity::Axis;

/// Time from when a program is compiled to its first statement, s.
const START_S: f64 = 0.04;
/// Time for which a program is still stopping or pausing when the arm rests, s.
const STOPPING_S: f64 = 0.01;
/// Deceleration when a program is ended, mm/s^2.
const PROGRAM_STOP_MM_S2: f64 = 4000.0;
/// Speed, m/s, and acceleration, m/s^2, of a motion that states none.
const STOCK_LIMITS: [f64; 2] = [0.25, 1.2];
/// Period of the control cycle, s.
pub(super) const CYCLE_S: f64 = 0.002;
/// Number of statements after which a program that takes no time counts as an infinite loop, which ends it.
const STATEMENTS_MOST: usize = 10_000;
/// Number of messages that are kept.
const MESSAGES_MOST: usize = 100;

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
        self.statements.clear();
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
                self.statements = self.next.drain(..).rev().collect();
                self.variables.clear();
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

    /// Takes a program. A secondary one is carried out at once; another one replaces the program that runs.
    pub(super) fn take(&mut self, program: Program, begin_s: f64, scene: &mut Scene, now_s: f64) {
        if !program.is_secondary {
            (self.next, self.begin_s) = (program.statements, begin_s);
            return;
        }
        let wake_s = std::mem::replace(&mut self.wake_s, f64::INFINITY);
        let others = std::mem::replace(&mut self.statements, program.statements);
        self.statements.reverse();
        let variables = std::mem::take(&mut self.variables);
        self.carry_on(scene, now_s);
        (self.wake_s, self.statements, self.variables) = (wake_s, others, variables);
    }

    /// Carries out statements until one takes time, or the program ends.
    fn step(&mut self, scene: &mut Scene, now_s: f64) {
        self.carry_on(scene, now_s);
        if self.wake_s.is_infinite() {
            (self.runtime, self.wake_s) = (Runtime::Stopping, now_s + STOPPING_S);
        }
    }

    /// Carries out statements until one takes time. One that can't be carried out ends the program, as does an infinite loop.
    fn carry_on(&mut self, scene: &mut Scene, now_s: f64) {
        for _ in 0..STATEMENTS_MOST {
            let Some(statement) = self.statements.pop() else { return };
            if self.execute(statement, scene, now_s).is_none() {
                break;
            }
            if self.wake_s.is_finite() {
                return;
            }
        }
        self.statements.clear();
    }

    fn execute(&mut self, statement: Statement, scene: &mut Scene, now_s: f64) -> Option<()> {
        match statement {
            Statement::Let(name, value) => {
                let value = self.value(&value, scene, now_s)?;
                self.variables.insert(name, value);
            }
            Statement::If { condition, yes, no } => {
                let chosen = if self.value(&condition, scene, now_s)?.truth()? { yes } else { no };
                self.statements.extend(chosen.into_iter().rev());
            }
            Statement::While { condition, body } => {
                if self.value(&condition, scene, now_s)?.truth()? {
                    self.statements.push(Statement::While { condition, body: body.clone() });
                    self.statements.extend(body.into_iter().rev());
                }
            }
            Statement::Do(call) => return self.call(&call, scene, now_s),
        }
        Some(())
    }

    /// Carries out a call for its effect.
    fn call(&mut self, call: &Call, scene: &mut Scene, now_s: f64) -> Option<()> {
        let mut values = Vec::new();
        for argument in &call.arguments {
            values.push(match argument {
                Some(argument) => Some(self.value(argument, scene, now_s)?),
                None => None,
            });
        }
        let number = |index: usize, stock: f64| match values.get(index) {
            Some(Some(value)) => value.number(),
            _ => Some(stock),
        };
        let first = values.first().and_then(Option::as_ref);
        match call.function.name {
            "movel" => {
                let limits = [number(2, STOCK_LIMITS[0])?, number(1, STOCK_LIMITS[1])?];
                let is_known = number(3, 0.0)? == 0.0 && number(4, 0.0).is_some();
                let pose = first?.pose().filter(|&pose| self.reaches(pose))?;
                if !is_known || limits.iter().any(|&limit| limit <= 0.0) {
                    return None;
                }
                self.move_linear(pose, limits, scene, now_s);
            }
            // a program moves only while it waits for the motion, so there is nothing to stop
            "stopl" => {}
            "sleep" => self.wake_s = now_s + number(0, 0.0)?.max(0.0),
            "sync" => self.wake_s = (((now_s + EARLY_S) / CYCLE_S).floor() + 1.0) * CYCLE_S,
            "halt" => self.statements.clear(),
            "set_tcp" => self.tcp = first?.pose()?,
            "set_payload" => self.payload_kg = number(0, 0.0)?,
            "write_output_integer_register" => *self.registers.get_mut(index(first?)?)? = number(1, 0.0)? as i32,
            "write_output_float_register" => *self.float_registers.get_mut(index(first?)?)? = number(1, 0.0)?,
            "textmsg" | "popup" => {
                let text: String = values.iter().take(2).flatten().map(Value::to_string).collect();
                self.messages.truncate(MESSAGES_MOST - 1);
                self.messages.push(text);
            }
            _ => {
                self.value(&Expression::Call(call.clone()), scene, now_s)?;
            }
        }
        Some(())
    }

    fn value(&self, expression: &Expression, scene: &mut Scene, now_s: f64) -> Option<Value> {
        let mut variables = |name: &str| self.variables.get(name).cloned();
        expression.value(&mut variables, &mut |name, arguments| self.asked(name, arguments, scene, now_s))
    }

    /// Result of a function that asks the robot.
    fn asked(&self, name: &str, arguments: &[Value], scene: &mut Scene, now_s: f64) -> Option<Value> {
        match (name, arguments) {
            ("get_actual_tcp_pose", _) => Some(Value::Pose(self.actual_pose(scene, now_s))),
            ("get_target_tcp_pose", _) => Some(Value::Pose(self.target_pose(now_s))),
            ("get_tcp_offset", _) => Some(Value::Pose(self.tcp)),
            ("get_target_payload", _) => Some(Value::Number(self.payload_kg)),
            ("get_steptime", _) => Some(Value::Number(CYCLE_S)),
            ("is_steady", _) => Some(Value::Truth(self.path.end_s(scene) <= now_s)),
            ("is_within_safety_limits", [Value::Pose(pose)]) => Some(Value::Truth(self.reaches(*pose))),
            ("read_output_integer_register", [address]) => {
                self.registers.get(index(address)?).map(|&value| Value::Number(f64::from(value)))
            }
            ("read_output_float_register", [address]) => {
                self.float_registers.get(index(address)?).map(|&value| Value::Number(value))
            }
            _ => None,
        }
    }

    /// Begins a motion of the TCP with a speed, m/s, and an acceleration, m/s^2.
    fn move_linear(&mut self, to: Pose, limits: [f64; 2], scene: &mut Scene, now_s: f64) {
        let (at_m, turn) = pose::parts(pose::within(to, pose::inverse(self.tcp)));
        let step_mm = self.arm.step_mm;
        let rounded = |mm: f64| if step_mm > 0.0 { (mm / step_mm).round() * step_mm } else { mm };
        let from_mm = Axis::ALL.map(|axis| scene.motion(axis).position_mm(now_s));
        let to_mm = self.arm.stage_mm(at_m.map(|m| 1000.0 * m)).map(|mm| scene.target_mm(rounded(mm)));
        let (from, to) = ((from_mm, self.path.planned(now_s).1), (to_mm, turn));
        self.path = Path::between(from, to, limits.map(|m| 1000.0 * m), self.deviation.1);
        self.path.drive(self.slider, scene, now_s);
        self.path.deviate(self.deviation.0, scene, now_s);
        self.wake_s = self.path.end_s(scene);
    }

    fn reaches(&self, [x, y, z, ..]: Pose) -> bool {
        norm([x, y, z]) <= self.arm.reach_m
    }
}

/// Number of a register.
fn index(value: &Value) -> Option<usize> {
    value.number().filter(|number| number.fract() == 0.0 && *number >= 0.0).map(|number| number as usize)
}
