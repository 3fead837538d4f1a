//! Enums over all drivers of a role, because a rig file selects the driver at run time. A driver has one line in the list of each
//! of its roles. The identity that a device reports is prepared for display here.

use super::{MissingLoadCell, daqmx, esp301, grbl, klipper, lines, marlin, modbus, process, ur, xps};
use palpate_core::quantity::{Axis, ForceReading};
use palpate_link::device::{
    AxisWay, DeviceError, DeviceProblem, Identity, LoadCell, MotionOrders, RestPlace, SensorArray, Stage, StageUse,
};
use std::time::Duration;

macro_rules! stages {
    ($($name:ident($driver:ty),)+) => {
        /// A stage.
        #[allow(missing_docs, reason = "each is named as the driver it holds")]
        pub enum AnyStage { $($name($driver),)+ }

        impl Stage for AnyStage {
            async fn identify(&mut self, usage: &StageUse) -> Result<Identity, DeviceError> {
                match self { $(Self::$name(it) => it.identify(usage).await.map(Identity::shown),)+ }
            }

            async fn nudge_away(&mut self, way_mm: f64, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
                match self { $(Self::$name(it) => it.nudge_away(way_mm, usage, orders).await,)+ }
            }

            async fn is_homed(&mut self) -> Result<bool, DeviceError> {
                match self { $(Self::$name(it) => it.is_homed().await,)+ }
            }

            async fn home_z(&mut self, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
                match self { $(Self::$name(it) => it.home_z(usage, orders).await,)+ }
            }

            async fn home(&mut self, usage: &StageUse, orders: &MotionOrders) -> Result<(), DeviceError> {
                match self { $(Self::$name(it) => it.home(usage, orders).await,)+ }
            }

            fn position_noise_mm(&self) -> f64 {
                match self { $(Self::$name(it) => it.position_noise_mm(),)+ }
            }

            fn forget_timing(&mut self) {
                match self { $(Self::$name(it) => it.forget_timing(),)+ }
            }

            fn usage(&self) -> Option<&StageUse> {
                match self { $(Self::$name(it) => it.usage(),)+ }
            }

            fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
                match self { $(Self::$name(it) => it.error(doing, problem),)+ }
            }

            async fn rest(&mut self, is_leaving: bool, orders: &MotionOrders) -> Result<Option<RestPlace>, DeviceError> {
                match self { $(Self::$name(it) => it.rest(is_leaving, orders).await,)+ }
            }

            async fn send(&mut self, ways: &[AxisWay], speed_mm_s: f64, usage: &StageUse, orders: &MotionOrders) -> Result<(), DeviceError> {
                match self { $(Self::$name(it) => it.send(ways, speed_mm_s, usage, orders).await,)+ }
            }

            async fn follow(&mut self, axes: &[Axis], expected: Duration, orders: &MotionOrders) -> Result<Vec<f64>, DeviceError> {
                match self { $(Self::$name(it) => it.follow(axes, expected, orders).await,)+ }
            }

            async fn position_mm(&mut self, axis: Axis, orders: &MotionOrders) -> Result<f64, DeviceError> {
                match self { $(Self::$name(it) => it.position_mm(axis, orders).await,)+ }
            }

            async fn stop(&mut self) -> Result<(), DeviceError> {
                match self { $(Self::$name(it) => it.stop().await,)+ }
            }

            async fn abort(&mut self) -> Result<(), DeviceError> {
                match self { $(Self::$name(it) => it.abort().await,)+ }
            }

            async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
                match self { $(Self::$name(it) => it.complaints().await,)+ }
            }

            async fn guard(&mut self, limit_n: Option<f64>) -> Result<(), DeviceError> {
                match self { $(Self::$name(it) => it.guard(limit_n).await,)+ }
            }
        }
    };
}

macro_rules! load_cells {
    ($($name:ident($driver:ty),)+) => {
        /// A load cell.
        #[allow(missing_docs, reason = "each is named as the driver it holds")]
        pub enum AnyLoadCell { $($name($driver),)+ }

        impl LoadCell for AnyLoadCell {
            async fn prepare(&mut self) -> Result<Identity, DeviceError> {
                match self { $(Self::$name(it) => it.prepare().await.map(Identity::shown),)+ }
            }

            fn forget_timing(&mut self) {
                match self { $(Self::$name(it) => it.forget_timing(),)+ }
            }

            async fn read(&mut self) -> Result<ForceReading, DeviceError> {
                match self { $(Self::$name(it) => it.read().await,)+ }
            }

            fn conversion(&self) -> Duration {
                match self { $(Self::$name(it) => it.conversion(),)+ }
            }
        }
    };
}

macro_rules! arrays {
    ($($name:ident($driver:ty),)+) => {
        /// An array.
        #[allow(missing_docs, reason = "each is named as the driver it holds")]
        pub enum AnyArray { $($name($driver),)+ }

        impl SensorArray for AnyArray {
            async fn prepare(&mut self) -> Result<Identity, DeviceError> {
                match self { $(Self::$name(it) => it.prepare().await.map(Identity::shown),)+ }
            }

            async fn read(&mut self, outputs: &mut [f64]) -> Result<(), DeviceError> {
                match self { $(Self::$name(it) => it.read(outputs).await,)+ }
            }

            fn units(&self) -> usize {
                match self { $(Self::$name(it) => it.units(),)+ }
            }
        }
    };
}

stages! {
    Esp301(esp301::Esp301),
    Xps(Box<xps::Xps>),
    Grbl(grbl::Grbl),
    Marlin(marlin::Marlin),
    Klipper(Box<klipper::Klipper>),
    Ur(Box<ur::Ur>),
    Process(process::ProcessStage),
}

load_cells! {
    Modbus(modbus::ModbusLoadCell),
    Lines(lines::LineLoadCell),
    Xps(xps::XpsAnalog),
    Daqmx(daqmx::DaqmxLoadCell),
    Ur(ur::UrForce),
    Process(process::ProcessLoadCell),
    Missing(MissingLoadCell),
}

arrays! {
    Modbus(modbus::ModbusArray),
    Lines(lines::LineArray),
    Daqmx(daqmx::DaqmxArray),
    Process(process::ProcessArray),
}
