//! Zero of the load cell without load, and its noise.

use super::drift::{Drift, ZeroLine};
use super::mains::MainsInterference;
use super::press::NoLoadReadings;
use super::side::SideZero;
use palpate_core::quantity::ForceReading;

/// Probability of a false alarm, per run of readings, at which repeated equal codes count as frozen.
const FROZEN_ODDS: f64 = 1e-9;

/// Fraction of repeated codes without load above which repetition doesn't indicate freezing, because the step is larger than the noise.
const REPEATS_TOO_OFTEN: f64 = 0.5;

/// Least number of repetitions that counts: with 100 independent codes that differ every second time, less is five sd.
const REPEATS_LEAST: f64 = 2.0;

/// Least correlation of neighbouring readings that counts, in sd of a chance correlation. The second constant is the largest
/// correlation.
const SHARED_SIGMAS: f64 = 3.0;
pub(crate) const SHARED_MOST: f64 = 0.95;

/// Largest ratio of the noise without load before a press to the noise at zeroing. The second constant is an additional allowance, N.
const NOISE_FACTOR: f64 = 3.0;
const NOISE_LEAST_N: f64 = 0.001;

/// Least force that counts as contact, N.
pub(crate) const DETECT_LEAST_N: f64 = 0.030;

/// Noise of equal readings by the rounding of numbers, N. And the step that a cell may have that didn't show one, N: a sixth of the least force
/// that counts as contact.
const NO_NOISE_N: f64 = 1e-9;
const UNKNOWN_STEP_N: f64 = 0.005;

/// Least force of a single reading that counts as contact, in sd of the noise.
pub(crate) const DETECT_SIGMAS: f64 = 8.0;

/// Longest time between two good readings while the indenter may touch, and largest age of one on which a motion may depend, s. Between the
/// reading and the motion, an ESP301 takes up to 80 ms for the read-back.
pub const STALE_S: f64 = 0.25;

/// The same in times between two readings of a slow cell or link, measured without load: a motion depends on two readings, and the next one
/// is awaited. And the largest that is accepted, s.
const STALE_GAPS: f64 = 3.0;
const STALE_MOST_S: f64 = 1.0;

/// Load cell reading without load; forces are relative to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Zero {
    /// Reading at zero force, N.
    pub offset_n: f64,
    /// Time of this reading by the readings' clock, s.
    pub at_s: f64,
    /// Drift of the offset from then on.
    pub drift: Drift,
    /// Standard deviation of one reading, N, mains interference included.
    pub sigma_n: f64,
    /// Standard deviation of one reading without the part that a mean over complete periods removes, N.
    pub noise_n: f64,
    /// Fraction of one reading's noise that the next reading contains too, 0 to 1. After a filter, neighbouring readings are
    /// alike.
    pub shared: f64,
    /// Largest time between two readings, s.
    pub gap_s: f64,
    /// Smallest step between two readings, N; 0 if no two readings were the same.
    pub step_n: f64,
    /// Standard deviation of the offset itself, N.
    pub offset_sigma_n: f64,
    /// Mains interference in the readings; `None` if no mains interference is visible.
    pub mains: Option<MainsInterference>,
    /// Number of equal readings in a row that means a frozen cell; `None` if a healthy cell repeats its readings too.
    pub frozen_after: Option<u32>,
    /// Zero of the forces sideways; `None` for a cell with one axis.
    pub side: Option<SideZero>,
}

impl Zero {
    /// Returns a zero with offset 0, of a cell with this noise and without mains interference.
    pub const fn with_noise(sigma_n: f64) -> Zero {
        Zero {
            offset_n: 0.0,
            at_s: 0.0,
            drift: Drift { rate_n_s: 0.0, sigma_n_s: 0.0, hidden_n_s: 0.0 },
            sigma_n,
            noise_n: sigma_n,
            shared: 0.0,
            gap_s: 0.0,
            step_n: 0.0,
            offset_sigma_n: 0.0,
            mains: None,
            frozen_after: None,
            side: None,
        }
    }

    /// Returns the zero of at least two readings without load that are `conversion_s` apart. The caller must reject readings that
    /// aren't finite.
    pub fn of(readings: &[ForceReading], conversion_s: f64) -> Zero {
        let n = readings.len().max(2) as f64;
        let mean = readings.iter().map(|r| r.force_n).sum::<f64>() / n;
        let at_s = readings.iter().map(|r| r.at_s).sum::<f64>() / n;
        let drift = ZeroLine::of(readings).drift();
        let off = |r: &ForceReading| r.force_n - mean - drift.rate_n_s * (r.at_s - at_s);
        let variance = readings.iter().map(|r| off(r).powi(2)).sum::<f64>() / (n - 1.0);
        let mains = MainsInterference::find(readings, conversion_s);
        let averaged =
            mains.filter(|mains| mains.whole_s.is_some()).map_or(0.0, |mains| mains.amplitude_n.powi(2) / 2.0);
        let noise_n = (variance - averaged).max(0.0).sqrt();
        let mut codes: Vec<f64> = readings.iter().map(|r| r.force_n).collect();
        codes.sort_by(f64::total_cmp);
        Zero {
            offset_n: mean,
            at_s,
            drift,
            sigma_n: variance.sqrt(),
            noise_n,
            // mains interference is shared too, but averaged differently
            shared: if mains.is_some() { 0.0 } else { shared(&readings.iter().map(off).collect::<Vec<_>>()) },
            gap_s: readings.windows(2).map(|pair| pair[1].at_s - pair[0].at_s).fold(0.0, f64::max),
            step_n: step_n(&codes),
            offset_sigma_n: noise_n / n.sqrt(),
            mains,
            frozen_after: frozen_after(&codes).map(|count| count.saturating_mul(repeats(readings, &codes))),
            side: SideZero::of(readings),
        }
    }

    /// Returns the zero of the same cell relative to newer air.
    #[must_use]
    pub(crate) fn counted_from(&self, no_load: &NoLoadReadings) -> Zero {
        let moved = |side: SideZero| SideZero { offset_n: no_load.side_mean_n.unwrap_or(side.offset_n), ..side };
        let offset_sigma_n = self.sigma_own_n(no_load.readings).hypot(self.drift.sigma_n());
        Zero { offset_n: no_load.mean_n, at_s: no_load.at_s, offset_sigma_n, side: self.side.map(moved), ..*self }
    }

    /// Reading at zero force at a time, N.
    pub fn at_n(&self, at_s: f64) -> f64 {
        self.offset_n + self.drift.rate_n_s * (at_s - self.at_s)
    }

    /// Force of a reading, N from the zero.
    pub fn from_zero_n(&self, reading: &ForceReading) -> f64 {
        reading.force_n - self.at_n(reading.at_s)
    }

    /// Largest difference of two means by the cell's steps, N: with less noise than a step, a mean is rounded like a reading. A cell that repeated
    /// one reading hasn't shown its step.
    pub fn rounding_n(&self) -> f64 {
        match (self.sigma_n < NO_NOISE_N, self.sigma_n < self.step_n) {
            (true, _) => self.step_n.max(UNKNOWN_STEP_N),
            (false, true) => self.step_n,
            (false, false) => 0.0,
        }
    }

    /// Time after which a reading is old, s.
    pub fn stale_s(&self) -> f64 {
        STALE_S.max(STALE_GAPS * self.gap_s).min(STALE_MOST_S)
    }

    /// Standard deviation of the mean of some readings by their own noise, N, with the readings treated as independent.
    pub fn sigma_own_n(&self, readings: u32) -> f64 {
        self.noise_n / f64::from(readings.max(1)).sqrt()
    }

    /// Standard deviation of the mean of some readings as a force, N: the noise of the readings and that of the zero.
    pub fn sigma_mean_n(&self, readings: u32) -> f64 {
        self.sigma_own_n(readings).hypot(self.offset_sigma_n)
    }

    /// Standard deviation of the mean of some readings by their own noise, N. Neighbouring readings with common noise count as
    /// fewer readings.
    pub(crate) fn noise_of_mean_n(&self, readings: u32) -> f64 {
        self.noise_n * (counts_for(self.shared) / f64::from(readings.max(1))).min(1.0).sqrt()
    }

    /// Duration of a mean that must take at least `least_s`, s: complete periods of the mains interference, if there is any.
    pub fn mean_s(&self, least_s: f64) -> f64 {
        self.mains.map_or(least_s, |mains| mains.whole_s(least_s))
    }

    /// Largest acceptable noise without load, N. Above this value the noise has grown.
    pub fn noise_most_n(&self) -> f64 {
        NOISE_FACTOR * self.sigma_n + NOISE_LEAST_N
    }

    /// Force above which one reading means contact, N.
    pub fn detect_n(&self) -> f64 {
        DETECT_LEAST_N.max(DETECT_SIGMAS * self.sigma_n)
    }
}

/// Correlation of deviations with the next ones, 0 to [`SHARED_MOST`]. It is 0 unless it exceeds chance.
fn shared(off: &[f64]) -> f64 {
    let (correlation, by_chance) = (correlation(off), SHARED_SIGMAS / (off.len().max(1) as f64).sqrt());
    if correlation > by_chance { correlation.min(SHARED_MOST) } else { 0.0 }
}

/// Correlation of deviations from their mean, or from a line, with the next ones; 0 if there are none.
pub(crate) fn correlation(off: &[f64]) -> f64 {
    let following: f64 = off.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let squares: f64 = off.iter().map(|off| off.powi(2)).sum();
    if squares > 0.0 { following / squares } else { 0.0 }
}

/// Number of readings with this correlation that count as one.
pub(crate) fn counts_for(correlation: f64) -> f64 {
    (1.0 + correlation) / (1.0 - correlation)
}

/// Smallest step between two readings, if some readings are equal, N. `codes` are sorted.
fn step_n(codes: &[f64]) -> f64 {
    let steps = codes.windows(2).map(|pair| pair[1] - pair[0]);
    if steps.clone().all(|step| step > 0.0) {
        return 0.0;
    }
    let least = steps.filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 0.0 }
}

/// Number of equal codes in a row that is less likely than [`FROZEN_ODDS`]. It depends on how often two codes without load agree. It is
/// doubled, because a reading can be read twice between two conversions. `codes` are sorted.
pub(crate) fn frozen_after(codes: &[f64]) -> Option<u32> {
    let agree = agreeing(codes);
    if !(agree > 0.0 && agree < REPEATS_TOO_OFTEN) {
        return None;
    }
    Some(2 * (FROZEN_ODDS.ln() / agree.ln()).ceil() as u32)
}

/// Returns how often two of some codes, drawn independently, are the same. `codes` are sorted.
pub(crate) fn agreeing(codes: &[f64]) -> f64 {
    let n = codes.len() as f64;
    codes.chunk_by(|a, b| a == b).map(|alike| (alike.len() as f64 / n).powi(2)).sum()
}

/// Number of times that a code is read before the next one, beyond the chance that two agree: a filter with coarse steps holds its codes, and so
/// does a cell that is slower than it is read. It is 1 unless codes change less than half as often as independent ones, which chance doesn't do.
/// `codes` are sorted.
fn repeats(readings: &[ForceReading], codes: &[f64]) -> u32 {
    let changes = readings.windows(2).filter(|pair| pair[0].force_n != pair[1].force_n).count() as f64;
    let held = (1.0 - agreeing(codes)) * (codes.len() as f64 - 1.0) / changes.max(1.0);
    if held > REPEATS_LEAST { held.ceil() as u32 } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::quantity::{Health, stream};
    use rand::distr::Distribution;
    use rand_distr::StandardNormal;

    fn readings(sigma_n: f64) -> Vec<ForceReading> {
        let mut rng = stream(1, 0, "test");
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let reading = |n: f64| ForceReading { at_s: 0.0, force_n: n, side_n: None, health: Health::default() };
        (0..100).map(|_| reading(((0.25 + sigma_n * draw()) * 1000.0).round() / 1000.0)).collect()
    }

    #[test]
    fn offset_noise_and_its_error_are_found() {
        let zero = Zero::of(&readings(0.003), 0.001);
        assert!((zero.offset_n - 0.25).abs() < 0.001);
        assert!((zero.sigma_n - 0.003).abs() < 0.0006);
        assert!((zero.sigma_mean_n(4) - zero.noise_n.hypot(zero.noise_n / 5.0) / 2.0).abs() < 1e-9);
        // 3 mN of noise on a 1 mN step: two codes agree once in eleven, nine in a row once in a thousand million
        assert!((18..=22).contains(&zero.frozen_after.unwrap()), "{:?}", zero.frozen_after);
    }

    #[test]
    fn a_zero_that_drifts_is_followed() {
        let drift = Drift { rate_n_s: 0.01, ..Drift::default() };
        let zero = Zero { offset_n: 0.5, at_s: 10.0, drift, ..Zero::with_noise(0.003) };
        assert!((zero.at_n(12.0) - 0.52).abs() < 1e-12);
        let reading = ForceReading { at_s: 12.0, force_n: 1.52, side_n: None, health: Health::default() };
        assert!((zero.from_zero_n(&reading) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn means_of_a_cell_without_noise_differ_by_its_step() {
        let of = |sigma_n, step_n| Zero { step_n, ..Zero::with_noise(sigma_n) }.rounding_n();
        assert_eq!([of(0.003, 0.001), of(0.0004, 0.001), of(1e-18, 0.0)], [0.0, 0.001, 0.005]);
    }

    #[test]
    fn codes_that_are_held_are_no_frozen_cell() {
        let each = readings(0.003);
        let held: Vec<ForceReading> = each.iter().flat_map(|reading| [*reading; 6]).collect();
        let [each, held] = [each, held].map(|readings| Zero::of(&readings, 0.001).frozen_after.unwrap());
        assert!((5 * each..=7 * each).contains(&held), "{held} of {each}");
    }

    #[test]
    fn readings_that_share_their_noise_count_as_fewer() {
        let zero = Zero { shared: 0.5, ..Zero::with_noise(0.003) };
        assert!((zero.noise_of_mean_n(300) - 0.003 * (3.0f64 / 300.0).sqrt()).abs() < 1e-12);
        assert_eq!(zero.noise_of_mean_n(2), 0.003, "never less certain than one reading");
        assert!((Zero::with_noise(0.003).noise_of_mean_n(300) - 0.003 / 300f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_cell_without_noise_is_never_called_frozen() {
        assert_eq!(Zero::of(&readings(0.0), 0.001).frozen_after, None);
    }
}
