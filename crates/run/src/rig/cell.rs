//! Load cell as described by its rig: readings adjusted by the gain from a known weight, and a statement of the traceability of
//! its forces.

use super::spec::LoadCellSpec;
use palpate_core::quantity::{ForceReading, WeightCheck};
use palpate_drivers::AnyLoadCell;
use palpate_link::device::{DeviceError, Identity, LoadCell};
use std::time::Duration;

/// Statement about a cell with unknown gain.
pub const GAIN_UNKNOWN: &str = "it has neither a certificate nor a check with a known weight: its forces may be wrong (`palpate doctor \
                                --check-weight-n N` checks it)";

/// A load cell whose readings are divided by the gain stated in the rig.
pub struct AdjustedCell {
    driver: AnyLoadCell,
    divisor: f64,
    text: Option<String>,
}

impl AdjustedCell {
    pub(super) fn new(driver: AnyLoadCell, spec: &LoadCellSpec) -> Self {
        AdjustedCell { driver, divisor: spec.divisor(), text: text(spec) }
    }
}

impl LoadCell for AdjustedCell {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        let mut identity = self.driver.prepare().await?;
        identity.warnings.extend(self.text.clone());
        Ok(identity)
    }

    fn forget_timing(&mut self) {
        self.driver.forget_timing();
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        let reading = self.driver.read().await?;
        Ok(ForceReading { force_n: reading.force_n / self.divisor, ..reading })
    }

    fn conversion(&self) -> Duration {
        self.driver.conversion()
    }
}

/// Returns a note for the user about the cell's gain.
fn text(spec: &LoadCellSpec) -> Option<String> {
    match &spec.check {
        Some(check) if check.adjusted => {
            let WeightCheck { gain, weight_n, date, .. } = check;
            Some(format!(
                "its readings are divided by {gain}, the gain measured with a weight of {weight_n} N on {date}"
            ))
        }
        Some(_) => None,
        None if spec.certificate.is_none() => Some(GAIN_UNKNOWN.to_owned()),
        None => None,
    }
}
