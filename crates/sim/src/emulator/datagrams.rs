//! A UDP socket as the far end of a stream: what is written goes to the client that sent last.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::UdpSocket;

/// The socket, and its client.
pub(super) struct DatagramServer {
    socket: UdpSocket,
    client: Option<SocketAddr>,
}

impl DatagramServer {
    pub(super) fn new(socket: UdpSocket) -> Self {
        DatagramServer { socket, client: None }
    }
}

/// Most errors in a row of a client that has gone, before others get a turn.
const GONE_MOST: usize = 16;

impl AsyncRead for DatagramServer {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        for _ in 0..GONE_MOST {
            // some systems report here that an earlier client has gone, which is no reason to end; an empty datagram asks nothing
            if let Ok(client) = ready!(self.socket.poll_recv_from(context, buffer))
                && buffer.filled().len() > before
            {
                self.client = Some(client);
                return Poll::Ready(Ok(()));
            }
        }
        context.waker().wake_by_ref();
        Poll::Pending
    }
}

impl AsyncWrite for DatagramServer {
    /// A datagram that can't be sent is lost, as on a network.
    fn poll_write(self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        if let Some(client) = self.client {
            let _ = ready!(self.socket.poll_send_to(context, bytes, client));
        }
        Poll::Ready(Ok(bytes.len()))
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}
