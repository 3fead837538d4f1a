//! Mains interference in the load cell's readings: found without load, and removed by means over complete periods.

use palpate_core::quantity::ForceReading;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Possible frequencies of the mains, Hz.
const MAINS_HZ: [f64; 2] = [50.0, 60.0];

/// Largest probability that noise alone shows an amplitude that counts as mains interference.
const FALSE_ODDS: f64 = 1e-6;

/// Least ratio of the mains interference to the noise of one reading. A smaller mains interference doesn't change a mean of several
/// readings, so it isn't removed.
const SHARE_LEAST: f64 = 0.15;

/// Possible error of the mains frequency, as a fraction of the frequency. A mean over complete periods leaves this fraction of
/// the mains interference.
const MAINS_OFF_SHARE: f64 = 0.01;

/// Number of conversions in a period from which a mean over one period removes the mains interference, even if a period isn't a whole
/// number of conversions.
const DENSE: f64 = 8.0;

/// Longest time, periods, over which conversions and periods must coincide if a period has fewer conversions. The second constant
/// is the tolerance of the coincidence, in conversions.
const PERIODS_MAX: u32 = 10;
const EVEN: f64 = 0.1;

/// Mains interference in the load cell's readings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MainsInterference {
    /// Amplitude of the mains interference, N.
    pub amplitude_n: f64,
    /// Frequency of the mains interference, Hz: that of the mains.
    pub hz: f64,
    /// Time, s, over which a mean removes the mains interference; multiples of this time remove the mains interference too. `None` if the
    /// cell converts too slowly for that.
    pub whole_s: Option<f64>,
}

impl MainsInterference {
    /// Finds the mains interference in some readings without load, if there is any. Conversions are `conversion_s` apart.
    pub fn find(readings: &[ForceReading], conversion_s: f64) -> Option<MainsInterference> {
        let levelled = levelled(readings);
        let n = levelled.len() as f64;
        let variance = levelled.iter().map(|(_, force_n)| force_n * force_n).sum::<f64>() / n;
        // conversions that are a whole number of periods apart all see the mains interference at the same moment of its turn
        let shows = |hz: &f64| ((hz * conversion_s).round() - hz * conversion_s).abs() > 0.02;
        let found = MAINS_HZ.into_iter().filter(shows).map(|hz| (amplitude(&levelled, hz), hz));
        let (amplitude_n, hz) = found.max_by(|a, b| a.0.total_cmp(&b.0))?;
        // with noise alone n A^2 / (4 sigma^2) is exponential with mean 1
        let noise = (variance - amplitude_n * amplitude_n / 2.0).max(0.0);
        let by_chance_n = (-4.0 * noise * FALSE_ODDS.ln() / n).sqrt();
        let counts = amplitude_n > by_chance_n.max(SHARE_LEAST * noise.sqrt()) && n >= 20.0;
        counts.then(|| MainsInterference { amplitude_n, hz, whole_s: whole_s(hz, conversion_s) })
    }

    /// Returns the part of the mains interference that remains in a mean over `seconds`, standard deviation, N. For complete periods, this
    /// part comes from the error of the mains frequency.
    pub fn left_n(&self, seconds: f64) -> f64 {
        let left = match self.whole_s {
            Some(_) => MAINS_OFF_SHARE,
            None => (1.0 / (std::f64::consts::PI * self.hz * seconds)).min(1.0),
        };
        self.amplitude_n * left / 2f64.sqrt()
    }

    /// Duration of a mean that takes at least `least_s`, s.
    pub fn whole_s(&self, least_s: f64) -> f64 {
        self.whole_s.map_or(least_s, |whole_s| whole_s * (least_s / whole_s - 1e-9).ceil().max(1.0))
    }
}

/// Shortest time over which a mean removes the mains interference completely, s.
fn whole_s(hz: f64, conversion_s: f64) -> Option<f64> {
    let a_period = 1.0 / (hz * conversion_s);
    if a_period >= DENSE {
        return Some(1.0 / hz);
    }
    let is_even = |periods: &u32| {
        let conversions = f64::from(*periods) * a_period;
        (conversions - conversions.round()).abs() < EVEN && conversions.round() >= 2.0
    };
    (1..=PERIODS_MAX).find(is_even).map(|periods| f64::from(periods) / hz)
}

/// Times and forces minus the straight line through them, s and N.
fn levelled(readings: &[ForceReading]) -> Vec<(f64, f64)> {
    let n = readings.len().max(1) as f64;
    let mean = |of: fn(&ForceReading) -> f64| readings.iter().map(of).sum::<f64>() / n;
    let (mid_s, mean_n) = (mean(|reading| reading.at_s), mean(|reading| reading.force_n));
    let sum = |of: &dyn Fn(&ForceReading) -> f64| readings.iter().map(of).sum::<f64>();
    let spread = sum(&|reading| (reading.at_s - mid_s).powi(2));
    let slope = if spread > 0.0 { sum(&|r| (r.at_s - mid_s) * (r.force_n - mean_n)) / spread } else { 0.0 };
    readings.iter().map(|r| (r.at_s - mid_s, r.force_n - mean_n - slope * (r.at_s - mid_s))).collect()
}

/// Amplitude of the readings at a frequency, N.
fn amplitude(levelled: &[(f64, f64)], hz: f64) -> f64 {
    let sum = |turn: fn(f64) -> f64| levelled.iter().map(|(at_s, n)| n * turn(TAU * hz * at_s)).sum::<f64>();
    2.0 * sum(f64::cos).hypot(sum(f64::sin)) / levelled.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::quantity::{Health, stream};
    use rand::distr::Distribution;
    use rand_distr::StandardNormal;

    /// Half a second of readings with 3 mN of noise, a drift, and mains interference.
    fn readings(conversions_hz: f64, hum_n: f64, hum_hz: f64, seed: u64) -> Vec<ForceReading> {
        let mut rng = stream(seed, 0, "hum");
        let reading = |i: usize| {
            let at_s = i as f64 / conversions_hz;
            let noise: f64 = StandardNormal.sample(&mut rng);
            let force_n = 0.2 + 0.001 * at_s + hum_n * (TAU * hum_hz * at_s + 0.7).sin() + 0.003 * noise;
            ForceReading { at_s, force_n, side_n: None, health: Health::default() }
        };
        (0..(conversions_hz / 2.0) as usize).map(reading).collect()
    }

    #[test]
    fn mains_is_found_with_its_frequency_and_noise_is_not() {
        for (conversions_hz, hum_hz, mains_hz) in [(1000.0, 49.8, 50.0), (1000.0, 60.1, 60.0), (240.0, 50.2, 50.0)] {
            let mains =
                MainsInterference::find(&readings(conversions_hz, 0.01, hum_hz, 1), 1.0 / conversions_hz).unwrap();
            assert_eq!(mains.hz, mains_hz);
            assert!((mains.amplitude_n - 0.01).abs() < 0.001, "{mains:?}");
        }
        let false_alarms =
            (0..2000).filter(|&seed| MainsInterference::find(&readings(1000.0, 0.0, 50.0, seed), 0.001).is_some());
        assert_eq!(false_alarms.count(), 0);
    }

    #[test]
    fn mean_over_whole_periods_is_free_of_mains() {
        for conversions_hz in [1000.0, 600.0, 240.0, 200.0, 120.0, 80.0] {
            let whole_s = whole_s(50.0, 1.0 / conversions_hz).unwrap();
            let count = (whole_s * conversions_hz).round() as usize;
            let sum: f64 = (0..count).map(|i| (TAU * 50.0 * i as f64 / conversions_hz + 0.3).sin()).sum();
            assert!((sum / count as f64).abs() < 0.05, "{conversions_hz} Hz, {count}: {}", sum / count as f64);
        }
        assert_eq!(whole_s(50.0, 0.02), Some(0.04), "it can't be seen there, and find says so");
        assert_eq!(MainsInterference::find(&readings(50.0, 0.01, 50.0, 1), 0.02), None);
    }

    #[test]
    fn times_are_rounded_up_to_whole_periods() {
        let mains = MainsInterference { amplitude_n: 0.01, hz: 50.0, whole_s: Some(0.02) };
        let whole = [0.001, 0.02, 0.021, 0.1].map(|least_s| mains.whole_s(least_s));
        assert!(whole.iter().zip([0.02, 0.02, 0.04, 0.1]).all(|(a, b)| (a - b).abs() < 1e-12), "{whole:?}");
        assert_eq!(MainsInterference { whole_s: None, ..mains }.whole_s(0.03), 0.03);
    }
}
