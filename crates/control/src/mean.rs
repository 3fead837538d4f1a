//! Mean of readings over time.

use super::zero::Zero;

/// A mean of readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// Value of the mean, in the readings' unit.
    pub value: f64,
    /// Middle of the time that the mean covers, s, by the readings' clock.
    pub middle_s: f64,
    /// Number of readings in the mean.
    pub readings: u32,
}

/// Returns the mean of readings, each with its time, s, oldest first. If the zero has found mains interference and the readings cover at
/// least one period of it, the mean covers the last complete periods. Otherwise all readings have the same weight. `None` if there are no
/// readings.
pub fn mean_of(readings: &[(f64, f64)], zero: &Zero) -> Option<Mean> {
    let (first_s, last_s) = (readings.first()?.0, readings.last()?.0);
    let whole_s = zero.mains.and_then(|mains| mains.whole_s);
    let periods = whole_s.map_or(0.0, |whole_s| ((last_s - first_s) / whole_s + 1e-9).floor());
    match whole_s.filter(|_| periods >= 1.0) {
        Some(whole_s) => Some(over(readings, last_s - periods * whole_s)),
        None => {
            let count = readings.len() as f64;
            let value = readings.iter().map(|(_, value)| value).sum::<f64>() / count;
            Some(Mean { value, middle_s: (first_s + last_s) / 2.0, readings: readings.len() as u32 })
        }
    }
}

/// Returns the mean over time from `from_s` to the last reading, with straight lines between readings.
fn over(readings: &[(f64, f64)], from_s: f64) -> Mean {
    let (mut area, mut parts) = (0.0, 0);
    for pair in readings.windows(2) {
        let [(a_s, a), (b_s, b)] = [pair[0], pair[1]];
        if b_s > from_s && b_s > a_s {
            let begin_s = a_s.max(from_s);
            let begin = a + (b - a) * (begin_s - a_s) / (b_s - a_s);
            area += (b_s - begin_s) * (begin + b) / 2.0;
            parts += 1;
        }
    }
    let last_s = readings.last().map_or(from_s, |last| last.0);
    Mean { value: area / (last_s - from_s), middle_s: (from_s + last_s) / 2.0, readings: parts }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MainsInterference;
    use std::f64::consts::TAU;

    #[test]
    fn mains_is_averaged_out_of_irregular_readings() {
        let mains = MainsInterference { amplitude_n: 0.01, hz: 50.0, whole_s: Some(0.02) };
        let with_mains = Zero { mains: Some(mains), ..Zero::with_noise(0.003) };
        let times = (0..60).map(|i| 0.001 * f64::from(i) + if i % 3 == 0 { 0.0004 } else { 0.0 });
        let readings: Vec<(f64, f64)> = times.map(|t| (t, 1.0 + 0.01 * (TAU * 50.0 * t + 0.4).sin())).collect();
        let mean = mean_of(&readings, &with_mains).unwrap();
        assert!((mean.value - 1.0).abs() < 2e-4, "{mean:?}");
        assert!((mean.middle_s - 0.039).abs() < 1e-9, "two periods of the 59 ms: {mean:?}");
        let plain = mean_of(&readings[..50], &Zero::with_noise(0.003)).unwrap();
        assert!((plain.value - 1.0).abs() > 1e-3 && plain.readings == 50, "{plain:?}");
        let short = mean_of(&readings[..10], &with_mains).unwrap();
        assert_eq!(short.readings, 10, "less than a period is all there is");
        assert_eq!(mean_of(&[], &with_mains), None);
    }
}
