//! Emulated instruments for other programs, on the real clock: a pseudo-terminal, or a TCP or UDP port of this machine.

use super::datagrams::DatagramServer;
use super::{Instrument, Shared, serve, serve_on};
use crate::scene::Scene;
use palpate_link::time::{Instant, sleep};
use palpate_link::wire::SerialLine;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::net::{TcpListener, UdpSocket};
use tokio::task::{JoinHandle, JoinSet};

/// Largest number of clients at once on one TCP port. A further client is accepted and closed at once, so that it sees a refusal
/// instead of a wait.
pub(crate) const CLIENTS_MOST: usize = 16;

/// Rest after a client couldn't be accepted. If the cause persists, the rest keeps the loop from spinning.
const AFTER_A_FAILED_ACCEPT: Duration = Duration::from_millis(100);

/// Reason why an instrument can't be offered.
#[derive(Debug, thiserror::Error)]
pub enum ListenError {
    /// The port isn't available.
    #[error("can't listen on {at}; port 0 selects a free port")]
    Port {
        /// Requested address and port.
        at: SocketAddr,
        /// The system's error.
        source: std::io::Error,
    },
    /// No pseudo-terminal is available.
    #[error("can't open a pseudo-terminal; use a TCP port instead")]
    PseudoTerminal(#[source] tokio_serial::Error),
    /// This system has no pseudo-terminals.
    #[error("this system has no pseudo-terminals: offer the instrument on a TCP port")]
    NoPseudoTerminals,
}

/// An instrument that is offered until this value is dropped.
#[derive(Debug)]
pub struct Listening {
    address: String,
    task: JoinHandle<()>,
}

impl Listening {
    /// Address of the instrument for a client: a path such as `/dev/pts/4`, or `127.0.0.1:port`.
    pub fn address(&self) -> &str {
        &self.address
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Offers an instrument on a new pseudo-terminal. Clients may connect and disconnect; the terminal stays. It has no modem lines
/// (RTS, CTS, DTR). It accepts any baud rate, which has no effect; the bytes take the time of `line`.
///
/// # Errors
/// The system has no pseudo-terminals, or all are in use.
#[cfg(unix)]
pub fn pseudo_terminal<I: Instrument + ?Sized + 'static>(
    instrument: Shared<I>,
    scene: Shared<Scene>,
    origin: Instant,
    line: Option<SerialLine>,
) -> Result<Listening, ListenError> {
    use tokio_serial::{SerialPort, SerialStream};

    // pair() leaves the terminal raw: no byte has a special meaning
    let (near, offered) = SerialStream::pair().map_err(ListenError::PseudoTerminal)?;
    let address = offered.name().ok_or(ListenError::NoPseudoTerminals)?;
    let task = tokio::spawn(async move {
        // kept open, because the terminal would end with its first client
        let _offered = offered;
        // Its only error is that the system removed the terminal: then nothing can be served.
        let _ = serve_on(line, near, instrument, scene, origin).await;
    });
    Ok(Listening { address, task })
}

/// Fails to offer an instrument on a pseudo-terminal, because this system has no pseudo-terminals.
///
/// # Errors
/// Always.
#[cfg(not(unix))]
pub fn pseudo_terminal<I: Instrument + ?Sized + 'static>(
    _instrument: Shared<I>,
    _scene: Shared<Scene>,
    _origin: Instant,
    _line: Option<SerialLine>,
) -> Result<Listening, ListenError> {
    Err(ListenError::NoPseudoTerminals)
}

/// Offers an instrument at a TCP address (port 0: any free port), to up to [`CLIENTS_MOST`] clients at once. An instrument with a
/// serial `line` is behind a server for serial ports, at the rate of the line. Clients aren't authenticated, so the caller is responsible for any address other than that of this machine.
///
/// # Errors
/// The port isn't available.
pub async fn tcp<I: Instrument + ?Sized + 'static>(
    at: SocketAddr,
    instrument: Shared<I>,
    scene: Shared<Scene>,
    origin: Instant,
    line: Option<SerialLine>,
) -> Result<Listening, ListenError> {
    let unavailable = |source| ListenError::Port { at, source };
    let listener = TcpListener::bind(at).await.map_err(unavailable)?;
    let address = listener.local_addr().map_err(unavailable)?.to_string();
    let task = tokio::spawn(async move {
        let mut clients = JoinSet::new();
        loop {
            tokio::select! {
                biased;
                Some(_) = clients.join_next() => {}
                accepted = listener.accept() => {
                    // A client that left before it was accepted, or a missing file handle, doesn't end listening.
                    let Ok((stream, _)) = accepted else {
                        sleep(AFTER_A_FAILED_ACCEPT).await;
                        continue;
                    };
                    if clients.len() < CLIENTS_MOST {
                        // without it a reply would wait until the client acknowledges the one before
                        let _ = stream.set_nodelay(true);
                        clients.spawn(serve_on(line, stream, instrument.clone(), scene.clone(), origin));
                    }
                }
            }
        }
    });
    Ok(Listening { address, task })
}

/// Offers an instrument at a UDP address (port 0: any free port). It sends to the client that asked last. Clients aren't authenticated, so
/// the caller is responsible for any address other than that of this machine.
///
/// # Errors
/// The port isn't available.
pub async fn udp<I: Instrument + ?Sized + 'static>(
    at: SocketAddr,
    instrument: Shared<I>,
    scene: Shared<Scene>,
    origin: Instant,
) -> Result<Listening, ListenError> {
    let unavailable = |source| ListenError::Port { at, source };
    let socket = UdpSocket::bind(at).await.map_err(unavailable)?;
    let address = socket.local_addr().map_err(unavailable)?.to_string();
    let task = tokio::spawn(async move {
        // Its only error is one of the socket, which then can't serve anybody.
        let _ = serve(DatagramServer::new(socket), instrument, scene, origin).await;
    });
    Ok(Listening { address, task })
}

#[cfg(test)]
mod tests {
    use super::super::lines::{NetFt, STRAIGHT, SerialBoard};
    use super::super::tests::{scene, shared};
    use super::*;
    use crate::scene::SceneDevice;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpStream;

    struct ListenEcho;

    fn local(port: u16) -> SocketAddr {
        ([127, 0, 0, 1], port).into()
    }

    impl Instrument for ListenEcho {
        fn device(&self) -> SceneDevice {
            SceneDevice::Array
        }
        fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
            (!inbox.is_empty()).then(|| std::mem::take(inbox))
        }
        fn answer(&mut self, request: &[u8], _: &mut Scene, _: f64) -> Vec<u8> {
            request.to_vec()
        }
    }

    /// Turns of the runtime within which it looks at its files more than once.
    #[cfg(unix)]
    const TURNS: usize = 500;

    #[cfg(unix)]
    #[tokio::test]
    async fn pseudo_terminal_passes_every_byte_to_successive_clients() {
        use tokio_serial::{SerialPortBuilderExt, SerialStream};
        let listening = pseudo_terminal(shared(ListenEcho), shared(scene()), Instant::now(), None).expect("a terminal");
        for _ in 0..3 {
            let mut client: SerialStream =
                tokio_serial::new(listening.address(), 115_200).open_native_async().expect("opens");
            let sent: Vec<u8> = (0..=255).collect();
            client.write_all(&sent).await.expect("writes");
            let mut echo = vec![0; sent.len()];
            client.read_exact(&mut echo).await.expect("reads");
            assert_eq!(echo, sent);
            drop(client);
            // shows the far end that the link is free before the next client comes
            for _ in 0..TURNS {
                tokio::task::yield_now().await;
            }
        }
    }

    #[tokio::test]
    async fn many_clients_share_one_instrument_and_one_too_many_is_refused() {
        let listening = tcp(local(0), shared(ListenEcho), shared(scene()), Instant::now(), None).await.expect("a port");
        let mut clients = Vec::new();
        for n in 0..CLIENTS_MOST as u8 {
            let mut client = TcpStream::connect(listening.address()).await.expect("connects");
            client.write_all(&[n]).await.expect("writes");
            assert_eq!(client.read_u8().await.expect("reads"), n);
            clients.push(client);
        }
        let mut one_too_many = TcpStream::connect(listening.address()).await.expect("connects");
        assert_eq!(one_too_many.read(&mut [0]).await.expect("an orderly end"), 0);
    }

    #[tokio::test]
    async fn the_client_that_asked_last_gets_the_stream_record_by_record() {
        let device = SerialBoard::new(NetFt::new(500.0, 2.0, STRAIGHT));
        let listening = udp(local(0), shared(device), shared(scene()), Instant::now()).await.expect("a port");
        let mut clients = Vec::new();
        for _ in 0..2 {
            let client = UdpSocket::bind(local(0)).await.expect("a port");
            client.connect(listening.address()).await.expect("an address");
            client.send(&[]).await.expect("sends");
            client.send(&[0x12, 0x34, 0, 2, 0, 0, 0, 0]).await.expect("sends");
            for sequence in 1..=20u32 {
                let mut record = [0; 64];
                assert_eq!(client.recv(&mut record).await.expect("receives"), 36);
                assert_eq!(record[..4], sequence.to_be_bytes());
            }
            clients.push(client);
        }
        // what the first still has in its queue was sent before the second asked
        let mut rest = 0;
        while clients[0].try_recv(&mut [0; 64]).is_ok() {
            rest += 1;
        }
        sleep(Duration::from_millis(50)).await;
        assert!(clients[0].try_recv(&mut [0; 64]).is_err(), "{rest} records were left");
        assert!(clients[1].try_recv(&mut [0; 64]).is_ok());
    }

    #[tokio::test]
    async fn a_port_that_is_taken_is_reported_with_its_number() {
        let first = tcp(local(0), shared(ListenEcho), shared(scene()), Instant::now(), None).await.expect("a port");
        let port = first.address().rsplit(':').next().and_then(|port| port.parse().ok()).expect("a number");
        let second = tcp(local(port), shared(ListenEcho), shared(scene()), Instant::now(), None).await;
        assert!(second.expect_err("taken").to_string().contains(&port.to_string()));
    }
}
