//! A terminal for a test: a person who reads, presses Enter and leaves.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{FdFlags, fcntl_setfd};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::process::{Child, Command};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;
use tokio::runtime::Builder;
use tokio::signal::unix::{self as signals, SignalKind};

/// Longest wait for the next output or action of a program: many times the usual, and an end for one that hangs.
const PATIENCE: Duration = Duration::from_secs(30);

/// If the system can do so, a program that another test starts at this time doesn't inherit the terminal either.
#[cfg(target_os = "linux")]
const CLOSED_IN_PROGRAMS: OpenptFlags = OpenptFlags::CLOEXEC;
#[cfg(not(target_os = "linux"))]
const CLOSED_IN_PROGRAMS: OpenptFlags = OpenptFlags::empty();

/// The person's end. Programs are at the far one.
pub struct TestTerminal {
    near: File,
    far: String,
    /// Written text that wasn't read yet.
    seen: String,
}

impl TestTerminal {
    /// A terminal without a person.
    pub fn open() -> TestTerminal {
        // programs don't inherit the near end, because a terminal closes only when no program has it
        let near = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | CLOSED_IN_PROGRAMS).expect("a pseudo-terminal");
        fcntl_setfd(&near, FdFlags::CLOEXEC).expect("a flag");
        grantpt(&near).expect("it is ours");
        unlockpt(&near).expect("it is open");
        let far = ptsname(&near, Vec::new()).expect("a name").into_string().expect("a path");
        let terminal = TestTerminal { near: near.into(), far, seen: String::new() };
        let far = terminal.far();
        let mut modes = tcgetattr(&far).expect("modes");
        // typed text isn't shown, and no key ends a program
        modes.make_raw();
        tcsetattr(&far, OptionalActions::Now, &modes).expect("modes");
        terminal
    }

    /// For a program's standard input, output or error.
    pub fn far(&self) -> File {
        OpenOptions::new().read(true).write(true).open(&self.far).expect("the far end opens")
    }

    /// Reads until some words have been written, and returns the text before them.
    pub fn until(&mut self, words: &str) -> String {
        loop {
            if let Some((before, behind)) = self.seen.split_once(words) {
                let before = before.to_owned();
                self.seen = behind.to_owned();
                return before;
            }
            assert!(self.read(), "it ended before it said {words:?}: {}", self.seen);
        }
    }

    /// Reads until all programs have left, and returns their output.
    pub fn until_end(mut self) -> String {
        while self.read() {}
        self.seen
    }

    pub fn enter(&mut self) {
        self.line("");
    }

    /// Types a line, as a scanner does.
    pub fn line(&mut self, text: &str) {
        self.near.write_all(format!("{text}\n").as_bytes()).expect("writes");
    }

    /// The person leaves.
    pub fn close(self) {}

    /// Whether there was something, before all programs left.
    fn read(&mut self) -> bool {
        let patience = Timespec { tv_sec: PATIENCE.as_secs() as i64, tv_nsec: 0 };
        let ready = poll(&mut [PollFd::new(&self.near, PollFlags::IN)], Some(&patience)).expect("a poll");
        assert!(ready > 0, "nothing within {} s: {}", PATIENCE.as_secs(), self.seen);
        let mut bytes = [0; 4096];
        // on Linux an error means that no program is left, after everything was read
        let count = self.near.read(&mut bytes).unwrap_or(0);
        self.seen += &String::from_utf8_lossy(&bytes[..count]);
        count > 0
    }
}

/// Starts programs from here with default hangup handling. If `nohup` or a service started the tests, hangups are ignored, and every
/// program inherits that; a signal that is caught here has its default in them.
pub fn heed_hangups() {
    let runtime = Builder::new_current_thread().enable_io().build().expect("a runtime");
    let _inside = runtime.enter();
    // it stays caught as long as this process lives
    drop(signals::signal(SignalKind::hangup()).expect("hangups can be caught"));
}

/// Starts a program.
pub fn spawned(command: &mut Command) -> Child {
    command.spawn().expect("the program starts")
}

/// Sends a signal: `INT`, `TERM`.
pub fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").arg(format!("-{name}")).arg(child.id().to_string()).status();
    assert!(sent.expect("kill starts").success(), "kill -{name}");
}

/// Exit of a program.
pub fn wait(mut child: Child) -> Option<i32> {
    let number = child.id();
    let (sender, receiver) = channel();
    // abandoned if the program hangs
    thread::spawn(move || sender.send(child.wait()));
    let status = receiver.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("process {number} doesn't end"));
    status.expect("it can be waited for").code()
}
