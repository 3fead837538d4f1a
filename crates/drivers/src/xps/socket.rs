//! One socket of an XPS: sends a call and receives its answer.

use super::text::{XpsReply, error_name, parse_answer};
use palpate_link::device::{DeviceError, DeviceProblem};
use palpate_link::time::Instant;
use palpate_link::wire::{Connector, LineLink, WireError, silent};
use std::time::Duration;

/// End of every answer (PROTOCOLS: socket interface of the programmer's manual).
const END: &str = "EndOfAPI";

/// Longest accepted answer, bytes. The list of all errors would be longer, but it isn't requested.
const ANSWER_MAX_BYTES: usize = 4096;

/// One socket of the controller, for one call at a time. Answers have no number. So a socket is closed if its answer didn't come;
/// a new socket can't receive that answer.
pub(super) struct Socket {
    lines: LineLink,
    device: String,
    /// Call whose answer is still expected.
    owed: Option<String>,
}

impl Socket {
    /// Creates a socket that is opened when it is first needed. `device` names it in messages.
    pub(super) fn new(connector: Connector, device: String) -> Self {
        Socket { lines: LineLink::new(connector, END, ANSWER_MAX_BYTES), device, owed: None }
    }

    /// Calls a function and waits for its answer.
    ///
    /// # Errors
    /// The controller's error by name, no answer in time, or an invalid answer.
    pub(super) async fn call(
        &mut self,
        doing: &str,
        call: &str,
        deadline: Duration,
    ) -> Result<Vec<String>, DeviceError> {
        match self.call_plainly(doing, call, deadline).await? {
            XpsReply { code: 0, values } => Ok(values),
            XpsReply { code, .. } => Err(self.refused(doing, call, code)),
        }
    }

    /// Does the same, but treats an error code as a normal answer.
    ///
    /// # Errors
    /// No answer in time, or an invalid answer.
    pub(super) async fn call_plainly(
        &mut self,
        doing: &str,
        call: &str,
        deadline: Duration,
    ) -> Result<XpsReply, DeviceError> {
        self.begin(doing, call, deadline).await?;
        let answer = self.answer_by(doing, Instant::now() + deadline).await?;
        answer.ok_or_else(|| {
            self.close();
            self.error(doing, DeviceProblem::Link(silent(call, deadline).to_string()))
        })
    }

    /// Sends a call; its answer is awaited later.
    ///
    /// # Errors
    /// Errors of the link.
    pub(super) async fn begin(&mut self, doing: &str, call: &str, deadline: Duration) -> Result<(), DeviceError> {
        // discard late and unsolicited replies
        if self.owed.is_some() || self.lines.something_came().await {
            self.close();
        }
        let sent = self.lines.send(call.as_bytes(), deadline).await;
        sent.map_err(|error| self.failed(doing, &error))?;
        self.owed = Some(call.to_owned());
        Ok(())
    }

    /// Returns the expected answer, if it comes before `until`. The future may be dropped while it waits.
    ///
    /// # Errors
    /// Errors of the link, or an invalid answer.
    pub(super) async fn answer_by(&mut self, doing: &str, until: Instant) -> Result<Option<XpsReply>, DeviceError> {
        let text = match self.lines.next_by(until).await {
            Ok(Some(text)) => text,
            Ok(None) => return Ok(None),
            Err(error) => return Err(self.failed(doing, &error)),
        };
        let call = self.owed.take().unwrap_or_default();
        match parse_answer(&text, &call) {
            Some(answer) => Ok(Some(answer)),
            None => {
                self.close();
                let expected = format!("the answer to {call}");
                Err(self.error(doing, DeviceProblem::Misfit { answer: text, expected }))
            }
        }
    }

    /// Whether an answer is still expected.
    pub(super) fn is_owed(&self) -> bool {
        self.owed.is_some()
    }

    /// Closes the socket; the next call opens it again.
    pub(super) fn close(&mut self) {
        self.owed = None;
        self.lines.close();
    }

    /// Returns the error that a call was answered with an error code.
    pub(super) fn refused(&self, doing: &str, call: &str, code: i32) -> DeviceError {
        self.error(doing, DeviceProblem::Refused(format!("error {code} ({}) to {call}", error_name(code))))
    }

    /// Returns an error of this device.
    pub(super) fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError { device: self.device.clone(), doing: doing.to_owned(), problem }
    }

    fn failed(&mut self, doing: &str, error: &WireError) -> DeviceError {
        self.close();
        self.error(doing, DeviceProblem::Link(error.to_string()))
    }
}
