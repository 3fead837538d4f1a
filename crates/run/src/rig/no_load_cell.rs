//! `load_cell = "none"`: a rig that presses by depth only.

use super::emulated::{EmulatedDevice, FarEnd};
use super::spec::{Dial, Driver, LoadCellDriver, LoadCellSpec, RigSpec, RigWiring};
use palpate_drivers::{AnyLoadCell, MissingLoadCell};
use palpate_link::device::DeviceError;
use palpate_link::wire::{ClaimError, Claims, Link};
use std::sync::Arc;

/// Driver of a rig without a load cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct WithoutLoadCell;

/// Rate that stands for the rate of readings, 1/s. Nothing is read.
const CONVERSIONS_HZ: f64 = 100.0;

impl LoadCellSpec {
    /// Returns the section of a rig that has no load cell.
    pub(super) fn none() -> LoadCellSpec {
        LoadCellSpec {
            driver: Arc::new(WithoutLoadCell),
            link: Link::Sim,
            conversions_hz: CONVERSIONS_HZ,
            lag_s: 0.0,
            air_n: None,
            stiffness_n_mm: None,
            axes: None,
            certificate: None,
            check: None,
            axes_check: None,
        }
    }
}

impl Driver for WithoutLoadCell {
    fn claim(&self, _: &Link, _: &mut Claims) -> Result<(), ClaimError> {
        Ok(())
    }
}

impl LoadCellDriver for WithoutLoadCell {
    fn open(&self, _: Dial, _: &RigWiring) -> Result<AnyLoadCell, DeviceError> {
        Ok(AnyLoadCell::Missing(MissingLoadCell))
    }

    fn emulated(&self, _: &RigSpec, _: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError> {
        Ok(EmulatedDevice { far_end: FarEnd::Library, protocol: "none", ports: &[], line: None })
    }
}
