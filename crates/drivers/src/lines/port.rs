//! Port that receives lines or frames continuously, also when no driver waits for one.

use super::count::Counted;
use super::framing::{Finder, Rejected};
use super::moment::DeviceClock;
use super::profile::LineProfile;
use palpate_core::parallel::lock;
use palpate_core::quantity::seconds;
use palpate_link::device::shown;
use palpate_link::time::{Instant, Task, sleep_until, spawn, timeout_at};
use palpate_link::wire::{ByteStream, Connector};
use std::io;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::sync::Notify;
use tokio::task::coop::unconstrained;

/// Number of bytes that are received at once. A full piece comes from a queue, so its readings may be old.
const PIECE_BYTES: usize = 4096;

/// Silence after the port was opened, before a command is sent to a device that sends nothing by itself. An Uno restarts then, and
/// its bootloader takes 1.5 to 2 s.
const BOOT: Duration = Duration::from_millis(2500);

/// Largest number of packets that are taken from the queue at once. A full queue of Linux has some 300.
const QUEUE_MOST: usize = 1000;

/// Longest wait until a command is sent.
const SEND_DEADLINE: Duration = Duration::from_secs(1);

/// A reading, with its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Received {
    /// Numbers of the reading.
    pub numbers: Vec<f64>,
    /// Time of the reading: when its last byte arrived, or earlier if the device's own time shows that it was held back.
    pub at: Instant,
    /// How many readings came before it.
    pub nth: u64,
}

/// A link to a device that sends lines or frames, shared by the roles that read from it.
///
/// A task receives everything and keeps only the newest reading, so nothing piles up. It ends with the last of the roles.
#[derive(Clone)]
pub struct LinePort {
    link: Arc<OpenLink>,
    mailbox: Arc<Mailbox>,
    profile: Arc<LineProfile>,
}

/// The link, and the task that receives from it.
struct OpenLink {
    connector: Arc<tokio::sync::Mutex<Connector>>,
    task: Mutex<Option<Task>>,
}

/// What the task and the roles share.
#[derive(Default)]
struct Mailbox {
    state: Mutex<PortState>,
    /// Notified when something came, or the link failed.
    came: Notify,
    /// Notified when a reading is asked for.
    asked: Notify,
}

/// What came on a port so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PortCounts {
    /// Readings.
    pub good: u64,
    /// Lines, frames or packets that aren't readings.
    pub rejected: u64,
    /// Readings that the device counted, but that didn't arrive.
    pub lost: u64,
}

#[derive(Default)]
struct PortState {
    newest: Option<Received>,
    counts: PortCounts,
    last_rejected: Option<Rejected>,
    /// Why the link failed.
    failed: Option<String>,
}

impl Drop for OpenLink {
    fn drop(&mut self) {
        lock(&self.task).take().into_iter().for_each(|task| task.abort());
    }
}

impl LinePort {
    /// Creates a port behind a link. Nothing is opened yet.
    pub fn new(connector: Connector, profile: LineProfile) -> LinePort {
        let connector = Arc::new(tokio::sync::Mutex::new(connector));
        let link = OpenLink { connector, task: Mutex::default() };
        LinePort { link: Arc::new(link), mailbox: Arc::default(), profile: Arc::new(profile) }
    }

    /// The profile of the device.
    pub fn profile(&self) -> &LineProfile {
        &self.profile
    }

    /// Waits for the first reading after the link is opened.
    ///
    /// # Errors
    /// What went wrong, in words.
    pub async fn start(&self) -> Result<Received, String> {
        let is_sent = self.profile.ask.is_some() || self.profile.on_start.is_some();
        let boot = if is_sent { boot(&self.profile) } else { Duration::ZERO };
        self.newer_than(0, Instant::now() + boot + seconds(self.profile.start_s)).await
    }

    /// Returns the newest reading, once one came after the first `nth`. A device that only answers is asked.
    ///
    /// # Errors
    /// What went wrong, in words: the link failed, or no reading came in time.
    pub async fn newer_than(&self, nth: u64, until: Instant) -> Result<Received, String> {
        self.receive();
        let began = Instant::now();
        if self.profile.ask.is_some() {
            self.mailbox.asked.notify_one();
        }
        loop {
            let came = self.mailbox.came.notified();
            if let Some(found) = self.found(nth)? {
                return Ok(found);
            }
            if timeout_at(until, came).await.is_err() {
                // bytes that arrive at this time count
                return self.found(nth)?.ok_or_else(|| self.silence(began.elapsed()));
            }
        }
    }

    /// Numbers of readings and of what isn't one so far.
    pub fn counts(&self) -> PortCounts {
        self.state().counts
    }

    fn found(&self, nth: u64) -> Result<Option<Received>, String> {
        let mut state = self.state();
        if let Some(newest) = state.newest.as_ref().filter(|newest| newest.nth >= nth) {
            return Ok(Some(newest.clone()));
        }
        match state.failed.take() {
            Some(why) => Err(why),
            None => Ok(None),
        }
    }

    /// Says that nothing came, and what came that isn't a reading.
    fn silence(&self, waited: Duration) -> String {
        let state = self.state();
        let waited_ms = waited.as_millis();
        let PortCounts { good, rejected, lost } = state.counts;
        match &state.last_rejected {
            Some(Rejected { expected, received }) if good == 0 => format!(
                "no reading within {waited_ms} ms, but {rejected} other lines or frames: expected {expected}, and the last was {:?}",
                shown(received)
            ),
            _ if lost > 0 => {
                format!(
                    "no reading within {waited_ms} ms; before, {lost} of {} readings were lost on their way",
                    good + lost
                )
            }
            _ => format!("no reading within {waited_ms} ms"),
        }
    }

    /// Begins to receive, if the link isn't open.
    fn receive(&self) {
        let mut task = lock(&self.link.task);
        if task.as_ref().is_none_or(Task::is_finished) {
            let (connector, mailbox, profile) =
                (self.link.connector.clone(), self.mailbox.clone(), self.profile.clone());
            *task = Some(spawn(async move {
                let ended = async {
                    let stream = connector.lock().await.open().await?;
                    Receiver::new(&profile).receive(stream, &mailbox).await
                };
                if let Err(error) = ended.await {
                    lock(&mailbox.state).failed = Some(format!("the link failed: {error}"));
                    mailbox.came.notify_waiters();
                }
            }));
        }
    }

    fn state(&self) -> MutexGuard<'_, PortState> {
        lock(&self.mailbox.state)
    }
}

/// What is known of the readings so far on a link that is open.
struct Receiver<'a> {
    profile: &'a LineProfile,
    finder: Finder,
    clock: DeviceClock,
    /// The device's count at the last reading.
    count: Option<f64>,
    /// Newest reading that isn't in the mailbox yet.
    fresh: Option<Received>,
    opened: Instant,
}

impl<'a> Receiver<'a> {
    fn new(profile: &'a LineProfile) -> Self {
        let finder = Finder::new(profile.framing.clone(), profile.ask.is_some());
        Receiver { profile, finder, clock: DeviceClock::default(), count: None, fresh: None, opened: Instant::now() }
    }

    /// Receives until the link fails.
    async fn receive(&mut self, mut stream: ByteStream, mailbox: &Mailbox) -> io::Result<()> {
        let mut piece = [0; PIECE_BYTES];
        let boots_until = self.opened + boot(self.profile);
        let mut is_ready = false;
        loop {
            tokio::select! {
                biased;
                read = stream.read(&mut piece) => {
                    self.take(&piece[..read?], &mut lock(&mailbox.state))?;
                    if self.profile.is_packets() {
                        self.take_queue(&mut stream, &mut piece, mailbox).await?;
                    }
                    self.publish(&mut lock(&mailbox.state));
                    mailbox.came.notify_waiters();
                }
                // no bootloader reads any more
                () = sleep_until(boots_until), if !is_ready => {
                    is_ready = true;
                    send(&mut stream, self.profile.on_start.as_deref()).await?;
                }
                () = mailbox.asked.notified(), if is_ready => send(&mut stream, self.profile.ask.as_deref().map(str::as_bytes)).await?,
            }
        }
    }

    /// Takes the packets that wait already. If this program was slow, the first of them are old, and only the last counts.
    async fn take_queue(&mut self, stream: &mut ByteStream, piece: &mut [u8], mailbox: &Mailbox) -> io::Result<()> {
        for _ in 0..QUEUE_MOST {
            // tokio would let other tasks run in between, which looks like the end of the queue
            let next = unconstrained(stream.read(piece));
            let Ok(read) = timeout_at(Instant::now(), next).await else { break };
            self.take(&piece[..read?], &mut lock(&mailbox.state))?;
        }
        Ok(())
    }

    /// Puts the newest reading into the mailbox.
    fn publish(&mut self, state: &mut PortState) {
        if let Some(fresh) = self.fresh.take() {
            state.newest = Some(fresh);
        }
    }

    /// Takes bytes that arrived now.
    ///
    /// # Errors
    /// The end of the link, or a count that jumped.
    fn take(&mut self, bytes: &[u8], state: &mut PortState) -> io::Result<()> {
        if bytes.is_empty() {
            return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the other end closed it"));
        }
        let arrived = Instant::now();
        self.finder.take(bytes);
        while let Some(found) = self.finder.find() {
            let possible = found.and_then(|numbers| match self.profile.is_possible(&numbers) {
                true => Ok(numbers),
                false => Err(Rejected {
                    expected: "numbers in the range that the profile states".to_owned(),
                    received: format!("{numbers:?}"),
                }),
            });
            let numbers = match possible {
                Ok(numbers) => numbers,
                Err(rejected) => {
                    state.counts.rejected += 1;
                    state.last_rejected = Some(rejected);
                    continue;
                }
            };
            if let Some(counter) = &self.profile.counter {
                let count = numbers[counter.column];
                match counter.compare(self.count, count) {
                    Counted::New { lost } => state.counts.lost += lost,
                    Counted::Old => continue,
                    Counted::Jumped { from } => {
                        let cause = "the device restarted, or another program took its readings";
                        return Err(io::Error::other(format!("its count jumped from {from} to {count}: {cause}")));
                    }
                }
                self.count = Some(count);
            }
            let at = self.taken(&numbers, arrived);
            state.counts.good += 1;
            // a full piece comes from a queue: how old its readings are isn't known
            if bytes.len() < PIECE_BYTES || self.profile.time.is_some() {
                self.fresh = Some(Received { numbers, at, nth: state.counts.good });
            }
        }
        Ok(())
    }

    /// Returns the time of a reading that arrived at this time.
    fn taken(&mut self, numbers: &[f64], arrived: Instant) -> Instant {
        let Some(time) = self.profile.time else { return arrived };
        let arrived_s = (arrived - self.opened).as_secs_f64();
        let taken_s = self.clock.taken_s(numbers[time.column] * time.unit_s, arrived_s);
        arrived - seconds((arrived_s - taken_s).clamp(0.0, arrived_s))
    }
}

/// Silence after the link is opened, before a command is sent. A device that sends packets has no bootloader.
fn boot(profile: &LineProfile) -> Duration {
    if profile.is_packets() { Duration::ZERO } else { BOOT }
}

async fn send(stream: &mut ByteStream, command: Option<&[u8]>) -> io::Result<()> {
    let Some(command) = command else { return Ok(()) };
    let sent = timeout_at(Instant::now() + SEND_DEADLINE, async {
        stream.write_all(command).await?;
        stream.flush().await
    });
    sent.await.map_err(|_| io::Error::new(io::ErrorKind::TimedOut, "it takes no command"))?
}
