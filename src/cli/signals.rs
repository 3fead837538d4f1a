//! Signals and key presses from a person or the system during a command.

use super::summary;
use crate::api::Failure;
use miette::{IntoDiagnostic, WrapErr};
#[cfg(unix)]
use palpate_link::time::timeout;
use palpate_run::run::Cancel;
use std::io::{self, IsTerminal};
use std::thread;
#[cfg(unix)]
use std::time::Duration;
use tokio::runtime::Builder;

/// Bit of SIGHUP, the first signal, in a mask of signals.
#[cfg(unix)]
const HANGUP_BIT: u64 = 1;

/// Number of SIGTSTP, which Ctrl-Z sends.
#[cfg(any(target_os = "linux", target_os = "android"))]
const SUSPEND: i32 = 20;
#[cfg(all(unix, not(any(target_os = "linux", target_os = "android"))))]
const SUSPEND: i32 = 18;

/// Duration of silence after which a terminal has no more input that was typed earlier.
#[cfg(unix)]
const STILL: Duration = Duration::from_millis(50);
#[cfg(unix)]
const TYPED_BYTES: usize = 256;

/// What the first Ctrl-C asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum First {
    /// A stop.
    Stop,
    /// A pause when the press under way is recorded, as of Ctrl-Z: a program that is suspended would leave the specimen under
    /// load. Another one before the pause is over asks for the stop, and so does the first while the rig is made ready.
    Pause,
}

/// Listens for Ctrl-C and, on Unix, a polite end and a closed terminal, which are a stop at once; under `nohup` a closed terminal
/// is none. `message` is printed when a stop is requested.
///
/// They are heard on a thread of their own, so that a simulated run needs no I/O driver: asking the system for events between
/// any two instants would be its largest cost.
pub(super) fn heed(first: First, message: Option<&'static str>) -> Result<Cancel, Failure> {
    let cancel = Cancel::default();
    let asked = cancel.clone();
    let runtime = Builder::new_current_thread().enable_io().build().into_diagnostic().map_err(Failure::usage)?;
    let signals = {
        let _inside = runtime.enter();
        Signals::new(first).into_diagnostic().wrap_err("can't listen for Ctrl-C").map_err(Failure::usage)?
    };
    let listen = async move {
        let mut signals = signals;
        while let Some(is_gentle) = signals.next().await {
            // a run that continued after a pause may be paused again
            if is_gentle && first == First::Pause && asked.pause() {
                say(&format!("\nfinishing this press, then {}; Ctrl-C again stops immediately", then()));
            } else {
                asked.ask();
                message.into_iter().for_each(|message| say(&format!("\n{message}")));
            }
        }
    };
    let named = thread::Builder::new().name("signals".to_owned());
    // it ends with the program
    drop(named.spawn(move || runtime.block_on(listen)).into_diagnostic().map_err(Failure::usage)?);
    Ok(cancel)
}

/// Whether a person is there who can end a pause: at a terminal that is read and written.
pub(super) fn is_attended() -> bool {
    io::stdin().is_terminal() && io::stderr().is_terminal()
}

/// Forgets what was typed before a pause: an Enter from then isn't the word of a person who has their hands in the rig.
pub(super) fn forget_typed() {
    // on a thread of its own, because a runtime doesn't run in another one; unreadable input can't be discarded
    drop(thread::spawn(read_away).join());
}

#[cfg(unix)]
fn read_away() -> io::Result<()> {
    use tokio::net::unix::pipe;
    Builder::new_current_thread().enable_all().build()?.block_on(async {
        // opened again, so that only this handle reads without waiting
        let typed = pipe::OpenOptions::new().unchecked(true).open_receiver("/dev/stdin")?;
        let mut bytes = [0; TYPED_BYTES];
        while let Ok(readable) = timeout(STILL, typed.readable()).await {
            readable?;
            match typed.try_read(&mut bytes) {
                Ok(0) => break,
                Err(error) if error.kind() != io::ErrorKind::WouldBlock => return Err(error),
                _ => {}
            }
        }
        Ok(())
    })
}

#[cfg(not(unix))]
fn read_away() -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Continues a paused run when the person presses Enter. Where the terminal is gone, that is a stop.
pub(super) fn go_on_at_enter(cancel: &Cancel) {
    let cancel = cancel.clone();
    let wait = move || match io::stdin().read_line(&mut String::new()) {
        Ok(read) if read > 0 => cancel.go_on(),
        _ => cancel.ask(),
    };
    if thread::Builder::new().name("enter".to_owned()).spawn(wait).is_err() {
        say("no terminal input is possible: the run ends here");
    }
}

fn then() -> &'static str {
    if is_attended() { "the run pauses" } else { "the run stops" }
}

/// Prints a text. A closed terminal isn't an error.
fn say(text: &str) {
    let _ = summary::tell(&format!("{text}\n"));
}

#[cfg(unix)]
struct Signals {
    interrupt: tokio::signal::unix::Signal,
    terminate: tokio::signal::unix::Signal,
    /// None where the program was started to outlive its terminal, as `nohup` does.
    hangup: Option<tokio::signal::unix::Signal>,
    /// None where a program that is suspended leaves nothing under load.
    suspend: Option<tokio::signal::unix::Signal>,
}

#[cfg(unix)]
impl Signals {
    fn new(first: First) -> io::Result<Signals> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Signals {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
            hangup: if ignores_hangup() { None } else { Some(signal(SignalKind::hangup())?) },
            suspend: match first {
                First::Pause => Some(signal(SignalKind::from_raw(SUSPEND))?),
                First::Stop => None,
            },
        })
    }

    /// Waits for the next signal. Returns whether it is a person's Ctrl-C or Ctrl-Z.
    async fn next(&mut self) -> Option<bool> {
        tokio::select! {
            heard = heard(&mut self.suspend) => heard.map(|()| true),
            heard = self.interrupt.recv() => heard.map(|()| true),
            heard = self.terminate.recv() => heard.map(|()| false),
            heard = heard(&mut self.hangup) => heard.map(|()| false),
        }
    }
}

/// Waits for the next occurrence of a signal, which may never come.
#[cfg(unix)]
async fn heard(signal: &mut Option<tokio::signal::unix::Signal>) -> Option<()> {
    match signal {
        Some(signal) => signal.recv().await,
        None => std::future::pending().await,
    }
}

/// Whether the program was started with hangups ignored. Linux states it in a file. Without this file, hangups stop the program.
#[cfg(unix)]
fn ignores_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    ignored.is_some_and(|signals| signals & HANGUP_BIT != 0)
}

#[cfg(windows)]
struct Signals {
    ctrl_c: tokio::signal::windows::CtrlC,
    close: tokio::signal::windows::CtrlClose,
    shutdown: tokio::signal::windows::CtrlShutdown,
}

#[cfg(windows)]
impl Signals {
    fn new(_: First) -> io::Result<Signals> {
        use tokio::signal::windows::{ctrl_c, ctrl_close, ctrl_shutdown};
        Ok(Signals { ctrl_c: ctrl_c()?, close: ctrl_close()?, shutdown: ctrl_shutdown()? })
    }

    /// Waits for the next signal. Returns whether it is a person's Ctrl-C.
    async fn next(&mut self) -> Option<bool> {
        tokio::select! {
            heard = self.ctrl_c.recv() => heard.map(|()| true),
            heard = self.close.recv() => heard.map(|()| false),
            heard = self.shutdown.recv() => heard.map(|()| false),
        }
    }
}
