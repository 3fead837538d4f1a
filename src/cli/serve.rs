//! `palpate serve`: answers readings of many connections at a TCP port, like `solve` answers standard input.

use super::exit::Failure;
use super::solutions::Solutions;
use super::solve::told_sensor_file;
use super::stream::Stream;
use super::summary::{print, tell};
use miette::{IntoDiagnostic, WrapErr};
use palpate_data::dataset::Mapping;
use palpate_data::dataset::answers::Answers;
use palpate_data::dataset::readings::{Lines, Readings};
use palpate_solver::{Fits, Session};
use socket2::{Domain, Socket, Type};
use std::io::{self, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

const EXAMPLES: &str = "\
Examples:
  palpate serve --model sensor.palpate --listen 127.0.0.1:4700
  palpate serve --model sensor.palpate --listen 127.0.0.1:0 --json

Prints the address, then serves until it is ended (Ctrl-C). Port 0 lets the
system choose a port. Each connection is a session of its own: lines of readings
in, a line for each out, as with `palpate solve --keep-going`. An invalid header
ends the connection after a line with the problem.

At most 1000 connections are served at the same time. Further ones get a line
with this reason, and are closed. A client that doesn't read its answers for a minute
is disconnected. So is one that speaks HTTP, because browsers reach this address.
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
    fits: Arc<Fits>,
    json: bool,
    connections: AtomicUsize,
}

/// Listens, and gives each connection a thread.
pub(super) fn serve(args: &ServeArgs) -> Result<ExitCode, Failure> {
    let fits = Arc::new(Fits::new(told_sensor_file(&args.model, args.quiet)?));
    let cant = || format!("can't listen at {}", args.listen);
    let listener = listen(args.listen).into_diagnostic().wrap_err_with(cant).map_err(Failure::usage)?;
    let address = listener.local_addr().into_diagnostic().wrap_err_with(cant).map_err(Failure::usage)?;
    if !address.ip().is_loopback() {
        tell("warning: this address may be reached from other computers; there is no password\n")?;
    }
    print(&format!("listening at {address}\n"))?;
    let service = Arc::new(Service { fits, json: args.json, connections: AtomicUsize::new(0) });
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
        if self.connections.fetch_add(1, Ordering::Relaxed) >= CONNECTIONS_MAX {
            self.refuse(&stream, &format!("{CONNECTIONS_MAX} connections are served already"));
            self.connections.fetch_sub(1, Ordering::Relaxed);
            return;
        }
        let service = self.clone();
        let connection = move || {
            // a connection that ends or fails concerns nobody else
            _ = service.converse(&stream, &peer.to_string());
            _ = stream.shutdown(Shutdown::Both);
            service.connections.fetch_sub(1, Ordering::Relaxed);
        };
        if thread::Builder::new().stack_size(STACK_BYTES).spawn(connection).is_err() {
            // the stream is closed
            self.connections.fetch_sub(1, Ordering::Relaxed);
        }
    }

    /// Answers the lines of a connection until it ends.
    fn converse(&self, stream: &TcpStream, peer: &str) -> io::Result<()> {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(READS_WITHIN))?;
        let readings = Readings::new(peer, self.fits.model().validity().units, None, Mapping::default());
        let mut answers = Answers::new(readings, Session::sharing(self.fits.clone()));
        let how = Stream { source: peer, keep_going: true, reasons_are_told: false, is_refused: is_http };
        let mut solutions = Solutions::new(stream, self.json, true);
        let end = how.answer(&mut answers, &mut Lines::new(peer, stream), &mut solutions)?;
        if let Err(error) = end {
            self.refuse(stream, &error.to_string());
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

fn address(text: &str) -> Result<SocketAddr, String> {
    let expected = || "expected an address and a port, such as 127.0.0.1:4700 or localhost:4700".to_owned();
    text.to_socket_addrs().ok().and_then(|mut addresses| addresses.next()).ok_or_else(expected)
}

fn is_http(line: &[u8]) -> bool {
    HTTP.iter().any(|method| line.starts_with(method))
}
