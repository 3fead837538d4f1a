//! The person at the bench: serial numbers and commands that are typed, and what is answered.

use super::super::exit::exit_code;
use super::super::notify::Notifier;
use super::super::summary::{print, tell};
use super::item::Flow;
use super::material::Material;
use super::status::{counted, described};
use super::typed::{Typed, next_line};
use crate::api::MannerOptions;
use crate::api::provenance::now;
use crate::api::{Failure, FailureKind};
use miette::IntoDiagnostic;
use palpate_document::printable;
use palpate_run::batch::{Admitted, BatchEvent, BatchFolder, Nest, SensorState, check_serial};
use palpate_run::run::Cancel;
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::io::{self, IsTerminal};
use std::process::ExitCode;

/// Largest number of characters of a typed text that is recorded.
const TYPED_MOST: usize = 200;

/// Largest number of interrupted sensors that are named one by one.
const NAMED_MOST: usize = 10;

const COMMANDS: &str = "  .repeat [SERIAL]  allow a sensor to be calibrated again, without SERIAL the last one
  .skip SERIAL      skip a sensor
  .note TEXT        note about the last sensor
  .status           show what became of each sensor
  .end              end; the same command continues the batch
";

/// Interactive session of a batch.
pub(super) struct Desk {
    /// The batch on disk.
    pub folder: BatchFolder,
    /// Its files.
    pub material: Material,
    /// Requests to stop.
    pub cancel: Cancel,
    /// Name of the operator.
    pub operator: Option<String>,
    /// Whether events are printed as JSON lines on standard output.
    pub json: bool,
    /// Warnings about devices that were shown already.
    pub warned: RefCell<BTreeSet<String>>,
    /// The program that gets events.
    pub notifier: Option<Notifier>,
}

/// A sensor on the bench that isn't calibrated yet.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    /// Serial number.
    pub serial: String,
    /// Its kind.
    pub kind: Admitted,
    /// Its place on the tray.
    pub nest: Option<Nest>,
}

/// What a person wants next.
enum Wanted {
    /// To calibrate these sensors.
    Run(Vec<Placed>),
    /// To end.
    End,
    /// To stop at once.
    Cancelled,
}

/// Answer to one line.
enum OperatorAnswer {
    Placed(Placed),
    Empty,
    Again,
    End,
}

impl Desk {
    /// Records an event, and then publishes it.
    pub(super) fn record(&mut self, event: &BatchEvent) -> Result<(), Failure> {
        self.folder.record(event).map_err(Failure::batch)?;
        self.publish(event)
    }

    /// Publishes an event that is on the disk. Every event of a batch that is at work passes here once.
    pub(super) fn publish(&self, event: &BatchEvent) -> Result<(), Failure> {
        if self.json {
            let line = serde_json::to_string(event).into_diagnostic().map_err(Failure::unwritten)?;
            print(&format!("{line}\n"))?;
        }
        self.notifier.iter().for_each(|notifier| notifier.pass(event));
        Ok(())
    }

    /// Publishes that the run of a sensor is paused. A line that can't be printed stops no run.
    pub(super) fn pauses(&self, serial: &str) {
        _ = self.publish(&BatchEvent::Paused { at: now(), serial: serial.to_owned() });
    }

    /// Shows a result: on standard output, unless that is for events.
    pub(super) fn show(&self, text: &str) -> Result<(), Failure> {
        if self.json { tell(text) } else { print(text) }
    }

    /// Whether results are read on a terminal.
    pub(super) fn is_on_screen(&self) -> bool {
        if self.json { io::stderr().is_terminal() } else { io::stdout().is_terminal() }
    }

    /// Reports where the batch is: what is done, and what was interrupted.
    fn greet(&self) -> Result<(), Failure> {
        let state = self.folder.state();
        tell(&format!("{}: {}\n", self.folder.path().display(), counted(state)))?;
        let interrupted = state.items.iter().chain(&state.reference);
        for item in interrupted.filter(|item| item.sensor_state == SensorState::Interrupted).take(NAMED_MOST) {
            let serial = &item.serial;
            let run = item.run.as_deref().unwrap_or_default();
            tell(&format!(
                "{serial} was interrupted; its presses are in {run}. To calibrate it again, type .repeat {serial}, then {serial}\n"
            ))?;
        }
        Ok(())
    }

    /// Asks for sensors and calibrates them, until a person ends.
    pub(super) fn work(&mut self, manner: &MannerOptions) -> Result<ExitCode, Failure> {
        self.greet()?;
        loop {
            let tray = match self.ask()? {
                Wanted::Run(tray) => tray,
                Wanted::End => break,
                Wanted::Cancelled => return Ok(exit_code(FailureKind::Cancelled)),
            };
            if self.calibrate(&tray, manner)? == Flow::Cancelled {
                return Ok(exit_code(FailureKind::Cancelled));
            }
        }
        self.greet()?;
        self.show(&format!("next: palpate batch report {}\n", self.folder.path().display()))?;
        Ok(ExitCode::SUCCESS)
    }

    /// Asks for the sensors that are calibrated next: one, or one for each nest.
    fn ask(&mut self) -> Result<Wanted, Failure> {
        let nests: Vec<Option<Nest>> = self.material.nests().map(Option::<&Nest>::cloned).collect();
        let mut tray: Vec<Placed> = Vec::new();
        for nest in nests {
            loop {
                let prompt = self.prompt(nest.as_ref(), &tray);
                let line = match next_line(&self.cancel, || tell(&prompt))? {
                    Typed::Cancelled => return Ok(Wanted::Cancelled),
                    // sensors that were placed before the input ended are calibrated
                    Typed::End if tray.is_empty() => return Ok(Wanted::End),
                    Typed::End => return Ok(Wanted::Run(tray)),
                    Typed::Line(line) => line,
                };
                match self.answer(&line, nest.clone(), &tray)? {
                    OperatorAnswer::Placed(placed) => tray.push(placed),
                    OperatorAnswer::Empty if nest.is_some() => {}
                    OperatorAnswer::Empty | OperatorAnswer::Again => continue,
                    OperatorAnswer::End => return Ok(Wanted::End),
                }
                break;
            }
        }
        Ok(Wanted::Run(tray))
    }

    fn prompt(&self, nest: Option<&Nest>, tray: &[Placed]) -> String {
        let state = self.folder.state();
        let place = nest.map(|nest| format!("nest {}, ", nest.name)).unwrap_or_default();
        let is_on_tray = |serial: &str| tray.iter().any(|placed| placed.serial == serial);
        let due = state.reference.as_ref().filter(|item| state.is_reference_due() && !is_on_tray(&item.serial));
        let waiting = state.count(SensorState::Waiting);
        match (
            due,
            state.items.iter().find(|item| item.sensor_state == SensorState::Waiting && !is_on_tray(&item.serial)),
        ) {
            (Some(reference), _) => format!("{place}reference sensor {} (or `later`) > ", reference.serial),
            (None, Some(next)) => format!("{place}next sensor ({}; {waiting} waiting) > ", next.serial),
            (None, None) => format!("{place}no sensor is waiting (.end, or .repeat SERIAL) > "),
        }
    }

    fn answer(&mut self, line: &str, nest: Option<Nest>, tray: &[Placed]) -> Result<OperatorAnswer, Failure> {
        if line.is_empty() {
            return Ok(OperatorAnswer::Empty);
        }
        if let Some(command) = line.strip_prefix('.') {
            return self.command(command);
        }
        let state = self.folder.state();
        if line.eq_ignore_ascii_case("later") && state.is_reference_due() {
            self.record(&BatchEvent::Postponed { at: now() })?;
            tell("the reference sensor is asked for after the next sensor\n")?;
            return Ok(OperatorAnswer::Again);
        }
        let serials: Vec<String> = tray.iter().map(|placed| placed.serial.clone()).collect();
        match state.admit(line, &serials) {
            Ok(kind) => Ok(OperatorAnswer::Placed(Placed { serial: line.to_owned(), kind, nest })),
            Err(reason) => {
                let typed = printable(line.chars().take(TYPED_MOST).collect());
                tell(&format!("refused: {typed}\n  {reason}; nothing moves\n"))?;
                self.record(&BatchEvent::Refused { at: now(), typed, reason })?;
                Ok(OperatorAnswer::Again)
            }
        }
    }

    fn command(&mut self, line: &str) -> Result<OperatorAnswer, Failure> {
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        let last = || self.folder.state().last.clone();
        let serial = if rest.is_empty() { last() } else { Some(rest.to_owned()) };
        let marked = match (word, serial) {
            ("end", _) => return Ok(OperatorAnswer::End),
            ("status", _) => {
                self.show(&described(self.folder.state()))?;
                return Ok(OperatorAnswer::Again);
            }
            ("repeat", Some(serial)) => self.mark(
                &serial,
                |at, serial| BatchEvent::Retry { at, serial },
                "may be calibrated again: type its serial number",
            ),
            ("skip", Some(serial)) if !rest.is_empty() => {
                self.mark(&serial, |at, serial| BatchEvent::Skipped { at, serial }, "is skipped")
            }
            ("note", _) if !rest.is_empty() && last().is_some() => {
                let note = printable(rest.chars().take(TYPED_MOST).collect());
                let serial = last().unwrap_or_default();
                self.mark(&serial, |at, serial| BatchEvent::Noted { at, serial, note }, "has this note")
            }
            _ => {
                return tell(&format!("unknown, or incomplete: .{}\n{COMMANDS}", printable(line.to_owned())))
                    .map(|()| OperatorAnswer::Again);
            }
        };
        marked.map(|()| OperatorAnswer::Again)
    }

    fn mark(
        &mut self,
        serial: &str,
        event: impl FnOnce(String, String) -> BatchEvent,
        done: &str,
    ) -> Result<(), Failure> {
        if check_serial(serial).is_err() || self.folder.state().item(serial).is_none() {
            return tell(&format!("{} isn't in this batch\n", printable(serial.to_owned())));
        }
        self.record(&event(now(), serial.to_owned()))?;
        tell(&format!("{serial} {done}\n"))
    }
}
