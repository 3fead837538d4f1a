//! Exit codes, and messages about failures.

use crate::batch::BatchError;
use crate::dataset::{DatasetError, JournalError};
use crate::document::Problems;
use crate::run::{Ending, Halt};
use miette::Report;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

/// Done, but not accepted by the rule, or not decided.
pub const NOT_ACCEPTED: u8 = 1;
/// Exit code of an invalid recipe, rig or command line. Nothing was moved.
const USAGE: u8 = 2;
/// Exit code of a device that failed.
const DEVICE: u8 = 3;
/// Exit code of a broken safety rule.
const TRIP: u8 = 4;
/// Exit code of a record that couldn't be kept.
const RECORD: u8 = 5;
/// Cancelled by a person, and parked.
pub const CANCELLED: u8 = 130;

/// Reason why a subcommand failed, and its exit code.
#[derive(Debug)]
pub struct Failure {
    code: u8,
    report: Report,
}

impl Failure {
    /// Bad input; nothing was moved.
    pub fn usage(report: impl Into<Report>) -> Failure {
        Failure { code: USAGE, report: report.into() }
    }

    /// The command ended, but its measurements can't be evaluated.
    pub fn not_accepted(report: impl Into<Report>) -> Failure {
        Failure { code: NOT_ACCEPTED, report: report.into() }
    }

    /// A result couldn't be written.
    pub fn unwritten(report: impl Into<Report>) -> Failure {
        Failure { code: RECORD, report: report.into() }
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
            DatasetError::Io { .. } | DatasetError::Journal(JournalError::Io { .. }) => RECORD,
        };
        Failure { code, report: error.into() }
    }

    /// The folder of a new run couldn't be made.
    pub fn unmade(error: DatasetError) -> Failure {
        match error {
            DatasetError::Io { doing, path, why } if why.kind() != ErrorKind::InvalidInput => {
                let help = "nothing was pressed: choose another --out, or free disk space and correct the permissions";
                let report = miette::miette!(help = help, "{doing} {}: {why}", path.display());
                Failure { code: RECORD, report }
            }
            error => Failure::dataset(error),
        }
    }

    /// What was measured couldn't be finished: something has moved by then.
    pub fn unfinished(error: DatasetError) -> Failure {
        Failure { code: RECORD, report: error.into() }
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
            Halt::Cancelled => Failure { code: CANCELLED, report: miette::miette!("cancelled") },
            Halt::Tripped(trip) => {
                let help = "find the cause before going on";
                Failure { code: TRIP, report: miette::miette!(help = help, "safety trip: {trip}") }
            }
            Halt::Device(error) => Failure { code: DEVICE, report: error.into() },
            Halt::Record(error) => Failure { code: RECORD, report: error.into() },
            Halt::Unconfirmed(why) => Failure { code: USAGE, report: miette::miette!("{why}") },
        }
    }

    /// The load cell can't be trusted.
    pub fn untrusted(report: impl Into<Report>) -> Failure {
        Failure { code: TRIP, report: report.into() }
    }

    /// A walk that ended early, and may have left the stage where it was.
    pub fn ended(ending: Ending) -> Failure {
        let Ending { halt, unparked, .. } = ending;
        match (&halt, &unparked) {
            (_, Some(_)) => say("the stage could not be parked: move it clear of the specimen by hand"),
            (Some(Halt::Record(_)), None) => say("the stage is parked"),
            _ => {}
        }
        match (halt, unparked) {
            (Some(halt), Some(unparked)) => {
                _ = Failure::halted(unparked).report(); // said even if it is not what the exit code is about
                Failure::halted(halt)
            }
            (Some(halt), None) | (None, Some(halt)) => Failure::halted(halt),
            (None, None) => Failure::halted(Halt::Cancelled), // never: such a walk didn't end early
        }
    }

    /// Prints the failure, and returns its exit code.
    pub fn report(self) -> ExitCode {
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
}

/// Prints a text. If the terminal has been closed, nothing is shown, but the exit code is still returned.
fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}
