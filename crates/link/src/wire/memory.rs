//! A link in memory: two ends, each of which reads what the other writes.
//!
//! It does what tokio's `duplex` does, and wakes in the same order, at less cost: a simulated run uses it for every exchange.

use palpate_core::parallel::lock;
use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

/// One end of a link in memory. The other end sees when it is dropped.
#[derive(Debug)]
pub struct MemoryStream {
    incoming: Arc<Mutex<Pipe>>,
    outgoing: Arc<Mutex<Pipe>>,
}

/// Creates a link. At most `most_bytes` wait in each direction before the writer has to wait.
pub fn in_memory(most_bytes: usize) -> (MemoryStream, MemoryStream) {
    let [there, back] = [(); 2].map(|()| Arc::new(Mutex::new(Pipe::new(most_bytes))));
    let near = MemoryStream { incoming: back.clone(), outgoing: there.clone() };
    (near, MemoryStream { incoming: there, outgoing: back })
}

/// One direction.
#[derive(Debug)]
struct Pipe {
    bytes: Vec<u8>,
    most_bytes: usize,
    /// Whether an end has gone.
    is_closed: bool,
    /// The reader, if it waits for bytes, and the writer, if it waits for room.
    reader: Option<Waker>,
    writer: Option<Waker>,
}

impl Pipe {
    fn new(most_bytes: usize) -> Self {
        Pipe { bytes: Vec::new(), most_bytes, is_closed: false, reader: None, writer: None }
    }
}

// wakers are used and dropped after a pipe is unlocked, because their task may use it

impl AsyncRead for MemoryStream {
    fn poll_read(self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let mut pipe = lock(&self.incoming);
        if pipe.bytes.is_empty() && !pipe.is_closed && buffer.remaining() > 0 {
            let replaced = pipe.reader.replace(context.waker().clone());
            drop(pipe);
            drop(replaced);
            return Poll::Pending;
        }
        let count = pipe.bytes.len().min(buffer.remaining());
        buffer.put_slice(&pipe.bytes[..count]);
        pipe.bytes.drain(..count);
        let woken = pipe.writer.take_if(|_| count > 0);
        drop(pipe);
        wake(woken);
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for MemoryStream {
    fn poll_write(self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let mut pipe = lock(&self.outgoing);
        if pipe.is_closed {
            return Poll::Ready(Err(io::ErrorKind::BrokenPipe.into()));
        }
        let count = bytes.len().min(pipe.most_bytes - pipe.bytes.len());
        if count == 0 && !bytes.is_empty() {
            let replaced = pipe.writer.replace(context.waker().clone());
            drop(pipe);
            drop(replaced);
            return Poll::Pending;
        }
        pipe.bytes.extend_from_slice(&bytes[..count]);
        let woken = pipe.reader.take_if(|_| count > 0);
        drop(pipe);
        wake(woken);
        Poll::Ready(Ok(count))
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.end_writing();
        Poll::Ready(Ok(()))
    }
}

impl MemoryStream {
    fn end_writing(&self) {
        let mut pipe = lock(&self.outgoing);
        pipe.is_closed = true;
        let woken = pipe.reader.take();
        drop(pipe);
        wake(woken);
    }
}

impl Drop for MemoryStream {
    fn drop(&mut self) {
        self.end_writing();
        let mut pipe = lock(&self.incoming);
        pipe.is_closed = true;
        let woken = pipe.writer.take();
        drop(pipe);
        wake(woken);
    }
}

fn wake(waiting: Option<Waker>) {
    waiting.into_iter().for_each(Waker::wake);
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

    #[tokio::test]
    async fn what_one_end_writes_the_other_reads_and_a_full_link_waits() {
        let (mut near, mut far) = in_memory(4);
        let writing = tokio::spawn(async move {
            near.write_all(b"ten bytes.").await.unwrap();
            near
        });
        let mut text = [0; 10];
        far.read_exact(&mut text).await.unwrap();
        assert_eq!(&text, b"ten bytes.");
        let mut near = writing.await.unwrap();
        far.write_all(b"last").await.unwrap();
        drop(far);
        let mut rest = Vec::new();
        near.read_to_end(&mut rest).await.unwrap();
        assert_eq!(rest, b"last", "what was written before the end went");
        assert_eq!(near.write_all(b"x").await.unwrap_err().kind(), io::ErrorKind::BrokenPipe);
    }
}
