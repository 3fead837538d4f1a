//! Uncertainty budget of one force: the parts of its uncertainty, after the GUM.

use super::press::NoLoadReadings;
use super::zero::Zero;
use palpate_core::quantity::round;
use serde::{Deserialize, Serialize};

/// Parts of a force's standard uncertainty, N each. The parts are independent, so their squares add up (GUM 5.1.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UncertaintyBudget {
    /// Load cell: uncertainty from its certificate at such a force, or from its check with a known weight (type B). `None` if
    /// there is neither.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell_n: Option<f64>,
    /// Zero, interpolated between the readings without load before and after. The first part is the noise of both means (type A). The
    /// second part is any departure of the zero from a linear change between the two (type B, rectangular).
    pub zero_n: f64,
    /// Noise of the readings in the window (type A).
    pub noise_n: f64,
    /// One step of the cell's readings (type B, rectangular).
    pub resolution_n: f64,
    /// Remainder of the mains interference (type B, arcsine).
    pub hum_n: f64,
    /// Change of the load cell's sensitivity since its calibration, by the temperature (type B, rectangular). `None` if its certificate states
    /// no change, or the temperature isn't monitored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_n: Option<f64>,
}

/// Data that a force was averaged from.
#[derive(Clone, Copy, Debug)]
pub struct Averaged {
    /// Number of readings in the window.
    pub readings: u32,
    /// Time that the readings took, s.
    pub seconds: f64,
    /// No-load readings before the press and after the press.
    pub no_loads: [NoLoadReadings; 2],
    /// Move of the zero from the first to the second, beyond the drift that was corrected, N.
    pub moved_n: f64,
    /// Position of the window between the two no-load readings, 0 to 1.
    pub share: f64,
}

impl UncertaintyBudget {
    /// Returns the budget of a force; `cell_n` is the load cell's own standard uncertainty at this force.
    pub fn of(averaged: &Averaged, zero: &Zero, cell_n: Option<f64>) -> UncertaintyBudget {
        let Averaged { readings, seconds, no_loads: [before, after], moved_n, share } = *averaged;
        let of_mean = |readings: u32| zero.noise_of_mean_n(readings);
        let (before_n, after_n) = (of_mean(before.readings), of_mean(after.readings));
        // if two means differ by more than their noise, the rest is a change of the zero
        let moved_2 = moved_n.powi(2) - before_n.powi(2) - after_n.powi(2);
        let noise_2 = ((1.0 - share) * before_n).powi(2) + (share * after_n).powi(2);
        let step_n = zero.step_n / 12f64.sqrt();
        // steps smaller than the noise are averaged out with it
        let resolution_n = if zero.noise_n < zero.step_n { step_n } else { step_n / f64::from(readings.max(1)).sqrt() };
        let hum_n = zero.mains.map_or(0.0, |mains| mains.left_n(seconds));
        let zero_n = (noise_2 + moved_2.max(0.0) / 12.0).sqrt();
        UncertaintyBudget { cell_n, zero_n, noise_n: of_mean(readings), resolution_n, hum_n, temperature_n: None }
    }

    /// Returns the combined standard uncertainty, N; `None` if the load cell's uncertainty is unknown.
    pub fn u_n(&self) -> Option<f64> {
        let UncertaintyBudget { cell_n, zero_n, noise_n, resolution_n, hum_n, temperature_n } = *self;
        let parts = [cell_n?, zero_n, noise_n, resolution_n, hum_n, temperature_n.unwrap_or_default()];
        Some(parts.iter().map(|part| part * part).sum::<f64>().sqrt())
    }

    /// Returns the budget of the force multiplied by a factor.
    #[must_use]
    pub fn times(self, factor: f64) -> UncertaintyBudget {
        let UncertaintyBudget { cell_n, zero_n, noise_n, resolution_n, hum_n, temperature_n } = self;
        UncertaintyBudget {
            cell_n: cell_n.map(|n| factor * n),
            zero_n: factor * zero_n,
            noise_n: factor * noise_n,
            resolution_n: factor * resolution_n,
            hum_n: factor * hum_n,
            temperature_n: temperature_n.map(|n| factor * n),
        }
    }

    /// Returns the budget rounded to 0.1 uN.
    #[must_use]
    pub fn rounded(self) -> UncertaintyBudget {
        let rounded = |n: f64| round(n, 7);
        let UncertaintyBudget { cell_n, zero_n, noise_n, resolution_n, hum_n, temperature_n } = self;
        UncertaintyBudget {
            cell_n: cell_n.map(rounded),
            zero_n: rounded(zero_n),
            noise_n: rounded(noise_n),
            resolution_n: rounded(resolution_n),
            hum_n: rounded(hum_n),
            temperature_n: temperature_n.map(rounded),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MainsInterference;

    fn averaged(after_n: f64) -> Averaged {
        let no_load =
            |mean_n| NoLoadReadings { mean_n, sigma_n: 0.003, readings: 100, age_s: 0.05, ..NoLoadReadings::default() };
        Averaged {
            readings: 225,
            seconds: 0.2,
            no_loads: [no_load(0.0), no_load(after_n)],
            moved_n: after_n,
            share: 0.5,
        }
    }

    #[test]
    fn budget_parts_follow_from_readings_and_certificate() {
        let zero = Zero { step_n: 0.001, ..Zero::with_noise(0.003) };
        let budget = UncertaintyBudget::of(&averaged(0.0), &zero, Some(0.004));
        assert!((budget.noise_n - 0.0002).abs() < 1e-12);
        assert!((budget.zero_n - 0.0003 / 2f64.sqrt()).abs() < 1e-12);
        assert!((budget.resolution_n - 0.001 / 12f64.sqrt() / 15.0).abs() < 1e-12);
        let u_n = budget.u_n().unwrap();
        assert!(u_n > 0.004 && u_n < 0.0041, "{u_n}");
        assert_eq!(
            UncertaintyBudget { cell_n: None, ..budget }.u_n(),
            None,
            "an uncertainty without the cell's own would be a lie"
        );
        let warm = UncertaintyBudget { temperature_n: Some(0.003), ..budget };
        assert!((warm.u_n().unwrap() - u_n.hypot(0.003)).abs() < 1e-15);
        let moved = UncertaintyBudget::of(&averaged(0.010), &zero, None);
        assert!((moved.zero_n - 0.010 / 12f64.sqrt()).abs() < 2e-5, "{moved:?}");
    }

    #[test]
    fn coarse_step_and_partial_mains_periods_count_in_full() {
        let coarse = Zero { step_n: 0.010, ..Zero::with_noise(0.001) };
        assert!(
            (UncertaintyBudget::of(&averaged(0.0), &coarse, None).resolution_n - 0.010 / 12f64.sqrt()).abs() < 1e-12
        );
        let mains = |whole_s| Some(MainsInterference { amplitude_n: 0.01, hz: 50.0, whole_s });
        let left_n =
            |whole_s| UncertaintyBudget::of(&averaged(0.0), &Zero { mains: mains(whole_s), ..coarse }, None).hum_n;
        assert!((left_n(Some(0.02)) - 0.0001 / 2f64.sqrt()).abs() < 1e-12);
        assert!((left_n(None) - 0.01 / (10.0 * std::f64::consts::PI) / 2f64.sqrt()).abs() < 1e-12);
    }
}
