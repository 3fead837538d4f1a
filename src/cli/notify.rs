//! The program of the user's that is started for a session and gets events: `[notify]` of the rig or of the batch file.
//!
//! It gets one JSON line for each verdict (or other end of a run), pause, alarm, and end of the session on its standard input. A
//! receiver that is dead, slow or missing changes nothing of a run: lines pass a bounded queue to a thread of their own.

use super::summary::tell;
use palpate_report::report::counted;
use palpate_run::batch::BatchEvent;
use std::io::{self, Write};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread;
use std::time::Duration;

/// Largest number of lines that wait for the receiver. Further ones are dropped and counted.
const LINES_MOST: usize = 256;

/// Time that a receiver has to end after its input is closed. Then it is left alone.
const ENDS_WITHIN: Duration = Duration::from_secs(5);

/// A receiver of events, started for a session.
pub(super) struct Notifier {
    /// Name of the program for the person.
    program: String,
    lines: Option<SyncSender<String>>,
    ended: Receiver<io::Result<ExitStatus>>,
    passed: AtomicU64,
    written: Arc<AtomicU64>,
    ends_within: Duration,
}

impl Notifier {
    /// Starts the program; `None` without a command. A program that can't be started is reported once.
    pub(super) fn start(command: &[String]) -> Option<Notifier> {
        Notifier::start_for(command, ENDS_WITHIN)
    }

    fn start_for(command: &[String], ends_within: Duration) -> Option<Notifier> {
        let (program, arguments) = command.split_first()?;
        let (lines, queue) = sync_channel(LINES_MOST);
        let (end, ended) = channel();
        let written = Arc::new(AtomicU64::new(0));
        let counter = written.clone();
        let started = started(program, arguments).and_then(|(child, input)| {
            let deliver = move || deliver(child, input, &queue, &counter, &end);
            thread::Builder::new().name("notify".to_owned()).spawn(deliver)
        });
        if let Err(why) = started {
            say(&format!("notify: {program} can't be started: {why}; there are no notifications\n"));
            return None;
        }
        let (program, lines) = (program.clone(), Some(lines));
        Some(Notifier { program, lines, ended, passed: AtomicU64::new(0), written, ends_within })
    }

    /// Passes an event on, if it is one that the receiver gets. Never waits.
    pub(super) fn pass(&self, event: &BatchEvent) {
        let is_passed = matches!(
            event,
            BatchEvent::Ended(_) | BatchEvent::Paused { .. } | BatchEvent::Alarm(_) | BatchEvent::Closed { .. }
        );
        // an event can always be written as JSON: it is in the journal
        let Some(line) = is_passed.then(|| serde_json::to_string(event).ok()).flatten() else { return };
        self.passed.fetch_add(1, Ordering::Relaxed);
        if let Some(lines) = &self.lines {
            _ = lines.try_send(format!("{line}\n"));
        }
    }
}

impl Drop for Notifier {
    /// Closes the receiver's input, gives it some time, and reports what it didn't get.
    fn drop(&mut self) {
        drop(self.lines.take());
        let ended = self.ended.recv_timeout(self.ends_within);
        let passed = self.passed.load(Ordering::Relaxed);
        let lost = passed.saturating_sub(self.written.load(Ordering::Acquire));
        let how = match ended {
            Ok(Ok(status)) if status.success() => String::new(),
            Ok(Ok(status)) => format!("; it ended with {status}"),
            Ok(Err(why)) => format!("; waiting for its end: {why}"),
            Err(_) => "; it is still running".to_owned(),
        };
        if lost > 0 || !how.is_empty() {
            let passed = counted(usize::try_from(passed).unwrap_or(usize::MAX), "event");
            say(&format!("notify: {} didn't get {lost} of {passed}{how}\n", self.program));
        }
    }
}

fn started(program: &str, arguments: &[String]) -> io::Result<(Child, ChildStdin)> {
    let mut command = Command::new(program);
    // the session's outputs: a receiver that keeps running doesn't hold them open
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
    // Ctrl-C at the bench is for the session
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn()?;
    let input = child.stdin.take().ok_or(io::ErrorKind::BrokenPipe)?;
    Ok((child, input))
}

/// Writes lines until there are no more or the receiver is dead, and waits for its end.
fn deliver(
    mut child: Child,
    mut input: ChildStdin,
    queue: &Receiver<String>,
    written: &AtomicU64,
    end: &Sender<io::Result<ExitStatus>>,
) {
    for line in queue {
        if input.write_all(line.as_bytes()).is_err() {
            break;
        }
        written.fetch_add(1, Ordering::Release);
    }
    drop(input);
    _ = end.send(child.wait());
}

/// Reports to the person. Nothing about a receiver stops a run, not even a closed standard error.
fn say(text: &str) {
    _ = tell(text);
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use palpate_run::batch::BatchSession;
    use std::fs;
    use std::path::Path;

    fn at() -> String {
        "2026-11-23T10:00:00+01:00[Europe/Berlin]".to_owned()
    }

    fn shell(script: &str) -> Vec<String> {
        ["sh", "-c", script].map(str::to_owned).to_vec()
    }

    fn paused(serial: &str) -> BatchEvent {
        BatchEvent::Paused { at: at(), serial: serial.to_owned() }
    }

    fn lost(notifier: &Notifier) -> u64 {
        notifier.passed.load(Ordering::Relaxed) - notifier.written.load(Ordering::Acquire)
    }

    #[test]
    fn a_receiver_gets_the_listed_events_as_json_lines_and_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let got = folder.path().join("got");
        let notifier = Notifier::start(&shell(&format!("cat > '{}'", got.display()))).unwrap();
        let events = [
            BatchEvent::Session(BatchSession::default()),
            paused("A-1"),
            BatchEvent::Skipped { at: at(), serial: "A-2".to_owned() },
            BatchEvent::Closed { at: at() },
        ];
        events.iter().for_each(|event| notifier.pass(event));
        drop(notifier);
        let lines = fs::read_to_string(got).unwrap();
        let read: Vec<BatchEvent> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(read, [events[1].clone(), events[3].clone()]);
    }

    /// Its receiver reads nothing until somebody writes to the pipe `go`, and then ends.
    fn deaf(go: &Path) -> Notifier {
        assert!(Command::new("mkfifo").arg(go).status().unwrap().success());
        Notifier::start_for(&shell(&format!("read line < '{}'", go.display())), Duration::ZERO).unwrap()
    }

    #[test]
    fn a_receiver_that_never_reads_is_never_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let go = folder.path().join("go");
        let notifier = deaf(&go);
        let long = "x".repeat(2000);
        let passed = 10 * LINES_MOST as u64;
        (0..passed).for_each(|_| notifier.pass(&paused(&long)));
        assert_eq!(notifier.passed.load(Ordering::Relaxed), passed);
        // lines neither in the pipe nor in the queue are lost
        assert!(lost(&notifier) > passed / 2);
        drop(notifier);
        fs::write(&go, "\n").unwrap();
    }

    #[test]
    fn receiver_that_dies_at_once_does_not_disturb() {
        let notifier = Notifier::start(&shell("exit 3")).unwrap();
        (0..10 * LINES_MOST).for_each(|_| notifier.pass(&paused("A-1")));
        assert!(lost(&notifier) > 0);
        drop(notifier);
    }

    #[test]
    fn without_a_command_or_a_program_there_is_no_receiver() {
        assert!(Notifier::start(&[]).is_none());
        assert!(Notifier::start(&["no-such-program-anywhere".to_owned()]).is_none());
    }
}
