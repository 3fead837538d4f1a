//! How far a run is, on a terminal.

use super::check_weight;
use super::signals::{forget_typed, go_on_at_enter, is_attended};
use super::summary;
use super::tables::filled;
use crate::api::Failure;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use palpate_core::parallel::lock;
use palpate_core::quantity::Axis;
use palpate_data::dataset::{RecordedCheck, RecordedContact, Retouch};
use palpate_data::recipe::{Entry, Phase, Plan};
use palpate_link::device::Identity;
use palpate_run::rig::RigSpec;
use palpate_run::run::{Ask, Cancel, KnownWeight, Listener};
use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Number of readings between two looks at the force on a terminal: ten looks per second with a cell of 200 Hz.
const FORCE_EVERY: u32 = 20;

/// Largest number of cells of the bar. The second constant is the least number that is drawn.
const BAR_CELLS: usize = 22;
const BAR_LEAST: usize = 6;

/// Interval at which the bar is drawn even if nothing happens.
const TICK: Duration = Duration::from_millis(250);

/// Shows a run as it goes: a bar on a terminal, plain lines elsewhere, and on standard output the acknowledgements if
/// asked for.
pub(super) struct Progress<'a> {
    bar: ProgressBar,
    on_terminal: bool,
    json: bool,
    cancel: Cancel,
    unheard: Option<Failure>,
    phase: Option<Phase>,
    done: u64,
    planned: u64,
    percent_printed: u64,
    shown: Arc<Mutex<BarState>>,
    at_pause: Box<dyn Fn() + 'a>,
    warned: Option<&'a RefCell<BTreeSet<String>>>,
    /// Weight that a person is asked for after the run.
    weight: Option<KnownWeight>,
}

/// Data on the bar's line in addition to the count.
#[derive(Debug, Default)]
struct BarState {
    /// Name of the phase; before the first phase, the name of the preparation.
    phase: String,
    /// The force, or a rest.
    message: String,
    /// Whether there is a press yet from which the remaining time can be estimated.
    timed: bool,
}

impl<'a> Progress<'a> {
    /// Progress of a plan of which some entries are done already.
    pub(super) fn new(plan: &Plan, done: usize, json: bool, cancel: Cancel) -> Self {
        let on_terminal = std::io::stderr().is_terminal();
        let planned = plan.entries.len() as u64;
        let bar = ProgressBar::with_draw_target(
            Some(planned),
            if on_terminal { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() },
        );
        let shown = Arc::new(Mutex::new(BarState { phase: "getting ready".to_owned(), ..BarState::default() }));
        set_style(&bar, &shown);
        bar.set_position(done as u64);
        if on_terminal {
            bar.enable_steady_tick(TICK); // a rest of minutes shows too
        }
        let done = done as u64;
        let at_pause = Box::new(|| {});
        Progress {
            bar,
            on_terminal,
            json,
            cancel,
            unheard: None,
            phase: None,
            done,
            planned,
            percent_printed: 0,
            shown,
            at_pause,
            warned: None,
            weight: None,
        }
    }

    /// The same, with the weight that the load cell of a real rig was checked with, if a person can be asked for it after the run.
    pub(super) fn weighing(self, spec: &RigSpec) -> Self {
        let check = spec.load_cell.check.as_ref().filter(|_| !spec.is_simulated() && is_attended());
        let weight = check.map(|check| KnownWeight {
            weight_n: check.weight_n,
            u_n: check.weight_u_n,
            pull: check.pull,
            along: Axis::Z,
        });
        Progress { weight, ..self }
    }

    /// The same, with what is called at every pause.
    pub(super) fn pausing(self, at_pause: impl Fn() + 'a) -> Self {
        Progress { at_pause: Box::new(at_pause), ..self }
    }

    /// The same, with the warnings that were shown in earlier runs and aren't shown again.
    pub(super) fn warned(self, warned: &'a RefCell<BTreeSet<String>>) -> Self {
        Progress { warned: Some(warned), ..self }
    }

    /// What is called for every force.
    pub(super) fn watched_cell(&self) -> Box<dyn Fn(f64)> {
        if !self.on_terminal {
            return Box::new(|_| {});
        }
        let (shown, count) = (self.shown.clone(), Cell::new(0));
        Box::new(move |force_n| {
            count.set(count.get() + 1);
            if count.get() % FORCE_EVERY == 0 {
                lock(&shown).message = format!("{force_n:+.3} N");
            }
        })
    }

    /// Whether every acknowledgement could be printed, as long as somebody read.
    pub(super) fn heard(&mut self) -> Result<(), Failure> {
        self.unheard.take().map_or(Ok(()), Err)
    }

    /// Takes the bar away.
    pub(super) fn end(&self) {
        self.bar.finish_and_clear();
    }

    fn line(&self, text: &str) {
        // a closed standard error stops no run
        self.bar.suspend(|| _ = writeln!(std::io::stderr(), "{text}"));
    }
}

impl Listener for Progress<'_> {
    fn ready(&mut self, devices: &[Identity]) {
        for device in devices {
            // text in brackets is for the manifest: serial numbers don't fit a line
            let name = device.identity.split(" (").next().unwrap_or_default();
            self.line(&format!("{:<10} {name}", device.role));
            for warning in &device.warnings {
                let line = format!("warning: {}: {warning}", device.role);
                if self.warned.is_none_or(|warned| warned.borrow_mut().insert(line.clone())) {
                    filled(&line, "  ").lines().for_each(|line| self.line(line));
                }
            }
        }
    }

    fn begins(&mut self, entry: &Entry) {
        if self.phase != Some(entry.phase) {
            self.phase = Some(entry.phase);
            lock(&self.shown).phase = entry.phase.name().to_owned();
            if !self.on_terminal {
                self.line(&format!("{}: from press {} of {}", entry.phase.name(), self.done + 1, self.planned));
            }
        }
    }

    fn recorded(&mut self, contact: &RecordedContact) {
        self.done += 1;
        lock(&self.shown).timed = true;
        self.bar.set_position(self.done);
        if self.json {
            let lines: String = contact.levels.iter().flat_map(|press| [press.to_json(), "\n".to_owned()]).collect();
            // missing output doesn't stop a run: the record is on disk
            let text = summary::print(&lines);
            self.unheard = self.unheard.take().or(text.err());
        }
        let tenth = self.done * 10 / self.planned.max(1) * 10;
        if !self.on_terminal && tenth > self.percent_printed {
            self.percent_printed = tenth;
            self.line(&format!("{tenth:>3} %: {} of {} presses", self.done, self.planned));
        }
    }

    fn retouched(&mut self, retouch: &Retouch) {
        let Retouch { place, before_mm, touched_mm, .. } = retouch;
        let moved_um = 1000.0 * (touched_mm - before_mm);
        self.line(&format!("touched again at {:.2}, {:.2} mm: moved by {moved_um:+.0} um", place.x_mm, place.y_mm));
    }

    fn checked(&mut self, check: &RecordedCheck) {
        if check.is_failed() {
            self.line(&format!("warning: {}", check.line())); // the summary shows it too, at the end
        }
    }

    fn weight(&mut self) -> Option<KnownWeight> {
        if self.weight.is_some() {
            self.line("after the run: the known weight again, to check the load cell");
        }
        self.weight
    }

    fn ask(&mut self, ask: Ask) {
        self.bar.suspend(|| check_weight::ask(ask));
    }

    fn waits(&mut self, text: &str) {
        self.line(text);
    }

    fn rests(&mut self, seconds: f64) {
        lock(&self.shown).message = format!("rest {seconds:.0} s");
    }

    fn paused(&mut self) -> bool {
        let is_attended = is_attended();
        if is_attended {
            (self.at_pause)();
            forget_typed();
            self.line(&format!(
                "paused after {} of {} presses, stage parked: Enter continues, Ctrl-C ends",
                self.done, self.planned
            ));
            let before = std::mem::replace(
                &mut *lock(&self.shown),
                BarState { phase: "PAUSED".to_owned(), ..BarState::default() },
            );
            go_on_at_enter(&self.cancel);
            *lock(&self.shown) = before;
            self.bar.reset_eta(); // the pause isn't part of a press
        }
        is_attended
    }
}

/// Sets the style. The complete line is one element, so that it can be fitted to the terminal each time it is drawn.
fn set_style(bar: &ProgressBar, shown: &Arc<Mutex<BarState>>) {
    let shown = shown.clone();
    let line = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        let shown = lock(&shown);
        let left = shown.timed.then(|| format!("{:#}", HumanDuration(state.eta())));
        _ = out.write_str(&line(
            &shown,
            left.as_deref(),
            state.pos(),
            state.len().unwrap_or_default(),
            summary::width(io::stderr()),
        ));
    };
    // an invalid template would leave the bar unchanged; every run on a terminal shows it
    if let Ok(style) = ProgressStyle::with_template("{line}") {
        bar.set_style(style.with_key("line", line));
    }
}

/// Returns the bar's line in at most `width` columns. It contains as much as fits: first the count, then the remaining time, the
/// force and the bar.
fn line(shown: &BarState, left: Option<&str>, done: u64, planned: u64, width: usize) -> String {
    let width = width.saturating_sub(1); // a full line makes some terminals wrap
    let mut count = format!("{done:>5}/{planned} presses");
    let mut phase = format!("{:<16}", shown.phase);
    if phase.len() + 1 + count.len() > width {
        (phase, count) = (shown.phase.clone(), format!("{done}/{planned}"));
    }
    let message = Some(shown.message.as_str()).filter(|message| left.is_some() && !message.is_empty());
    for part in [left.map(|left| format!(", {left} left")), message.map(|message| format!(", {message}"))] {
        let part = part.unwrap_or_default();
        if phase.len() + 1 + count.len() + part.len() <= width {
            count += &part;
        }
    }
    let room = width.saturating_sub(phase.len() + count.len() + " [] ".len()).min(BAR_CELLS);
    let text = if room < BAR_LEAST {
        format!("{phase} {count}")
    } else {
        let filled = (done * room as u64 / planned.max(1)).min(room as u64) as usize;
        let head = if filled < room { ">" } else { "" };
        format!("{phase} [{:<room$}] {count}", "=".repeat(filled) + head)
    };
    text.chars().take(width).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_of_the_bar_fits_terminals_of_40_to_200_columns() {
        let shown = BarState { phase: "characterisation".to_owned(), message: "+0.995 N".to_owned(), timed: true };
        let fitted = |width| line(&shown, Some("12m"), 312, 625, width);
        for width in 20..=200 {
            let text = fitted(width);
            assert!(text.len() < width, "{width}: {text}");
            assert!(
                text.starts_with("characterisation") && (width < 30 || text.contains("312/625")),
                "{width}: {text}"
            );
        }
        assert_eq!(fitted(40), "characterisation   312/625 presses");
        assert_eq!(fitted(60), "characterisation   312/625 presses, 12m left, +0.995 N");
        assert_eq!(fitted(80), "characterisation [==========>           ]   312/625 presses, 12m left, +0.995 N");
        assert_eq!(fitted(200), fitted(80));
        let begins = line(&BarState { phase: "getting ready".to_owned(), ..BarState::default() }, None, 0, 625, 80);
        assert_eq!(begins, "getting ready    [>                     ]     0/625 presses");
    }
}
