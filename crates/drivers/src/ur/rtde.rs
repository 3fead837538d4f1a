//! RTDE (real-time data exchange), protocol version 2: packages of a robot's state. All numbers are big-endian.

use palpate_link::time::{Instant, timeout, timeout_at};
use palpate_link::wire::{ByteStream, Connector, WireError, silent};
use std::io::{Error, ErrorKind};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

/// Longest wait for an answer, and for the next package of a started stream.
const ANSWER_DEADLINE: Duration = Duration::from_secs(1);

/// Longest package, bytes. That of the state has some 200, a text message may be longer.
const PACKAGE_BYTES_MAX: usize = 4096;

/// Largest number of texts that are kept.
const TEXTS_MAX: usize = 16;

/// Largest number of packages that may come before an answer.
const PACKAGES_MAX: usize = 1000;

/// Registers of the robot's program. The lower 24 belong to field buses (RTDE guide, "general purpose registers").
pub(super) const BEGUN_REGISTER: u8 = 40;
pub(super) const ENDED_REGISTER: u8 = 41;
pub(super) const OUTSIDE_REGISTER: u8 = 42;

const VARIABLES: &str = "actual_TCP_pose,actual_TCP_speed,actual_TCP_force,target_speed_fraction,speed_scaling,robot_mode,safety_mode,runtime_state,\
                         output_int_register_40,output_int_register_41,output_int_register_42";
const TYPES: &str = "VECTOR6D,VECTOR6D,VECTOR6D,DOUBLE,DOUBLE,INT32,INT32,UINT32,INT32,INT32,INT32";
const STATE_BYTES: usize = 3 * 48 + 2 * 8 + 6 * 4;

/// Types of packages (RTDE guide, "package types").
mod package {
    pub(super) const VERSION: u8 = b'V';
    pub(super) const MESSAGE: u8 = b'M';
    pub(super) const STATE: u8 = b'U';
    pub(super) const OUTPUTS: u8 = b'O';
    pub(super) const START: u8 = b'S';
    pub(super) const PAUSE: u8 = b'P';
}

/// State of a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RobotState {
    /// Position of the tool's centre point in the base, mm.
    pub at_mm: [f64; 3],
    /// Orientation of the tool, as a rotation vector, rad.
    pub rotation_rad: [f64; 3],
    /// Speed of the tool's centre point, mm/s.
    pub speed_mm_s: [f64; 3],
    /// Force at the tool's centre point along the base's axes, N.
    pub force_n: [f64; 3],
    /// Share of its speed to which the speed slider is set.
    pub slider: f64,
    /// Share of that speed which the robot itself allows in a motion.
    pub scaling: f64,
    pub robot_mode: i32,
    pub safety_mode: i32,
    pub runtime: u32,
    /// Number of the program that began last, of the one that ended last, and of the last corner that is out of reach.
    pub begun: i32,
    pub ended: i32,
    pub outside: i32,
}

/// Connection to a robot's RTDE server. It is opened when it is needed, and after a failure.
pub(super) struct Rtde {
    connector: Connector,
    stream: Option<ByteStream>,
    inbox: Vec<u8>,
    recipe: u8,
    is_started: bool,
    /// Time from one state to the next.
    interval: Duration,
    /// Texts that the controller sent.
    pub texts: Vec<String>,
}

impl Rtde {
    pub(super) fn new(connector: Connector, interval: Duration) -> Self {
        Rtde { connector, stream: None, inbox: Vec::new(), recipe: 0, is_started: false, interval, texts: Vec::new() }
    }

    /// Time from one state to the next of a controller of the CB series (RTDE guide).
    pub(super) const INTERVAL: Duration = Duration::from_millis(8);
    /// The same of a later controller.
    pub(super) const SHORT_INTERVAL: Duration = Duration::from_millis(2);

    /// Returns the newest state, and starts the stream if it isn't started.
    pub(super) async fn newest(&mut self) -> Result<RobotState, WireError> {
        if !self.is_started {
            return self.start().await;
        }
        let mut newest = None;
        while let Ok(next) = timeout(Duration::ZERO, self.next()).await {
            newest = Some(next?);
        }
        match newest {
            Some(state) => Ok(state),
            None => self.next().await,
        }
    }

    /// Whether the stream of states is started.
    pub(super) fn is_started(&self) -> bool {
        self.is_started
    }

    /// Starts the stream of states, and returns the first.
    pub(super) async fn start(&mut self) -> Result<RobotState, WireError> {
        if self.is_started {
            self.pause().await; // what waited is old
        }
        self.connect().await?;
        let accepted = self.ask(package::START, &[]).await?;
        self.accepted(&accepted, "the start of RTDE")?;
        self.is_started = true;
        self.next().await
    }

    /// Ends the stream of states. A failure closes the connection, which ends it too.
    pub(super) async fn pause(&mut self) {
        self.is_started = false;
        if self.stream.is_some() && self.ask(package::PAUSE, &[]).await.is_err() {
            self.close();
        }
    }

    /// Returns the next state of a started stream. The future may be dropped while it waits.
    pub(super) async fn next(&mut self) -> Result<RobotState, WireError> {
        let until = Instant::now() + ANSWER_DEADLINE;
        for _ in 0..PACKAGES_MAX {
            let (kind, payload) = self.package(until, "the next RTDE package").await?;
            if kind == package::STATE {
                return self.state(&payload);
            }
        }
        Err(self.broken("it sends no state"))
    }

    fn state(&mut self, payload: &[u8]) -> Result<RobotState, WireError> {
        match payload.split_first() {
            Some((recipe, state)) if *recipe == self.recipe && state.len() == STATE_BYTES => {
                parse_state(state).ok_or_else(|| self.broken("a package of RTDE has a number that isn't finite"))
            }
            _ => Err(self.broken("a package of RTDE isn't of the form that was agreed")),
        }
    }

    /// Opens the connection and agrees on the packages.
    async fn connect(&mut self) -> Result<(), WireError> {
        if self.stream.is_some() {
            return Ok(());
        }
        self.inbox.clear();
        self.stream = Some(self.connector.open().await?);
        let accepted = self.ask(package::VERSION, &2u16.to_be_bytes()).await?;
        self.accepted(&accepted, "version 2 of RTDE")?;
        let mut wanted = self.interval.as_secs_f64().recip().to_be_bytes().to_vec();
        wanted.extend_from_slice(VARIABLES.as_bytes());
        let answer = self.ask(package::OUTPUTS, &wanted).await?;
        match answer.split_first() {
            Some((recipe, types)) if types == TYPES.as_bytes() => self.recipe = *recipe,
            _ => {
                let types = String::from_utf8_lossy(answer.get(1..).unwrap_or_default()).into_owned();
                return Err(
                    self.broken(&format!("it offers the RTDE variables {VARIABLES} as {types}, expected {TYPES} (PolyScope 3.9, 5.3 or later)"))
                );
            }
        }
        Ok(())
    }

    fn accepted(&mut self, answer: &[u8], what: &str) -> Result<(), WireError> {
        if answer == [1] { Ok(()) } else { Err(self.broken(&format!("it doesn't accept {what}"))) }
    }

    /// Sends a package and returns the payload of its answer. Other packages that come before it are dropped.
    async fn ask(&mut self, kind: u8, payload: &[u8]) -> Result<Vec<u8>, WireError> {
        let until = Instant::now() + ANSWER_DEADLINE;
        let size = (payload.len() + 3) as u16;
        let bytes = [&size.to_be_bytes()[..], &[kind], payload].concat();
        let Some(stream) = self.stream.as_mut() else { return Err(self.broken("it isn't open")) };
        let written = timeout_at(until, stream.write_all(&bytes)).await;
        if !matches!(written, Ok(Ok(()))) {
            return Err(self.broken("it doesn't accept a request of RTDE"));
        }
        for _ in 0..PACKAGES_MAX {
            let (came, payload) = self.package(until, "a request of RTDE").await?;
            if came == kind {
                return Ok(payload);
            }
        }
        Err(self.broken("it doesn't answer a request of RTDE"))
    }

    /// Returns the next package. The bytes received so far are kept if the future is dropped.
    async fn package(&mut self, until: Instant, awaited: &str) -> Result<(u8, Vec<u8>), WireError> {
        loop {
            if let [high, low, kind, ..] = self.inbox[..] {
                let size = usize::from(u16::from_be_bytes([high, low]));
                if !(3..=PACKAGE_BYTES_MAX).contains(&size) {
                    return Err(self.broken("it sends no packages of RTDE"));
                }
                if self.inbox.len() >= size {
                    let payload = self.inbox[3..size].to_vec();
                    self.inbox.drain(..size);
                    if kind == package::MESSAGE {
                        self.keep(&payload);
                        continue;
                    }
                    return Ok((kind, payload));
                }
            }
            let mut chunk = [0; 1024];
            let Some(stream) = self.stream.as_mut() else { return Err(self.broken("it isn't open")) };
            match timeout_at(until, stream.read(&mut chunk)).await {
                Ok(Ok(0)) => return Err(self.broken("the other end closed it")),
                Ok(Ok(count)) => self.inbox.extend_from_slice(&chunk[..count]),
                Ok(Err(error)) => {
                    self.close();
                    return Err(error.into());
                }
                Err(_) => {
                    self.close();
                    return Err(silent(awaited, ANSWER_DEADLINE));
                }
            }
        }
    }

    /// Keeps a text message: its length, its text, and where it comes from.
    fn keep(&mut self, payload: &[u8]) {
        let text = payload.split_first().and_then(|(length, rest)| rest.get(..usize::from(*length)));
        if self.texts.len() < TEXTS_MAX {
            self.texts.extend(text.map(|text| String::from_utf8_lossy(text).into_owned()));
        }
    }

    pub(super) fn close(&mut self) {
        (self.stream, self.is_started) = (None, false);
    }

    /// Closes the connection, and returns the error.
    fn broken(&mut self, text: &str) -> WireError {
        self.close();
        Error::new(ErrorKind::InvalidData, text).into()
    }
}

/// Reads a state of [`STATE_BYTES`], in the order of [`VARIABLES`]. `None` if a number isn't finite.
fn parse_state(bytes: &[u8]) -> Option<RobotState> {
    let double = |at: usize| f64::from_be_bytes(std::array::from_fn(|byte| bytes[at + byte]));
    let whole = |at: usize| i32::from_be_bytes(std::array::from_fn(|byte| bytes[at + byte]));
    let three = |at: usize, factor: f64| std::array::from_fn(|nth| factor * double(at + 8 * nth));
    (0..20).all(|nth| double(8 * nth).is_finite()).then(|| RobotState {
        at_mm: three(0, 1000.0),
        rotation_rad: three(24, 1.0),
        speed_mm_s: three(48, 1000.0),
        force_n: three(96, 1.0),
        slider: double(144).clamp(0.0, 1.0),
        scaling: double(152).clamp(0.0, 1.0),
        robot_mode: whole(160),
        safety_mode: whole(164),
        runtime: whole(168) as u32,
        begun: whole(172),
        ended: whole(176),
        outside: whole(180),
    })
}
