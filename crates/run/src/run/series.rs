//! Readings of a press, kept as the devices return them.
//!
//! The recorder stands between the force loop and the devices. It changes neither what is read nor when.

use super::Halt;
use super::clock::RunClock;
use palpate_control::Zero;
use palpate_core::quantity::{ForceReading, Identity};
use palpate_data::dataset::{
    DatasetError, MonitorValue, NoLoad, ReadValue, SeriesMark, SeriesQueue, SeriesReading, SeriesReadings,
    SeriesWriteError,
};
use palpate_data::recipe::SeriesScope;
use palpate_link::device::{DeviceError, LoadCell, SensorArray};
use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

/// Number of values after which the readings of a long press go to the disk before it ends: 2 MB.
const PIECE: usize = 1 << 18;

/// Recorder of the readings of one press after another.
pub(super) struct SeriesRecorder {
    scope: SeriesScope,
    queue: SeriesQueue,
    clock: RunClock,
    pressing: RefCell<Pressing>,
}

/// Readings of the press under way.
#[derive(Default)]
struct Pressing {
    readings: SeriesReadings,
    /// Number of values in them.
    values: usize,
    /// Whether a press is under way, and whether a window is.
    in_press: bool,
    in_window: bool,
    /// What forces and outputs count from; `None` until it was read.
    no_load: Option<NoLoad>,
    /// Least difference of our time and the load cell's.
    origin_s: Option<f64>,
    /// Time of the newest reading of a monitor so far, s.
    monitors_s: f64,
    failed: Option<SeriesWriteError>,
}

impl SeriesRecorder {
    /// Creates a recorder that adds readings to a queue. `clock` counts from the start of the run.
    pub(super) fn new(scope: SeriesScope, queue: SeriesQueue, clock: RunClock) -> Self {
        SeriesRecorder { scope, queue, clock, pressing: RefCell::default() }
    }

    /// Begins a press. Readings of monitors since the press before are kept with any scope.
    pub(super) fn begin(&self, press: u64, monitors: Vec<MonitorValue>) {
        let mut pressing = self.pressing.borrow_mut();
        let (origin_s, known_s) = (pressing.origin_s, pressing.monitors_s);
        let monitors_s = monitors.iter().map(|monitor| monitor.t_s).fold(known_s, f64::max);
        let row = |monitor: MonitorValue| SeriesReading {
            t_s: monitor.t_s,
            taken_s: None,
            value: ReadValue::Monitor(monitor),
        };
        let rows = monitors.into_iter().filter(|monitor| monitor.t_s > known_s).map(row).collect();
        let readings = SeriesReadings { press, rows };
        *pressing = Pressing { readings, in_press: true, origin_s, monitors_s, ..Pressing::default() };
    }

    /// Makes further readings relative to these readings without load.
    pub(super) fn count_from(&self, no_load: &NoLoad) {
        self.pressing.borrow_mut().no_load = Some(no_load.clone());
    }

    /// Begins or ends a window.
    pub(super) fn window(&self, is_open: bool) {
        self.pressing.borrow_mut().in_window = is_open;
    }

    /// Ends a press: waits until its readings are on the disk, and returns what the journal states about them.
    pub(super) fn end(&self) -> Result<SeriesMark, Halt> {
        let mut pressing = self.pressing.borrow_mut();
        pressing.in_press = false;
        pressing.send(&self.queue);
        let sent = pressing.failed.take().map_or(Ok(()), Err);
        sent.and_then(|()| self.queue.mark()).map_err(|error| DatasetError::from(error).into())
    }

    /// Returns the error that ends a press before its end: more readings wait for the disk than may.
    pub(super) fn check(&self) -> Result<(), Halt> {
        let failed = self.pressing.borrow_mut().failed.take();
        failed.map_or(Ok(()), |error| Err(DatasetError::from(error).into()))
    }

    fn force(&self, reading: &ForceReading) {
        let t_s = self.clock.now_s();
        let mut pressing = self.pressing.borrow_mut();
        let difference_s = t_s - reading.at_s;
        let origin_s = pressing.origin_s.map_or(difference_s, |known_s| known_s.min(difference_s));
        pressing.origin_s = Some(origin_s);
        let value = ReadValue::Force { force_n: reading.force_n, side_n: reading.side_n };
        self.add(pressing, SeriesReading { t_s, taken_s: Some(reading.at_s + origin_s), value });
    }

    fn outputs(&self, outputs: &[f64]) {
        let value = ReadValue::Outputs(outputs.to_vec());
        self.add(self.pressing.borrow_mut(), SeriesReading { t_s: self.clock.now_s(), taken_s: None, value });
    }

    /// Adds z, read back, mm in the specimen frame.
    pub(super) fn height(&self, z_mm: f64) {
        let value = ReadValue::Height(z_mm);
        self.add(self.pressing.borrow_mut(), SeriesReading { t_s: self.clock.now_s(), taken_s: None, value });
    }

    fn add(&self, mut pressing: std::cell::RefMut<'_, Pressing>, reading: SeriesReading) {
        let is_kept = match self.scope {
            SeriesScope::None => false,
            SeriesScope::Window => pressing.in_window,
            SeriesScope::Press => pressing.in_press,
        };
        if !is_kept {
            return;
        }
        pressing.values += reading.values();
        pressing.readings.rows.push(reading);
        if pressing.values >= PIECE && pressing.no_load.is_some() {
            pressing.send(&self.queue);
        }
    }
}

impl Pressing {
    /// Hands the readings so far to the disk, relative to those without load.
    fn send(&mut self, queue: &SeriesQueue) {
        let press = self.readings.press;
        self.values = 0;
        let mut readings = std::mem::replace(&mut self.readings, SeriesReadings { press, rows: Vec::new() });
        if let Some(no_load) = &self.no_load {
            // by our time, which is that of the cell and the least difference
            let zero_s = self.origin_s.map_or(0.0, |origin_s| origin_s + no_load.force.at_s);
            readings.rows.iter_mut().for_each(|reading| reading.count_from(no_load, zero_s));
        }
        if !readings.rows.is_empty() && self.failed.is_none() {
            self.failed = queue.add(readings).err();
        }
    }
}

/// Device whose readings may be kept.
pub(super) struct RecordedDevice<D> {
    pub device: D,
    pub series: Option<Rc<SeriesRecorder>>,
    /// Largest reading of a load cell.
    pub largest: LargestReading,
}

impl<D> RecordedDevice<D> {
    pub(super) fn new(device: D) -> Self {
        RecordedDevice { device, series: None, largest: LargestReading::default() }
    }
}

/// Largest value that two successive readings of a load cell reached: a single wrong reading doesn't count.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LargestReading {
    last: Option<(f64, bool)>,
    /// The cell's reading, N, and whether it is the end of the cell's range; `None` before two readings.
    pub reading: Option<(f64, bool)>,
    /// When the cell read it, by its own clock, s.
    pub at_s: f64,
}

impl LargestReading {
    pub(super) fn take(&mut self, reading: &ForceReading) {
        let now = (reading.force_n, reading.health.saturated);
        if let Some(before) = self.last.replace(now) {
            let both = if before.0 < now.0 { before } else { now };
            let is_larger = self.reading.is_none_or(|largest| both.0 > largest.0);
            if is_larger && both.0.is_finite() {
                (self.reading, self.at_s) = (Some(both), reading.at_s);
            }
        }
    }

    /// States that the largest reading was the end of the cell's range.
    pub(super) fn is_the_end(&mut self) {
        self.reading.iter_mut().for_each(|(_, is_end)| *is_end = true);
    }

    /// Keeps the forces when they count from another zero.
    pub(super) fn count_from(&mut self, before: &Zero, now: &Zero) {
        let by_n = now.at_n(self.at_s) - before.at_n(self.at_s);
        self.last.iter_mut().chain(&mut self.reading).for_each(|(reading_n, _)| *reading_n += by_n);
    }
}

impl<C: LoadCell> LoadCell for RecordedDevice<C> {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        self.device.prepare().await
    }

    fn forget_timing(&mut self) {
        self.device.forget_timing();
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        let reading = self.device.read().await?;
        self.series.iter().for_each(|series| series.force(&reading));
        self.largest.take(&reading);
        Ok(reading)
    }

    fn conversion(&self) -> Duration {
        self.device.conversion()
    }
}

impl<A: SensorArray> SensorArray for RecordedDevice<A> {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        self.device.prepare().await
    }

    async fn read(&mut self, outputs: &mut [f64]) -> Result<(), DeviceError> {
        self.device.read(outputs).await?;
        self.series.iter().for_each(|series| series.outputs(outputs));
        Ok(())
    }

    fn units(&self) -> usize {
        self.device.units()
    }
}
