//! Why a command failed: kinds of failures with their exit codes, and the message.

use miette::Report;
use palpate_data::dataset::{DatasetError, JournalError};
use palpate_document::Problems;
use palpate_run::batch::BatchError;
use palpate_run::run::{Ending, Halt, Remaining};
use std::fmt;
use std::io::ErrorKind;

/// Kind of a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FailureKind {
    /// Done, but not accepted by the rule, not decided, or without a result that can be judged.
    NotAccepted,
    /// An invalid recipe, rig, table or option. Nothing was moved.
    Usage,
    /// A device failed.
    Device,
    /// A safety rule was broken.
    Trip,
    /// A record or a result couldn't be stored.
    Record,
    /// A person cancelled, and the stage is parked.
    Cancelled,
}

impl FailureKind {
    /// Returns the exit code of a command that ends like this.
    pub const fn code(self) -> u8 {
        match self {
            FailureKind::NotAccepted => 1,
            FailureKind::Usage => 2,
            FailureKind::Device => 3,
            FailureKind::Trip => 4,
            FailureKind::Record => 5,
            FailureKind::Cancelled => 130,
        }
    }
}

/// Reason why a command failed.
///
/// [`Display`](fmt::Display) prints plain lines: the causes of a failure in one line, its help in the next.
#[derive(Debug)]
pub struct Failure {
    kind: FailureKind,
    report: Report,
    /// Where the stage is, if a run left it.
    stage: Option<String>,
    /// A failure that is reported first; the exit code isn't about it.
    before: Option<Box<Failure>>,
}

impl Failure {
    fn new(kind: FailureKind, report: impl Into<Report>) -> Failure {
        Failure { kind, report: report.into(), stage: None, before: None }
    }

    /// Bad input; nothing was moved.
    pub fn usage(report: impl Into<Report>) -> Failure {
        Failure::new(FailureKind::Usage, report)
    }

    /// An option has a value that it can't have; `why` states what it can have.
    pub(crate) fn option(option: &str, value: impl fmt::Display, why: &str) -> Failure {
        Failure::usage(miette::miette!("invalid value '{value}' for '{option}': {why}"))
    }

    /// The command ended, but its measurements can't be evaluated.
    pub fn not_accepted(report: impl Into<Report>) -> Failure {
        Failure::new(FailureKind::NotAccepted, report)
    }

    /// A result couldn't be written.
    pub fn unwritten(report: impl Into<Report>) -> Failure {
        Failure::new(FailureKind::Record, report)
    }

    /// The record couldn't be made or read.
    pub fn dataset(error: DatasetError) -> Failure {
        let kind = match error {
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
            | DatasetError::Series { .. }
            | DatasetError::Journal(
                JournalError::Damaged { .. } | JournalError::Format { .. } | JournalError::Kind { .. },
            ) => FailureKind::Usage,
            // not a regular file: nothing was read from it or written to it
            DatasetError::Io { ref why, .. } | DatasetError::Journal(JournalError::Io { ref why, .. })
                if why.kind() == ErrorKind::InvalidInput =>
            {
                FailureKind::Usage
            }
            DatasetError::Io { .. }
            | DatasetError::Readings(_)
            | DatasetError::Journal(JournalError::Io { .. } | JournalError::Displaced { .. }) => FailureKind::Record,
        };
        Failure::new(kind, error)
    }

    /// The folder of a new run couldn't be made.
    pub fn unmade(error: DatasetError) -> Failure {
        match error {
            DatasetError::Io { doing, path, why } if why.kind() != ErrorKind::InvalidInput => {
                let help = "nothing was pressed: choose another --out, or free disk space and correct the permissions";
                let report = miette::miette!(help = help, "{doing} {}: {why}", path.display());
                Failure::new(FailureKind::Record, report)
            }
            error => Failure::dataset(error),
        }
    }

    /// What was measured couldn't be finished: something has moved by then.
    pub fn unfinished(error: DatasetError) -> Failure {
        Failure::new(FailureKind::Record, error)
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
            Halt::Cancelled => Failure::new(FailureKind::Cancelled, miette::miette!("cancelled")),
            Halt::Tripped(trip) => {
                let help = "find the cause before you continue";
                Failure::new(FailureKind::Trip, miette::miette!(help = help, "safety trip: {trip}"))
            }
            Halt::OutOfBounds(text) => {
                let help = "bring the value within its bounds, then continue with `palpate resume`";
                Failure::new(FailureKind::Cancelled, miette::miette!(help = help, "{text}"))
            }
            Halt::Device(error) | Halt::Missed(error) => Failure::new(FailureKind::Device, error),
            Halt::Record(error) => Failure::new(FailureKind::Record, error),
            Halt::Unconfirmed(why) => Failure::new(FailureKind::Usage, miette::miette!("{why}")),
        }
    }

    /// The load cell can't be trusted.
    pub fn untrusted(report: impl Into<Report>) -> Failure {
        Failure::new(FailureKind::Trip, report)
    }

    /// A run ended by a fault of the program itself.
    pub(crate) fn of_panic() -> Failure {
        let help = "move the stage clear of the specimen by hand";
        Failure::new(FailureKind::Device, miette::miette!(help = help, "the run ended by a fault of this program"))
    }

    /// A run that ended early, and may have left the stage where it was.
    pub fn ended(ending: Ending) -> Failure {
        let Ending { halt, unparked, remaining, largest, .. } = ending;
        let parked = match (&halt, &unparked) {
            (_, Some(_)) => Some("the stage could not be parked: move it clear of the specimen by hand".to_owned()),
            (Some(Halt::Tripped(_)), None) => Some("the stage is parked at the end of z's travel".to_owned()),
            (Some(Halt::Record(_) | Halt::OutOfBounds(_)), None) => Some("the stage is parked".to_owned()),
            _ => None,
        };
        let stage: Vec<String> =
            parked.into_iter().chain(remaining.text()).chain(largest.map(|largest| largest.text())).collect();
        let stage = (!stage.is_empty()).then(|| stage.join("; "));
        let (halt, unparked) = match (halt, unparked) {
            (Some(halt), unparked) => (halt, unparked),
            (None, Some(unparked)) => (unparked, None),
            (None, None) => (Halt::Cancelled, None), // never: such a run didn't end early
        };
        let before = unparked.map(|why| Box::new(Failure::halted(why)));
        let failure = Failure::halted(halt);
        // a person who cancelled isn't told that the stage is parked
        let is_pressed = failure.kind == FailureKind::Cancelled && matches!(remaining, Remaining::Force(_));
        let kind = if is_pressed { FailureKind::Device } else { failure.kind };
        Failure { stage, before, kind, ..failure }
    }

    /// The same, after another failure.
    pub fn after(self, before: Failure) -> Failure {
        Failure { before: Some(Box::new(before)), ..self }
    }

    /// Returns the kind of the failure.
    pub fn kind(&self) -> FailureKind {
        self.kind
    }

    /// Returns the parts in the order in which they are reported: where the stage is, each earlier failure, and the failure itself.
    pub(crate) fn into_parts(self) -> (Option<String>, Option<Box<Failure>>, Report) {
        (self.stage, self.before, self.report)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.stage.iter().try_for_each(|stage| writeln!(f, "{stage}"))?;
        self.before.iter().try_for_each(|before| writeln!(f, "{before}"))?;
        match self.report.downcast_ref::<Problems>() {
            Some(problems) => {
                problems.text().try_for_each(|(line, help)| writeln!(f, "{line}{}", helped(help)))?;
                write!(f, "{problems}; nothing was done")
            }
            None => f.write_str(&plain(&self.report)),
        }
    }
}

impl std::error::Error for Failure {}

/// Returns a report with its causes in one line, and its advice in another.
fn plain(report: &Report) -> String {
    let causes: Vec<String> = report.chain().map(ToString::to_string).collect();
    let help = report.help().map(|help| help.to_string());
    causes.join(": ") + &helped(help.as_deref())
}

fn helped(help: Option<&str>) -> String {
    help.map_or_else(String::new, |help| format!("\nhelp: {help}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_run::run::LargestForce;

    #[test]
    fn a_cancelled_run_that_still_presses_is_no_cancelled_run() {
        let ended = |remaining| Failure::ended(Ending { remaining, ..Ending::halted(Halt::Cancelled) });
        assert_eq!(ended(Remaining::Nothing).kind(), FailureKind::Cancelled);
        let largest = Some(LargestForce { force_n: 4.9, is_least: true, by_depth_n: None });
        let over = Failure::ended(Ending { largest, ..Ending::halted(Halt::Cancelled) });
        let text = "the largest force was at least 4.90 N, the end of the load cell's range";
        assert_eq!(over.into_parts().0.as_deref(), Some(text));
        let deep = largest.map(|largest| LargestForce { by_depth_n: Some(7.2), ..largest });
        let over = Failure::ended(Ending { largest: deep, ..Ending::halted(Halt::Cancelled) });
        let text = format!("{text}; by the depth at the stop and the declared stiffness up to 7.20 N");
        assert_eq!(over.into_parts().0, Some(text));
        let pressed = ended(Remaining::Force(0.99));
        assert_eq!(pressed.kind(), FailureKind::Device);
        assert_eq!(pressed.into_parts().0.as_deref(), Some("0.99 N remain on the specimen"));
    }
}
