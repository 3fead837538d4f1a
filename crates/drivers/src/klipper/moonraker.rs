//! Requests to Moonraker: JSON-RPC 2.0 in the bodies of HTTP/1.1.

use palpate_link::device::{DeviceError, DeviceProblem};
use palpate_link::time::{Instant, timeout, timeout_at};
use palpate_link::wire::{ByteStream, Connector, silent};
use serde_json::{Value, json};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

/// Longest wait until a request is taken, and for its answer beyond the time that it takes.
const ANSWER_DEADLINE: Duration = Duration::from_secs(4);

/// Longest answer, bytes. The settings of a printer have some 20,000.
const ANSWER_BYTES_MAX: usize = 1 << 20;

/// End of the head of an HTTP message.
const HEAD_END: &[u8] = b"\r\n\r\n";

/// Connection to Moonraker. It is opened when it is needed, and after a failure.
pub(super) struct Moonraker {
    connector: Connector,
    stream: Option<ByteStream>,
    inbox: Vec<u8>,
    link: String,
    id: u64,
}

impl Moonraker {
    pub(super) fn new(connector: Connector, link: String) -> Self {
        Moonraker { connector, stream: None, inbox: Vec::new(), link, id: 0 }
    }

    /// Asks, and returns the result.
    pub(super) async fn ask(&mut self, doing: &str, method: &str, params: Value) -> Result<Value, DeviceError> {
        self.send(doing, method, params).await?;
        self.answer(doing, method, Duration::ZERO).await
    }

    /// Runs G-code to its end, and waits for it. `takes` is its expected duration.
    pub(super) async fn run(&mut self, doing: &str, script: &str, takes: Duration) -> Result<(), DeviceError> {
        self.send(doing, SCRIPT, json!({ "script": script })).await?;
        self.answer(doing, script, takes).await.map(drop)
    }

    /// Sends G-code; its [`answer`](Self::answer) comes at its end.
    pub(super) async fn begin(&mut self, doing: &str, script: &str) -> Result<(), DeviceError> {
        self.send(doing, SCRIPT, json!({ "script": script })).await
    }

    async fn send(&mut self, doing: &str, method: &str, params: Value) -> Result<(), DeviceError> {
        self.id += 1;
        let body = json!({ "jsonrpc": "2.0", "method": method, "params": params, "id": self.id }).to_string();
        let request = format!(
            "POST /server/jsonrpc HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
            self.link.trim_start_matches("tcp://"),
            body.len()
        );
        let until = Instant::now() + ANSWER_DEADLINE;
        self.forget_closed().await;
        let written = async {
            let stream = match &mut self.stream {
                Some(stream) => stream,
                closed => {
                    self.inbox.clear();
                    closed.insert(self.connector.open().await?)
                }
            };
            stream.write_all(request.as_bytes()).await?;
            stream.flush().await
        };
        match timeout_at(until, written).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => Err(self.failed(doing, &format!("the link failed: {error}"))),
            Err(_) => Err(self.failed(doing, &silent(method, ANSWER_DEADLINE).to_string())),
        }
    }

    /// Forgets a connection that the other end closed meanwhile: a proxy does after a minute.
    async fn forget_closed(&mut self) {
        let Some(stream) = self.stream.as_mut() else { return };
        let mut chunk = [0; 1024];
        match timeout(Duration::ZERO, stream.read(&mut chunk)).await {
            Ok(Ok(count @ 1..)) => self.inbox.extend_from_slice(&chunk[..count]),
            Ok(_) => self.close(),
            Err(_) => {}
        }
    }

    /// Waits for the answer to the last request. The future may be dropped while it waits.
    pub(super) async fn answer(&mut self, doing: &str, asked: &str, takes: Duration) -> Result<Value, DeviceError> {
        let until = Instant::now() + takes + ANSWER_DEADLINE;
        loop {
            let (status, body) = self.message(doing, asked, until).await?;
            if status == 401 {
                let text = "it refuses this computer: add its address to `trusted_clients` in [authorization] of moonraker.conf";
                return Err(self.error(doing, DeviceProblem::Mismatch(text.to_owned())));
            }
            let Ok(Value::Object(mut answer)) = serde_json::from_slice(&body) else {
                let (answer, expected) =
                    (String::from_utf8_lossy(&body).into_owned(), "an object of JSON-RPC".to_owned());
                self.close();
                return Err(self.error(doing, DeviceProblem::Misfit { answer, expected }));
            };
            if answer.get("id").is_some_and(|id| *id != json!(self.id) && !id.is_null()) {
                continue; // of an earlier request
            }
            if let Some(result) = answer.remove("result") {
                return Ok(result);
            }
            let message = answer.get("error").and_then(|error| error.get("message"));
            let text = message.and_then(Value::as_str).map_or_else(|| format!("{answer:?}"), str::to_owned);
            if answer.get("error").and_then(|error| error["code"].as_i64()).is_some_and(|code| code >= 500) {
                let text = format!("Moonraker has lost its printer: {text}");
                return Err(self.error(doing, DeviceProblem::Motion(text)));
            }
            return Err(self.error(doing, DeviceProblem::Refused(text)));
        }
    }

    /// Returns the status and the body of the next HTTP message. The bytes received so far are kept if the future is dropped.
    async fn message(&mut self, doing: &str, asked: &str, until: Instant) -> Result<(u16, Vec<u8>), DeviceError> {
        loop {
            if let Some(head) = self.inbox.windows(HEAD_END.len()).position(|bytes| bytes == HEAD_END) {
                let text = String::from_utf8_lossy(&self.inbox[..head]).into_owned();
                let Some((status, length)) = parse_head(&text) else {
                    self.close();
                    let expected = "an answer of HTTP/1.1 with a Content-Length".to_owned();
                    return Err(self.error(doing, DeviceProblem::Misfit { answer: text, expected }));
                };
                let begin = head + HEAD_END.len();
                if self.inbox.len() >= begin + length {
                    let body = self.inbox[begin..begin + length].to_vec();
                    self.inbox.drain(..begin + length);
                    return Ok((status, body));
                }
            }
            if self.inbox.len() > ANSWER_BYTES_MAX {
                return Err(self.failed(doing, "an answer of over a million bytes"));
            }
            let Some(stream) = self.stream.as_mut() else { return Err(self.failed(doing, "the link was lost")) };
            let mut chunk = [0; 4096];
            match timeout_at(until, stream.read(&mut chunk)).await {
                Ok(Ok(0)) => return Err(self.failed(doing, "the link failed: the other end closed it")),
                Ok(Ok(count)) => self.inbox.extend_from_slice(&chunk[..count]),
                Ok(Err(error)) => return Err(self.failed(doing, &format!("the link failed: {error}"))),
                Err(_) => {
                    let waited = ANSWER_DEADLINE.as_millis();
                    return Err(self.failed(
                        doing,
                        &format!(
                            "no answer to {asked:?} within {waited} ms after it was due; what was sent may still move"
                        ),
                    ));
                }
            }
        }
    }

    /// Closes the connection. No late answer can come.
    pub(super) fn close(&mut self) {
        self.stream = None;
    }

    pub(super) fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError { device: format!("stage (Klipper at {})", self.link), doing: doing.to_owned(), problem }
    }

    fn failed(&mut self, doing: &str, text: &str) -> DeviceError {
        self.close();
        self.error(doing, DeviceProblem::Link(text.to_owned()))
    }
}

const SCRIPT: &str = "printer.gcode.script";

/// Returns the status of an HTTP answer, and the length of its body.
fn parse_head(head: &str) -> Option<(u16, usize)> {
    let mut lines = head.lines();
    let status = lines.next()?.strip_prefix("HTTP/1.")?.split_whitespace().nth(1)?.parse().ok()?;
    let length =
        lines.filter_map(|line| line.split_once(':')).find(|(name, _)| name.eq_ignore_ascii_case("content-length"));
    let length = length?.1.trim().parse().ok().filter(|length| *length <= ANSWER_BYTES_MAX)?;
    Some((status, length))
}
