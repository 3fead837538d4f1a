//! How a command prints its result: as text, or as one JSON object.

use super::summary::print;
use crate::api::Failure;
use miette::IntoDiagnostic as _;
use serde::Serialize;

/// Form of the result.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct OutputArgs {
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

impl OutputArgs {
    /// Prints the text, or the same content as one line of JSON.
    pub(super) fn print(self, text: &str, content: &impl Serialize) -> Result<(), Failure> {
        self.text(text)?;
        self.object(content)
    }

    /// Prints a part of the text as soon as it is known, so that a failure of a later step doesn't lose it.
    pub(super) fn text(self, text: &str) -> Result<(), Failure> {
        if self.json { Ok(()) } else { print(text) }
    }

    /// Prints the content at the end, if it is asked for instead of the text.
    pub(super) fn object(self, content: &impl Serialize) -> Result<(), Failure> {
        if self.json { print(&json_line(content)?) } else { Ok(()) }
    }
}

/// Returns a line with one JSON object.
pub(super) fn json_line(content: &impl Serialize) -> Result<String, Failure> {
    Ok(serde_json::to_string(content).into_diagnostic().map_err(Failure::usage)? + "\n")
}
