//! A UDP socket as a stream of bytes: each read gives the bytes of one datagram, and each write sends one.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{UdpSocket, lookup_host};

/// A socket that sends to one address, and receives from it only.
#[derive(Debug)]
pub(super) struct DatagramStream {
    socket: UdpSocket,
}

impl DatagramStream {
    /// Connects a socket on a free port. Nothing is sent.
    ///
    /// # Errors
    /// The name of the host isn't known, or there is no way to it.
    pub(super) async fn connect(host: &str, port: u16) -> io::Result<DatagramStream> {
        let mut last = io::Error::new(io::ErrorKind::NotFound, "no address of this name was found");
        for address in lookup_host((host, port)).await? {
            match connected(address).await {
                Ok(socket) => return Ok(DatagramStream { socket }),
                Err(error) => last = error,
            }
        }
        Err(last)
    }
}

async fn connected(address: SocketAddr) -> io::Result<UdpSocket> {
    let own: SocketAddr = match address {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let socket = UdpSocket::bind(own).await?;
    socket.connect(address).await?;
    Ok(socket)
}

impl AsyncRead for DatagramStream {
    fn poll_read(self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        loop {
            ready!(self.socket.poll_recv(context, buffer))?;
            // an empty datagram isn't the end of the stream
            if buffer.filled().len() > before || buffer.remaining() == 0 {
                return Poll::Ready(Ok(()));
            }
        }
    }
}

impl AsyncWrite for DatagramStream {
    fn poll_write(self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        self.socket.poll_send(context, bytes)
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}

#[cfg(test)]
mod tests {
    use crate::wire::{Connector, Link};
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::UdpSocket;

    #[tokio::test]
    async fn a_read_is_one_datagram_and_a_write_is_one() {
        let device = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let stranger = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let link = Link::parse(&format!("udp://{}", device.local_addr().unwrap())).unwrap();
        let mut stream = Connector::Real(link).open().await.unwrap();
        stream.write_all(b"start").await.unwrap();
        let mut buffer = [0; 64];
        let (length, client) = device.recv_from(&mut buffer).await.unwrap();
        assert_eq!(&buffer[..length], b"start");
        stranger.send_to(b"other", client).await.unwrap();
        for datagram in [&b"one"[..], b"", b"three"] {
            device.send_to(datagram, client).await.unwrap();
        }
        for datagram in [&b"one"[..], b"three"] {
            let length = stream.read(&mut buffer).await.unwrap();
            assert_eq!(&buffer[..length], datagram);
        }
    }
}
