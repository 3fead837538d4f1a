//! Rate of a load cell, by its noise without load.

use super::mains::MainsInterference;
use super::zero::agreeing;
use palpate_core::quantity::ForceReading;

/// Largest step between two readings, in sd, with which a repeated reading is no new one: of independent readings with this step at most a
/// fifth equals the one before.
const STEP_MOST: f64 = 0.7;

/// Fraction of new readings below which a cell is read more than twice for each conversion.
const NEW_LEAST: f64 = 0.5;

/// Largest odds that the changes of independent readings keep such distances by chance.
const CHANCE_MOST: f64 = 1e-6;

/// Width of the window of distances, in readings: a distance, and one more and less.
const WINDOW: f64 = 3.0;

/// Slowest load cell that is accepted, with a factor of two for an estimate from few changes, conversions/s. Rarer changes are a drift.
const SLOWEST_HZ: f64 = 5.0 / 2.0;

/// Number of changes, each one step in the same direction, that show a ramp without noise, such as a drift: of independent readings so many are
/// one case in 5000. And the largest of them, in the smallest: a reading is rounded.
const RAMP_LEAST: f64 = 6.0;
const RAMP_STEP_MOST: f64 = 1.5;

/// Number of readings, and their time, after which coarse steps hide the rate, s: a cell of 5 Hz changes some fifty times in it.
const LOOKS_MOST: usize = 4000;
const LOOK_MOST_S: f64 = 30.0;

/// What readings without load show of a load cell's rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShownRate {
    /// It isn't read more than twice for each conversion, or its steps hide that.
    AsRead,
    /// It makes this number of new readings per second, and is read more than twice for each.
    Slower(f64),
    /// Its readings change too rarely, and more of them show why.
    Unclear,
}

impl ShownRate {
    /// Returns what some readings show that are taken `conversion_s` apart.
    pub fn of(readings: &[ForceReading], conversion_s: f64) -> ShownRate {
        let (Some(first), Some(last)) = (readings.first(), readings.last()) else { return ShownRate::AsRead };
        let pairs = readings.windows(2).len() as f64;
        let is_new = |pair: &[ForceReading]| pair[0].force_n != pair[1].force_n;
        let new = readings.windows(2).filter(|pair| is_new(pair)).count() as f64;
        let took_s = last.at_s - first.at_s;
        let (step, differ) = steps_of(readings);
        let climbs = climbs(readings);
        if !climbs && step <= STEP_MOST && new < NEW_LEAST * pairs && (new / took_s).is_finite() {
            return ShownRate::Slower(new / took_s);
        }
        // independent readings differ from the one before as often as from any other
        let rate_hz = new / (differ * took_s);
        let is_rare = new < NEW_LEAST * differ * pairs && rate_hz >= SLOWEST_HZ;
        // a hum of few steps changes them in a pattern too
        if !is_rare || MainsInterference::find(readings, conversion_s).is_some() {
            return ShownRate::AsRead;
        }
        if !climbs && is_held(readings) {
            return ShownRate::Slower(rate_hz);
        }
        // the steps of a ramp show how fast it is, not how often it is read
        let is_ramp = climbs && new >= RAMP_LEAST;
        let is_enough = is_ramp || readings.len() >= LOOKS_MOST || took_s >= LOOK_MOST_S;
        if is_enough { ShownRate::AsRead } else { ShownRate::Unclear }
    }
}

/// Returns the smallest step between two readings, in sd, and the fraction of two readings that differ.
fn steps_of(readings: &[ForceReading]) -> (f64, f64) {
    let n = readings.len() as f64;
    let mean_n = readings.iter().map(|reading| reading.force_n).sum::<f64>() / n;
    let variance = readings.iter().map(|reading| (reading.force_n - mean_n).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    let mut codes: Vec<f64> = readings.iter().map(|reading| reading.force_n).collect();
    codes.sort_by(f64::total_cmp);
    let steps = codes.windows(2).map(|pair| pair[1] - pair[0]).filter(|step_n| *step_n > 0.0);
    let step_n = steps.fold(f64::INFINITY, f64::min);
    (step_n / variance.sqrt(), 1.0 - agreeing(&codes))
}

/// Whether each change is one step, all in the same direction. A slow cell with noise goes both ways, and one that drifts by more than a step in
/// its time makes steps of different sizes.
fn climbs(readings: &[ForceReading]) -> bool {
    let changes: Vec<f64> =
        readings.windows(2).map(|pair| pair[1].force_n - pair[0].force_n).filter(|change_n| *change_n != 0.0).collect();
    let least_n = changes.iter().fold(f64::INFINITY, |least_n, change_n| least_n.min(change_n.abs()));
    let is_up = changes.first().is_some_and(|change_n| *change_n > 0.0);
    changes.iter().all(|change_n| (*change_n > 0.0) == is_up && change_n.abs() < RAMP_STEP_MOST * least_n)
}

/// Whether changes keep a distance of one conversion from each other, which a cell does that holds each conversion until the next one. Changes of
/// independent or filtered readings are the rarer the larger their distance is, so of all distances up to this one, no more than the window's
/// part is in a window at the end.
fn is_held(readings: &[ForceReading]) -> bool {
    let changes: Vec<usize> =
        (1..readings.len()).filter(|&nth| readings[nth].force_n != readings[nth - 1].force_n).collect();
    let mut gaps: Vec<usize> = changes.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_unstable();
    let by_chance = |gap: usize| {
        // a link isn't even, so a conversion is read once more or less
        let up_to = |most: usize| gaps.partition_point(|gap| *gap <= most) as f64;
        let (all, shorter) = (up_to(gap + 1), up_to(gap.saturating_sub(2)));
        let (share, odds) = ((all - shorter) / all, WINDOW / (gap as f64 + 1.0));
        if share > odds { tail(share, odds).powf(all) } else { 1.0 }
    };
    // as many distances are tried as there are
    let gaps_from_three = gaps.iter().copied().filter(|gap| *gap as f64 >= WINDOW);
    gaps_from_three.map(by_chance).fold(1.0, f64::min) * (gaps.len() as f64) < CHANCE_MOST
}

/// Returns a bound of the odds, to the power of one trial, that such a share of trials with these odds succeeds (Chernoff).
fn tail(share: f64, odds: f64) -> f64 {
    let part = |of: f64, among: f64| if of > 0.0 { (among / of).powf(of) } else { 1.0 };
    part(share, odds) * part(1.0 - share, 1.0 - odds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::quantity::{Health, stream};
    use rand::RngExt;
    use std::f64::consts::{PI, TAU};

    /// Readings of a cell that is read at `hz` and converts at `real_hz`, with steps in sd. Each conversion shares a part of its noise with the
    /// one before.
    fn filtered(hz: f64, real_hz: f64, step: f64, shared: f64, count: u32) -> Vec<ForceReading> {
        let mut rng = stream(1, 0, "rate of a load cell");
        // the sum of twelve uniform numbers has an sd of 1
        let (mut noise, mut before): (Vec<f64>, f64) = (Vec::new(), 0.0);
        (0..count)
            .map(|nth| {
                let at_s = f64::from(nth) / hz;
                while noise.len() <= (at_s * real_hz + 1e-6) as usize {
                    let drawn = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                    before = shared * before + (1.0 - shared * shared).sqrt() * drawn;
                    noise.push(if step > 0.0 { (before / step).round() * step } else { before });
                }
                let force_n = 0.003 * noise[(at_s * real_hz + 1e-6) as usize];
                ForceReading { at_s, force_n, side_n: None, health: Health::default() }
            })
            .collect()
    }

    fn readings(hz: f64, real_hz: f64, step: f64, count: u32) -> Vec<ForceReading> {
        filtered(hz, real_hz, step, 0.0, count)
    }

    fn slower_hz(readings: &[ForceReading], hz: f64) -> Option<f64> {
        match ShownRate::of(readings, 1.0 / hz) {
            ShownRate::Slower(rate_hz) => Some(rate_hz),
            ShownRate::AsRead | ShownRate::Unclear => None,
        }
    }

    #[test]
    fn a_cell_that_converts_more_slowly_than_it_is_read_shows_its_rate() {
        for (hz, real_hz) in [(80.0, 10.0), (200.0, 80.0), (50.0, 12.5)] {
            let rate_hz = slower_hz(&readings(hz, real_hz, 0.0, 200), hz).expect("it is slower");
            assert!((rate_hz / real_hz - 1.0).abs() < 0.05, "{rate_hz} of {real_hz}");
        }
    }

    #[test]
    fn coarse_steps_need_more_readings_to_show_the_rate() {
        for step in [1.0, 1.5, 2.0, 3.0] {
            assert_eq!(ShownRate::of(&readings(80.0, 10.0, step, 60), 1.0 / 80.0), ShownRate::Unclear, "{step} sd");
            let rate_hz = slower_hz(&readings(80.0, 10.0, step, 2000), 80.0).expect("it is slower");
            assert!((rate_hz / 10.0 - 1.0).abs() < 0.2, "{rate_hz} of 10, {step} sd");
        }
    }

    #[test]
    fn a_sound_cell_and_one_with_coarse_steps_are_not_called_slower() {
        for count in [100, 200, 2000] {
            for real_hz in [60.0, 80.0] {
                assert_eq!(slower_hz(&readings(80.0, real_hz, 0.0, count), 80.0), None);
            }
            for step in [0.2, 0.5, 1.0, 2.0, 8.0] {
                for shared in [0.0, 0.5, 0.8] {
                    let shown = slower_hz(&filtered(80.0, 80.0, step, shared, count), 80.0);
                    assert_eq!(shown, None, "{step} sd, {shared} shared, {count} readings");
                }
            }
        }
        // the density at no difference of two normal numbers, times the step
        assert!(STEP_MOST / (2.0 * PI.sqrt()) < 0.2);
        assert_eq!(ShownRate::of(&[], 0.01), ShownRate::AsRead);
    }

    #[test]
    fn a_hum_or_a_drift_of_few_steps_is_no_slow_cell() {
        let of = |force: &dyn Fn(f64) -> f64| {
            let reading = |nth: u32| {
                let at_s = f64::from(nth) / 1000.0;
                let force_n = 0.001 * (force(at_s) / 0.001).round();
                ForceReading { at_s, force_n, side_n: None, health: Health::default() }
            };
            let readings: Vec<ForceReading> = (0..1000).map(reading).collect();
            ShownRate::of(&readings, 0.001)
        };
        assert_eq!(of(&|at_s| 0.0015 * (TAU * 50.0 * at_s).sin()), ShownRate::AsRead);
        assert_eq!(of(&|at_s| 0.0005 * at_s), ShownRate::AsRead);
    }

    #[test]
    fn a_ramp_without_noise_is_no_slow_cell() {
        let of = |hz: f64, held_hz: f64, n_s: f64, seconds: f64| {
            let reading = |nth: u32| {
                let at_s = f64::from(nth) / hz;
                let converted_s = (at_s * held_hz + 1e-6).floor() / held_hz;
                let force_n = 0.001 * (n_s * converted_s / 0.001).round();
                ForceReading { at_s, force_n, side_n: None, health: Health::default() }
            };
            let readings: Vec<ForceReading> = (0..(seconds * hz) as u32).map(reading).collect();
            ShownRate::of(&readings, 1.0 / hz)
        };
        for n_s in [0.001, -0.004, 0.0067, 0.013, -0.020] {
            for hz in [80.0, 200.0, 1000.0] {
                let short = of(hz, hz, n_s, 0.5);
                assert!(matches!(short, ShownRate::AsRead | ShownRate::Unclear), "{n_s} N/s at {hz} Hz: {short:?}");
                assert_eq!(of(hz, hz, n_s, 9.0), ShownRate::AsRead, "{n_s} N/s at {hz} Hz");
            }
        }
        // 1.3 steps in each conversion
        assert!(matches!(of(80.0, 10.0, 0.013, 9.0), ShownRate::Slower(_)));
    }
}
