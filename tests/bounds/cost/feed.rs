//! Runs a command to its end, and gives it readings as users do.

use rustix::process::{Pid, Signal, kill_process};
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

/// How the readings arrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Feed {
    /// As a file.
    File,
    /// Through a pipe, each line after the answer to the one before.
    Pipe,
    /// Through so many connections to a server in turn, each line after the answer to the one before. So one thread works at a time,
    /// and every run counts the same.
    Server { connections: usize },
}

/// Longest wait for an answer: an end for a server that hangs.
const PATIENCE: Duration = Duration::from_secs(120);

/// Runs a command in a folder until it has answered each line, and returns how it ended. A server is ended by SIGTERM.
pub(super) fn feed(mut command: Command, feed: Feed, lines: &[String], folder: &Path, name: &str) -> ExitStatus {
    let input = folder.join(format!("{name}.lines"));
    std::fs::write(&input, lines.concat()).expect("a file can be written");
    command.stdin(match feed {
        Feed::File => Stdio::from(File::open(&input).expect("what was written")),
        Feed::Pipe => Stdio::piped(),
        Feed::Server { .. } => Stdio::null(),
    });
    command.stdout(if feed == Feed::File { Stdio::null() } else { Stdio::piped() });
    let mut child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    match feed {
        Feed::File => {}
        Feed::Pipe => through_pipe(&mut child, lines),
        Feed::Server { connections } => through_connections(&mut child, connections, lines),
    }
    child.wait().expect("it can be waited for")
}

/// Ends at the first line without an answer: the program has ended, and its exit is the reason.
fn through_pipe(child: &mut Child, lines: &[String]) {
    let mut input = child.stdin.take().expect("piped");
    let mut answers = BufReader::new(child.stdout.take().expect("piped"));
    lines.iter().all(|line| is_answered(line, &mut input, &mut answers));
}

fn through_connections(child: &mut Child, connections: usize, lines: &[String]) {
    let mut said = BufReader::new(child.stdout.take().expect("piped"));
    let mut line = String::new();
    said.read_line(&mut line).expect("text");
    let Some(address) = line.trim().strip_prefix("listening at ") else { return };
    let connect = |_| {
        let stream = TcpStream::connect(address).expect("it listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a socket");
        let answers = BufReader::new(stream.try_clone().expect("a socket"));
        (stream, answers)
    };
    let mut clients: Vec<_> = (0..connections).map(connect).collect();
    let mut turns = lines.iter().enumerate();
    turns.all(|(index, line)| {
        let (stream, answers) = &mut clients[index % connections];
        is_answered(line, stream, answers)
    });
    // one that has ended already keeps its exit
    let _ = kill_process(Pid::from_child(child), Signal::TERM);
}

fn is_answered(line: &str, input: &mut impl Write, answers: &mut impl BufRead) -> bool {
    let mut answer = String::new();
    input.write_all(line.as_bytes()).is_ok() && answers.read_line(&mut answer).is_ok_and(|bytes| bytes > 0)
}
