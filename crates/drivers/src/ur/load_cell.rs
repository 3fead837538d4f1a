//! The robot's own force as a load cell, read by RTDE over a connection of its own.

use super::frame::TaughtFrame;
use super::rtde::Rtde;
use palpate_core::quantity::{Axis, ForceReading, Health};
use palpate_link::device::{DeviceError, DeviceProblem, Identity, LoadCell};
use palpate_link::time::Instant;
use palpate_link::wire::{Connector, WireError};
use std::time::Duration;

/// Force along the stage's z, as the robot reports it for its tool's centre point.
pub struct UrForce {
    robot: Rtde,
    frame: TaughtFrame,
    /// Direction along z that leads away from the specimen: +1 or -1. The specimen pushes the tip there.
    away: f64,
    link: String,
    origin: Instant,
}

impl UrForce {
    /// Creates the load cell behind a link to the robot's RTDE port. The times of readings are relative to `origin`.
    pub fn new(connector: Connector, frame: TaughtFrame, away: f64, link: String, origin: Instant) -> Self {
        UrForce { robot: Rtde::new(connector, Rtde::INTERVAL), frame, away, link, origin }
    }

    fn failed(&self, doing: &str, error: &WireError) -> DeviceError {
        let device = format!("load cell (UR at {})", self.link);
        DeviceError { device, doing: doing.to_owned(), problem: DeviceProblem::Link(error.to_string()) }
    }
}

impl LoadCell for UrForce {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        self.read().await?;
        Ok(Identity {
            role: "load_cell".to_owned(),
            identity: "the robot's own force".to_owned(),
            link: self.link.clone(),
            warnings: Vec::new(),
        })
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        let state = self.robot.newest().await.map_err(|error| self.failed("reading the force", &error))?;
        let force_n = self.away * self.frame.along(state.force_n)[Axis::Z.index()];
        let health = Health { saturated: false, fault: !force_n.is_finite() };
        Ok(ForceReading { at_s: self.origin.elapsed().as_secs_f64(), force_n, side_n: None, health })
    }

    fn conversion(&self) -> Duration {
        Rtde::INTERVAL
    }
}
