//! The link as the Modbus library sees it.

use super::request::Transport;
use palpate_link::wire::ByteStream;
use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

/// Link in the form that the Modbus library needs.
///
/// The end of the link is reported as an error with its own text. Otherwise the library would report the system's last error,
/// from any earlier call, as the reason.
///
/// On a serial line no request is sent while unread data without a request are present. RTU messages have no numbers, so a late
/// or doubled answer would count as the answer to the next request. All later answers would then be shifted too.
#[derive(Debug)]
pub(super) struct ModbusLine {
    stream: ByteStream,
    transport: Transport,
}

impl ModbusLine {
    pub(super) fn new(stream: ByteStream, transport: Transport) -> Self {
        ModbusLine { stream, transport }
    }
}

impl AsyncRead for ModbusLine {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buf.filled().len();
        ready!(Pin::new(&mut self.stream).poll_read(cx, buf))?;
        let is_end = buf.filled().len() == before && buf.remaining() > 0;
        Poll::Ready(match is_end {
            true => Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the other end closed the link")),
            false => Ok(()),
        })
    }
}

impl AsyncWrite for ModbusLine {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        if self.transport == Transport::Rtu {
            let mut stray = [0; 64];
            let mut stray = ReadBuf::new(&mut stray);
            // errors of the line show when the answer is read
            let _ = Pin::new(&mut self.stream).poll_read(cx, &mut stray);
            if !stray.filled().is_empty() {
                return Poll::Ready(Err(io::Error::new(io::ErrorKind::InvalidData, "it sent data without a request")));
            }
        }
        Pin::new(&mut self.stream).poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

    #[tokio::test]
    async fn request_waits_until_unsolicited_bytes_are_discarded() {
        let (near, mut far) = duplex(64);
        let mut line = ModbusLine::new(Box::new(near), Transport::Rtu);
        line.write_all(b"ask").await.unwrap();
        far.write_all(b"told").await.unwrap();
        let mut answer = [0; 4];
        line.read_exact(&mut answer).await.unwrap();
        line.write_all(b"ask").await.unwrap();
        far.write_all(b"toldtold").await.unwrap();
        line.read_exact(&mut answer).await.unwrap();
        assert!(line.write_all(b"ask").await.unwrap_err().to_string().contains("without a request"));
    }
}
