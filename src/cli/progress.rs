//! How far a run is, on a terminal.

use super::exit::Failure;
use super::signals::{forget_typed, go_on_at_enter, is_attended};
use super::summary;
use crate::dataset::{Contact, Retouch};
use crate::device::Identity;
use crate::recipe::{Entry, Phase, Plan};
use crate::run::{Cancel, Listener};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::cell::Cell;
use std::io::{IsTerminal, Write};
use std::time::Duration;

/// Readings between two looks at the force on a terminal: ten a second on a cell of 200 Hz.
const FORCE_EVERY: u32 = 20;

/// How often the bar is drawn though nothing happens.
const TICK: Duration = Duration::from_millis(250);

/// Shows a run as it goes: a bar on a terminal, plain lines elsewhere, and on standard output the acknowledgements if
/// asked for.
pub struct Progress {
    bar: ProgressBar,
    on_terminal: bool,
    json: bool,
    cancel: Cancel,
    unheard: Option<Failure>,
    phase: Option<Phase>,
    done: u64,
    planned: u64,
    percent_told: u64,
    /// Whether there is a press yet from which the time that is left can be told.
    timed: bool,
}

impl Progress {
    /// Progress of a plan of which some entries are done already.
    pub fn new(plan: &Plan, done: usize, json: bool, cancel: Cancel) -> Self {
        let on_terminal = std::io::stderr().is_terminal();
        let planned = plan.entries.len() as u64;
        let bar = ProgressBar::with_draw_target(
            Some(planned),
            if on_terminal { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() },
        );
        set_template(&bar, "{prefix:<16} [{bar:22}] {pos:>5}/{len} presses");
        bar.set_prefix("getting ready");
        bar.set_position(done as u64);
        if on_terminal {
            bar.enable_steady_tick(TICK); // a rest of minutes shows too
        }
        let done = done as u64;
        Progress {
            bar,
            on_terminal,
            json,
            cancel,
            unheard: None,
            phase: None,
            done,
            planned,
            percent_told: 0,
            timed: false,
        }
    }

    /// What is told of every force.
    pub fn gauge(&self) -> Box<dyn Fn(f64)> {
        if !self.on_terminal {
            return Box::new(|_| {});
        }
        let (bar, count) = (self.bar.clone(), Cell::new(0));
        Box::new(move |force_n| {
            count.set(count.get() + 1);
            if count.get() % FORCE_EVERY == 0 {
                bar.set_message(format!("{force_n:+.3} N"));
            }
        })
    }

    /// Whether every acknowledgement could be printed, as long as somebody read.
    pub fn heard(&mut self) -> Result<(), Failure> {
        self.unheard.take().map_or(Ok(()), Err)
    }

    /// Takes the bar away.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }

    fn line(&self, text: &str) {
        // a closed standard error stops no run
        self.bar.suspend(|| _ = writeln!(std::io::stderr(), "{text}"));
    }
}

impl Listener for Progress {
    fn ready(&mut self, devices: &[Identity]) {
        for device in devices {
            // what stands in brackets is for the manifest: serial numbers don't fit a line
            let name = device.identity.split(" (").next().unwrap_or_default();
            self.line(&format!("{:<10} {name}", device.role));
            for warning in &device.warnings {
                self.line(&format!("warning: {}: {warning}", device.role));
            }
        }
    }

    fn begins(&mut self, entry: &Entry) {
        if self.phase != Some(entry.phase) {
            self.phase = Some(entry.phase);
            self.bar.set_prefix(entry.phase.name());
            if !self.on_terminal {
                self.line(&format!("{}: from press {} of {}", entry.phase.name(), self.done + 1, self.planned));
            }
        }
    }

    fn recorded(&mut self, contact: &Contact) {
        self.done += 1;
        self.bar.set_position(self.done);
        if !self.timed {
            self.timed = true;
            set_template(&self.bar, "{prefix:<16} [{bar:22}] {pos:>5}/{len} presses, {eta} left, {msg}");
        }
        if self.json {
            let lines: String = contact.levels.iter().flat_map(|press| [press.to_json(), "\n".to_owned()]).collect();
            // what nobody can read doesn't stop a run: the record is on disk
            let told = summary::print(&lines);
            self.unheard = self.unheard.take().or(told.err());
        }
        let tenth = self.done * 10 / self.planned.max(1) * 10;
        if !self.on_terminal && tenth > self.percent_told {
            self.percent_told = tenth;
            self.line(&format!("{tenth:>3} %: {} of {} presses", self.done, self.planned));
        }
    }

    fn retouched(&mut self, retouch: &Retouch) {
        let Retouch { place, before_mm, touched_mm, .. } = retouch;
        let moved_um = 1000.0 * (touched_mm - before_mm);
        self.line(&format!("touched again at {:.2}, {:.2} mm: moved by {moved_um:+.0} um", place.x_mm, place.y_mm));
    }

    fn rests(&mut self, seconds: f64) {
        self.bar.set_message(format!("rest {seconds:.0} s"));
    }

    fn paused(&mut self) -> bool {
        let is_attended = is_attended();
        if is_attended {
            forget_typed();
            self.line(&format!(
                "paused after {} of {} presses, stage parked: Enter continues, Ctrl-C ends",
                self.done, self.planned
            ));
            go_on_at_enter(&self.cancel);
        }
        is_attended
    }
}

fn set_template(bar: &ProgressBar, template: &str) {
    // a template that can't be read would leave the bar as it is; both are seen in every run on a terminal
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
}
