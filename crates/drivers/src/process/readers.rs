//! Load cell and array behind programs of the user.

use super::port::{ANSWER_DEADLINE, FORCE_DEADLINE, JsonObject, ProgramPort};
use palpate_core::quantity::{ForceReading, Health};
use palpate_link::device::{DeviceError, DeviceProblem, Identity, LoadCell, SensorArray};
use palpate_link::time::Instant;
use palpate_link::wire::Connector;
use serde_json::Value;
use std::time::Duration;

/// A load cell behind a program.
pub struct ProcessLoadCell {
    port: ProgramPort,
    conversion: Duration,
    origin: Instant,
}

/// An array behind a program.
pub struct ProcessArray {
    port: ProgramPort,
    units: usize,
}

impl ProcessLoadCell {
    /// Creates a load cell with a new reading `conversions_hz` times per second; the times of readings are relative to `origin`.
    /// `start` is the longest time until the program answers for the first time.
    pub fn new(connector: Connector, link: String, start: Duration, conversions_hz: f64, origin: Instant) -> Self {
        let conversion = Duration::from_secs_f64(1.0 / conversions_hz);
        ProcessLoadCell { port: ProgramPort::new(connector, "load_cell", link, start), conversion, origin }
    }
}

impl LoadCell for ProcessLoadCell {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        let (identity, _) = self.port.identify().await?;
        self.read_within(ANSWER_DEADLINE).await?; // the first may take longer
        Ok(identity)
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        self.read_within(FORCE_DEADLINE + self.conversion).await
    }

    fn conversion(&self) -> Duration {
        self.conversion
    }
}

impl ProcessLoadCell {
    async fn read_within(&mut self, deadline: Duration) -> Result<ForceReading, DeviceError> {
        let doing = "reading the force";
        let said = self.port.ask_within(doing, "read", JsonObject::new(), None, deadline).await?;
        let force_n = said.get("force_n").and_then(Value::as_f64).filter(|force_n| force_n.is_finite());
        let Some(force_n) = force_n else {
            return Err(self.port.misfit(doing, &said, "\"force_n\", a number".to_owned()));
        };
        // languages without truth values send 1
        let is_true =
            |value: &Value| value.as_bool().unwrap_or_else(|| value.as_f64().is_some_and(|number| number != 0.0));
        let says = |key: &str| said.get(key).is_some_and(is_true);
        let health = Health { saturated: says("saturated"), fault: says("fault") };
        Ok(ForceReading { at_s: self.origin.elapsed().as_secs_f64(), force_n, side_n: None, health })
    }
}

impl ProcessArray {
    /// Creates an array of `units` units. `start` is the longest time until the program answers for the first time.
    pub fn new(connector: Connector, link: String, start: Duration, units: usize) -> Self {
        ProcessArray { port: ProgramPort::new(connector, "array", link, start), units }
    }
}

impl SensorArray for ProcessArray {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        let (identity, said) = self.port.identify().await?;
        if said.get("units").and_then(Value::as_u64) != Some(self.units as u64) {
            let text = format!("it doesn't report \"units\": {}, the number of units in the rig file", self.units);
            return Err(self.port.error("identifying it", DeviceProblem::Mismatch(text)));
        }
        self.read(&mut vec![0.0; self.units]).await?;
        Ok(identity)
    }

    async fn read(&mut self, outputs: &mut [f64]) -> Result<(), DeviceError> {
        let doing = "reading the outputs";
        let said = self.port.ask(doing, "read", JsonObject::new(), None).await?;
        let read: Option<Vec<f64>> = said
            .get("outputs")
            .and_then(Value::as_array)
            .filter(|values| values.len() == outputs.len())
            .and_then(|values| values.iter().map(Value::as_f64).collect());
        match read.filter(|values| values.iter().all(|value| value.is_finite())) {
            Some(values) => {
                outputs.copy_from_slice(&values);
                Ok(())
            }
            None => Err(self.port.misfit(doing, &said, format!("\"outputs\", {} numbers", outputs.len()))),
        }
    }

    fn units(&self) -> usize {
        self.units
    }
}
