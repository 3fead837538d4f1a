//! Drift of a load cell's zero: a straight line through the air that was read, with its error.

use super::trip::{SafetyRule, Trip};
use super::zero::{DETECT_LEAST_N, SHARED_MOST, correlation, counts_for};
use palpate_core::quantity::ForceReading;
use serde::{Deserialize, Serialize};

/// Least rate by which forces are corrected, N/s, and in its own sd. A cell that warms up has 1 mN/s at most, and a wave of 5 mN in 25 s
/// reaches 1.3 mN/s and turns around. A press of 15 s bears this rate: it moves by less than a touch.
const USED_N_S: f64 = 0.0015;
const USED_SIGMAS: f64 = 4.0;

/// Shortest time over which a rate is shown by which forces are corrected, s: the wave of a cell of 5 s looks like a drift for two. And the
/// rate in sd from which it is read for so long.
const LASTS_S: f64 = 8.0;
const SEEN_SIGMAS: f64 = 3.0;

/// Growth of the rate's variance, (N/s)^2 each second: 0.4 mN/s from press to press. A cell that cools down after 20 mN/s with a time constant
/// of five minutes changes its rate by 1 mN/s.
const RATE_WALK: f64 = 1e-8;

/// Largest rate that isn't shown and still is no touch, N/s. On a descent the air is read each second, so a light touch would have to grow as
/// slowly.
const HIDDEN_MOST_N_S: f64 = 0.005;

/// Rate of a cell of which nothing is known, N/s, and the number of quantities that a line has.
const UNKNOWN_N_S: f64 = 1.0;
const LINE: usize = 2;

/// Time that a rate must hold for: a press takes that long, s. And the part of the force limit by which a zero may drift in it.
const PRESS_S: f64 = 15.0;
const DRIFTED_SHARE: f64 = 0.2;

/// The stated least force limit is rounded up to this, N.
const LIMIT_GRAIN_N: f64 = 0.01;

/// Rate of a zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// Rate by which forces are corrected, N/s; 0 if no drift is shown.
    pub rate_n_s: f64,
    /// Standard deviation of the rate, N/s.
    pub sigma_n_s: f64,
    /// Rate that isn't shown well enough, N/s: forces aren't corrected by it, but the zero may move so.
    #[serde(skip)]
    pub hidden_n_s: f64,
}

/// Straight line of a zero over time. Each air that is read makes it more certain, and the time between them less (a Kalman filter of the
/// offset and its rate).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroLine {
    /// Begin and end of what it was read from, s.
    began_s: f64,
    until_s: f64,
    at_s: f64,
    offset_n: f64,
    rate_n_s: f64,
    /// Variances of the offset and of the rate, and their covariance between the two.
    variances: [f64; 3],
}

impl ZeroLine {
    /// Returns the line through readings of one time, by least squares.
    pub fn of(readings: &[ForceReading]) -> ZeroLine {
        let n = readings.len().max(1) as f64;
        let mean = |value: &dyn Fn(&ForceReading) -> f64| readings.iter().map(value).sum::<f64>() / n;
        let (at_s, offset_n) = (mean(&|reading| reading.at_s), mean(&|reading| reading.force_n));
        let spread = mean(&|reading| (reading.at_s - at_s).powi(2));
        if readings.len() <= LINE || spread <= 0.0 {
            return ZeroLine {
                began_s: at_s,
                until_s: at_s,
                at_s,
                offset_n,
                rate_n_s: 0.0,
                variances: [0.0, 0.0, UNKNOWN_N_S.powi(2)],
            };
        }
        let rate_n_s = mean(&|reading| (reading.at_s - at_s) * (reading.force_n - offset_n)) / spread;
        let left: Vec<f64> =
            readings.iter().map(|reading| reading.force_n - offset_n - rate_n_s * (reading.at_s - at_s)).collect();
        let squares: f64 = left.iter().map(|left| left * left).sum();
        // neighbours that are alike count as fewer, also by chance: those of a bent line are
        let variance = squares / (n - LINE as f64) * counts_for(correlation(&left).clamp(0.0, SHARED_MOST));
        let of_rate = (variance / (n * spread)).min(UNKNOWN_N_S.powi(2));
        let (began_s, until_s) = (readings[0].at_s, readings[readings.len() - 1].at_s);
        ZeroLine { began_s, until_s, at_s, offset_n, rate_n_s, variances: [variance / n, 0.0, of_rate] }
    }

    /// Returns the line with newer air: its middle, s, its mean and the standard deviation of this mean, N. Older air adds nothing.
    #[must_use]
    pub fn read(&self, at_s: f64, mean_n: f64, sigma_n: f64) -> ZeroLine {
        let dt_s = at_s - self.at_s;
        if dt_s <= 0.0 {
            return *self;
        }
        let [of_offset, between, of_rate] = self.variances;
        let rate = of_rate + RATE_WALK * dt_s;
        let both = between + dt_s * of_rate + RATE_WALK * dt_s.powi(2) / 2.0;
        let offset = of_offset + dt_s * (between + both) - RATE_WALK * dt_s.powi(3) / 6.0;
        let all = (offset + sigma_n.powi(2)).max(f64::MIN_POSITIVE);
        let predicted_n = self.offset_n + self.rate_n_s * dt_s;
        let off_n = mean_n - predicted_n;
        ZeroLine {
            began_s: self.began_s,
            until_s: self.until_s.max(at_s),
            at_s,
            offset_n: predicted_n + offset / all * off_n,
            rate_n_s: self.rate_n_s + both / all * off_n,
            variances: [offset - offset * offset / all, both - both * offset / all, rate - both * both / all],
        }
    }

    /// Returns the line with the middle of a newer one.
    #[must_use]
    pub fn continued(&self, newer: &ZeroLine) -> ZeroLine {
        self.read(newer.at_s, newer.offset_n, newer.variances[0].sqrt())
    }

    /// Returns the rate that is shown.
    pub fn drift(&self) -> Drift {
        let sigma_n_s = self.variances[2].max(0.0).sqrt();
        let is_shown = self.rate_n_s.abs() >= USED_N_S.max(USED_SIGMAS * sigma_n_s);
        let (rate_n_s, hidden_n_s) = if is_shown { (self.rate_n_s, 0.0) } else { (0.0, self.rate_n_s) };
        Drift { rate_n_s, sigma_n_s, hidden_n_s }
    }

    /// Returns the rate by which forces are corrected.
    pub fn lasting(&self) -> Drift {
        let drift = self.drift();
        if self.lasts() { drift } else { Drift { rate_n_s: 0.0, hidden_n_s: self.rate_n_s, ..drift } }
    }

    /// Whether more readings are needed: the rate may move the zero by a touch in a press, or a drift is seen and wasn't read for long enough.
    pub fn is_vague(&self) -> bool {
        let sigma_n_s = self.drift().sigma_n_s;
        let is_seen = self.rate_n_s.abs() >= USED_N_S.max(SEEN_SIGMAS * sigma_n_s);
        SEEN_SIGMAS * sigma_n_s > DETECT_LEAST_N / PRESS_S || (is_seen && !self.lasts())
    }

    fn lasts(&self) -> bool {
        self.until_s - self.began_s >= LASTS_S
    }
}

impl Drift {
    /// Largest rate with which a specimen with this force limit is pressed, N/s.
    pub fn most_n_s(limit_n: f64) -> f64 {
        DRIFTED_SHARE * limit_n / PRESS_S
    }

    /// Rate that was seen, N/s, whether forces are corrected by it or not; `None` if chance explains it.
    pub fn seen_n_s(&self) -> Option<f64> {
        let rate_n_s = self.rate_n_s + self.hidden_n_s;
        (rate_n_s != 0.0 && rate_n_s.abs() >= USED_SIGMAS * self.sigma_n_s).then_some(rate_n_s)
    }

    /// Checks that a specimen with this force limit is pressed with this rate.
    ///
    /// # Errors
    /// The rate is larger.
    pub fn passes(&self, limit_n: f64) -> Result<(), Trip> {
        let most_n_s = Drift::most_n_s(limit_n);
        if self.rate_n_s.abs() > most_n_s {
            return Err(Drift::trip(self.rate_n_s, most_n_s).with(Drift::needs_limit(
                self.rate_n_s,
                limit_n,
                most_n_s,
            )));
        }
        Ok(())
    }

    /// Returns the trip by a rate of the zero, with the largest one that would have passed, N/s.
    pub fn trip(rate_n_s: f64, most_n_s: f64) -> Trip {
        Trip::new(SafetyRule::Drifts, rate_n_s, most_n_s, "N/s")
    }

    /// Returns the sentence about the least force limit that this rate needs, if with this limit the largest one is `most_n_s`.
    pub fn needs_limit(rate_n_s: f64, limit_n: f64, most_n_s: f64) -> String {
        let least_n = (limit_n * (rate_n_s / most_n_s).abs() / LIMIT_GRAIN_N).ceil() * LIMIT_GRAIN_N;
        format!("it needs a `limits.force_n` of at least {least_n:.2} N, which the specimen has to bear")
    }

    /// Largest rate of the zero besides the one that is corrected, N/s.
    pub(crate) fn unknown_n_s(&self) -> f64 {
        self.hidden_n_s.abs() + 3.0 * self.sigma_n_s
    }

    /// The same during a descent, where a larger one may be a touch.
    pub(crate) fn unknown_on_descent_n_s(&self) -> f64 {
        self.unknown_n_s().min(HIDDEN_MOST_N_S)
    }

    /// Standard deviation of a force by the rate at the end of a press, N; 0 if forces aren't corrected.
    pub(crate) fn sigma_n(&self) -> f64 {
        if self.rate_n_s == 0.0 { 0.0 } else { self.sigma_n_s * PRESS_S }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::quantity::{Health, stream};
    use rand::distr::Distribution;
    use rand_distr::StandardNormal;

    fn readings(count: usize, sigma_n: f64, rate_n_s: f64) -> Vec<ForceReading> {
        let mut rng = stream(1, 0, "drift");
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let reading = |at_s: f64, n: f64| ForceReading { at_s, force_n: n, side_n: None, health: Health::default() };
        (0..count)
            .map(|nth| 0.005 * nth as f64)
            .map(|at_s| reading(at_s, 0.25 + rate_n_s * at_s + sigma_n * draw()))
            .collect()
    }

    #[test]
    fn a_fast_drift_is_shown_with_its_error_and_a_slow_one_is_not() {
        let drift = ZeroLine::of(&readings(200, 0.002, 0.013)).drift();
        assert!((drift.rate_n_s - 0.013).abs() < 3.0 * drift.sigma_n_s, "{drift:?}");
        assert!((drift.sigma_n_s - 0.0005).abs() < 0.0001, "{drift:?}");
        assert_eq!(ZeroLine::of(&readings(200, 0.002, 0.001)).drift().rate_n_s, 0.0, "both airs correct it");
        assert_eq!(ZeroLine::of(&readings(200, 0.05, 0.013)).drift().rate_n_s, 0.0, "noise hides it");
        let is_vague = |count: usize, sigma_n, rate_n_s| ZeroLine::of(&readings(count, sigma_n, rate_n_s)).is_vague();
        assert!(is_vague(100, 0.002, 0.013) && !is_vague(2000, 0.002, 0.013), "it lasts");
        assert!(is_vague(200, 0.05, 0.0), "it may drift by a touch in a press");
        assert!(!is_vague(200, 0.002, 0.0));
        let short = ZeroLine::of(&readings(200, 0.002, 0.013)).lasting();
        assert_eq!((short.rate_n_s, short.hidden_n_s > 0.01), (0.0, true), "{short:?}");
    }

    #[test]
    fn air_that_is_read_later_shows_what_noise_has_hidden() {
        let mut line = ZeroLine::of(&readings(200, 0.05, 0.013));
        for nth in 1..=4 {
            let at_s = 12.0 * f64::from(nth);
            line = line.read(at_s, 0.25 + 0.013 * at_s + if nth % 2 == 0 { 0.008 } else { -0.008 }, 0.01);
        }
        assert_eq!(line.read(20.0, 0.25, 0.01), line, "older air");
        let drift = line.drift();
        assert!((drift.rate_n_s - 0.013).abs() < 0.002 && drift.sigma_n_s < 0.002, "{drift:?}");
    }

    #[test]
    fn a_wave_and_a_jump_are_no_drift() {
        let mut line = ZeroLine::of(&readings(200, 0.002, 0.0));
        for nth in 1..60 {
            let at_s = 7.0 * f64::from(nth);
            line = line.read(at_s, 0.25 + 0.005 * (std::f64::consts::TAU * at_s / 25.0).sin(), 0.0005);
            assert_eq!(line.drift().rate_n_s, 0.0, "{nth}: {line:?}");
        }
    }
}
