//! Lines that came and what they wait for.

use super::gcode::Block;
use super::machine::Activity;
use super::report::RX_MOST;
use super::{Grbl, Lock, Reply, settings};
use crate::scene::Scene;
use std::collections::VecDeque;

/// Lines that came and aren't run yet, at most as many as the serial buffer has room for, and what the first waits for.
#[derive(Default)]
pub struct Waiting {
    lines: VecDeque<String>,
    stall: Option<Stall>,
}

/// What a line waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stall {
    /// That the planner has room, and no jog is being cancelled.
    Room,
    /// That the axes stand, which they do at `still_s` as far as is known, and then so long.
    Dwell { still_s: f64, dwell_s: f64 },
    /// An instant, s.
    Until(f64),
}

impl Waiting {
    /// Adds a line; one that the buffer has no room for is lost.
    pub fn push(&mut self, line: &str) {
        let taken: usize = self.lines.iter().map(|line| line.len() + 1).sum();
        if self.lines.is_empty() || taken + line.len() < RX_MOST {
            self.lines.push_back(line.into());
        }
    }

    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// Forgets all of them.
    pub fn clear(&mut self) {
        *self = Waiting::default();
    }

    #[cfg(test)]
    pub fn bytes(&self) -> usize {
        self.lines.iter().map(String::len).sum()
    }
}

impl Grbl {
    /// Runs the lines that wait for nothing any more.
    pub(super) fn run_waiting(&mut self, reply: &mut Reply, scene: &mut Scene, now_s: f64) {
        while let Some(line) = self.waiting.lines.front().cloned() {
            if self.lock == Lock::Critical {
                self.waiting.clear(); // it answers nothing until it is reset
                return;
            }
            if self.machine.is_held() {
                return;
            }
            let stall = self.waiting.stall.or_else(|| self.begin_to_wait(&line, scene, now_s));
            self.waiting.stall = stall.and_then(|stall| self.still_waits(stall, now_s));
            if self.waiting.stall.is_some() {
                return;
            }
            self.waiting.lines.pop_front();
            self.take_line(&line, reply, scene, now_s);
            if std::mem::take(&mut self.asked) {
                self.tell_status(reply, scene, now_s);
            }
        }
    }

    /// When the first line may be run, s; none: not before something else happens.
    pub(super) fn next_s(&self) -> Option<f64> {
        if self.machine.is_held() {
            return None;
        }
        Some(match self.waiting.stall? {
            Stall::Room => self.machine.ready_s(),
            Stall::Dwell { still_s, .. } => still_s,
            Stall::Until(at_s) => at_s,
        })
    }

    /// What a line has to wait for; homing begins with it.
    fn begin_to_wait(&mut self, line: &str, scene: &mut Scene, now_s: f64) -> Option<Stall> {
        let activity = self.machine.activity(now_s);
        if line == "$H" {
            if activity != Activity::Idle || !self.settings.on(settings::HOMING) {
                return None;
            }
            let homing = self.machine.home(&self.settings, scene, now_s);
            self.homing = Some(homing);
            return homing.ok().map(|homed| Stall::Until(homed.end_s));
        }
        if let Some(dwell_s) = Block::parse(line).ok().and_then(|block| block.dwell_s()) {
            let runs = self.lock == Lock::Open && activity != Activity::Jog;
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
