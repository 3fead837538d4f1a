//! Load cell and array behind a line port.

use super::port::{LinePort, PortCounts, Received};
use super::profile::{ForceColumns, ForceField, OutputColumns};
use crate::mounting::AxesMounting;
use palpate_core::quantity::{ForceReading, Health};
use palpate_link::device::{DeviceError, DeviceProblem, Identity, LoadCell, SensorArray};
use palpate_link::time::Instant;
use std::time::Duration;

/// Longest wait for a reading beyond the time of one conversion. It is twice the age at which a reading is stale.
const READING_DEADLINE: Duration = Duration::from_millis(500);

/// Longest wait for the outputs. A pressure matrix at 9600 baud takes 0.1 s for a line, a large one some more.
const OUTPUTS_DEADLINE: Duration = Duration::from_secs(2);

/// A load cell whose readings are lines or frames.
pub struct LineLoadCell {
    port: LinePort,
    force: ForceField,
    mounting: AxesMounting,
    conversion: Duration,
    origin: Instant,
    link: String,
    /// Number of the last reading.
    nth: u64,
}

/// An array whose readings are lines or frames.
pub struct LineArray {
    port: LinePort,
    outputs: OutputColumns,
    link: String,
    nth: u64,
}

impl LineLoadCell {
    /// Creates a load cell that sends `conversions_hz` readings per second; the times of readings are relative to `origin`.
    pub fn new(port: LinePort, force: ForceField, link: String, conversions_hz: f64, origin: Instant) -> Self {
        let conversion = Duration::from_secs_f64(1.0 / conversions_hz);
        LineLoadCell { port, force, mounting: AxesMounting::default(), conversion, origin, link, nth: 0 }
    }

    /// States how a cell with three axes is mounted: the matrix from the forces along its axes to those of the tip on the specimen along
    /// x, y and the press.
    #[must_use]
    pub fn mounted(self, mounting: [[f64; 3]; 3]) -> Self {
        LineLoadCell { mounting: AxesMounting(mounting), ..self }
    }

    fn reading(&self, received: &Received) -> ForceReading {
        let columns = self.force.columns;
        let is_at_end =
            |number: f64| self.force.saturated_at.is_some_and(|ends| number <= ends.min || number >= ends.max);
        let status = self.port.profile().status;
        let health = status.map_or(Health::default(), |status| status.health(received.numbers[status.column]));
        let saturated = health.saturated || columns.all().iter().any(|&column| is_at_end(received.numbers[column]));
        let newton = |column: usize| self.force.newton(received.numbers[column]);
        let (side_n, force_n) = match columns {
            ForceColumns::One([column]) => (None, newton(column)),
            ForceColumns::Axes(axes) => {
                let (side_n, force_n) = self.mounting.forces_n(axes.map(newton));
                (Some(side_n), force_n)
            }
        };
        let at_s = received.at.duration_since(self.origin).as_secs_f64();
        ForceReading { at_s, force_n, side_n, health: Health { saturated, ..health } }
    }
}

impl LoadCell for LineLoadCell {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        let first = self.port.start().await;
        let first =
            first.map_err(|why| failed(&self.port, "load cell", &self.link, "waiting for its first reading", why))?;
        self.nth = first.nth;
        Ok(identity(&self.port, "load_cell", &self.link, String::new()))
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        let until = Instant::now() + READING_DEADLINE + self.conversion;
        let received = self.port.newer_than(self.nth + 1, until).await;
        let received = received.map_err(|why| failed(&self.port, "load cell", &self.link, "reading the force", why))?;
        self.nth = received.nth;
        Ok(self.reading(&received))
    }

    fn conversion(&self) -> Duration {
        self.conversion
    }
}

impl LineArray {
    /// Creates an array of the profile's outputs.
    pub fn new(port: LinePort, outputs: OutputColumns, link: String) -> Self {
        LineArray { port, outputs, link, nth: 0 }
    }
}

impl SensorArray for LineArray {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        let first = self.port.start().await;
        let first =
            first.map_err(|why| failed(&self.port, "array", &self.link, "waiting for its first reading", why))?;
        self.nth = first.nth;
        Ok(identity(&self.port, "array", &self.link, format!(", {} outputs", self.units())))
    }

    async fn read(&mut self, outputs: &mut [f64]) -> Result<(), DeviceError> {
        let received = self.port.newer_than(self.nth + 1, Instant::now() + OUTPUTS_DEADLINE).await;
        let received = received.map_err(|why| failed(&self.port, "array", &self.link, "reading the outputs", why))?;
        self.nth = received.nth;
        for (output, &column) in outputs.iter_mut().zip(&self.outputs.columns) {
            *output = (received.numbers[column] - self.outputs.offset) * self.outputs.scale;
        }
        Ok(())
    }

    fn units(&self) -> usize {
        self.outputs.columns.len()
    }
}

/// Fraction of lines or frames that may be rejected without a warning.
const REJECTED_SHARE: f64 = 0.01;

/// Fraction of readings that may be lost without a warning. A rare loss is normal for datagrams, and a reading has its own time.
const LOST_SHARE: f64 = 0.001;

fn identity(port: &LinePort, role: &str, link: &str, more: String) -> Identity {
    let PortCounts { good, rejected, lost } = port.counts();
    // the first may be part of a greeting, or lack its beginning
    let is_noisy = rejected > 3 && rejected as f64 > REJECTED_SHARE * (good + rejected) as f64;
    let noisy = || format!("{rejected} of {} lines or frames aren't readings", good + rejected);
    let is_lossy = lost as f64 > LOST_SHARE * (good + lost) as f64;
    let lossy = || format!("{lost} of {} readings were lost on their way", good + lost);
    Identity {
        role: role.to_owned(),
        identity: format!("{}{more}", port.profile().name),
        link: link.to_owned(),
        warnings: is_noisy.then(noisy).into_iter().chain(is_lossy.then(lossy)).collect(),
    }
}

fn failed(port: &LinePort, role: &str, link: &str, doing: &str, why: String) -> DeviceError {
    let device = format!("{role} ({} at {link})", port.profile().name);
    DeviceError { device, doing: doing.to_owned(), problem: DeviceProblem::Link(why) }
}
