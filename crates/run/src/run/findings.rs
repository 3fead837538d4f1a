//! What was measured on a rig and differs from its file.

use crate::rig::RigSpec;
use palpate_control::ShownRate;
use palpate_core::quantity::ForceReading;
use palpate_drivers::lines::ForceCounts;
use palpate_link::device::{DeviceError, DeviceProblem};
use serde::Serialize;

/// Difference of counts that is only rounding of `newton_per_unit`, relative to them.
const COUNTS_ROUNDING: f64 = 1e-6;

/// A value of the rig file that isn't the measured one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Section of the rig file.
    pub role: &'static str,
    /// Key in this section.
    pub key: &'static str,
    /// Measured value, as the file has it.
    pub measured: String,
    /// Value of the rig.
    pub in_rig: String,
}

impl Finding {
    /// Compares the rate of a load cell without load.
    pub(super) fn of_rate(readings: &[ForceReading], spec: &RigSpec) -> Option<Finding> {
        let ShownRate::Slower(rate_hz) = ShownRate::of(readings, 1.0 / spec.load_cell.conversions_hz) else {
            return None;
        };
        let measured = format!("{:?}", two_digits(rate_hz));
        let in_rig = format!("{:?}", spec.load_cell.conversions_hz);
        Some(Finding { role: "load_cell", key: "conversions_hz", measured, in_rig })
    }

    /// Compares the counts per N of the rig with those that the page of a Net F/T states in N.
    pub(super) fn of_counts(of_rig: f64, ForceCounts { counts, unit }: &ForceCounts) -> Option<Finding> {
        let is_same = (counts - of_rig).abs() <= COUNTS_ROUNDING * of_rig.abs();
        let [measured, in_rig] = [*counts, of_rig].map(|counts| format!("{:?}", 1.0 / counts));
        (unit == "N" && !is_same).then_some(Finding {
            role: "load_cell",
            key: "driver.newton_per_unit",
            measured,
            in_rig,
        })
    }

    /// Returns the line to write in the section.
    pub fn line(&self) -> String {
        format!("{} = {}  # the rig has {}", self.key, self.measured, self.in_rig)
    }

    /// Returns the error of a device with which nothing may begin.
    pub(super) fn error(&self) -> DeviceError {
        let Finding { role, key, measured, in_rig } = self;
        let text = format!("`{key}` is {measured}, but the rig has {in_rig}: write {key} = {measured} in [{role}]");
        let (device, doing) = ((*role).to_owned(), "comparing it with the rig".to_owned());
        DeviceError { device, doing, problem: DeviceProblem::Mismatch(text) }
    }
}

/// Rounds to two digits: no rate is measured better.
fn two_digits(value: f64) -> f64 {
    let unit = 10f64.powf(value.log10().floor() - 1.0);
    ((value / unit).round() * unit * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_counts_of_a_net_ft_are_found_and_the_same_are_not() {
        let found = |of_rig: f64, counts: f64, unit: &str| {
            Finding::of_counts(of_rig, &ForceCounts { counts, unit: unit.to_owned() }).map(|finding| finding.line())
        };
        assert_eq!(found(1.0 / 0.000_001, 1e6, "N"), None);
        assert_eq!(found(1e6, 500_000.0, "N").unwrap(), "driver.newton_per_unit = 2e-6  # the rig has 1e-6");
        assert_eq!(found(1e6, 500_000.0, "lbf"), None, "its unit comes first");
    }

    #[test]
    fn a_rate_has_two_digits() {
        assert_eq!([9.96, 10.04, 12.34, 812.0].map(two_digits), [10.0, 10.0, 12.0, 810.0]);
    }
}
