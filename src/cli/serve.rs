//! `palpate serve`: answers readings of many connections at a TCP port, like `solve` answers standard input.

use super::method::tell_sensor;
use super::summary::{note, print, tell};
use crate::api::Failure;
use crate::api::force_answer::ForceSolutions;
use crate::api::lines::AnswerWriter;
use crate::api::read_sensor;
use crate::api::solutions::{Measure, Solutions};
use crate::api::stream::AnswerStream;
use miette::{IntoDiagnostic, WrapErr};
use palpate_core::parallel::lock;
use palpate_data::dataset::answers::{Answers, ReadingSolver};
use palpate_data::dataset::readings::{Readings, StreamLines};
use palpate_data::dataset::sensor_file::SensorModel;
use palpate_data::dataset::{LiveSession, Mapping};
use palpate_solver::vector::{VectorFits, VectorSession};
use palpate_solver::{Fits, HistoryRegression, HistorySession, Session};
use socket2::{Domain, Socket, Type};
use std::collections::HashMap;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

const EXAMPLES: &str = "\
Examples:
  palpate serve --model sensor.palpate --listen 127.0.0.1:4700
  palpate serve --model sensor.palpate --listen 127.0.0.1:0 --json

Prints the address, then serves until it is ended (Ctrl-C). Port 0 lets the
system choose a port. Each connection is a session of its own: lines of readings
in, a line for each out, as with `palpate solve --keep-going`. An invalid header
ends the connection after a line with the problem.

At most 1000 connections are served at the same time. A further one takes the
place of the connection that was silent for longest, if for at least a minute.
Otherwise it gets a line with this reason, and is closed. A client that doesn't read its answers for a minute
is disconnected. So is one that speaks HTTP.
There is no password: any program that reaches the address can use it.";

/// Answer readings at a TCP port, one session for each connection
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ServeArgs {
    /// A sensor file, written by `palpate fit`
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Address and port to listen at
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    listen: SocketAddr,
    /// Answer with one JSON object per line instead of CSV
    #[arg(long)]
    json: bool,
    /// Don't print which method is used
    #[arg(long)]
    quiet: bool,
}

/// Largest number of connections at the same time. Each has a thread.
const CONNECTIONS_MAX: usize = 1000;

/// Time after which a silent connection may lose its place to a new one, if all places are taken. As long as there is room,
/// connections may be silent for ever.
const SILENT_AFTER: Duration = Duration::from_secs(60);

/// Stack of a connection's thread. Memory is used only as far as it is needed.
const STACK_BYTES: usize = 4 << 20;

/// Time after which a client that doesn't read its answers is disconnected.
const READS_WITHIN: Duration = Duration::from_secs(60);

/// Pause after a connection that the system couldn't open, for example because there are too many open files.
const REST: Duration = Duration::from_millis(100);

/// Beginnings of a line that is HTTP.
const HTTP: [&[u8]; 10] =
    [b"GET ", b"POST ", b"PUT ", b"HEAD ", b"DELETE ", b"OPTIONS ", b"CONNECT ", b"TRACE ", b"PATCH ", b"PRI "];

/// What all connections share.
struct Service {
    fits: SharedFits,
    json: bool,
    clients: Mutex<Clients>,
}

/// Model that all connections share.
enum SharedFits {
    Contact(Arc<Fits>),
    Vector(Arc<VectorFits>),
    History(Arc<HistoryRegression>),
}

/// Connections that are served.
struct Clients {
    served: HashMap<u64, Arc<ServeClient>>,
    /// Number of connections so far.
    count: u64,
    most: usize,
    silent_after: Duration,
}

/// One connection.
#[derive(Debug)]
struct ServeClient {
    stream: TcpStream,
    /// When it began or last sent something.
    heard: Mutex<Instant>,
}

/// Listens, and gives each connection a thread.
pub(super) fn serve(args: &ServeArgs) -> Result<ExitCode, Failure> {
    let sensor = read_sensor(&args.model, &note)?;
    if !args.quiet {
        tell_sensor(&sensor, false)?;
    }
    let fits = match sensor.model {
        SensorModel::Contact(model) => SharedFits::Contact(Arc::new(Fits::new(*model))),
        SensorModel::Vector(model) => SharedFits::Vector(Arc::new(VectorFits::new(*model))),
        SensorModel::History(model) => SharedFits::History(model.into()),
    };
    let cant = || format!("can't listen at {}", args.listen);
    let listener = listen(args.listen).map_err(|error| {
        let help = match error.kind() {
            io::ErrorKind::AddrInUse => "another program listens there: choose another port with --listen",
            _ => "choose an address of this computer, and a port from 1024 on",
        };
        Failure::usage(miette::miette!(help = help, "{}: {error}", cant()))
    })?;
    let address = listener.local_addr().into_diagnostic().wrap_err_with(cant).map_err(Failure::usage)?;
    if !address.ip().is_loopback() {
        tell("warning: this address may be reached from other computers; there is no password\n")?;
    }
    print(&format!("listening at {address}\n"))?;
    let clients = Mutex::new(Clients::new(CONNECTIONS_MAX, SILENT_AFTER));
    let service = Arc::new(Service { fits, json: args.json, clients });
    loop {
        match listener.accept() {
            Ok((stream, peer)) => service.clone().begin(stream, peer),
            // accepting again at once would only use the processor
            Err(_) => thread::sleep(REST),
        }
    }
}

/// Listens with a queue for as many connections as are served. With the standard library's queue of 128 the system resets
/// connections that arrive while the processor is busy.
fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = Socket::new(Domain::for_address(address), Type::STREAM, None)?;
    #[cfg(unix)]
    socket.set_reuse_address(true)?;
    socket.bind(&address.into())?;
    socket.listen(CONNECTIONS_MAX as i32)?;
    Ok(socket.into())
}

impl Service {
    /// Starts the thread of a connection.
    fn begin(self: Arc<Self>, stream: TcpStream, peer: SocketAddr) {
        let close = |silent: &TcpStream| {
            // a client that doesn't read isn't waited for
            _ = silent.set_nonblocking(true);
            self.refuse(silent, "closed because it was silent, and all connections are in use");
        };
        let admitted = lock(&self.clients).admit(stream, Instant::now(), close);
        let (number, client) = match admitted {
            Ok(admitted) => admitted,
            Err(stream) => return self.refuse(&stream, &format!("{CONNECTIONS_MAX} connections are served already")),
        };
        let service = self.clone();
        let connection = move || {
            // a connection that ends or fails doesn't affect the others
            _ = service.converse(&client, &peer.to_string());
            _ = client.stream.shutdown(Shutdown::Both);
            lock(&service.clients).served.remove(&number);
        };
        if thread::Builder::new().stack_size(STACK_BYTES).spawn(connection).is_err() {
            // the stream is closed
            lock(&self.clients).served.remove(&number);
        }
    }

    /// Answers the lines of a connection until it ends.
    fn converse(&self, client: &ServeClient, peer: &str) -> io::Result<()> {
        let stream = &client.stream;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(READS_WITHIN))?;
        match &self.fits {
            SharedFits::Contact(fits) => {
                let model = fits.model();
                let solutions = Solutions::new(stream, self.json, true, Measure::of(model)).of_methods(model.fitted());
                self.answer(
                    LiveSession::new(Session::sharing(fits.clone())),
                    model.validity().units,
                    client,
                    peer,
                    solutions,
                )
            }
            SharedFits::Vector(fits) => {
                let solutions = ForceSolutions::new(stream, self.json, true);
                self.answer(VectorSession::new(fits.clone()), fits.model().validity().units, client, peer, solutions)
            }
            SharedFits::History(fit) => {
                let solutions = ForceSolutions::new(stream, self.json, true);
                self.answer(HistorySession::new(fit.clone()), fit.validity().units, client, peer, solutions)
            }
        }
    }

    fn answer<S: ReadingSolver>(
        &self,
        session: S,
        units: usize,
        client: &ServeClient,
        peer: &str,
        mut solutions: impl AnswerWriter<S::Solution>,
    ) -> io::Result<()> {
        let mut answers = Answers::new(Readings::new(peer, units, None, Mapping::default()), session);
        let how =
            AnswerStream { source: peer, keep_going: true, with_reasons: false, note: &note, is_refused: is_http };
        let end = how.answer(&mut answers, &mut StreamLines::new(peer, client), &mut solutions)?;
        if let Err(error) = end {
            self.refuse(&client.stream, &error.to_string());
        }
        Ok(())
    }

    /// Writes the reason for which a connection is closed.
    fn refuse(&self, mut stream: &TcpStream, why: &str) {
        let line = match self.json {
            true => format!("{}\n", serde_json::json!({ "error": why })),
            false => format!("error: {why}\n"),
        };
        // a client that is gone needs no reason
        _ = stream.write_all(line.as_bytes());
    }
}

impl Clients {
    fn new(most: usize, silent_after: Duration) -> Clients {
        Clients { served: HashMap::new(), count: 0, most, silent_after }
    }

    /// Admits a connection, and returns it with its number. If all places are taken, it takes that of the connection that was
    /// silent for longest, which `close` informs; or it is returned, if none was silent for long enough.
    fn admit(
        &mut self,
        stream: TcpStream,
        now: Instant,
        mut close: impl FnMut(&TcpStream),
    ) -> Result<(u64, Arc<ServeClient>), TcpStream> {
        if self.served.len() >= self.most {
            let silent = self.served.iter().map(|(number, client)| (*lock(&client.heard), *number)).min();
            match silent.filter(|(heard, _)| now.saturating_duration_since(*heard) >= self.silent_after) {
                Some((_, number)) => self.served.remove(&number).into_iter().for_each(|client| {
                    close(&client.stream);
                    _ = client.stream.shutdown(Shutdown::Both); // its thread ends
                }),
                None => return Err(stream),
            }
        }
        self.count += 1;
        let client = Arc::new(ServeClient { stream, heard: Mutex::new(now) });
        self.served.insert(self.count, client.clone());
        Ok((self.count, client))
    }
}

impl Read for &ServeClient {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = (&self.stream).read(buffer)?;
        *lock(&self.heard) = Instant::now();
        Ok(read)
    }
}

fn address(text: &str) -> Result<SocketAddr, String> {
    let expected = || "expected an address and a port, such as 127.0.0.1:4700 or localhost:4700".to_owned();
    text.to_socket_addrs().ok().and_then(|mut addresses| addresses.next()).ok_or_else(expected)
}

fn is_http(line: &[u8]) -> bool {
    HTTP.iter().any(|method| line.starts_with(method))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_connection_takes_the_place_of_the_one_that_was_silent_for_longest() {
        const MINUTE: Duration = Duration::from_secs(60);
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let connected = || {
            let far = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            (listener.accept().unwrap().0, far)
        };
        let (mut clients, now) = (Clients::new(2, MINUTE), Instant::now());
        let words = |mut near: &TcpStream| near.write_all(b"silent\n").unwrap();
        let [(first, mut first_far), (second, _second_far), (third, _far)] = [connected(), connected(), connected()];
        clients.admit(first, now, words).unwrap();
        let (number, second) = clients.admit(second, now, words).unwrap();
        // both were silent for less than a minute
        let third = clients.admit(third, now + MINUTE - Duration::from_secs(1), words).unwrap_err();
        *lock(&second.heard) = now + Duration::from_secs(50);
        clients.admit(third, now + MINUTE, words).unwrap();
        let mut text = String::new();
        first_far.read_to_string(&mut text).unwrap();
        assert_eq!(text, "silent\n", "then it is closed");
        assert!(clients.served.contains_key(&number) && clients.served.len() == 2);
        // nobody is silent for long enough now
        clients.admit(connected().0, now + MINUTE, words).unwrap_err();
        clients.served.clear();
        clients.admit(connected().0, now, words).unwrap();
        clients.admit(connected().0, now + 100 * MINUTE, words).unwrap();
        assert_eq!(clients.served.len(), 2, "as long as there is room, nobody is closed");
    }
}
