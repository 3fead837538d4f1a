//! Whichever driver plays a role: a rig file decides while the program runs.

use super::daqmx::{DaqmxArray, DaqmxLoadCell};
use super::esp301::Esp301;
use super::grbl::Grbl;
use super::modbus::{ModbusArray, ModbusLoadCell};
use super::process::{ProcessArray, ProcessLoadCell, ProcessStage};
use super::xps::{Xps, XpsAnalog};
use crate::device::{DeviceError, Identity, LoadCell, Reins, SensorArray, Stage, StageUse};
use crate::quantity::{Axis, ForceReading};
use std::time::Duration;

/// A stage.
#[allow(missing_docs, reason = "each is named as the driver it holds")]
pub enum AnyStage {
    Esp301(Esp301),
    Xps(Box<Xps>),
    Grbl(Grbl),
    Process(ProcessStage),
}

/// A load cell.
#[allow(missing_docs, reason = "each is named as the driver it holds")]
pub enum AnyLoadCell {
    Modbus(ModbusLoadCell),
    Xps(XpsAnalog),
    Daqmx(DaqmxLoadCell),
    Process(ProcessLoadCell),
}

/// An array.
#[allow(missing_docs, reason = "each is named as the driver it holds")]
pub enum AnyArray {
    Modbus(ModbusArray),
    Daqmx(DaqmxArray),
    Process(ProcessArray),
}

/// The same done by whichever driver it is.
macro_rules! whichever {
    ($role:ident::{$($driver:ident),+}, $this:expr, $it:ident => $done:expr) => {
        match $this { $($role::$driver($it) => $done,)+ }
    };
}

macro_rules! stage {
    ($this:expr, $it:ident => $done:expr) => { whichever!(AnyStage::{Esp301, Xps, Grbl, Process}, $this, $it => $done) };
}

macro_rules! load_cell {
    ($this:expr, $it:ident => $done:expr) => { whichever!(AnyLoadCell::{Modbus, Xps, Daqmx, Process}, $this, $it => $done) };
}

macro_rules! array {
    ($this:expr, $it:ident => $done:expr) => { whichever!(AnyArray::{Modbus, Daqmx, Process}, $this, $it => $done) };
}

impl Stage for AnyStage {
    async fn prepare(&mut self, usage: &StageUse, reins: &Reins) -> Result<Identity, DeviceError> {
        stage!(self, it => it.prepare(usage, reins).await)
    }

    fn afresh(&mut self) {
        stage!(self, it => it.afresh());
    }

    async fn begin(&mut self, targets: &[(Axis, f64)], speed_mm_s: f64, reins: &Reins) -> Result<(), DeviceError> {
        stage!(self, it => it.begin(targets, speed_mm_s, reins).await)
    }

    async fn follow(&mut self, axes: &[Axis], expected: Duration, reins: &Reins) -> Result<Vec<f64>, DeviceError> {
        stage!(self, it => it.follow(axes, expected, reins).await)
    }

    async fn position_mm(&mut self, axis: Axis, reins: &Reins) -> Result<f64, DeviceError> {
        stage!(self, it => it.position_mm(axis, reins).await)
    }

    async fn stop(&mut self) -> Result<(), DeviceError> {
        stage!(self, it => it.stop().await)
    }

    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        stage!(self, it => it.complaints().await)
    }

    async fn guard(&mut self, limit_n: Option<f64>) -> Result<(), DeviceError> {
        stage!(self, it => it.guard(limit_n).await)
    }
}

impl LoadCell for AnyLoadCell {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        load_cell!(self, it => it.prepare().await)
    }

    fn afresh(&mut self) {
        load_cell!(self, it => it.afresh());
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        load_cell!(self, it => it.read().await)
    }

    fn conversion(&self) -> Duration {
        load_cell!(self, it => it.conversion())
    }
}

impl SensorArray for AnyArray {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        array!(self, it => it.prepare().await)
    }

    async fn read(&mut self, outputs: &mut [f64]) -> Result<(), DeviceError> {
        array!(self, it => it.read(outputs).await)
    }

    fn units(&self) -> usize {
        array!(self, it => it.units())
    }
}
