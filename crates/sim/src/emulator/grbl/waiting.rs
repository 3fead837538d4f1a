//! Lines that came and can't run yet.

use super::gcode::GcodeLine;
use super::machine::Activity;
use super::report::RX_MOST;
use super::{GrblEmulator, LockState, Reply};
use crate::scene::Scene;

/// A line that waits.
#[derive(Clone)]
pub(super) struct WaitingLine {
    pub text: String,
    /// Whether another sender sent it, who gets its answer.
    pub is_others: bool,
}

/// Reason why a line waits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Stall {
    /// Room in the planner, with no jog being cancelled.
    Room,
    /// Rest of the axes, expected at `still_s`, and then the time `dwell_s`.
    Dwell { still_s: f64, dwell_s: f64 },
    /// A time, s.
    Until(f64),
}

impl GrblEmulator {
    /// Stores a line until it can be run. A line for which the buffer has no room is lost.
    pub(super) fn keep(&mut self, line: WaitingLine) {
        let taken: usize = self.waiting.iter().map(|line| line.text.len() + 1).sum();
        if self.waiting.is_empty() || taken + line.text.len() < RX_MOST {
            self.waiting.push_back(line);
        }
    }

    pub(super) fn forget_lines(&mut self) {
        self.waiting.clear();
        self.stall = None;
    }

    /// Runs the lines that no longer have to wait. In a feed hold all of them wait, also those that ask (protocol.c).
    pub(super) fn run_waiting(&mut self, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        while let Some(line) = self.waiting.front().cloned().filter(|_| self.machine.held_s().is_none()) {
            if self.lock == LockState::Critical {
                self.forget_lines(); // it answers nothing until it is reset
                return;
            }
            let stall = self.stall.or_else(|| self.begin_to_wait(&line.text, scene, now_s));
            self.stall = stall.and_then(|stall| self.still_waits(stall, now_s));
            if self.stall.is_some() {
                return;
            }
            self.waiting.pop_front();
            let mut others = Reply::default();
            self.take_line(&line.text, if line.is_others { &mut others } else { reply }, scene, now_s);
            if std::mem::take(&mut self.asked) {
                self.tell_status(reply, scene, now_s);
            }
        }
    }

    /// Time from which the first line may be run, s. `None` if the line waits for another event.
    pub(super) fn stall_ends_s(&self) -> Option<f64> {
        Some(match self.stall.filter(|_| self.machine.held_s().is_none())? {
            Stall::Room => self.machine.ready_s(),
            Stall::Dwell { still_s, .. } => still_s,
            Stall::Until(at_s) => at_s,
        })
    }

    /// Returns the reason for which a line has to wait. Starts homing if the line requests it.
    fn begin_to_wait(&mut self, line: &str, scene: &mut Scene, now_s: f64) -> Option<Stall> {
        let activity = self.machine.activity();
        if line == "$H" && self.machine.board.settings.homes() {
            if activity != Activity::Idle {
                return None;
            }
            let homed = self.machine.home(scene, now_s);
            self.homing = Some(homed);
            return Some(Stall::Until(homed.end_s));
        }
        if let Some(dwell_s) = GcodeLine::parse(line).ok().and_then(|block| block.dwell_s()) {
            let runs = self.lock == LockState::Open && activity != Activity::Jog;
            return runs.then_some(Stall::Dwell { still_s: now_s, dwell_s });
        }
        let moves = !line.starts_with('$') || line.starts_with("$J");
        moves.then_some(Stall::Room)
    }

    fn still_waits(&self, stall: Stall, now_s: f64) -> Option<Stall> {
        match stall {
            Stall::Room => (self.machine.ready_s() > now_s).then_some(stall),
            Stall::Dwell { still_s, dwell_s } => {
                let still_s = self.machine.end_s().max(still_s);
                if still_s > now_s {
                    Some(Stall::Dwell { still_s, dwell_s })
                } else {
                    self.still_waits(Stall::Until(still_s + dwell_s), now_s)
                }
            }
            Stall::Until(at_s) => (at_s > now_s).then_some(stall),
        }
    }
}
