//! Programs of others in Python, run with the interpreter that `PALPATE_PYTHON` names.
//!
//! The tests that need it are ignored by default. They fail if something is missing.

use super::{CommandOutput, Live, shipped};
use std::ffi::{OsStr, OsString};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// Longest silence of a program; the longest takes a quarter of it.
const PATIENCE: Duration = Duration::from_secs(300);

/// The list of packages.
const PACKAGES: &str = "tests/outside/requirements.txt";

/// An interpreter with everything that a test needs.
pub struct Python {
    interpreter: OsString,
}

impl Python {
    /// The interpreter, which must accept this statement: `import pymodbus`.
    pub fn with(statement: &str) -> Python {
        let interpreter = std::env::var_os("PALPATE_PYTHON").filter(|name| !name.is_empty());
        let interpreter = interpreter.unwrap_or_else(|| {
            panic!("PALPATE_PYTHON names no interpreter: install one with the packages of {PACKAGES}, and name it")
        });
        let python = Python { interpreter };
        let tried = python.command().args(["-c", statement]).output();
        let reason = match tried {
            Ok(Output { status, .. }) if status.success() => return python,
            Ok(Output { stderr, .. }) => String::from_utf8_lossy(&stderr).lines().last().unwrap_or_default().to_owned(),
            Err(error) => error.to_string(),
        };
        panic!("{}: {reason}. Install the packages of {PACKAGES}", python.interpreter.display());
    }

    /// The interpreter with a script of `tests/outside` and its arguments.
    pub fn script(&self, name: &str, words: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Command {
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

/// Runs a program to its successful end, and returns its standard output.
pub fn said(command: Command) -> String {
    let described = format!("{command:?}");
    let CommandOutput { code, out, err } = Live::start(command).end_within(PATIENCE);
    assert_eq!(code, Some(0), "{described}\n{out}\n{err}");
    out
}
