//! One program: sends requests and receives answers, matched by their numbers.

use palpate_link::device::{DeviceError, DeviceProblem, Identity, MotionOrders};
use palpate_link::time::Instant;
use palpate_link::wire::{Connector, LineLink, WireError, silent};
use serde_json::{Map, Value, json};
use std::io::ErrorKind;
use std::time::Duration;

/// Number of the protocol version of a role (docs/reference/process.md). A stage of version 1 was moved to places.
fn protocol(role: &str) -> u64 {
    if role == "stage" { 2 } else { 1 }
}

/// Longest line (docs/reference/process.md), bytes.
const LINE_MAX_BYTES: usize = 65_536;

/// Longest wait for an answer (docs/reference/process.md). The second constant is the longest wait for the answer to `prepare`.
pub(super) const ANSWER_DEADLINE: Duration = Duration::from_secs(2);
pub(super) const PREPARE_DEADLINE: Duration = Duration::from_secs(120);

/// Longest wait for a reading of a load cell that has a reading ready at any time. It is twice the age at which a reading is
/// stale and a motion is stopped, so a late reading is still reported as late. Under load, nothing waits longer.
pub(super) const FORCE_DEADLINE: Duration = Duration::from_millis(500);

/// Largest number of lines that are ignored while an answer is awaited: late answers, or lines that aren't answers.
const STRAY_LINES_MAX: usize = 64;

/// JSON object.
pub(super) type JsonObject = Map<String, Value>;

/// Program that is reached through its standard input and output.
pub(super) struct ProgramPort {
    lines: LineLink,
    role: &'static str,
    link: String,
    next_id: u64,
    /// Longest wait for the answer to `identify`: the program may still start.
    start: Duration,
    /// Whether the program ended. It isn't started again, because a new program doesn't know the device's position.
    ended: bool,
}

impl ProgramPort {
    pub(super) fn new(connector: Connector, role: &'static str, link: String, start: Duration) -> Self {
        ProgramPort {
            lines: LineLink::new(connector, "\n", LINE_MAX_BYTES),
            role,
            link,
            next_id: 1,
            start,
            ended: false,
        }
    }

    /// Asks for the program's identity and checks that it plays the intended role.
    pub(super) async fn identify(&mut self) -> Result<(Identity, JsonObject), DeviceError> {
        let doing = "identifying it";
        let said = self.ask_within(doing, "identify", JsonObject::new(), None, self.start).await?;
        let misfit = |expected: String| self.misfit(doing, &said, expected);
        if said.get("role").and_then(Value::as_str) != Some(self.role) {
            return Err(misfit(format!("\"role\": \"{}\"", self.role)));
        }
        let version = protocol(self.role);
        if said.get("protocol").and_then(Value::as_u64) != Some(version) {
            return Err(misfit(format!(
                "\"protocol\": {version}, the number of docs/reference/process.md for this role"
            )));
        }
        let Some(identity) = said.get("identity").and_then(Value::as_str) else {
            return Err(misfit("\"identity\" as a string".to_owned()));
        };
        let identity = Identity {
            role: self.role.to_owned(),
            identity: identity.to_owned(),
            link: self.link.clone(),
            warnings: Vec::new(),
        };
        Ok((identity, said))
    }

    /// Returns the answer to a request. Orders during this time are sent at once.
    pub(super) async fn ask(
        &mut self,
        doing: &str,
        what: &str,
        with: JsonObject,
        orders: Option<&MotionOrders>,
    ) -> Result<JsonObject, DeviceError> {
        self.ask_within(doing, what, with, orders, ANSWER_DEADLINE).await
    }

    pub(super) async fn ask_within(
        &mut self,
        doing: &str,
        what: &str,
        mut request: JsonObject,
        orders: Option<&MotionOrders>,
        deadline: Duration,
    ) -> Result<JsonObject, DeviceError> {
        let id = self.next_id;
        self.next_id += 1;
        request.insert("id".to_owned(), json!(id));
        request.insert("do".to_owned(), json!(what));
        self.send(doing, &request).await?;
        let until = Instant::now() + deadline;
        let mut strays = 0;
        while strays < STRAY_LINES_MAX {
            let line = match orders {
                None => self.lines.next_by(until).await,
                Some(orders) => {
                    tokio::select! {
                        biased;
                        () = orders.pulled().notified() => {
                            self.obey(doing, orders).await?;
                            continue;
                        }
                        line = self.lines.next_by(until) => line,
                    }
                }
            };
            let Some(line) = line.map_err(|error| self.failed(doing, &error))? else { break };
            match answer_in(&line, id) {
                Some(answer) => match answer.get("error") {
                    None => return Ok(answer),
                    Some(error) => {
                        let text = error.as_str().map_or_else(|| error.to_string(), str::to_owned);
                        return Err(self.error(doing, DeviceProblem::Refused(text)));
                    }
                },
                None => strays += 1,
            }
        }
        let problem = match strays {
            0 => DeviceProblem::Link(silent(what, deadline).to_string()),
            _ => DeviceProblem::Misfit {
                answer: format!("{strays} lines"),
                expected: format!("one JSON object with \"id\": {id}"),
            },
        };
        Err(self.error(doing, problem))
    }

    /// Sends the orders at once. They have no answer.
    pub(super) async fn obey(&mut self, doing: &str, orders: &MotionOrders) -> Result<(), DeviceError> {
        use palpate_link::device::MotionOrder;
        match orders.take() {
            Some(MotionOrder::Stop) => self.stop(doing).await,
            Some(MotionOrder::Speed(mm_s)) => {
                let line = json!({ "do": "speed", "speed_mm_s": mm_s });
                self.send(doing, line.as_object().unwrap_or(&JsonObject::new())).await
            }
            None => Ok(()),
        }
    }

    /// Requests an immediate stop. The request has no answer.
    pub(super) async fn stop(&mut self, doing: &str) -> Result<(), DeviceError> {
        let line = json!({ "do": "stop" });
        self.send(doing, line.as_object().unwrap_or(&JsonObject::new())).await
    }

    pub(super) fn misfit(&self, doing: &str, answer: &JsonObject, expected: String) -> DeviceError {
        let answer = serde_json::to_string(answer).unwrap_or_default();
        self.error(doing, DeviceProblem::Misfit { answer, expected })
    }

    pub(super) fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError {
            device: format!("{} ({})", self.role.replace('_', " "), self.link),
            doing: doing.to_owned(),
            problem,
        }
    }

    async fn send(&mut self, doing: &str, line: &JsonObject) -> Result<(), DeviceError> {
        if self.ended {
            return Err(self.error(doing, DeviceProblem::Ended("the program has ended".to_owned())));
        }
        let text = serde_json::to_string(line).unwrap_or_default() + "\n";
        self.lines.send(text.as_bytes(), ANSWER_DEADLINE).await.map_err(|error| self.failed(doing, &error))
    }

    fn failed(&mut self, doing: &str, error: &WireError) -> DeviceError {
        self.ended |= !matches!(error, WireError::Endless { .. }); // in all other cases the link is closed
        let problem = match error {
            WireError::Io(error) => match error.kind() {
                ErrorKind::NotFound | ErrorKind::PermissionDenied => DeviceProblem::NotStarted(error.to_string()),
                ErrorKind::UnexpectedEof | ErrorKind::BrokenPipe => DeviceProblem::Ended(error.to_string()),
                _ => DeviceProblem::Link(error.to_string()),
            },
            _ => DeviceProblem::Link(error.to_string()),
        };
        self.error(doing, problem)
    }
}

/// Returns the object on a line, if it is the answer to the request of this id.
pub fn answer_in(line: &str, id: u64) -> Option<Map<String, Value>> {
    match serde_json::from_str(line).ok()? {
        Value::Object(object) if object.get("id").and_then(Value::as_u64) == Some(id) => Some(object),
        _ => None,
    }
}
