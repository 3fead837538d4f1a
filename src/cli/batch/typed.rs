//! Lines that a person or a scanner types.

use super::super::signals::{forget_typed, is_attended};
use crate::api::Failure;
use palpate_run::run::Cancel;
use std::io::{self, BufRead, Read};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// Longest line that is read, bytes. The rest of a longer line is skipped.
const LINE_MOST: u64 = 1024;

/// Interval of checks whether a person requested a stop instead of a line.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// What came instead of waiting.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Typed {
    /// A line, without blanks at its ends.
    Line(String),
    /// The input has ended.
    End,
    /// A person requested a stop.
    Cancelled,
}

/// Waits for the next line. At a terminal, a line that was typed earlier doesn't count: a scan during a run would start the next
/// sensor while a person has their hands in the rig.
pub(super) fn next_line(cancel: &Cancel, prompt: impl FnOnce() -> Result<(), Failure>) -> Result<Typed, Failure> {
    cancel.go_on(); // a pause from the last press has nothing to wait for
    cancel.preparing(); // so that Ctrl-C is a stop
    if is_attended() {
        forget_typed();
        prompt()?;
    }
    let (sender, receiver) = channel();
    // it ends with the program if nobody types
    let reader =
        thread::Builder::new().name("typed".to_owned()).spawn(move || sender.send(read_line(io::stdin().lock())));
    reader.map_err(|error| Failure::usage(miette::miette!("can't read what is typed: {error}")))?;
    loop {
        match receiver.recv_timeout(LOOK_EVERY) {
            Ok(Ok(Some(line))) => return Ok(Typed::Line(line)),
            // a terminal that is gone reads as an error
            Ok(_) | Err(RecvTimeoutError::Disconnected) => return Ok(Typed::End),
            Err(RecvTimeoutError::Timeout) if cancel.asked() => return Ok(Typed::Cancelled),
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}

/// Reads a line; `None` at the end of the input.
fn read_line(mut from: impl BufRead) -> io::Result<Option<String>> {
    let mut line = Vec::new();
    if from.by_ref().take(LINE_MOST).read_until(b'\n', &mut line)? == 0 {
        return Ok(None);
    }
    let mut rest = line.clone();
    while rest.last() != Some(&b'\n') {
        rest.clear();
        if from.by_ref().take(LINE_MOST).read_until(b'\n', &mut rest)? == 0 {
            break;
        }
    }
    Ok(Some(String::from_utf8_lossy(&line).trim().to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_one_by_one_and_a_long_one_is_cut() {
        let long = "x".repeat(3000);
        let text = format!("A-1\r\n\n {long}\nA-2");
        let mut from = text.as_bytes();
        let mut next = || read_line(&mut from).unwrap();
        assert_eq!(next().as_deref(), Some("A-1"));
        assert_eq!(next().as_deref(), Some(""));
        assert_eq!(next().map(|line| line.len()), Some(LINE_MOST as usize - 1));
        assert_eq!((next().as_deref(), next()), (Some("A-2"), None));
    }
}
