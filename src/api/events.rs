//! Events of a run on a thread of its own, for a consumer that may be slow.
//!
//! The run never waits for the consumer. Contacts that don't fit into the queue are read from the journal, where they are by
//! then. Events about the progress are lost if too many of them wait.

use super::{Failure, OpenedRun};
use palpate_core::parallel::lock;
use palpate_data::dataset::{DatasetError, JOURNAL, Journal, Press, Record, RecordedContact, Retouch, Status};
use palpate_data::recipe::{Entry, Phase};
use palpate_link::device::Identity;
use palpate_run::run::{Cancel, Listener};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Largest number of contacts that wait in the queue, or are read from the journal at once.
const CONTACTS_MAX: usize = 1024;
/// Largest number of events about the progress that wait. The oldest is lost.
const PROGRESS_MAX: usize = 256;

/// An event of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum RunEvent {
    /// The instruments are ready.
    Ready(Vec<Identity>),
    /// A press begins.
    Begins {
        /// Number of the press in the plan.
        press: u64,
        /// Its purpose.
        phase: Phase,
    },
    /// A place was touched again before the run continues.
    Retouched(Retouch),
    /// The indenter rests without load.
    Rests {
        /// Duration, s.
        seconds: f64,
    },
    /// A level of a press is on disk.
    Pressed(Box<Press>),
    /// The run has ended, and the stage is parked.
    Ended(Status),
}

/// The events of a run under way. The run is stopped and the stage is parked when this is dropped.
pub struct RunEvents {
    path: PathBuf,
    planned: usize,
    runner: Arc<RunThread>,
    queue: Arc<Queue>,
    /// Levels that are handed out before the queue.
    levels: VecDeque<Press>,
    /// Number of contacts that left the queue or were read from the journal.
    taken: usize,
    is_over: bool,
}

/// The thread of a run.
pub struct RunThread {
    cancel: Cancel,
    /// Bits of the latest force, N.
    force: Arc<AtomicU64>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl RunThread {
    /// Returns the latest reading of the load cell, N, relative to its zero.
    pub fn force_n(&self) -> f64 {
        f64::from_bits(self.force.load(Ordering::Relaxed))
    }

    /// Stops the run as the first Ctrl-C does: after the press under way. At once while the rig is being prepared.
    pub fn stop(&self) {
        if !self.cancel.pause() && !self.cancel.pausing() {
            self.cancel.ask();
        }
    }

    /// Stops the run as a second Ctrl-C does, and returns when the stage is parked.
    pub fn park(&self) {
        self.cancel.ask();
        let thread = lock(&self.thread).take();
        // the queue has the end after a panic
        thread.into_iter().for_each(|thread| drop(thread.join()));
    }
}

/// Answer to a request for the next event.
#[derive(Debug)]
pub enum Next {
    /// The event.
    Event(RunEvent),
    /// There was no event in this time.
    Waiting,
    /// The run has failed; no event follows.
    Failed(Failure),
    /// No event follows.
    Over,
}

#[derive(Default)]
struct Queue {
    state: Mutex<EventQueue>,
    changed: Condvar,
}

#[derive(Default)]
struct EventQueue {
    /// Number of events so far.
    order: u64,
    contacts: VecDeque<(u64, Vec<Press>)>,
    progress: VecDeque<(u64, RunEvent)>,
    /// Number of contacts on disk.
    recorded: usize,
    /// Whether contacts are only on disk because the queue was full.
    is_behind: bool,
    end: Option<Result<Status, Failure>>,
}

impl RunEvents {
    /// Begins to execute a run on a thread of its own.
    ///
    /// # Errors
    /// The system starts no thread.
    pub fn start(mut begun: OpenedRun) -> Result<RunEvents, Failure> {
        let (path, planned) = (begun.path().to_owned(), begun.planned());
        let (cancel, queue) = (Cancel::default(), Arc::new(Queue::default()));
        let (force, asked, heard) = (Arc::new(AtomicU64::default()), cancel.clone(), queue.clone());
        let latest = force.clone();
        let execute = move || {
            let shown = |force_n: f64| latest.store(force_n.to_bits(), Ordering::Relaxed);
            let executed = catch_unwind(AssertUnwindSafe(|| begun.execute(&asked, &shown, &mut Heard(&heard))));
            let end = executed.unwrap_or_else(|_| Err(Failure::of_panic()));
            lock(&heard.state).end = Some(end);
            heard.changed.notify_all();
        };
        let thread = thread::Builder::new().name("run".to_owned()).spawn(execute);
        let thread = thread.map_err(|why| Failure::usage(miette::miette!("no thread for the run: {why}")))?;
        let runner = Arc::new(RunThread { cancel, force, thread: Mutex::new(Some(thread)) });
        Ok(RunEvents { path, planned, runner, queue, levels: VecDeque::new(), taken: 0, is_over: false })
    }

    /// Returns the events of a run that was complete already: only its end.
    pub fn of_complete(path: PathBuf, planned: usize) -> RunEvents {
        let runner = RunThread { cancel: Cancel::default(), force: Arc::default(), thread: Mutex::default() };
        let state = EventQueue { end: Some(Ok(Status::Complete)), ..EventQueue::default() };
        let queue = Queue { state: Mutex::new(state), changed: Condvar::new() };
        let (runner, queue) = (Arc::new(runner), Arc::new(queue));
        RunEvents { path, planned, runner, queue, levels: VecDeque::new(), taken: 0, is_over: false }
    }

    /// Returns the folder of the run.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the number of presses of the plan.
    pub fn planned(&self) -> usize {
        self.planned
    }

    /// Returns the thread of the run.
    pub fn runner(&self) -> &Arc<RunThread> {
        &self.runner
    }

    /// Waits for the next event for at most this time.
    pub fn next(&mut self, most: Duration) -> Next {
        loop {
            if let Some(press) = self.levels.pop_front() {
                return Next::Event(RunEvent::Pressed(Box::new(press)));
            }
            if self.is_over {
                return Next::Over;
            }
            let mut state = lock(&self.queue.state);
            if state.is_idle() {
                let waited = self.queue.changed.wait_timeout_while(state, most, |state| state.is_idle());
                let (waited, timeout) = waited.unwrap_or_else(PoisonError::into_inner);
                if timeout.timed_out() {
                    return Next::Waiting;
                }
                state = waited;
            }
            if let Some(event) = state.progress_before_contact() {
                return Next::Event(event);
            }
            if let Some((_, levels)) = state.contacts.pop_front() {
                self.taken += 1;
                self.levels.extend(levels);
            } else if state.is_behind {
                let recorded = state.recorded;
                drop(state);
                if let Err(error) = self.read_on(recorded) {
                    self.is_over = true;
                    return Next::Failed(Failure::dataset(error));
                }
                let mut state = lock(&self.queue.state);
                state.is_behind = self.taken < state.recorded;
            } else if let Some(end) = state.end.take() {
                self.is_over = true;
                return end.map_or_else(Next::Failed, |status| Next::Event(RunEvent::Ended(status)));
            }
        }
    }

    /// Reads contacts that weren't queued from the journal, up to the last of `recorded`.
    fn read_on(&mut self, recorded: usize) -> Result<(), DatasetError> {
        let mut contacts = 0;
        for record in Journal::<Record>::records(&self.path.join(JOURNAL))? {
            let Record::Contact(contact) = record?.1 else { continue };
            contacts += 1;
            if contacts > self.taken {
                self.levels.extend(contact.levels);
                self.taken += 1;
                if self.levels.len() >= CONTACTS_MAX || self.taken == recorded {
                    break;
                }
            }
        }
        Ok(())
    }
}

impl Drop for RunEvents {
    fn drop(&mut self) {
        self.runner.park();
    }
}

impl EventQueue {
    /// Whether there is nothing to hand out.
    fn is_idle(&self) -> bool {
        self.contacts.is_empty() && self.progress.is_empty() && !self.is_behind && self.end.is_none()
    }

    /// Takes the first event about the progress, if it came before the first contact.
    fn progress_before_contact(&mut self) -> Option<RunEvent> {
        let (order, _) = self.progress.front()?;
        let is_first = self.contacts.front().is_none_or(|(contact, _)| order < contact);
        is_first.then(|| self.progress.pop_front()).flatten().map(|(_, event)| event)
    }
}

/// Puts the events of a run into the queue.
struct Heard<'a>(&'a Queue);

impl Heard<'_> {
    fn progress(&self, event: RunEvent) {
        let mut state = lock(&self.0.state);
        state.order += 1;
        let order = state.order;
        if state.progress.len() == PROGRESS_MAX {
            state.progress.pop_front();
        }
        state.progress.push_back((order, event));
        self.0.changed.notify_one();
    }
}

impl Listener for Heard<'_> {
    fn ready(&mut self, devices: &[Identity]) {
        self.progress(RunEvent::Ready(devices.to_vec()));
    }

    fn retouched(&mut self, retouch: &Retouch) {
        self.progress(RunEvent::Retouched(*retouch));
    }

    fn begins(&mut self, entry: &Entry) {
        self.progress(RunEvent::Begins { press: entry.press, phase: entry.phase });
    }

    fn rests(&mut self, seconds: f64) {
        self.progress(RunEvent::Rests { seconds });
    }

    fn recorded(&mut self, contact: &RecordedContact) {
        let mut state = lock(&self.0.state);
        state.order += 1;
        state.recorded += 1;
        let order = state.order;
        if state.is_behind || state.contacts.len() == CONTACTS_MAX {
            state.is_behind = true;
        } else {
            state.contacts.push_back((order, contact.levels.clone()));
        }
        self.0.changed.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::{RunOptions, begin, read_run};
    use tempfile::TempDir;

    const LONG: Duration = Duration::from_secs(60);

    /// A run of these steps.
    fn started(folder: &TempDir, steps: &str) -> RunEvents {
        let recipe = folder.path().join("recipe.toml");
        std::fs::write(&recipe, format!("name = \"r\"\nrig = \"sim\"\n{steps}")).unwrap();
        let options = RunOptions { recipe, out: Some(folder.path().join("run")), ..RunOptions::default() };
        RunEvents::start(begin(&options).unwrap()).ok().unwrap()
    }

    /// Presses at random places.
    fn random(count: usize) -> String {
        let area = "x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], force_n = [0.1, 1.0]";
        format!("[press]\nsample_s = 0.02\n[[step]]\nphase = \"test\"\nrandom = {{ count = {count}, {area} }}\n")
    }

    fn drained(events: &mut RunEvents) -> (Vec<Press>, Vec<RunEvent>, Next) {
        let (mut presses, mut others) = (Vec::new(), Vec::new());
        loop {
            match events.next(LONG) {
                Next::Event(RunEvent::Pressed(press)) => presses.push(*press),
                Next::Event(event) => others.push(event),
                end => return (presses, others, end),
            }
        }
    }

    #[test]
    fn slow_consumer_gets_every_press() {
        let folder = tempfile::tempdir().unwrap();
        let count = 2 * CONTACTS_MAX + 5;
        let mut events = started(&folder, &random(count));
        let thread = lock(&events.runner.thread).take();
        thread.unwrap().join().unwrap();
        assert_eq!(lock(&events.queue.state).contacts.len(), CONTACTS_MAX);
        let (presses, others, end) = drained(&mut events);
        let (recorded, ..) = read_run(events.path(), &|_| {}).unwrap();
        let expected: Vec<Press> = recorded.contacts.into_iter().flat_map(|contact| contact.levels).collect();
        assert_eq!((presses.len(), others.len()), (count, PROGRESS_MAX + 1));
        assert_eq!((presses, others.last()), (expected, Some(&RunEvent::Ended(Status::Complete))));
        assert!(matches!(end, Next::Over));
    }

    #[test]
    fn a_consumer_that_keeps_up_gets_the_events_in_their_order() {
        let folder = tempfile::tempdir().unwrap();
        let mut events = started(&folder, &random(40));
        let mut numbers = Vec::new();
        loop {
            match events.next(LONG) {
                Next::Event(RunEvent::Begins { press, .. }) => numbers.push((press, false)),
                Next::Event(RunEvent::Pressed(press)) => numbers.push((press.press, true)),
                Next::Event(_) => {}
                end => break assert!(matches!(end, Next::Over)),
            }
        }
        assert_eq!(numbers, (0..40).flat_map(|press| [(press, false), (press, true)]).collect::<Vec<_>>());
        assert!(matches!(events.next(LONG), Next::Over));
    }

    #[test]
    fn a_run_whose_events_are_dropped_is_stopped_and_parked() {
        let folder = tempfile::tempdir().unwrap();
        let mut events = started(&folder, &random(20_000));
        while !matches!(events.next(LONG), Next::Event(RunEvent::Pressed(_))) {}
        let path = events.path().to_owned();
        drop(events);
        let (recorded, ..) = read_run(&path, &|_| {}).unwrap();
        assert!(recorded.has_ended && recorded.manifest.status == Status::Stopped);
        assert!(!recorded.contacts.is_empty() && recorded.contacts.len() < 20_000);
    }

    #[test]
    fn stop_finishes_the_current_press() {
        let folder = tempfile::tempdir().unwrap();
        let mut events = started(&folder, &random(20_000));
        while !matches!(events.next(LONG), Next::Event(RunEvent::Pressed(_))) {}
        events.runner().stop();
        let (_, others, end) = drained(&mut events);
        assert_eq!(others.last(), Some(&RunEvent::Ended(Status::Stopped)));
        assert!(matches!(end, Next::Over));
    }
}
