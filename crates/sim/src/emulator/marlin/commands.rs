//! What each command does, and what it waits for.

use super::gcode::MarlinCommand;
use super::planner::MarlinPlanner;
use super::{CLEANING_S, KILLED, MarlinEmulator, MarlinReply, report};
use crate::scene::Scene;

/// Reason why a command waits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Stall {
    /// Room in the queue.
    Room,
    /// An empty queue.
    Still,
    /// A time, s.
    Until(f64),
}

impl Stall {
    /// Time of the end of the wait, s, as far as it is known now.
    pub(super) fn end_s(self, planner: &MarlinPlanner) -> f64 {
        match self {
            Stall::Room => planner.ready_s(),
            Stall::Still => planner.end_s(),
            Stall::Until(at_s) => at_s,
        }
    }
}

impl MarlinEmulator {
    /// Returns what a command waits for after it has waited for something, or for nothing. `None`: it can be executed.
    pub(super) fn next_stall(
        &mut self,
        waited: Option<Stall>,
        command: &MarlinCommand<'_>,
        scene: &mut Scene,
        now_s: f64,
    ) -> Option<Stall> {
        let levels = command.switch('S').is_some_and(|on| on != self.planner.levels);
        match (command.code, waited) {
            (('G', 0 | 1), None) => Some(Stall::Room),
            (('G', 4 | 28) | ('M', 400), None) => Some(Stall::Still),
            (('M', 18 | 84), None) if command.value('S').is_none() => Some(Stall::Still),
            (('M', 420), None) if levels => Some(Stall::Still),
            // Marlin queues the new count behind the motions; here it waits for them
            (('G', 92), None) if !self.planner.board.workspace_offsets => Some(Stall::Still),
            (('G', 4), Some(Stall::Still)) => {
                let ms = command.value('P').map(|ms| ms / 1000.0);
                command.value('S').or(ms).map(|dwell_s| Stall::Until(now_s + dwell_s))
            }
            (('G', 28), Some(Stall::Still)) => {
                Some(Stall::Until(self.planner.home(command.named_axes(), scene, now_s)))
            }
            (('M', 410), None) => {
                self.planner.quick_stop(scene, now_s);
                Some(Stall::Until(now_s + CLEANING_S))
            }
            _ => None,
        }
    }

    /// Executes a command that waits for nothing any more, and answers it.
    pub(super) fn execute(
        &mut self,
        command: &MarlinCommand<'_>,
        reply: &mut MarlinReply,
        scene: &mut Scene,
        now_s: f64,
    ) {
        let planner = &mut self.planner;
        match command.code {
            ('G', 0 | 1) => planner.go(command, scene, now_s),
            ('G', 28) => {
                if !planner.is_home(scene) {
                    return self.kill("Homing Failed", reply, now_s);
                }
                reply.line(report::position(planner, scene, now_s));
            }
            ('G', unit @ (20 | 21)) if planner.board.inches => planner.count_in_inches(unit == 20),
            ('G', distance @ (90 | 91)) => planner.relative = distance == 91,
            ('G', 92) => {
                planner.set_logical(command, scene);
                reply.line(report::position(planner, scene, now_s));
            }
            ('M', 17) => planner.motors_on(command.named_axes()),
            ('M', 18 | 84) => match command.value('S') {
                Some(idle_s) => {
                    planner.board.idle_s = idle_s;
                    planner.moves_until(now_s);
                }
                None => planner.motors_off(command.named_axes(), scene, now_s),
            },
            ('M', 105) => return self.ok(report::TEMPERATURES, reply, now_s),
            ('M', 110) => self.last_line = command.value('N').map_or(self.last_line, |number| number as i64),
            ('M', 112) => return self.kill(KILLED, reply, now_s),
            ('M', 113) => match command.value('S') {
                Some(keepalive_s) => self.keepalive_s = whole_seconds(keepalive_s),
                None => reply.line(format!("echo:M113 S{:.0}", self.keepalive_s)),
            },
            ('M', 114) => reply.line(report::position(planner, scene, now_s)),
            ('M', 115) => self.identify(reply),
            ('M', 155) => {
                let every_s = whole_seconds(command.value('S').unwrap_or(0.0));
                self.reports = (every_s > 0.0).then_some((every_s, now_s + every_s));
            }
            ('M', 92 | 201 | 203 | 204 | 211) => self.set_or_report(command, reply),
            ('M', 420) if planner.board.bed_rise.is_some() => {
                let before_mm = planner.logical_mm();
                planner.level(command.switch('S').unwrap_or(planner.levels), scene);
                reply.line(format!("echo:Bed Leveling {}", report::on_off(planner.levels)));
                reply.line("echo:Fade Height OFF");
                if planner.logical_mm() != before_mm {
                    reply.line(report::position(planner, scene, now_s));
                }
            }
            ('M', 290) if planner.board.babysteps => planner.babystep(command, scene, now_s),
            ('M', 503) => report::settings(planner).iter().for_each(|line| reply.line(line)),
            ('M', 220) if !['S', 'B', 'R'].into_iter().any(|letter| command.has(letter)) => {
                reply.line(format!("FR:{:.0}%", planner.feed_percent));
            }
            ('M', 220) => {
                planner.feed_percent =
                    command.value('S').filter(|&percent| percent > 0.0).unwrap_or(planner.feed_percent)
            }
            ('G', 4) | ('M', 400 | 410) => {}
            // what has no effect here: units, extruder, heaters, fan, jerk
            ('G', 21) | ('M', 82 | 83 | 104 | 106..=108 | 140 | 205 | 221) | ('T', _) => {}
            _ => unknown(command, reply),
        }
        self.ok("", reply, now_s);
    }

    fn identify(&self, reply: &mut MarlinReply) {
        let board = &self.planner.board;
        let has = |name: &str| match name {
            "AUTOLEVEL" | "LEVELING_DATA" => board.bed_rise.is_some(),
            "EMERGENCY_PARSER" => board.emergency_parser,
            "BABYSTEPPING" => board.babysteps,
            _ => false,
        };
        reply.line(report::FIRMWARE);
        for capability in report::CAPABILITIES.split(' ') {
            match capability.strip_suffix(":0").filter(|name| has(name)) {
                Some(name) => reply.line(format!("Cap:{name}:1")),
                None => reply.line(format!("Cap:{capability}")),
            }
        }
    }

    /// A setting with values writes them; without, it is reported.
    fn set_or_report(&mut self, command: &MarlinCommand<'_>, reply: &mut MarlinReply) {
        let planner = &mut self.planner;
        let board = &mut planner.board;
        let number = command.code.1;
        if !"XYZESPRT".chars().any(|letter| command.has(letter)) {
            reply.line(report::setting(planner, number).unwrap_or_default());
            if number == 211 {
                reply.line(report::soft_ends(planner));
            }
            return;
        }
        let values = match number {
            201 => &mut board.acceleration_mm_s2,
            203 => &mut board.most_mm_s,
            204 => {
                let travel_mm_s2 = command.value('S').or(command.value('T')).filter(|&value| value > 0.0);
                board.travel_acceleration_mm_s2 = travel_mm_s2.unwrap_or(board.travel_acceleration_mm_s2);
                return;
            }
            211 => {
                planner.limits_softly = command.switch('S').unwrap_or(planner.limits_softly);
                return;
            }
            _ => return unknown(command, reply),
        };
        for (value, axis) in values.iter_mut().zip(command.axes()) {
            *value = axis.filter(|&axis| axis > 0.0).unwrap_or(*value);
        }
        planner.limits_changed();
    }
}

/// Seconds of a setting that has whole seconds, at most a minute.
fn whole_seconds(value: f64) -> f64 {
    value.clamp(0.0, 60.0).trunc()
}

fn unknown(command: &MarlinCommand<'_>, reply: &mut MarlinReply) {
    reply.line(format!("echo:Unknown command: \"{}\"", command.text));
}
