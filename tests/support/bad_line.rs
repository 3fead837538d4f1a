//! A bad line between a driver and an emulator: messages in both directions are passed on, and some are dropped, delayed, repeated,
//! truncated, garbled or swapped. All of it follows from a seed.

use palpate_core::parallel::lock;
use palpate_core::quantity::{Axis, RandomStream, stream};
use palpate_link::time::{Instant, sleep_until};
use palpate_link::wire::Connector;
use palpate_sim::emulator::{self, Instrument, Shared};
use palpate_sim::scene::{Scene, Trajectory};
use rand::RngExt;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

/// Fraction of the messages with a fault while the line is bad.
pub const BAD_SHARE: f64 = 0.15;

/// Bytes that wait in one part of a line.
const LINE_BYTES: usize = 1 << 16;

/// Largest number of messages of a run; a run with more doesn't end.
const MESSAGES_MOST: usize = 400_000;

/// Step at which a motion is observed, s, and the largest number of steps.
const STEP_S: f64 = 0.005;
const STEPS_MOST: usize = 2000;

/// Largest delay of a message's repetition, s.
const DOUBLE_LATE_S: f64 = 0.5;

/// Largest delay of the second answer to a repeated request, s.
const ECHO_S: f64 = 0.1;

/// How a protocol separates its messages, and whether a line that is opened again is the same line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Framing {
    Esp301,
    Xps,
    Grbl,
    Process,
    Rtu,
    Tcp,
}

#[derive(Clone, Copy, PartialEq)]
enum BadLineWay {
    There,
    Back,
}

impl Framing {
    /// A message on a serial line arrives at the program that has it open by then.
    fn is_serial(self) -> bool {
        matches!(self, Framing::Esp301 | Framing::Grbl | Framing::Rtu)
    }

    fn take(self, way: BadLineWay, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        let behind = |mark: &[u8]| inbox.windows(mark.len()).position(|w| w == mark).map(|at| at + mark.len());
        let length = match (self, way) {
            (Framing::Esp301, BadLineWay::There) => behind(b"\r"),
            (Framing::Xps, BadLineWay::There) => behind(b")"),
            (Framing::Xps, BadLineWay::Back) => behind(b"EndOfAPI"),
            (Framing::Grbl, BadLineWay::There) if matches!(inbox.first(), Some(b'?' | b'!' | b'~' | 0x18 | 0x80..)) => {
                Some(1)
            }
            (Framing::Rtu, _) => Some(inbox.len()).filter(|&length| length > 0),
            (Framing::Tcp, _) => inbox.get(4..6).map(|two| 6 + usize::from(u16::from_be_bytes([two[0], two[1]]))),
            _ => behind(b"\n"),
        };
        let length = length.filter(|&length| length <= inbox.len())?;
        Some(inbox.drain(..length).collect())
    }
}

/// Motions of the axes: begun at `from_s` at the earliest, and over by `until_s`.
pub struct Motions {
    pub from_s: f64,
    pub until_s: f64,
    pub axes: [Trajectory; 3],
}

/// Planned and past faults on the lines of one run.
pub struct BadLineFate {
    rng: RandomStream,
    /// Whether messages have faults now.
    pub bad: bool,
    /// Number of messages until the link is closed.
    pub close_in: Option<usize>,
    /// Messages that the driver sent.
    pub sent: usize,
    /// Times at which changed messages were delivered, s: with other bytes or in another order.
    pub altered_s: Vec<f64>,
    pub stray_s: Vec<f64>,
    /// Whether a changed message went to the device, or one went there twice.
    pub altered_command: bool,
    /// The axes' motions.
    pub motions: Vec<Motions>,
    /// Time of their last observation, s.
    looked_s: f64,
    origin: Instant,
    scene: Shared<Scene>,
}

impl BadLineFate {
    /// No faults yet.
    pub fn new(seed: u64, scene: Shared<Scene>, origin: Instant) -> Shared<BadLineFate> {
        let rng = stream(seed, 0, "bad line");
        let (altered_s, stray_s) = (Vec::new(), Vec::new());
        let fate = BadLineFate {
            rng,
            bad: false,
            close_in: None,
            sent: 0,
            altered_s,
            stray_s,
            altered_command: false,
            motions: Vec::new(),
            looked_s: 0.0,
            origin,
            scene,
        };
        Arc::new(Mutex::new(fate))
    }

    pub fn now_s(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }

    /// Notes the axes' motions, if they are new.
    pub fn look(&mut self) {
        let scene = lock(&self.scene);
        let motions = Axis::ALL.map(|axis| scene.motion(axis).clone());
        let now_s = self.origin.elapsed().as_secs_f64();
        if self.motions.last().is_none_or(|last| last.axes != motions) {
            if let Some(last) = self.motions.last_mut() {
                last.until_s = now_s;
            }
            self.motions.push(Motions { from_s: self.looked_s, until_s: f64::INFINITY, axes: motions });
        }
        self.looked_s = now_s;
    }

    /// Whether an axis can have been at a place between two times, mm.
    pub fn could_be(&self, axis: Axis, (from_s, to_s): (f64, f64), place_mm: f64, tolerance_mm: f64) -> bool {
        self.motions.iter().any(|motions| {
            let (from_s, to_s) = (from_s.max(motions.from_s), to_s.min(motions.until_s));
            from_s <= to_s && passes(&motions.axes[axis.index()], (from_s, to_s), place_mm, tolerance_mm)
        })
    }

    /// Whether an axis moves, as of the last observation.
    pub fn moves(&self, axis: Axis) -> bool {
        self.motions.last().is_some_and(|motions| motions.axes[axis.index()].moving(self.now_s()))
    }

    /// Whether a changed message was delivered between two times. A repeated request is answered twice, and the second answer looks like
    /// that of the next request.
    pub fn happened(&self, from_s: f64, to_s: f64) -> (bool, bool) {
        let any = |times: &[f64], from_s: f64| times.iter().any(|at_s| (from_s..=to_s).contains(at_s));
        (any(&self.altered_s, from_s), any(&self.stray_s, from_s - ECHO_S))
    }

    /// Other bytes instead of a message.
    fn garble(&mut self, message: &[u8]) -> Vec<u8> {
        let mut garbled = message.to_vec();
        let digits: Vec<usize> = (0..message.len()).filter(|&at| message[at].is_ascii_digit()).collect();
        match self.rng.random_range(0..4) {
            0 => {
                let end = message.iter().rposition(|byte| !b"\r\n".contains(byte)).map_or(0, |last| last + 1);
                garbled.truncate(end.min(message.len() - 1));
            }
            1 if !digits.is_empty() => {
                let at = digits[self.rng.random_range(0..digits.len())];
                garbled[at] = b'0' + (message[at] - b'0' + self.rng.random_range(1..10u8)) % 10;
            }
            2 => {
                let at = self.rng.random_range(0..message.len());
                garbled[at] = garbled[at].wrapping_add(self.rng.random_range(1..=255u8));
            }
            _ => {
                let at = self.rng.random_range(0..message.len());
                garbled[at] ^= 1 << self.rng.random_range(0..8);
            }
        }
        garbled
    }

    fn delay(&mut self) -> Duration {
        let (least_s, most_s) = match self.rng.random_range(0..10) {
            0..5 => (0.001, 0.05),
            5..8 => (0.05, 1.0),
            _ => (1.0, 10.0),
        };
        Duration::from_secs_f64(self.rng.random_range(least_s..most_s))
    }
}

/// Messages on their way in one direction.
#[derive(Default)]
struct Lane {
    inbox: Vec<u8>,
    due: Vec<Parcel>,
    /// Messages that come now wait behind a delayed one until then.
    clear: Option<Instant>,
    /// Swapped with the next one.
    overtaken: Option<Parcel>,
}

struct Parcel {
    at: Instant,
    bytes: Vec<u8>,
    altered: bool,
    stray: bool,
}

impl Lane {
    /// Puts a message on its way, with its fault.
    fn send(&mut self, message: Vec<u8>, fate: &mut BadLineFate) {
        let now = Instant::now();
        let at = self.clear.filter(|&clear| clear > now).unwrap_or(now);
        let mut parcel = Parcel { at, bytes: message, altered: false, stray: at > now };
        let kind = if fate.bad && fate.rng.random_bool(BAD_SHARE) { fate.rng.random_range(0..6) } else { 6 };
        match kind {
            0 => return,
            1 => {
                parcel.at += fate.delay();
                parcel.stray = true;
                self.clear = Some(parcel.at);
            }
            2 => {
                let late_s = if fate.rng.random_bool(0.5) { 0.0 } else { fate.rng.random_range(0.0..DOUBLE_LATE_S) };
                let bytes = parcel.bytes.clone();
                let at = parcel.at + Duration::from_secs_f64(late_s);
                self.due.push(Parcel { at, bytes, altered: false, stray: true });
            }
            3 => {
                let length = fate.rng.random_range(0..parcel.bytes.len());
                parcel.bytes.truncate(length);
                parcel.altered = true;
            }
            4 => {
                parcel.bytes = fate.garble(&parcel.bytes);
                parcel.altered = true;
            }
            5 if self.overtaken.is_none() => {
                parcel.stray = true;
                self.overtaken = Some(parcel);
                return;
            }
            _ => {}
        }
        let overtaken = self.overtaken.take().map(|overtaken| Parcel { at: parcel.at, ..overtaken });
        self.due.push(parcel);
        self.due.extend(overtaken);
        self.due.sort_by_key(|parcel| parcel.at);
    }

    fn next(&self) -> Option<Instant> {
        self.due.first().map(|parcel| parcel.at)
    }

    /// The messages that are due by now.
    fn take(&mut self) -> Option<Parcel> {
        (self.next()? <= Instant::now()).then(|| self.due.remove(0))
    }
}

/// Links to an instrument over a line with these faults.
pub fn connector(
    framing: Framing,
    instrument: Shared<dyn Instrument>,
    scene: Shared<Scene>,
    origin: Instant,
    fate: Shared<BadLineFate>,
) -> Connector {
    let wired = move |nears: UnboundedReceiver<DuplexStream>| {
        let (far, served) = duplex(LINE_BYTES);
        drop(palpate_link::time::spawn(emulator::serve(served, instrument.clone(), scene.clone(), origin)));
        drop(palpate_link::time::spawn(pass_on(nears, far, framing, fate.clone())));
    };
    let line: Mutex<Option<UnboundedSender<DuplexStream>>> = Mutex::new(None);
    Connector::in_memory(move || {
        let (driver, near) = duplex(LINE_BYTES);
        let mut line = line.lock().expect("no dialling panicked");
        if line.is_none() || !framing.is_serial() {
            let (sender, nears) = unbounded_channel();
            wired(nears);
            *line = Some(sender);
        }
        let passed_on = line.as_ref().is_some_and(|line| line.send(near).is_ok());
        assert!(passed_on, "the line is there as long as the driver");
        if !framing.is_serial() {
            *line = None;
        }
        driver
    })
}

async fn pass_on(
    mut nears: UnboundedReceiver<DuplexStream>,
    mut far: DuplexStream,
    framing: Framing,
    fate: Shared<BadLineFate>,
) {
    let (mut there, mut back) = (Lane::default(), Lane::default());
    let (mut near, mut may_come) = (None::<DuplexStream>, true);
    let (mut heard, mut said) = ([0; 4096], [0; 4096]);
    while near.is_some() || may_come || there.next().is_some() {
        let due = there.next().into_iter().chain(back.next()).min();
        tokio::select! {
            biased;
            came = nears.recv(), if may_come => match came {
                Some(stream) => near = Some(stream),
                None => may_come = false,
            },
            () = at(due) => {
                while let Some(parcel) = there.take() {
                    note(&fate, &parcel, BadLineWay::There);
                    let _ = far.write_all(&parcel.bytes).await; // a device that is gone receives nothing
                }
                while let Some(parcel) = back.take() {
                    note(&fate, &parcel, BadLineWay::Back);
                    if let Some(near) = &mut near {
                        let _ = near.write_all(&parcel.bytes).await; // nor does a driver
                    }
                }
            }
            count = hear(&mut near, &mut heard) => match count {
                0 => near = None,
                count => {
                    there.inbox.extend_from_slice(&heard[..count]);
                    while let Some(message) = framing.take(BadLineWay::There, &mut there.inbox) {
                        let mut fate = lock(&fate);
                        fate.sent += 1;
                        assert!(fate.sent < MESSAGES_MOST, "it sends for ever");
                        there.send(message, &mut fate);
                        if let Some(left) = &mut fate.close_in {
                            *left = left.saturating_sub(1);
                            if *left == 0 {
                                fate.close_in = None;
                                near = None;
                            }
                        }
                    }
                }
            },
            count = far.read(&mut said) => match count.unwrap_or(0) {
                0 => return,
                count => {
                    back.inbox.extend_from_slice(&said[..count]);
                    while let Some(message) = framing.take(BadLineWay::Back, &mut back.inbox) {
                        back.send(message, &mut lock(&fate));
                    }
                }
            },
        }
        lock(&fate).look();
    }
}

/// Whether a motion passes a place between two times, observed so often that it can't turn unseen.
pub fn passes(motion: &Trajectory, (from_s, to_s): (f64, f64), place_mm: f64, tolerance_mm: f64) -> bool {
    let steps = (((to_s - from_s) / STEP_S).ceil() as usize).clamp(1, STEPS_MOST);
    let at_mm = |step: usize| motion.position_mm(from_s + (to_s - from_s) * step as f64 / steps as f64);
    (0..steps).any(|step| {
        let (a, b) = (at_mm(step), at_mm(step + 1));
        place_mm >= a.min(b) - tolerance_mm && place_mm <= a.max(b) + tolerance_mm
    })
}

fn note(fate: &Shared<BadLineFate>, parcel: &Parcel, way: BadLineWay) {
    let mut fate = lock(fate);
    let now_s = fate.now_s();
    fate.look();
    if parcel.altered {
        fate.altered_s.push(now_s);
        fate.altered_command |= way == BadLineWay::There;
    }
    if parcel.stray {
        fate.stray_s.push(now_s);
        // a motion is a displacement: a line that delivers it twice changes it
        fate.altered_command |= way == BadLineWay::There;
    }
}

/// Number of received bytes; 0: the driver has closed the line.
async fn hear(near: &mut Option<DuplexStream>, heard: &mut [u8]) -> usize {
    match near {
        Some(near) => near.read(heard).await.unwrap_or(0),
        None => std::future::pending().await,
    }
}

async fn at(due: Option<Instant>) {
    match due {
        Some(due) => sleep_until(due).await,
        None => std::future::pending().await,
    }
}
