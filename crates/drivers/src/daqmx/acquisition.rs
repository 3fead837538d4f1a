//! One task that samples all inputs with the card's own clock.

use palpate_link::device::{DeviceError, DeviceProblem};
use palpate_link::time::{Instant, sleep};
use palpate_link::wire::daqmx::{AUTO, DIFF, Functions, HeldUp, NRSE, NiDaqmx, PSEUDO_DIFF, RSE, TaskHandle};
use std::time::Duration;

/// Amount of unread data that the library may hold, s. Nothing is read while the indenter rests without load.
const BUFFER_S: f64 = 10.0;

/// Largest age of unread data. Older data are discarded together with the task, and sampling starts again, well before the buffer
/// overflows.
const REST: Duration = Duration::from_secs(1);

/// Size of the fetch buffer, s: data of the largest allowed age, and a margin. A buffer smaller than the available data would be
/// an error.
const FETCH_S: f64 = 2.0;

/// Longest wait for a scan beyond the scan's own time. It allows for delays in a USB device and a busy computer.
const SCAN_DEADLINE: Duration = Duration::from_millis(500);

/// Largest possible reading of an input of such a device, V. Its largest range is +-10 V, and it reads slightly beyond.
const MOST_V: f64 = 10.5;

/// Wiring of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Terminal {
    /// Relative to the device's ground.
    Rse,
    /// Relative to the sense input.
    Nrse,
    /// Differential: one input relative to another.
    Diff,
    /// Pseudodifferential: like `Diff`, with a ground of its own.
    PseudoDiff,
}

/// Inputs with the same wiring.
#[derive(Clone, Debug, PartialEq)]
pub struct Inputs {
    /// Name in DAQmx: `Dev1/ai0`, or `Dev1/ai1:9`.
    pub physical: String,
    /// Number of these inputs.
    pub count: usize,
    /// Wiring of the inputs.
    pub terminal: Terminal,
    /// Range of the inputs, plus and minus, V.
    pub range_v: f64,
}

/// One task that samples all inputs of a rig together, hardware-timed and continuous. New samples are fetched in small pieces
/// that never wait in the library.
pub struct Acquisition {
    functions: Functions,
    inputs: Vec<Inputs>,
    rate_hz: f64,
    link: String,
    task: Option<TaskHandle>,
    /// Number of scans since the task was created.
    scans: u64,
    newest: Vec<f64>,
    /// Time of the last query to the library.
    looked: Instant,
    buffer: Vec<f64>,
}

impl Acquisition {
    /// Creates a task over these inputs, in this order, each sampled `rate_hz` times per second. No function is called yet.
    pub fn new(functions: Functions, inputs: Vec<Inputs>, rate_hz: f64, link: String) -> Self {
        let (scans, looked, buffer) = (0, Instant::now(), Vec::new());
        Acquisition { functions, inputs, rate_hz, link, task: None, scans, newest: Vec::new(), looked, buffer }
    }

    /// Creates and starts the task.
    ///
    /// # Errors
    /// Error of the library.
    pub async fn prepare(&mut self) -> Result<(), DeviceError> {
        if self.task.is_some() {
            return Ok(());
        }
        let doing = "setting up its task";
        let (inputs, rate_hz) = (self.inputs.clone(), self.rate_hz);
        let made = self.functions.call(move |ni| make(ni, &inputs, rate_hz)).await;
        self.task = Some(self.said(doing, made)?);
        self.looked = Instant::now();
        Ok(())
    }

    /// Returns the number of scans so far and the newest scan: one voltage for each input, in the order of the inputs.
    pub fn newest(&self) -> (u64, &[f64]) {
        (self.scans, &self.newest)
    }

    /// Waits for a scan after the scan of this number.
    ///
    /// # Errors
    /// Error of the library, or no scan comes.
    pub async fn after(&mut self, scan: u64) -> Result<(), DeviceError> {
        let doing = "reading its inputs";
        let asked = Instant::now();
        if self.looked.elapsed() > REST {
            self.begin_anew().await?;
        }
        let period = Duration::from_secs_f64(1.0 / self.rate_hz);
        loop {
            self.fetch().await?;
            if self.scans > scan {
                return Ok(());
            }
            if asked.elapsed() > period + SCAN_DEADLINE {
                let text = format!("no scan arrived within {} ms", asked.elapsed().as_millis());
                return Err(self.error(doing, DeviceProblem::Link(text)));
            }
            sleep(period).await;
        }
    }

    /// Returns an error of this device.
    pub fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError {
            device: format!("NI device ({} over {})", self.names(), self.link),
            doing: doing.to_owned(),
            problem,
        }
    }

    fn names(&self) -> String {
        self.inputs.iter().map(|inputs| inputs.physical.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// Fetches the available data. No data isn't an error.
    async fn fetch(&mut self) -> Result<(), DeviceError> {
        let doing = "reading its inputs";
        let Some(task) = self.task else {
            return Err(self.error(doing, DeviceProblem::Link("its task isn't running".to_owned())));
        };
        let channels: usize = self.inputs.iter().map(|inputs| inputs.count).sum();
        let most = (FETCH_S * self.rate_hz).ceil() as usize + 1;
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.resize(channels * most, 0.0);
        let fetched = self.functions.call(move |ni| {
            let mut read = 0;
            let status = ni.read_analog_f64(task, AUTO, &mut buffer, &mut read);
            check(ni, status).map(|()| (buffer, read))
        });
        let (buffer, read) = match fetched.await {
            Ok(Err(text)) => {
                // overrun, unplugged, reset: the task can't be used any more
                self.drop_task();
                return Err(self.error(doing, DeviceProblem::Refused(text)));
            }
            fetched => self.said(doing, fetched)?,
        };
        self.looked = Instant::now();
        let Some(read) = usize::try_from(read).ok().filter(|&read| read <= most) else {
            let (answer, expected) = (format!("{read} scans"), format!("{most} at most, as asked for"));
            return Err(self.error(doing, DeviceProblem::Misfit { answer, expected }));
        };
        if read > 0 {
            self.newest.clear();
            self.newest.extend_from_slice(&buffer[(read - 1) * channels..read * channels]);
            self.scans += read as u64;
        }
        self.buffer = buffer;
        if self.newest.iter().all(|volts| volts.abs() <= MOST_V) {
            return Ok(());
        }
        let expected = format!("a voltage within {MOST_V} V from every input");
        Err(self.error(doing, DeviceProblem::Misfit { answer: format!("{:?}", self.newest), expected }))
    }

    /// Discards the unread data and starts again.
    async fn begin_anew(&mut self) -> Result<(), DeviceError> {
        let Some(task) = self.task else { return Ok(()) };
        let restarted = self.functions.call(move |ni| {
            check(ni, ni.stop_task(task))?;
            check(ni, ni.start_task(task))
        });
        let restarted = restarted.await;
        self.looked = Instant::now();
        self.said("starting its task again", restarted)
    }

    fn drop_task(&mut self) {
        if let Some(task) = self.task.take() {
            self.functions.call_and_leave(move |ni| {
                ni.clear_task(task); // nobody is left to answer
            });
        }
    }

    fn said<T>(&self, doing: &str, result: Result<Result<T, String>, HeldUp>) -> Result<T, DeviceError> {
        match result {
            Ok(Ok(value)) => Ok(value),
            Ok(Err(text)) => Err(self.error(doing, DeviceProblem::Refused(text))),
            Err(held_up) => Err(self.error(doing, DeviceProblem::Link(held_up.to_string()))),
        }
    }
}

impl Drop for Acquisition {
    fn drop(&mut self) {
        self.drop_task();
    }
}

/// Creates and starts a task. A task that can't be started is removed.
fn make(ni: &dyn NiDaqmx, inputs: &[Inputs], rate_hz: f64) -> Result<TaskHandle, String> {
    let mut task = 0;
    check(ni, ni.create_task("", &mut task))?;
    let channels = |inputs: &Inputs| {
        ni.create_ai_voltage_channel(task, &inputs.physical, inputs.terminal.code(), [-inputs.range_v, inputs.range_v])
    };
    let samples = (BUFFER_S * rate_hz) as u64;
    let started = inputs
        .iter()
        .try_for_each(|inputs| check(ni, channels(inputs)))
        .and_then(|()| check(ni, ni.configure_sample_clock(task, rate_hz, samples)))
        .and_then(|()| check(ni, ni.start_task(task)));
    if started.is_err() {
        ni.clear_task(task);
    }
    started.map(|()| task)
}

/// Returns an error if the status is below 0, in NI's words.
fn check(ni: &dyn NiDaqmx, status: i32) -> Result<(), String> {
    if status >= 0 {
        return Ok(());
    }
    let text = ni.extended_error_info();
    let text = if text.is_empty() { ni.error_string(status) } else { text };
    Err(format!("error {status}: {text}"))
}

impl Terminal {
    fn code(self) -> i32 {
        match self {
            Terminal::Rse => RSE,
            Terminal::Nrse => NRSE,
            Terminal::Diff => DIFF,
            Terminal::PseudoDiff => PSEUDO_DIFF,
        }
    }
}
