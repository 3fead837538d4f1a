//! Readings of the load cell without load: the zero, its line over time, and the air before and after a press.

use super::Halt;
use super::watched_cell::WatchedLoadCell;
use palpate_control::{NO_LOAD_READINGS, NoLoadReadings, SafetyRule, Trip, Watch, Zero, ZeroLine, mean_of};
use palpate_core::quantity::{ForceReading, Limits};
use palpate_link::device::LoadCell;
use palpate_link::time::Instant;
use std::collections::VecDeque;

/// Time for which readings without load are kept, s, and largest number of kept readings. The zero may have moved since older readings.
const NO_LOAD_S: f64 = 0.3;
const NO_LOAD_MAX: usize = 4096;
/// Least time of the readings without load, s, so that its mean is almost as good as a window's.
const NO_LOAD_LEAST_S: f64 = 0.05;

/// Range of a uniform distribution, in sd.
const UNIFORM: f64 = 3.464_101_615_137_754_6;

/// Newest readings of the cell without load, collected as they arrive.
#[derive(Debug, Default)]
pub(super) struct NoLoadForces {
    /// Whether the current readings are readings without load.
    pub(super) open: bool,
    /// Times of the readings, and the cell's readings, N: the force, and those sideways.
    pub(super) readings: VecDeque<(Instant, f64, Option<[f64; 2]>)>,
}

impl<C: LoadCell> WatchedLoadCell<'_, C> {
    /// Returns the line of the zero by readings without load: through them alone, or through all air so far, whichever knows the rate better.
    pub(super) fn line(&self, readings: &[ForceReading]) -> ZeroLine {
        let alone = ZeroLine::of(readings);
        let together = self.line.map(|line| line.continued(&alone));
        together.filter(|line| line.drift().sigma_n_s < alone.drift().sigma_n_s).unwrap_or(alone)
    }

    /// Makes forces relative to a new zero that was taken from these readings.
    pub(super) fn zero(&mut self, limits: &Limits, zero: Zero, readings: &[ForceReading]) {
        let line = self.line(readings);
        let (before, zero) = (*self.watch.zero(), Zero { drift: line.lasting(), ..zero });
        if self.line.is_some() {
            self.cell.largest.count_from(&before, &zero);
        }
        self.first_zero.get_or_insert((zero.at_s, zero.offset_n));
        self.watch = Watch::new(limits, zero);
        self.line = Some(line);
    }

    /// Makes forces relative to this air, and to the drift that all air so far has shown, which it states.
    pub(super) fn count_from(&mut self, no_load: &mut NoLoadReadings) {
        let zero = self.watch.zero();
        let sigma_n = zero.sigma_own_n(no_load.readings).hypot(zero.rounding_n() / UNIFORM);
        let drift = self.line.as_mut().map(|line| {
            *line = line.read(no_load.at_s, no_load.mean_n, sigma_n);
            line.lasting()
        });
        let drift = drift.unwrap_or_default();
        no_load.drift = (drift.rate_n_s != 0.0).then_some(drift);
        let before = *self.watch.zero();
        self.watch.count_from(no_load, drift);
        self.cell.largest.count_from(&before, self.watch.zero());
    }

    /// Whether readings count as air.
    pub(super) fn is_no_load_open(&self) -> bool {
        self.no_load.open
    }

    /// Treats the readings from now on as air.
    pub(super) fn begin_no_load(&mut self) {
        self.no_load = NoLoadForces { open: true, ..NoLoadForces::default() };
    }

    /// Returns the newest readings without load, and reads more until there are enough; the stage must be at rest. Later readings are
    /// no longer air.
    pub(super) async fn end_no_load(&mut self) -> Result<NoLoadReadings, Halt> {
        if !self.no_load.open {
            self.begin_no_load();
        }
        let least_s = self.watch.zero().mean_s(NO_LOAD_LEAST_S);
        while self.no_load.count() < NO_LOAD_READINGS || self.no_load.span_s() < least_s {
            let Some((_, reading)) = self.next_reading().await? else { continue };
            let force_n = self.watch.no_load_n(&reading)?;
            self.take(&reading, force_n);
        }
        self.no_load.open = false;
        let (sigma_n, most_n) = (self.no_load.sigma_n(), self.watch.zero().noise_most_n());
        if sigma_n > most_n {
            let (rest_n, jump_n) = self.no_load.sigma_without_jump_n();
            // one jump may be the first reading of a noise
            if rest_n <= most_n && self.still_sigma_n().await? <= most_n {
                return Err(Trip::new(SafetyRule::ZeroDrifted, jump_n, most_n, "N").into());
            }
        }
        let newest = self.no_load.readings.back().map_or(self.began, |(at, ..)| *at);
        let before = |at: Instant| -(newest - at).as_secs_f64();
        let readings: Vec<(f64, f64)> = self.no_load.readings.iter().map(|&(at, n, _)| (before(at), n)).collect();
        let mean =
            mean_of(&readings, self.watch.zero()).ok_or_else(|| Trip::new(SafetyRule::Stale, 0.0, 0.0, "readings"))?;
        let side_mean_n = side_mean(self.no_load.readings.iter().map(|(.., side_n)| *side_n));
        let (age_s, at_s) = (-mean.middle_s, self.read_s + mean.middle_s);
        Ok(NoLoadReadings {
            mean_n: mean.value,
            sigma_n,
            readings: mean.readings,
            age_s,
            at_s,
            drift: None,
            side_mean_n,
        })
    }
}

impl NoLoadForces {
    pub(super) fn count(&self) -> u32 {
        self.readings.len() as u32
    }

    fn span_s(&self) -> f64 {
        let ends = self.readings.front().zip(self.readings.back());
        ends.map_or(0.0, |((first, ..), (last, ..))| (*last - *first).as_secs_f64())
    }

    /// Squared differences of successive readings, N^2.
    fn squares(&self) -> impl Iterator<Item = f64> {
        let following = self.readings.iter().skip(1);
        self.readings.iter().zip(following).map(|((_, a, _), (_, b, _))| (b - a).powi(2))
    }

    /// Noise of one reading, from the differences of successive readings. An increasing force or a drifting zero isn't noise.
    pub(super) fn sigma_n(&self) -> f64 {
        (self.squares().sum::<f64>() / (2.0 * f64::from(self.count().max(2) - 1))).sqrt()
    }

    /// The same without the largest difference, which is returned too: a zero that jumps once isn't noise.
    fn sigma_without_jump_n(&self) -> (f64, f64) {
        let (sum, largest) = (self.squares().sum::<f64>(), self.squares().fold(0.0, f64::max));
        (((sum - largest).max(0.0) / (2.0 * f64::from(self.count().max(3) - 2))).sqrt(), largest.sqrt())
    }

    pub(super) fn take(&mut self, now: Instant, reading: &ForceReading) {
        if !self.open {
            return;
        }
        let is_old = |&(at, ..): &(Instant, f64, Option<[f64; 2]>)| (now - at).as_secs_f64() > NO_LOAD_S;
        while self.readings.len() >= NO_LOAD_MAX
            || (self.count() > NO_LOAD_READINGS && self.readings.front().is_some_and(is_old))
        {
            self.readings.pop_front();
        }
        self.readings.push_back((now, reading.force_n, reading.side_n));
    }
}

/// Returns the mean forces sideways, N; `None` if a reading has none, or there are no readings.
pub(super) fn side_mean(readings: impl Iterator<Item = Option<[f64; 2]>>) -> Option<[f64; 2]> {
    let sides: Vec<[f64; 2]> = readings.collect::<Option<_>>()?;
    let mean = |axis: usize| sides.iter().map(|side_n| side_n[axis]).sum::<f64>() / sides.len() as f64;
    (!sides.is_empty()).then(|| [mean(0), mean(1)])
}
