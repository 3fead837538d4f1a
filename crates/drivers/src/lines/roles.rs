//! Load cell and array behind a line port.

use super::port::{LinePort, Received};
use super::profile::{ForceField, OutputColumns};
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
        LineLoadCell { port, force, conversion, origin, link, nth: 0 }
    }

    fn reading(&self, received: &Received) -> ForceReading {
        let number = received.numbers[self.force.column];
        let saturated = self.force.saturated_at.is_some_and(|ends| number <= ends.min || number >= ends.max);
        let at_s = received.at.duration_since(self.origin).as_secs_f64();
        ForceReading {
            at_s,
            force_n: self.force.newton(number),
            side_n: None,
            health: Health { saturated, fault: false },
        }
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

fn identity(port: &LinePort, role: &str, link: &str, more: String) -> Identity {
    let (good, rejected) = port.counts();
    // the first may be part of a greeting, or lack its beginning
    let is_noisy = rejected > 3 && rejected as f64 > REJECTED_SHARE * (good + rejected) as f64;
    let text = || format!("{rejected} of {} lines or frames aren't readings", good + rejected);
    Identity {
        role: role.to_owned(),
        identity: format!("{}{more}", port.profile().name),
        link: link.to_owned(),
        warnings: is_noisy.then(text).into_iter().collect(),
    }
}

fn failed(port: &LinePort, role: &str, link: &str, doing: &str, why: String) -> DeviceError {
    let device = format!("{role} ({} at {link})", port.profile().name);
    DeviceError { device, doing: doing.to_owned(), problem: DeviceProblem::Link(why) }
}
