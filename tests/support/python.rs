//! Programs of others, written in Python: run with the interpreter that `PALPATE_PYTHON` names.
//!
//! Neither it nor any package is needed to build or test the project: what isn't there is skipped, and said to be.

use super::skips::skipped;
use super::{Live, Told, shipped};
use std::ffi::{OsStr, OsString};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// Longest that one may be still; the longest takes a quarter of it.
const PATIENCE: Duration = Duration::from_secs(60);

/// An interpreter that has what a test needs.
pub(crate) struct Python {
    interpreter: OsString,
}

impl Python {
    /// The interpreter, if it takes this statement (`import pymodbus`); else `test` is said to be skipped.
    pub(crate) fn with(test: &str, statement: &str) -> Option<Python> {
        let Some(interpreter) = std::env::var_os("PALPATE_PYTHON").filter(|name| !name.is_empty()) else {
            skipped(test, "PALPATE_PYTHON names no interpreter (tests/outside/requirements.txt has its packages)");
            return None;
        };
        let python = Python { interpreter };
        let tried = python.command().args(["-c", statement]).output();
        let reason = match tried {
            Ok(Output { status, .. }) if status.success() => return Some(python),
            Ok(Output { stderr, .. }) => String::from_utf8_lossy(&stderr).lines().last().unwrap_or_default().to_owned(),
            Err(error) => error.to_string(),
        };
        skipped(test, &format!("{}: {reason}", python.interpreter.display()));
        None
    }

    /// The interpreter with a script of `tests/outside` and its arguments.
    pub(crate) fn script(&self, name: &str, words: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Command {
        let mut command = self.command();
        command.arg(shipped("tests/outside").join(name)).args(words);
        command
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.interpreter);
        command.env("PYTHONDONTWRITEBYTECODE", "1").env("PYTHONUNBUFFERED", "1").stdin(Stdio::null());
        command
    }
}

/// Runs a program to its end, which must be a good one, and gives what it said on standard output.
pub(crate) fn said(command: Command) -> String {
    let described = format!("{command:?}");
    let Told { code, out, err } = Live::start(command).end_within(PATIENCE);
    assert_eq!(code, Some(0), "{described}\n{out}\n{err}");
    out
}
