//! Opening of links.

use super::datagram::DatagramStream;
use super::{Link, Parity, program};
use crate::time::timeout;
use std::io;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_serial::{FlowControl, SerialPortBuilderExt, StopBits};

/// Longest wait until a TCP server accepts, or the name of a host is found.
const CONNECT_DEADLINE: Duration = Duration::from_secs(5);

/// Anything that bytes can be written to and read from.
pub trait Duplex: AsyncRead + AsyncWrite + Unpin + Send + std::fmt::Debug {}

impl<T: AsyncRead + AsyncWrite + Unpin + Send + std::fmt::Debug> Duplex for T {}

/// An open link.
pub type ByteStream = Box<dyn Duplex>;

/// Opens one instrument's link, and opens it again if it was lost.
pub enum Connector {
    /// A real port or socket.
    Real(Link),
    /// The near end of a stream whose far end is an emulator.
    Memory(Box<dyn Fn() -> ByteStream + Send + Sync>),
}

impl Connector {
    /// Creates links in memory, each of which `dial` opens.
    pub fn in_memory<S: Duplex + 'static>(dial: impl Fn() -> S + Send + Sync + 'static) -> Connector {
        Connector::Memory(Box::new(move || Box::new(dial())))
    }

    /// Opens the link.
    ///
    /// # Errors
    /// The operating system's error; for an emulator's link in [`Connector::Real`], an error that nothing is at its far end.
    pub async fn open(&self) -> io::Result<ByteStream> {
        match self {
            Connector::Memory(dial) => Ok(dial()),
            Connector::Real(Link::Tcp { host, port }) => {
                let dialled = timeout(CONNECT_DEADLINE, TcpStream::connect((host.as_str(), *port))).await;
                let stream = dialled
                    .map_err(|_| io::Error::new(io::ErrorKind::TimedOut, "no answer to the connection request"))??;
                stream.set_nodelay(true)?;
                Ok(Box::new(stream))
            }
            Connector::Real(Link::Udp { host, port }) => {
                let dialled = timeout(CONNECT_DEADLINE, DatagramStream::connect(host, *port)).await;
                let no_address = |_| io::Error::new(io::ErrorKind::TimedOut, "no address of this name was found");
                Ok(Box::new(dialled.map_err(no_address)??))
            }
            Connector::Real(Link::Serial { port, baud, parity, stop_bits, rts_cts }) => {
                let parity = match parity {
                    Parity::None => tokio_serial::Parity::None,
                    Parity::Even => tokio_serial::Parity::Even,
                    Parity::Odd => tokio_serial::Parity::Odd,
                };
                let stop_bits = if *stop_bits == 2 { StopBits::Two } else { StopBits::One };
                let flow = if *rts_cts { FlowControl::Hardware } else { FlowControl::None };
                let line = tokio_serial::new(port, *baud).parity(parity).stop_bits(stop_bits).flow_control(flow);
                Ok(Box::new(line.open_native_async()?))
            }
            Connector::Real(Link::Process(command)) => program::start(command),
            Connector::Real(Link::Sim | Link::Emulated(_) | Link::Daqmx(_)) => {
                Err(io::Error::new(io::ErrorKind::Unsupported, "it has no byte stream"))
            }
        }
    }
}
