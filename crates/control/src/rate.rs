//! Rate of a load cell, by its noise without load.

use palpate_core::quantity::ForceReading;

/// Largest step between two readings, in sd, with which a repeated reading is no new one: of independent readings with this step at most a
/// fifth equals the one before.
const STEP_MOST: f64 = 0.7;

/// Fraction of new readings below which a cell is read more than twice for each conversion.
const NEW_LEAST: f64 = 0.5;

/// Returns the number of new readings per second of a load cell that is read more than twice for each conversion; `None` if it isn't, or if
/// its steps hide it.
pub fn slower_rate_hz(readings: &[ForceReading]) -> Option<f64> {
    let (first, last) = (readings.first()?, readings.last()?);
    let pairs = readings.windows(2).len() as f64;
    let new = readings.windows(2).filter(|pair| pair[0].force_n != pair[1].force_n).count() as f64;
    let mean_n = readings.iter().map(|reading| reading.force_n).sum::<f64>() / (pairs + 1.0);
    let variance = readings.iter().map(|reading| (reading.force_n - mean_n).powi(2)).sum::<f64>() / pairs;
    let mut codes: Vec<f64> = readings.iter().map(|reading| reading.force_n).collect();
    codes.sort_by(f64::total_cmp);
    let steps = codes.windows(2).map(|pair| pair[1] - pair[0]).filter(|step_n| *step_n > 0.0);
    let step_n = steps.fold(f64::INFINITY, f64::min);
    let is_shown = step_n <= STEP_MOST * variance.sqrt(); // written as the positive condition, so NaN fails
    let rate_hz = new / (last.at_s - first.at_s);
    (is_shown && new < NEW_LEAST * pairs && rate_hz.is_finite()).then_some(rate_hz)
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::quantity::{Health, stream};
    use rand::RngExt;
    use std::f64::consts::PI;

    /// Readings of a cell that is read at `hz` and converts at `real_hz`, with steps in sd.
    fn readings(hz: f64, real_hz: f64, step: f64) -> Vec<ForceReading> {
        let mut rng = stream(1, 0, "rate of a load cell");
        // the sum of twelve uniform numbers has an sd of 1
        let mut noise: Vec<f64> = Vec::new();
        (0..200)
            .map(|nth| {
                let at_s = f64::from(nth) / hz;
                while noise.len() <= (at_s * real_hz) as usize {
                    let drawn = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                    noise.push(if step > 0.0 { (drawn / step).round() * step } else { drawn });
                }
                let force_n = 0.003 * noise[(at_s * real_hz) as usize];
                ForceReading { at_s, force_n, side_n: None, health: Health::default() }
            })
            .collect()
    }

    #[test]
    fn a_cell_that_converts_more_slowly_than_it_is_read_shows_its_rate() {
        for (hz, real_hz) in [(80.0, 10.0), (200.0, 80.0), (50.0, 12.5)] {
            let rate_hz = slower_rate_hz(&readings(hz, real_hz, 0.0)).expect("it is slower");
            assert!((rate_hz / real_hz - 1.0).abs() < 0.05, "{rate_hz} of {real_hz}");
        }
    }

    #[test]
    fn a_sound_cell_and_one_with_coarse_steps_are_not_called_slower() {
        assert_eq!(slower_rate_hz(&readings(80.0, 80.0, 0.0)), None);
        assert_eq!(slower_rate_hz(&readings(80.0, 60.0, 0.0)), None);
        for step in [0.2, 0.5, 1.0, 2.0, 8.0] {
            assert_eq!(slower_rate_hz(&readings(80.0, 80.0, step)), None, "{step} sd");
        }
        // the density at no difference of two normal numbers, times the step
        assert!(STEP_MOST / (2.0 * PI.sqrt()) < 0.2);
        assert_eq!(slower_rate_hz(&[]), None);
    }
}
