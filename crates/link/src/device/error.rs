//! Error of a device.

use miette::Diagnostic;
use palpate_core::quantity::{shortened, shown};
use thiserror::Error;

/// A device failed to do a requested task: the device, the task, the answer, and the next step.
#[derive(Debug, Error)]
#[error("{device}: while {doing}: {problem}")]
pub struct DeviceError {
    /// Role and instrument, such as `stage (ESP301)`.
    pub device: String,
    /// Task that was under way.
    pub doing: String,
    /// Answer of the device, or its absence.
    pub problem: DeviceProblem,
}

/// Answer or problem. Text from a device is shown shortened and without control characters that a terminal would execute.
#[derive(Debug, Error)]
pub enum DeviceProblem {
    /// The link failed or stayed silent.
    #[error("{}", shown(.0))]
    Link(String),
    /// This program may not use the link.
    #[error("{}", shown(.0))]
    Claim(String),
    /// The program of the rig file can't be started.
    #[error("{}", shown(.0))]
    NotStarted(String),
    /// The program of the rig file has ended.
    #[error("{}", shown(.0))]
    Ended(String),
    /// The answer makes no sense.
    #[error("it answered {:?}, expected {expected}", shortened(.answer))]
    Misfit {
        /// Received answer.
        answer: String,
        /// Expected answer.
        expected: String,
    },
    /// The device refused, in its own words.
    #[error("it reports: {}", shown(.0))]
    Refused(String),
    /// The device works but differs from the rig file.
    #[error("{}", shown(.0))]
    Mismatch(String),
    /// Settings of the device differ from the rig file; each with what to change, in the order in which the device takes the changes.
    #[error("{}", listed(.0))]
    Settings(Vec<String>),
    /// The controller ended a motion itself, at the force of its guard.
    #[error("its guard ended the motion at a force of {limit_n:.3} N or more")]
    Guarded {
        /// The guard's force, N, the cell's own zero included.
        limit_n: f64,
    },
    /// A motion ended slightly off its target, and the controller reported no error.
    #[error("{}", shown(.0))]
    Coarse(String),
    /// A motion didn't end, or ended at the wrong position.
    #[error("{}", shown(.0))]
    Motion(String),
}

impl Diagnostic for DeviceError {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        Some(Box::new(match self.problem {
            DeviceProblem::Link(_) => {
                "check that the device is on, its cable, and the address in the rig file; `palpate ports` lists ports; --simulate needs no device"
            }
            DeviceProblem::NotStarted(_) => {
                "check the spelling of the program in the rig file's `process`, or give its path"
            }
            DeviceProblem::Ended(_) => {
                "see the program's own messages above and correct it; then repeat the command, or continue a run with `palpate resume`"
            }
            DeviceProblem::Claim(_) => {
                "only one program at a time can use a device; palpate uses a lock file in the temporary folder"
            }
            DeviceProblem::Misfit { .. } => {
                "check that the driver in the rig file fits the device, and that no other program talks to it"
            }
            DeviceProblem::Refused(_) => {
                "find the message in the device's manual and clear its cause; then repeat the command, or continue a run with `palpate resume`"
            }
            DeviceProblem::Mismatch(_) | DeviceProblem::Settings(_) => {
                "change the rig file or the device's settings so that they agree"
            }
            DeviceProblem::Guarded { .. } => "check the specimen and the load cell before you continue",
            DeviceProblem::Coarse(_) => {
                "state the stage's steps as `step_mm` of [stage], or use finer ones (microsteps, encoder); also check the axis for friction and backlash"
            }
            DeviceProblem::Motion(_) => {
                "find what blocks the stage and clear it; then repeat the command, or continue a run with `palpate resume`"
            }
        }))
    }
}

/// Returns one text as it is, and several as a list with a line for each.
fn listed(texts: &[String]) -> String {
    match texts {
        [text] => shown(text),
        texts => {
            let lines = texts.iter().map(|text| format!("\n  - {}", shown(text)));
            format!("{} settings differ from the rig:{}", texts.len(), lines.collect::<String>())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::quantity::{Identity, SHOWN_MAX_CHARS};

    #[test]
    fn errors_and_identities_have_their_text() {
        let rude = format!("\u{1b}]0;title\u{7}{}", "x".repeat(10 * SHOWN_MAX_CHARS));
        let problems: [fn(String) -> DeviceProblem; 6] = [
            DeviceProblem::Link,
            DeviceProblem::Claim,
            DeviceProblem::Refused,
            DeviceProblem::Mismatch,
            DeviceProblem::Motion,
            |answer| DeviceProblem::Misfit { answer, expected: "a number".to_owned() },
        ];
        for problem in problems {
            let (device, doing) = ("stage".to_owned(), "moving".to_owned());
            let words = DeviceError { device, doing, problem: problem(rude.clone()) }.to_string();
            assert!(!words.contains(char::is_control) && words.chars().count() < SHOWN_MAX_CHARS + 100, "{words}");
        }
        let (role, link) = ("stage".to_owned(), "link".to_owned());
        let identity = Identity { role, identity: rude.clone(), link, warnings: vec![rude] }.shown();
        for text in [&identity.identity, &identity.warnings[0]] {
            assert!(!text.contains(char::is_control) && text.chars().count() == SHOWN_MAX_CHARS + 1, "{text}");
        }
    }
}
