//! Load cell and array that read from one task.

use super::Acquisition;
use palpate_core::quantity::{ForceReading, Health};
use palpate_link::device::{DeviceError, Identity, LoadCell, SensorArray};
use palpate_link::time::Instant;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Mutex;

/// One task that a load cell and an array read from.
pub type SharedAcquisition = Arc<Mutex<Acquisition>>;

/// Fraction of an input's range from which a reading may be beyond the end of the range.
const FULL_SCALE: f64 = 0.999;

/// A load cell on an input of a task.
pub struct DaqmxLoadCell {
    acquisition: SharedAcquisition,
    /// Index of the load cell's voltage in a scan.
    at: usize,
    sensitivity: Sensitivity,
    range_v: f64,
    conversion: Duration,
    /// Last scan that was read; no scan is read twice.
    seen: u64,
    origin: Instant,
    identity: Identity,
}

/// N per volt of a load cell.
#[derive(Clone, Debug, PartialEq)]
pub enum Sensitivity {
    /// Of a cell with one axis, which is on one input.
    OneAxis(f64),
    /// Of a cell with three axes, for each of its inputs: rows for the forces of the tip on the specimen along x, y and the press.
    Axes([Vec<f64>; 3]),
}

/// An array on inputs of a task.
pub struct DaqmxArray {
    acquisition: SharedAcquisition,
    at: usize,
    units: usize,
    seen: u64,
    identity: Identity,
}

impl DaqmxLoadCell {
    /// Creates a load cell of a sensitivity, whose first input is at index `at` of a scan. The times of readings are relative to
    /// `origin`.
    pub fn new(
        acquisition: SharedAcquisition,
        at: usize,
        sensitivity: Sensitivity,
        range_v: f64,
        conversions_hz: f64,
        origin: Instant,
        identity: Identity,
    ) -> Self {
        let conversion = Duration::from_secs_f64(1.0 / conversions_hz);
        DaqmxLoadCell { acquisition, at, sensitivity, range_v, conversion, seen: 0, origin, identity }
    }
}

impl LoadCell for DaqmxLoadCell {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        self.acquisition.lock().await.prepare().await?;
        self.read().await?;
        Ok(self.identity.clone())
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        let mut acquisition = self.acquisition.lock().await;
        acquisition.after(self.seen).await?;
        let (scan, volts) = acquisition.newest();
        self.seen = scan;
        let inputs = match &self.sensitivity {
            Sensitivity::OneAxis(_) => 1,
            Sensitivity::Axes(rows) => rows[0].len(),
        };
        let own = volts.get(self.at..self.at + inputs).unwrap_or(&[f64::NAN]);
        let (side_n, force_n) = match &self.sensitivity {
            Sensitivity::OneAxis(newton_per_volt) => (None, own[0] * newton_per_volt),
            Sensitivity::Axes(rows) => {
                let along = |row: &Vec<f64>| row.iter().zip(own).map(|(newton, volts)| newton * volts).sum();
                let [x_n, y_n, force_n] = rows.each_ref().map(along);
                (Some([x_n, y_n]), force_n)
            }
        };
        let saturated = own.iter().any(|volts| volts.abs() >= FULL_SCALE * self.range_v);
        let (at_s, health) = (self.origin.elapsed().as_secs_f64(), Health { saturated, fault: false });
        Ok(ForceReading { at_s, force_n, side_n, health })
    }

    fn conversion(&self) -> Duration {
        self.conversion
    }
}

impl DaqmxArray {
    /// Creates an array of `units` units from index `at` of a scan on.
    pub fn new(acquisition: SharedAcquisition, at: usize, units: usize, identity: Identity) -> Self {
        DaqmxArray { acquisition, at, units, seen: 0, identity }
    }
}

impl SensorArray for DaqmxArray {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        self.acquisition.lock().await.prepare().await?;
        self.read(&mut vec![0.0; self.units]).await?;
        Ok(self.identity.clone())
    }

    async fn read(&mut self, outputs: &mut [f64]) -> Result<(), DeviceError> {
        let mut acquisition = self.acquisition.lock().await;
        acquisition.after(self.seen).await?;
        let (scan, volts) = acquisition.newest();
        self.seen = scan;
        let own = volts.get(self.at..self.at + outputs.len()).unwrap_or_default();
        outputs.iter_mut().zip(own).for_each(|(output, volts)| *output = *volts);
        Ok(())
    }

    fn units(&self) -> usize {
        self.units
    }
}
