//! Lines from the serial buffer to the command buffer, and their turns (Marlin's queue.cpp).

use super::commands::Stall;
use super::fault::MarlinFaultKind;
use super::gcode::MarlinCommand;
use super::{CLEANING_S, KILLED, MarlinEmulator, MarlinReply, Power, line};
use crate::scene::Scene;

/// Lines in the command buffer, with the one that is carried out (BUFSIZE).
const COMMANDS_MOST: usize = 4;
/// Bytes in the serial buffer behind it.
pub(super) const RECEIVED_MOST: usize = 128;

/// Line of the command buffer.
#[derive(Clone)]
pub(super) struct QueuedLine {
    pub text: String,
    /// Whether another host sent it, who gets its answer.
    pub is_others: bool,
}

impl MarlinEmulator {
    /// Stores a line in the serial buffer. A line for which there is no room is lost.
    pub(super) fn receive(&mut self, request: &[u8], reply: &mut MarlinReply, scene: &mut Scene, now_s: f64) {
        let mut line = String::from_utf8_lossy(request).into_owned();
        if self.faults.take(now_s, |kind| kind == MarlinFaultKind::GarbledLine).is_some() {
            line = garbled(&line);
        }
        if self.stock.emergency_parser {
            let (letter, number) = MarlinCommand::parse(&line).code;
            self.stop_at_once(&format!("{letter}{number}"), reply, scene, now_s);
        }
        let taken: usize = self.received.iter().map(|line| line.len() + 1).sum();
        if taken + line.len() < RECEIVED_MOST {
            self.received.push_back(line);
        }
    }

    /// Moves lines to the command buffer while it has room. M112 and M410 act here if they have no number.
    pub(super) fn accept_lines(&mut self, reply: &mut MarlinReply, scene: &mut Scene, now_s: f64) {
        while self.commands.len() < COMMANDS_MOST
            && self.power == Power::Runs
            && let Some(line) = self.received.pop_front()
        {
            match line::check(&line, self.last_line) {
                Ok(number) => self.last_line = number,
                Err(refusal) => {
                    let last = self.last_line;
                    reply.line(format!("Error:{}, Last Line: {last}", refusal.text()));
                    reply.line(format!("Resend: {}", last.wrapping_add(1)));
                    if self.stock.ok_after_resend {
                        self.ok("", reply, now_s);
                    }
                    self.received.clear();
                    self.reader.clear();
                    self.flushes = true;
                    return;
                }
            }
            self.act_early(&line, reply, scene, now_s);
            self.commands.push_back(QueuedLine { text: line, is_others: false });
        }
    }

    /// Does what a line without a number does before its turn, unless it was done when the line was received.
    pub(super) fn act_early(&mut self, line: &str, reply: &mut MarlinReply, scene: &mut Scene, now_s: f64) {
        if !self.stock.emergency_parser {
            self.stop_at_once(line.trim_start_matches(' '), reply, scene, now_s);
        }
    }

    /// M112 and M410 at the front of a text act at once.
    fn stop_at_once(&mut self, text: &str, reply: &mut MarlinReply, scene: &mut Scene, now_s: f64) {
        if text.starts_with("M112") {
            self.kill(KILLED, reply, now_s);
        } else if text.starts_with("M410") {
            self.planner.quick_stop(scene, now_s);
            self.held_s = now_s + CLEANING_S;
        }
    }

    /// Lets the first command wait, or ends it.
    pub(super) fn carry_on(&mut self, reply: &mut MarlinReply, scene: &mut Scene, now_s: f64) {
        let Some(QueuedLine { text, is_others }) = self.commands.front().cloned() else { return };
        let command = MarlinCommand::parse(&text);
        let waited = self.stall;
        if waited.is_none() {
            self.busy_s = if self.keepalive_s > 0.0 { now_s + self.keepalive_s } else { f64::INFINITY };
            if self.faults.take(now_s, |kind| kind == MarlinFaultKind::Busy).is_some() {
                self.stall = Some(Stall::Until(f64::INFINITY));
                return;
            }
        }
        self.stall = self.next_stall(waited, &command, scene, now_s);
        if self.stall.is_none() {
            self.busy_s = f64::INFINITY;
            let mut others = MarlinReply::default();
            self.execute(&command, if is_others { &mut others } else { reply }, scene, now_s);
            self.commands.pop_front();
            self.accept_lines(reply, scene, now_s);
        }
    }
}

/// Returns a line with the lowest bit of its command's letter inverted.
fn garbled(line: &str) -> String {
    let command = MarlinCommand::parse(line).text;
    let at = line.find(command).unwrap_or(0);
    let invert = |(n, char): (usize, char)| if n == at && char.is_ascii() { char::from(char as u8 ^ 1) } else { char };
    line.char_indices().map(invert).collect()
}
