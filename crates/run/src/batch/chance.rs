//! The chance that a typical sensor is decided: an acceptance rule applied to drawn test errors.

use super::Typical;
use palpate_core::quantity::stream;
use palpate_data::acceptance::{AcceptanceRule, Limit, LimitedFigure, Measured, SensorVerdict, TestErrors, judge};
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;

/// Number of drawn sensors. The standard error of a chance is at most 1.6 %.
pub const DRAWS: usize = 1000;

/// Fixed random seed, so that the same batch file always has the same chance.
const SEED: u64 = 1;

/// Chance of each verdict for a typical sensor, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Chance {
    /// Accepted.
    pub accepted: f64,
    /// Not accepted.
    pub not_accepted: f64,
    /// Not decided.
    pub not_decided: f64,
}

/// Numbers of presses, and the bench's uncertainties.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Test {
    /// Number of calibration presses.
    pub calibration_presses: usize,
    /// Number of test presses.
    pub test_presses: usize,
    /// Standard uncertainty of the pressed places, mm; `None` if it is unknown.
    pub u_place_mm: Option<f64>,
    /// Standard uncertainty of the forces, N; `None` if it is unknown.
    pub u_force_n: Option<f64>,
}

/// Returns the chance of each verdict for a sensor with typical errors. A location error is the distance of two normal errors of the
/// same spread, a force error the size of a normal error; both have the stated means. Figures that a test doesn't measure
/// count as within their limits.
///
/// # Errors
/// The name of the missing key of `typical`.
pub fn chance(rule: &AcceptanceRule, test: &Test, typical: &Typical) -> Result<Chance, &'static str> {
    let limits: Vec<Limit> = rule.limits.iter().filter(|limit| is_drawn(limit.figure)).copied().collect();
    let has = |figures: [LimitedFigure; 3]| limits.iter().any(|limit| figures.contains(&limit.figure));
    let is_of_places = has([LimitedFigure::LocationMean, LimitedFigure::LocationP95, LimitedFigure::LocationWithin]);
    let is_of_forces = has([LimitedFigure::ForceMean, LimitedFigure::ForceP95, LimitedFigure::ForceWithin]);
    if is_of_places && typical.location_mean_mm.is_none() {
        return Err("location_mean_mm");
    }
    if is_of_forces && typical.force_mean_n.is_none() {
        return Err("force_mean_n");
    }
    let rule = AcceptanceRule { limits, ..rule.clone() };
    let mut rng = stream(SEED, 0, "typical sensors");
    let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
    let mut chance = Chance::default();
    for _ in 0..DRAWS {
        // the mean of a Rayleigh distribution is sigma * sqrt(pi / 2), that of a half-normal one sigma * sqrt(2 / pi)
        let places_mm = typical.location_mean_mm.map(|mean_mm| {
            let sigma_mm = mean_mm / (PI / 2.0).sqrt();
            (0..test.test_presses).map(|_| (sigma_mm * normal()).hypot(sigma_mm * normal())).collect()
        });
        let forces_n = typical.force_mean_n.map(|mean_n| {
            let sigma_n = mean_n / (2.0 / PI).sqrt();
            (0..test.test_presses).map(|_| (sigma_n * normal()).abs()).collect()
        });
        let measured = Measured {
            calibration_presses: test.calibration_presses,
            test_presses: test.test_presses,
            location: places_mm.map(|sizes| TestErrors { sizes, u_truth: test.u_place_mm }),
            force: forces_n.map(|sizes| TestErrors { sizes, u_truth: test.u_force_n }),
            broken_outputs: Some(Vec::new()),
            ..Measured::default()
        };
        let share = match judge(&rule, &measured).verdict {
            SensorVerdict::Accepted => &mut chance.accepted,
            SensorVerdict::NotAccepted => &mut chance.not_accepted,
            SensorVerdict::NotDecided => &mut chance.not_decided,
        };
        *share += 1.0 / DRAWS as f64;
    }
    Ok(chance)
}

/// Whether a figure is drawn, or is 0 for a typical sensor.
fn is_drawn(figure: LimitedFigure) -> bool {
    figure.is_of_test() || matches!(figure, LimitedFigure::BrokenChannels | LimitedFigure::FlaggedPresses)
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_data::recipe::parse_rule;

    fn of(rule: &str, test_presses: usize, location_mean_mm: f64) -> Chance {
        let rule = parse_rule("accept.toml", rule).unwrap();
        let test = Test { calibration_presses: 100, test_presses, u_place_mm: Some(0.01), u_force_n: Some(0.001) };
        let typical = Typical { location_mean_mm: Some(location_mean_mm), force_mean_n: None };
        chance(&rule, &test, &typical).unwrap()
    }

    const GUARDED: &str = "rule = \"guarded\"\nlocation_mean_mm = 1.0\n";

    #[test]
    fn a_guarded_rule_decides_more_often_with_more_presses_and_never_with_too_few() {
        assert_eq!(of(GUARDED, 58, 0.9).accepted, 0.0);
        let close = [58, 60, 100, 400].map(|presses| of(GUARDED, presses, 0.9).not_decided);
        assert!(close.is_sorted_by(|fewer, more| fewer > more), "{close:?}");
        assert!(close[3] < 0.1, "{close:?}");
        let far = of(GUARDED, 100, 0.5);
        assert!(far.accepted > 0.999 && far.not_accepted == 0.0, "{far:?}");
        let over = of(GUARDED, 100, 1.3);
        assert!(over.not_accepted > 0.99, "{over:?}");
    }

    #[test]
    fn a_simple_rule_always_decides_and_at_the_limit_half_are_accepted() {
        let half = of("location_mean_mm = 1.0\nnoise_percent = 1.0\n", 100, 1.0);
        assert!(half.not_decided == 0.0 && (half.accepted - 0.5).abs() < 0.06, "{half:?}");
    }

    #[test]
    fn without_the_typical_errors_that_the_rule_needs_there_is_no_chance() {
        let rule = parse_rule("accept.toml", "force_mean_n = 0.1\nlocation_mean_mm = 1.0\n").unwrap();
        let typical = Typical { location_mean_mm: Some(1.0), force_mean_n: None };
        assert_eq!(chance(&rule, &Test::default(), &Typical::default()), Err("location_mean_mm"));
        assert_eq!(chance(&rule, &Test::default(), &typical), Err("force_mean_n"));
    }
}
