//! A program whose standard input and output are a link, and the way it is ended.

use super::ByteStream;
use crate::time::{Sleep, sleep};
use palpate_core::parallel::lock;
use std::future::Future;
use std::io;
use std::pin::Pin;
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::task::{Context, Poll, ready};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::process::{ChildStdin, ChildStdout};

/// Time from the end of a program's input to the program's own end (docs/reference/process.md). During this time the program brings its
/// device to rest.
const INPUT_ENDED_DEADLINE: Duration = Duration::from_secs(2);

/// Time from the signal that asks a program to end to the signal that it can't ignore.
#[cfg(unix)]
const TERMINATED_DEADLINE: Duration = Duration::from_secs(1);

/// Longest wait for the end of a killed program, which the system may delay.
const KILLED_DEADLINE: Duration = Duration::from_secs(1);

/// Largest number of looks at a program that closed its output or input. Its exit status is available a moment later.
const STATUS_LOOKS: u32 = 40;

/// Interval between checks whether a program has ended.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// Threads that wait for the programs to end.
static ENDING: Mutex<Vec<JoinHandle<()>>> = Mutex::new(Vec::new());

/// Input and output of a program. When this value is dropped, the program's input ends, and a thread waits for the program's end.
#[derive(Debug)]
struct ProgramPipes {
    input: ChildStdin,
    /// Running program; `None` only during the drop.
    running: Option<Running>,
}

/// Running program, from its start to its end.
#[derive(Debug)]
struct Running {
    child: Child,
    /// Output of the program, kept open until the end though nobody reads it any more. A program that writes a last answer isn't
    /// killed for that.
    output: ChildStdout,
    /// Number of checks of the exit status since the program closed its output or input.
    looks: u32,
    next_look: Option<Pin<Box<Sleep>>>,
}

/// Starts a program. The link is the program's standard input and output.
pub(super) fn start(command: &[String]) -> io::Result<ByteStream> {
    let (program, arguments) = command.split_first().ok_or(io::ErrorKind::InvalidInput)?;
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped());
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        command.process_group(0); // Ctrl-C is handled here: the stage is still needed to park
    }
    let mut child = command.spawn().map_err(|error| not_started(program, &error))?;
    match (child.stdin.take(), child.stdout.take()) {
        (Some(input), Some(output)) => {
            let running = Running { child, output: ChildStdout::from_std(output)?, looks: 0, next_look: None };
            Ok(Box::new(ProgramPipes { input: ChildStdin::from_std(input)?, running: Some(running) }))
        }
        _ => Err(io::ErrorKind::BrokenPipe.into()),
    }
}

/// Returns the reason why a program can't be started.
fn not_started(program: &str, error: &io::Error) -> io::Error {
    let text = match error.kind() {
        io::ErrorKind::NotFound => format!("the program `{program}` wasn't found"),
        _ => format!("the program `{program}` can't be started: {error}"),
    };
    io::Error::new(error.kind(), text)
}

/// Waits until every program whose link was dropped has ended or couldn't be ended.
pub(super) fn wait_for_ends() {
    let ending = std::mem::take(&mut *lock(&ENDING));
    for thread in ending {
        let _ = thread.join(); // nothing more can be done in either case
    }
}

impl Drop for ProgramPipes {
    fn drop(&mut self) {
        let Some(mut running) = self.running.take() else { return };
        // a thread of its own, because the caller still has a stage to park; the input ends when this returns
        let thread = thread::Builder::new().name("ending".to_owned()).spawn(move || running.see_to_its_end());
        // without a thread it only gets the end of its input
        lock(&ENDING).extend(thread);
    }
}

impl Running {
    /// Returns the error for a program that closed its output or input. It contains the exit status if the status is available
    /// soon.
    fn poll_ended(&mut self, context: &mut Context<'_>) -> Poll<io::Error> {
        loop {
            if let Some(look) = &mut self.next_look
                && look.as_mut().poll(context).is_pending()
            {
                return Poll::Pending;
            }
            self.next_look = None;
            let text = match self.child.try_wait() {
                Ok(Some(status)) => format!("the program has ended ({status})"),
                Ok(None) if self.looks < STATUS_LOOKS => {
                    self.looks += 1;
                    self.next_look = Some(Box::pin(sleep(LOOK_EVERY)));
                    continue;
                }
                _ => "the program closed its output".to_owned(),
            };
            return Poll::Ready(io::Error::new(io::ErrorKind::UnexpectedEof, text));
        }
    }

    fn see_to_its_end(&mut self) {
        if self.ends_within(INPUT_ENDED_DEADLINE) {
            return;
        }
        #[cfg(unix)]
        {
            group::terminate(&self.child);
            if self.ends_within(TERMINATED_DEADLINE) {
                return;
            }
            group::kill(&self.child);
        }
        #[cfg(not(unix))]
        let _ = self.child.kill(); // it has ended just now
        self.ends_within(KILLED_DEADLINE);
    }

    fn ends_within(&mut self, deadline: Duration) -> bool {
        let until = Instant::now() + deadline;
        while !self.has_ended() {
            if Instant::now() >= until {
                return false;
            }
            thread::sleep(LOOK_EVERY);
        }
        true
    }

    /// Whether the program has ended, and on Unix also all processes that it started in its group.
    fn has_ended(&mut self) -> bool {
        // a process without a status has ended
        let has_ended = !matches!(self.child.try_wait(), Ok(None));
        #[cfg(unix)]
        let has_ended = has_ended && !group::is_there(&self.child);
        has_ended
    }
}

/// Process group that a program leads. The group has the program's number. The system doesn't reuse this number while a process
/// of the group exists.
#[cfg(unix)]
mod group {
    use rustix::process::{Pid, Signal, kill_process_group, test_kill_process_group};
    use std::process::Child;

    pub(super) fn is_there(leader: &Child) -> bool {
        of(leader).is_some_and(|group| test_kill_process_group(group).is_ok())
    }

    pub(super) fn terminate(leader: &Child) {
        send(leader, Signal::TERM);
    }

    pub(super) fn kill(leader: &Child) {
        send(leader, Signal::KILL);
    }

    fn send(leader: &Child, signal: Signal) {
        if let Some(group) = of(leader) {
            let _ = kill_process_group(group, signal); // it has ended, or belongs to another user
        }
    }

    fn of(leader: &Child) -> Option<Pid> {
        Pid::from_raw(i32::try_from(leader.id()).ok()?)
    }
}

impl AsyncRead for ProgramPipes {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, read: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let Some(running) = &mut self.running else { return Poll::Ready(Ok(())) };
        if running.next_look.is_none() {
            let before = read.filled().len();
            ready!(Pin::new(&mut running.output).poll_read(context, read))?;
            if read.filled().len() > before || read.remaining() == 0 {
                return Poll::Ready(Ok(()));
            }
        }
        running.poll_ended(context).map(Err)
    }
}

impl AsyncWrite for ProgramPipes {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let is_asked = self.running.as_ref().is_some_and(|running| running.next_look.is_some());
        if !is_asked {
            match ready!(Pin::new(&mut self.input).poll_write(context, bytes)) {
                Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {}
                written => return Poll::Ready(written),
            }
        }
        match &mut self.running {
            Some(running) => running.poll_ended(context).map(Err),
            None => Poll::Ready(Err(io::ErrorKind::BrokenPipe.into())),
        }
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.input).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.input).poll_shutdown(context)
    }
}
