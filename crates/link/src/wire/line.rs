//! Questions and answers of one line each.

use super::Connector;
use super::lines::{LineLink, WireError, silent};
use crate::time::Instant;
use std::time::Duration;
use tokio::sync::Notify;

/// Longest accepted answer line, bytes. The longest real line is an error text of some 60.
const LINE_MAX_BYTES: usize = 1024;

/// Silence after which a link that lost synchronisation counts as quiet.
const QUIET: Duration = Duration::from_millis(100);

/// Largest number of answers that are discarded while a link is synchronised again.
const STRAY_LINES_MAX: usize = 64;

/// Urgent line that a waiting exchange sends at once on request, before its answer has come. The line has no answer itself.
pub struct Urgent<'a> {
    /// Notified when there is something to send.
    pub asked: &'a Notify,
    /// Line to send then, if there is still one.
    pub line: &'a dyn Fn() -> Option<String>,
}

/// One request at a time over a line protocol. Sent lines end with CR and received lines with CR LF (ESP300 manual, RS-232).
///
/// An exchange that isn't finished (no answer, or its future dropped) leaves the link out of step. The next exchange first
/// resynchronises: it waits for quiet, asks the `marker` question and discards lines up to its answer.
pub struct LineExchange {
    lines: LineLink,
    deadline: Duration,
    marker: Marker,
    out_of_step: bool,
}

/// Harmless question whose answer can't be confused with another answer.
#[derive(Clone, Copy, Debug)]
struct Marker {
    question: &'static str,
    answer_contains: &'static str,
}

impl LineExchange {
    /// Creates an exchange over a link that is opened when it is first needed. `question` is harmless, and only its answer
    /// contains `answer_contains`.
    pub fn new(
        connector: Connector,
        deadline: Duration,
        question: &'static str,
        answer_contains: &'static str,
    ) -> Self {
        let marker = Marker { question, answer_contains };
        LineExchange { lines: LineLink::new(connector, "\n", LINE_MAX_BYTES), deadline, marker, out_of_step: false }
    }

    /// Sends a line that has no answer.
    ///
    /// # Errors
    /// Errors of the link.
    pub async fn tell(&mut self, line: &str) -> Result<(), WireError> {
        self.bring_back_in_step(None).await?;
        self.send(line).await
    }

    /// Sends a line at once, in step or not, because a stop waits for nothing.
    ///
    /// # Errors
    /// Errors of the link.
    pub async fn tell_now(&mut self, line: &str) -> Result<(), WireError> {
        self.send(line).await
    }

    /// Sends a question and returns its answer without the line end.
    ///
    /// # Errors
    /// As [`ask_all`](Self::ask_all).
    pub async fn ask(&mut self, question: &str) -> Result<String, WireError> {
        Ok(self.ask_all(question, 1, None).await?.pop().unwrap_or_default())
    }

    /// Sends a line of questions and returns their answers, one line each. An urgent line is sent at once during the wait.
    ///
    /// # Errors
    /// No answer in time, or errors of the link.
    pub async fn ask_all(
        &mut self,
        question: &str,
        lines: usize,
        urgent: Option<&Urgent<'_>>,
    ) -> Result<Vec<String>, WireError> {
        // unrequested bytes would be taken for the answer
        if self.lines.something_came().await {
            self.out_of_step = true;
        }
        self.bring_back_in_step(urgent).await?;
        self.out_of_step = true;
        let answer = self.ask_in_step(question, lines, urgent).await?;
        self.out_of_step = false;
        Ok(answer)
    }

    /// Reports that the last answer made no sense, so that the next exchange resynchronises first.
    pub fn misfit(&mut self) {
        self.out_of_step = true;
    }

    async fn ask_in_step(
        &mut self,
        question: &str,
        lines: usize,
        urgent: Option<&Urgent<'_>>,
    ) -> Result<Vec<String>, WireError> {
        self.send(question).await?;
        let until = Instant::now() + self.deadline;
        let mut answers = Vec::with_capacity(lines);
        while answers.len() < lines {
            answers.push(self.line_by(until, urgent).await?.ok_or_else(|| self.silent(question))?);
        }
        Ok(answers)
    }

    async fn bring_back_in_step(&mut self, urgent: Option<&Urgent<'_>>) -> Result<(), WireError> {
        if !self.out_of_step {
            return Ok(());
        }
        for _ in 0..STRAY_LINES_MAX {
            if self.line_by(Instant::now() + QUIET, urgent).await?.is_none() {
                break;
            }
        }
        self.lines.forget();
        let Marker { question, answer_contains } = self.marker;
        self.send(question).await?;
        let until = Instant::now() + self.deadline;
        for _ in 0..STRAY_LINES_MAX {
            match self.line_by(until, urgent).await? {
                Some(line) if line.contains(answer_contains) => {
                    self.out_of_step = false;
                    return Ok(());
                }
                Some(_) => {}
                None => break,
            }
        }
        Err(self.silent(question))
    }

    /// Returns the next line before the deadline, or `None`. An urgent line is sent at once, during any wait.
    async fn line_by(&mut self, until: Instant, urgent: Option<&Urgent<'_>>) -> Result<Option<String>, WireError> {
        loop {
            let line = match urgent {
                None => self.lines.next_by(until).await,
                Some(urgent) => {
                    tokio::select! {
                        biased;
                        () = urgent.asked.notified() => {
                            if let Some(line) = (urgent.line)() {
                                self.send(&line).await?;
                            }
                            continue;
                        }
                        line = self.lines.next_by(until) => line,
                    }
                }
            };
            return line;
        }
    }

    fn silent(&self, request: &str) -> WireError {
        silent(request, self.deadline)
    }

    async fn send(&mut self, line: &str) -> Result<(), WireError> {
        self.lines.send(format!("{line}\r").as_bytes(), self.deadline).await
    }
}
