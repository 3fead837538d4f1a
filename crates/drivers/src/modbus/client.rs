//! The client side of Modbus: reads, retries and time-outs.

use super::line::ModbusLine;
use super::profile::{Probe, Profile, Register};
use super::request::{Function, ModbusFraming, Transport};
use palpate_link::device::{DeviceError, DeviceProblem};
use palpate_link::time::Elapsed;
use palpate_link::time::{Instant, sleep_until, timeout};
use palpate_link::wire::{ByteStream, Connector};
use std::io::ErrorKind;
use std::time::Duration;
use tokio::io::AsyncReadExt;
use tokio_modbus::client::{Client, rtu, tcp};
use tokio_modbus::slave::Slave;
use tokio_modbus::{Error, Request, Response};

/// Number of attempts for a read. A read changes nothing, so it may be repeated.
const READ_TRIES: usize = 3;

/// Silence after which a serial line that lost synchronisation counts as quiet. A late answer arrives within this time.
const QUIET: Duration = Duration::from_millis(20);

/// Largest number of bytes that are discarded until a line is quiet.
const STRAY_BYTES_MAX: usize = 4096;

/// A connection as the Modbus library returns it, without the wrapper that allocates once more for each call.
type Context = Box<dyn Client>;

/// One Modbus device behind a link. The link is opened when it is needed. It is opened again after any event that left it out of
/// step.
pub struct ModbusClient {
    connector: Connector,
    transport: Transport,
    unit_id: u8,
    deadline: Duration,
    /// Least time from an answer to the next request.
    rest: Duration,
    /// Least time from one request to the next. A device needs no more requests than it has conversions.
    pace: Duration,
    /// Time before which no value is asked for.
    paced: Instant,
    /// Time before which nothing is sent.
    rested: Instant,
    device: String,
    /// Connection, taken out during an exchange. After a dropped exchange it isn't put back, so the link is opened again.
    context: Option<Context>,
    opened_before: bool,
    /// Whether an answer to an earlier request may still come.
    doubtful: bool,
}

impl ModbusClient {
    /// Creates a device of a profile; `role` and `link` name it in messages.
    pub fn new(
        connector: Connector,
        framing: impl Into<ModbusFraming>,
        profile: &Profile,
        role: &str,
        link: &str,
    ) -> Self {
        let ModbusFraming { transport, silence } = framing.into();
        ModbusClient {
            connector,
            transport,
            unit_id: profile.unit_id,
            deadline: Duration::from_millis(profile.deadline_ms),
            rest: silence.max(Duration::from_millis(profile.rest_ms)),
            pace: Duration::ZERO,
            paced: Instant::now(),
            rested: Instant::now(),
            device: format!("{role} ({} at {link})", profile.name),
            context: None,
            opened_before: false,
            doubtful: false,
        }
    }

    /// Limits the requests to one in each `pace`.
    pub(crate) fn set_pace(&mut self, pace: Duration) {
        self.pace = pace;
    }

    /// Reads registers from an address on the wire (function code 3 or 4).
    ///
    /// # Errors
    /// The device's exception, or the link's failure after the allowed number of tries.
    pub async fn read(
        &mut self,
        doing: &str,
        function: Function,
        address: u16,
        count: u16,
    ) -> Result<Vec<u16>, DeviceError> {
        let mut last = String::new();
        for _ in 0..READ_TRIES {
            until(self.paced.max(self.rested)).await;
            let asked = Instant::now();
            let opened = self.open().await;
            let mut context = opened
                .map_err(|error| self.error(doing, DeviceProblem::Link(format!("can't open the link: {error}"))))?;
            if self.doubtful {
                // RTU has no numbers: a late answer looks like the next one. An answer to the other function can't be mistaken for it, even
                // an exception
                match self.exchange(&mut context, function.other(), address, count).await {
                    Ok(Ok(_)) => self.doubtful = false,
                    Ok(Err(Error::Transport(error))) if error.kind() == ErrorKind::UnexpectedEof => {
                        last = error.to_string();
                        continue;
                    }
                    _ => {
                        last = "its answers don't match the requests".to_owned();
                        continue;
                    }
                }
            }
            let answered = self.exchange(&mut context, function, address, count).await;
            self.paced = asked + self.pace;
            match answered {
                Ok(Ok(Ok(words))) if words.len() == usize::from(count) => {
                    self.context = Some(context);
                    return Ok(words);
                }
                Ok(Ok(Ok(words))) => last = format!("{} registers arrived instead of {count}", words.len()),
                Ok(Ok(Err(exception))) => {
                    self.context = Some(context);
                    let text = format!("{exception} (registers {address} to {})", address.saturating_add(count - 1));
                    return Err(self.error(doing, DeviceProblem::Refused(text)));
                }
                Ok(Err(error)) => last = error.to_string(),
                Err(_) => last = format!("no answer within {} ms", self.deadline.as_millis()),
            }
        }
        Err(self.error(doing, DeviceProblem::Link(format!("{last}, {READ_TRIES} times"))))
    }

    /// Reads one number.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub async fn read_number(&mut self, doing: &str, register: Register) -> Result<f64, DeviceError> {
        let Register { function, address, encoding } = register;
        let words = self.read(doing, function, address, encoding.registers()).await?;
        encoding.decode(&words).ok_or_else(|| {
            let expected = format!("a {:?}", encoding.number);
            self.error(doing, DeviceProblem::Misfit { answer: format!("{words:?}"), expected })
        })
    }

    /// Reads every register with a known value.
    ///
    /// # Errors
    /// The first register that differs: the device, the address or the word order is wrong.
    pub async fn probe(&mut self, probes: &[Probe]) -> Result<(), DeviceError> {
        for probe in probes {
            let doing = format!("checking {}", probe.what);
            let value = self.read_number(&doing, probe.register).await?;
            if value != probe.value {
                let expected = format!("{} at register {}", probe.value, probe.register.address);
                return Err(self.error(&doing, DeviceProblem::Misfit { answer: value.to_string(), expected }));
            }
        }
        Ok(())
    }

    /// Returns an error of this device.
    pub fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError { device: self.device.clone(), doing: doing.to_owned(), problem }
    }

    /// Sends a request as soon as the device has rested since its last answer, and waits for the answer.
    async fn exchange(
        &mut self,
        context: &mut Context,
        function: Function,
        address: u16,
        count: u16,
    ) -> Result<tokio_modbus::Result<Vec<u16>>, Elapsed> {
        until(self.rested).await;
        let answered = timeout(self.deadline, read(context, function, address, count)).await;
        self.rested = Instant::now() + self.rest;
        answered
    }

    async fn open(&mut self) -> std::io::Result<Context> {
        if let Some(context) = self.context.take() {
            return Ok(context);
        }
        let mut stream = self.connector.open().await?;
        if self.opened_before && self.transport == Transport::Rtu {
            until_quiet(&mut stream).await?;
            self.doubtful = true;
        }
        self.opened_before = true;
        let slave = Slave(self.unit_id);
        let line = ModbusLine::new(stream, self.transport);
        Ok(match self.transport {
            Transport::Rtu => rtu::attach_slave(line, slave).into(),
            Transport::Tcp => tcp::attach_slave(line, slave).into(),
        })
    }
}

/// Waits until a time. Doesn't wait if it has passed.
async fn until(time: Instant) {
    if time > Instant::now() {
        sleep_until(time).await;
    }
}

/// Reads registers with either function. The count of the answer isn't checked here: the library's own reading functions panic on a
/// wrong one where debug assertions are on.
async fn read(context: &mut Context, function: Function, address: u16, count: u16) -> tokio_modbus::Result<Vec<u16>> {
    let request = match function {
        Function::Holding => Request::ReadHoldingRegisters(address, count),
        Function::Input => Request::ReadInputRegisters(address, count),
    };
    let answered = context.call(request).await?;
    Ok(answered.map(|response| match response {
        Response::ReadHoldingRegisters(words) | Response::ReadInputRegisters(words) => words,
        _ => Vec::new(), // the library refuses an answer to another function
    }))
}

/// Discards incoming bytes until no more arrive.
async fn until_quiet(stream: &mut ByteStream) -> std::io::Result<()> {
    let mut stray = [0; 256];
    let mut total = 0;
    while total < STRAY_BYTES_MAX {
        match timeout(QUIET, stream.read(&mut stray)).await {
            Ok(Ok(0)) | Err(_) => break,
            Ok(count) => total += count?,
        }
    }
    Ok(())
}
