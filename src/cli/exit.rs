//! Exit codes, and messages about failures.

use miette::Report;
use palpate_data::dataset::{DatasetError, JournalError};
use palpate_document::Problems;
use palpate_run::batch::BatchError;
use palpate_run::run::{Ending, Halt};
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

/// Done, but not accepted by the rule, or not decided.
pub(super) const NOT_ACCEPTED: u8 = 1;
/// Exit code of an invalid recipe, rig or command line. Nothing was moved.
pub(super) const USAGE: u8 = 2;
/// Exit code of a device that failed.
pub(super) const DEVICE: u8 = 3;
/// Exit code of a broken safety rule.
const TRIP: u8 = 4;
/// Exit code of a record that couldn't be kept.
const RECORD: u8 = 5;
/// Cancelled by a person, and parked.
pub(super) const CANCELLED: u8 = 130;

/// Reason why a subcommand failed, and its exit code.
#[derive(Debug)]
pub struct Failure {
    code: u8,
    report: Report,
    /// Where the stage is, if a walk left it.
    stage: Option<String>,
    /// A failure that is reported first; the exit code isn't about it.
    before: Option<Box<Failure>>,
}

impl Failure {
    fn new(code: u8, report: impl Into<Report>) -> Failure {
        Failure { code, report: report.into(), stage: None, before: None }
    }

    /// Bad input; nothing was moved.
    pub fn usage(report: impl Into<Report>) -> Failure {
        Failure::new(USAGE, report)
    }

    /// The command ended, but its measurements can't be evaluated.
    pub fn not_accepted(report: impl Into<Report>) -> Failure {
        Failure::new(NOT_ACCEPTED, report)
    }

    /// A result couldn't be written.
    pub fn unwritten(report: impl Into<Report>) -> Failure {
        Failure::new(RECORD, report)
    }

    /// The record couldn't be made or read.
    pub fn dataset(error: DatasetError) -> Failure {
        let code = match error {
            DatasetError::Exists { .. }
            | DatasetError::NoFolder { .. }
            | DatasetError::NoRun { .. }
            | DatasetError::NoJournal { .. }
            | DatasetError::JournalFolder { .. }
            | DatasetError::Missing { .. }
            | DatasetError::Held { .. }
            | DatasetError::Changed { .. }
            | DatasetError::Lost { .. }
            | DatasetError::Foreign { .. }
            | DatasetError::Manifest { .. }
            | DatasetError::Journal(
                JournalError::Damaged { .. } | JournalError::Format { .. } | JournalError::Kind { .. },
            ) => USAGE,
            // not a regular file: nothing was read from it or written to it
            DatasetError::Io { ref why, .. } | DatasetError::Journal(JournalError::Io { ref why, .. })
                if why.kind() == ErrorKind::InvalidInput =>
            {
                USAGE
            }
            DatasetError::Io { .. }
            | DatasetError::Journal(JournalError::Io { .. } | JournalError::Displaced { .. }) => RECORD,
        };
        Failure::new(code, error)
    }

    /// The folder of a new run couldn't be made.
    pub fn unmade(error: DatasetError) -> Failure {
        match error {
            DatasetError::Io { doing, path, why } if why.kind() != ErrorKind::InvalidInput => {
                let help = "nothing was pressed: choose another --out, or free disk space and correct the permissions";
                let report = miette::miette!(help = help, "{doing} {}: {why}", path.display());
                Failure::new(RECORD, report)
            }
            error => Failure::dataset(error),
        }
    }

    /// What was measured couldn't be finished: something has moved by then.
    pub fn unfinished(error: DatasetError) -> Failure {
        Failure::new(RECORD, error)
    }

    /// The record of a batch couldn't be made or read.
    pub fn batch(error: BatchError) -> Failure {
        match error {
            BatchError::Dataset(error) => Failure::dataset(error),
            error => Failure::usage(error),
        }
    }

    /// A run that ended early.
    pub fn halted(halt: Halt) -> Failure {
        match halt {
            Halt::Cancelled => Failure::new(CANCELLED, miette::miette!("cancelled")),
            Halt::Tripped(trip) => {
                let help = "find the cause before going on";
                Failure::new(TRIP, miette::miette!(help = help, "safety trip: {trip}"))
            }
            Halt::Device(error) => Failure::new(DEVICE, error),
            Halt::Record(error) => Failure::new(RECORD, error),
            Halt::Unconfirmed(why) => Failure::new(USAGE, miette::miette!("{why}")),
        }
    }

    /// The load cell can't be trusted.
    pub fn untrusted(report: impl Into<Report>) -> Failure {
        Failure::new(TRIP, report)
    }

    /// A walk that ended early, and may have left the stage where it was.
    pub fn ended(ending: Ending) -> Failure {
        let Ending { halt, unparked, remaining, .. } = ending;
        let parked = match (&halt, &unparked) {
            (_, Some(_)) => Some("the stage could not be parked: move it clear of the specimen by hand".to_owned()),
            (Some(Halt::Tripped(_)), None) => Some("the stage is parked at the end of z's travel".to_owned()),
            (Some(Halt::Record(_)), None) => Some("the stage is parked".to_owned()),
            _ => None,
        };
        let stage: Vec<String> = parked.into_iter().chain(remaining.told()).collect();
        let stage = (!stage.is_empty()).then(|| stage.join("; "));
        let (halt, unparked) = match (halt, unparked) {
            (Some(halt), unparked) => (halt, unparked),
            (None, Some(unparked)) => (unparked, None),
            (None, None) => (Halt::Cancelled, None), // never: such a walk didn't end early
        };
        let before = unparked.map(|why| Box::new(Failure::halted(why)));
        Failure { stage, before, ..Failure::halted(halt) }
    }

    /// The same, after another failure.
    pub fn after(self, before: Failure) -> Failure {
        Failure { before: Some(Box::new(before)), ..self }
    }

    /// Prints the failure, and returns its exit code.
    pub fn report(self) -> ExitCode {
        self.stage.iter().for_each(|stage| say(stage));
        self.before.into_iter().for_each(|before| _ = before.report());
        match self.report.downcast::<Problems>() {
            Ok(problems) => {
                // the count last, where the eye is when the printing ends
                let count = problems.to_string();
                problems.into_reports().for_each(|report| say(&format!("{report:?}")));
                say(&format!("{count}; nothing was done"));
            }
            Err(report) => say(&format!("{report:?}")),
        }
        ExitCode::from(self.code)
    }

    /// Returns the exit code, and what [`report`](Self::report) prints as plain lines without graphics.
    pub fn plain(self) -> (u8, String) {
        let mut lines: Vec<String> = self.stage.into_iter().collect();
        lines.extend(self.before.map(|before| before.plain().1));
        lines.push(match self.report.downcast_ref::<Problems>() {
            Some(problems) => {
                let line = |(line, help): (String, Option<&str>)| line + &helped(help);
                let listed: Vec<String> = problems.told().map(line).collect();
                format!("{}\n{problems}; nothing was done", listed.join("\n"))
            }
            None => plain(&self.report),
        });
        (self.code, lines.join("\n"))
    }
}

/// Returns a report with its causes in one line, and its advice in another.
fn plain(report: &Report) -> String {
    let causes: Vec<String> = report.chain().map(ToString::to_string).collect();
    let help = report.help().map(|help| help.to_string());
    causes.join(": ") + &helped(help.as_deref())
}

fn helped(help: Option<&str>) -> String {
    help.map_or_else(String::new, |help| format!("\nhelp: {help}"))
}

/// Prints a text, of whose control characters only colours and line ends reach the terminal. If it has been closed, nothing is
/// shown, but the exit code is still returned.
fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", coloured(text));
}

fn coloured(text: &str) -> String {
    let (mut shown, mut rest) = (String::with_capacity(text.len()), text.chars());
    while let Some(letter) = rest.next() {
        let is_colour = || {
            let parts = rest.as_str().strip_prefix('[').and_then(|rest| rest.split_once('m'));
            parts.is_some_and(|(numbers, _)| numbers.chars().all(|c| c.is_ascii_digit() || c == ';'))
        };
        let is_shown = !letter.is_control() || matches!(letter, '\n' | '\t') || letter == '\u{1b}' && is_colour();
        shown.push(if is_shown { letter } else { '\u{fffd}' });
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_what_controls_a_terminal_only_colours_are_printed() {
        let coloured_text = "\u{1b}[1;31mx\u{1b}[0m\n\ty\u{1b}[m";
        assert_eq!(coloured(coloured_text), coloured_text);
        assert_eq!(
            coloured("\u{1b}]0;owned\u{7}\r\u{1b}[2J\u{9b}1m"),
            "\u{fffd}]0;owned\u{fffd}\u{fffd}\u{fffd}[2J\u{fffd}1m"
        );
    }
}
