use super::{ByteStream, Connector};
use std::future::poll_fn;
use std::io;
use std::pin::Pin;
use std::task::Poll;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWriteExt, ReadBuf};
use tokio::sync::Notify;
use tokio::time::{Instant, timeout, timeout_at};

/// Longest answer line that is taken for one, bytes; the longest real one is an error text of some 60.
const LINE_MAX_BYTES: usize = 1024;

/// Silence after which a link that fell out of step is taken to be quiet.
const QUIET: Duration = Duration::from_millis(100);

/// Most answers that are thrown away while a link is brought back into step.
const STRAY_LINES_MAX: usize = 64;

/// What went wrong on a link.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// The link itself failed.
    #[error("the link failed: {0}")]
    Io(#[from] io::Error),
    /// No answer within the deadline.
    #[error("no answer to {request:?} within {waited_ms} ms")]
    Silent {
        /// What was sent.
        request: String,
        /// The deadline, ms.
        waited_ms: u64,
    },
    /// An answer with no end.
    #[error("an answer of over {LINE_MAX_BYTES} bytes without a line end")]
    Endless,
}

/// What a waiting exchange sends at once when it is asked for, answer or no answer. It has no answer itself.
pub struct Urgent<'a> {
    /// Told when there is something to send.
    pub asked: &'a Notify,
    /// What to send then, if anything is left to.
    pub line: &'a dyn Fn() -> Option<String>,
}

/// One request at a time over a line protocol; lines go out with CR and come back with CR LF (ESP300 manual, RS-232).
///
/// An exchange that isn't finished (no answer, or its future dropped) leaves the link out of step; the next one first
/// brings it back: it waits for quiet, asks the `marker` question and discards lines up to its answer.
pub struct LineExchange {
    connector: Connector,
    stream: Option<ByteStream>,
    inbox: Vec<u8>,
    deadline: Duration,
    marker: Marker,
    out_of_step: bool,
}

/// A harmless question whose answer can't be mistaken for another's.
#[derive(Clone, Copy, Debug)]
struct Marker {
    question: &'static str,
    answer_contains: &'static str,
}

impl LineExchange {
    /// An exchange over a link that is opened when it is first needed. `question` is harmless, and only its answer contains
    /// `answer_contains`.
    pub fn new(
        connector: Connector,
        deadline: Duration,
        question: &'static str,
        answer_contains: &'static str,
    ) -> Self {
        let marker = Marker { question, answer_contains };
        LineExchange { connector, stream: None, inbox: Vec::new(), deadline, marker, out_of_step: false }
    }

    /// Sends a line that has no answer.
    ///
    /// # Errors
    /// The link's own.
    pub async fn tell(&mut self, line: &str) -> Result<(), WireError> {
        self.bring_back_in_step(None).await?;
        self.send(line).await
    }

    /// Sends a line at once, in step or not: a stop waits for nothing.
    ///
    /// # Errors
    /// The link's own.
    pub async fn tell_now(&mut self, line: &str) -> Result<(), WireError> {
        self.send(line).await
    }

    /// Sends a question and gives its answer without the line end.
    ///
    /// # Errors
    /// As [`ask_all`](Self::ask_all).
    pub async fn ask(&mut self, question: &str) -> Result<String, WireError> {
        Ok(self.ask_all(question, 1, None).await?.pop().unwrap_or_default())
    }

    /// Sends a line of questions and gives their answers, a line each. While it waits, what is urgent is sent at once.
    ///
    /// # Errors
    /// No answer in time, or the link's own.
    pub async fn ask_all(
        &mut self,
        question: &str,
        lines: usize,
        urgent: Option<&Urgent<'_>>,
    ) -> Result<Vec<String>, WireError> {
        // what came without being asked for would be taken for the answer
        if !self.inbox.is_empty() || self.something_came().await {
            self.out_of_step = true;
        }
        self.bring_back_in_step(urgent).await?;
        self.out_of_step = true;
        let answer = self.ask_in_step(question, lines, urgent).await?;
        self.out_of_step = false;
        Ok(answer)
    }

    /// Says that the last answer made no sense, so that the next exchange resynchronises first.
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
        self.inbox.clear();
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

    /// The next line that comes until then, or none. What is urgent is sent at once, whatever is being waited for.
    async fn line_by(&mut self, until: Instant, urgent: Option<&Urgent<'_>>) -> Result<Option<String>, WireError> {
        loop {
            let line = match urgent {
                None => timeout_at(until, self.read_line()).await,
                Some(urgent) => {
                    tokio::select! {
                        biased;
                        () = urgent.asked.notified() => {
                            if let Some(line) = (urgent.line)() {
                                self.send(&line).await?;
                            }
                            continue;
                        }
                        line = timeout_at(until, self.read_line()) => line,
                    }
                }
            };
            return line.ok().transpose();
        }
    }

    /// Whether bytes wait on the link; they are kept. What is wrong with the link shows in the exchange that follows.
    async fn something_came(&mut self) -> bool {
        let Some(stream) = self.stream.as_mut() else { return false };
        let mut chunk = [0; 256];
        let mut waiting = ReadBuf::new(&mut chunk);
        poll_fn(|cx| {
            let _ = Pin::new(&mut *stream).poll_read(cx, &mut waiting);
            Poll::Ready(())
        })
        .await;
        self.inbox.extend_from_slice(waiting.filled());
        !self.inbox.is_empty()
    }

    fn silent(&self, request: &str) -> WireError {
        WireError::Silent { request: request.to_owned(), waited_ms: self.deadline.as_millis() as u64 }
    }

    async fn send(&mut self, line: &str) -> Result<(), WireError> {
        let mut bytes = Vec::with_capacity(line.len() + 1);
        bytes.extend_from_slice(line.as_bytes());
        bytes.push(b'\r');
        let deadline = self.deadline;
        let sent = {
            let stream = self.stream().await?;
            timeout(deadline, async {
                stream.write_all(&bytes).await?;
                stream.flush().await
            })
            .await
        };
        match sent {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => {
                self.stream = None;
                Err(error.into())
            }
            Err(_) => {
                self.stream = None; // half a line may have gone: nothing is to be glued to it
                Err(self.silent(line))
            }
        }
    }

    /// The next line. May be dropped while it waits: what has come so far stays in the inbox.
    async fn read_line(&mut self) -> Result<String, WireError> {
        loop {
            if let Some(end) = self.inbox.iter().position(|&byte| byte == b'\n') {
                let line: Vec<u8> = self.inbox.drain(..=end).collect();
                return Ok(String::from_utf8_lossy(&line).trim().to_owned());
            }
            if self.inbox.len() > LINE_MAX_BYTES {
                self.inbox.clear();
                return Err(WireError::Endless);
            }
            let mut chunk = [0; 256];
            let count = self.stream().await?.read(&mut chunk).await;
            match count {
                Ok(0) => {
                    self.stream = None;
                    return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the far end closed it").into());
                }
                Ok(count) => self.inbox.extend_from_slice(&chunk[..count]),
                Err(error) => {
                    self.stream = None;
                    return Err(error.into());
                }
            }
        }
    }

    async fn stream(&mut self) -> Result<&mut ByteStream, WireError> {
        if self.stream.is_none() {
            self.inbox.clear();
            self.stream = Some(self.connector.open().await?);
        }
        self.stream.as_mut().ok_or_else(|| io::Error::from(io::ErrorKind::NotConnected).into())
    }
}
