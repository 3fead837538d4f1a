//! Lines on a link, and errors of the link.

use super::{ByteStream, Connector};
use crate::time::{Instant, timeout, timeout_at};
use std::future::poll_fn;
use std::io;
use std::pin::Pin;
use std::task::Poll;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWriteExt, ReadBuf};

/// Error of a link.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// The link itself failed.
    #[error("the link failed: {0}")]
    Io(#[from] io::Error),
    /// No answer within the deadline.
    #[error("no answer to {request:?} within {waited_ms} ms")]
    Silent {
        /// Sent request.
        request: String,
        /// The deadline, ms.
        waited_ms: u64,
    },
    /// An answer without an end.
    #[error("an answer of more than {most_bytes} bytes without an end")]
    Endless {
        /// Longest accepted answer, bytes.
        most_bytes: usize,
    },
}

/// Texts with an end mark, over a link. The link is opened when it is needed, and opened again after a failure.
pub struct LineLink {
    connector: Connector,
    stream: Option<ByteStream>,
    inbox: Vec<u8>,
    /// Part of the inbox that has been searched for the mark.
    searched: usize,
    end: &'static str,
    most_bytes: usize,
}

impl LineLink {
    /// Creates lines on a link. Each received text ends with `end` and has at most `most_bytes`.
    pub fn new(connector: Connector, end: &'static str, most_bytes: usize) -> Self {
        LineLink { connector, stream: None, inbox: Vec::new(), searched: 0, end, most_bytes }
    }

    /// Opens the link if it isn't open. Returns whether it was opened now.
    ///
    /// # Errors
    /// Errors of the link.
    pub async fn open(&mut self) -> Result<bool, WireError> {
        let opens = self.stream.is_none();
        self.stream().await?;
        Ok(opens)
    }

    /// Sends bytes unchanged, within a deadline.
    ///
    /// # Errors
    /// Errors of the link, or the link doesn't accept the bytes.
    pub async fn send(&mut self, bytes: &[u8], deadline: Duration) -> Result<(), WireError> {
        let sent = {
            let stream = self.stream().await?;
            timeout(deadline, async {
                stream.write_all(bytes).await?;
                stream.flush().await
            })
            .await
        };
        match sent {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => {
                self.close();
                Err(error.into())
            }
            Err(_) => {
                self.close(); // a part may have been sent: the next line must not follow it
                Err(silent(&String::from_utf8_lossy(bytes), deadline))
            }
        }
    }

    /// Returns the next text without its end and the blanks around it. The future may be dropped while it waits: the bytes
    /// received so far are kept.
    ///
    /// # Errors
    /// Errors of the link, or a text without an end.
    pub async fn next(&mut self) -> Result<String, WireError> {
        loop {
            if let Some(text) = self.take() {
                return Ok(text);
            }
            if self.inbox.len() > self.most_bytes {
                self.forget();
                return Err(WireError::Endless { most_bytes: self.most_bytes });
            }
            let mut chunk = [0; 256];
            let count = self.stream().await?.read(&mut chunk).await;
            match count {
                Ok(0) => {
                    self.close();
                    return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the other end closed it").into());
                }
                Ok(count) => self.inbox.extend_from_slice(&chunk[..count]),
                Err(error) => {
                    self.close();
                    return Err(error.into());
                }
            }
        }
    }

    /// Returns the next text that comes before `until`; `None` if there is none.
    ///
    /// # Errors
    /// As [`next`](Self::next).
    pub async fn next_by(&mut self, until: Instant) -> Result<Option<String>, WireError> {
        timeout_at(until, self.next()).await.ok().transpose()
    }

    /// Whether bytes have arrived on the link; they are kept. An error of the link appears in the next exchange.
    pub async fn something_came(&mut self) -> bool {
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

    /// Discards received bytes that weren't read.
    pub fn forget(&mut self) {
        self.inbox.clear();
        self.searched = 0;
    }

    /// Closes the link. The next use opens it again, and no late answer can come.
    pub fn close(&mut self) {
        self.stream = None;
        self.forget();
    }

    fn take(&mut self) -> Option<String> {
        let end = self.end.as_bytes();
        let from = self.searched.saturating_sub(end.len() - 1);
        let Some(found) = self.inbox[from..].windows(end.len()).position(|window| window == end) else {
            self.searched = self.inbox.len();
            return None;
        };
        let text = String::from_utf8_lossy(&self.inbox[..from + found]).trim().to_owned();
        self.inbox.drain(..from + found + end.len());
        self.searched = 0;
        Some(text)
    }

    async fn stream(&mut self) -> Result<&mut ByteStream, WireError> {
        if self.stream.is_none() {
            self.forget();
            self.stream = Some(self.connector.open().await?);
        }
        self.stream.as_mut().ok_or_else(|| io::Error::from(io::ErrorKind::NotConnected).into())
    }
}

/// Returns the error that no answer came.
pub fn silent(request: &str, deadline: Duration) -> WireError {
    WireError::Silent { request: request.trim_end().to_owned(), waited_ms: deadline.as_millis() as u64 }
}
