//! Check of the load cell with a known weight. A person puts the weight on the tip and removes it. The cell itself detects both,
//! and the stage doesn't move.

use super::Halt;
use super::watched_cell::WatchedLoadCell;
use crate::rig::GroundTruth;
use palpate_control::{Mean, SafetyRule, Trip, Zero, mean_of};
use palpate_core::quantity::{AxesCheck, Axis, COVERAGE, ForceReading, GRAVITY_M_S2, LoadCellCertificate, WeightCheck};
use palpate_link::device::LoadCell;
use palpate_link::time::Instant;
use std::time::Duration;

/// Number of times that the weight is put on.
pub const WEIGHT_TIMES: u32 = 3;

/// Longest wait until the weight is put on or removed, and rests.
pub const WEIGHT_WAIT: Duration = Duration::from_secs(60);

/// Least move of the mean that shows that the weight is on, as a fraction of the weight. It is small enough for a cell in wrong
/// units too.
const MOVED_SHARE: f64 = 0.05;
/// Largest rest of the weight's reading after the weight is removed, as a fraction of the reading.
const LEFT_SHARE: f64 = 0.25;
/// Largest difference of two successive means at rest, in sd. The second constant is an allowance, as a fraction of the weight.
const REST_SIGMAS: f64 = 4.0;
const REST_SHARE: f64 = 0.001;
/// Least duration of a look, s, and least number of its readings.
const LOOK_S: f64 = 0.25;
const LOOK_READINGS: usize = 4;
/// Least duration of the window of a weight at rest, s, and least number of readings in each half.
const WINDOW_S: f64 = 1.0;
const HALF_READINGS: usize = 10;
/// Least number of readings and least time for the zero without load, s.
const ZERO_READINGS: usize = 100;
const ZERO_S: f64 = 1.0;
/// Largest standard deviation of the gain over time.
const UNSTEADY: f64 = 0.01;

/// A weight that a load cell is checked with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownWeight {
    /// Its force, N.
    pub weight_n: f64,
    /// Expanded uncertainty of the force, k = 2, N.
    pub u_n: f64,
    /// Whether the weight hangs from the tip and pulls. Otherwise it acts in the direction of contact.
    pub pull: bool,
    /// Axis of the specimen along which it acts; z is the press.
    pub along: Axis,
}

/// Request to a person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ask {
    /// Put the weight on, for the repetition of this number, counted from 1.
    PutOn(u32, KnownWeight),
    /// Remove the weight.
    TakeOff(u32),
    /// Press the tip with a finger.
    Finger,
}

/// A check with a weight: the weight and the person who is asked.
pub struct Weighing<'a> {
    /// The weight.
    pub weight: KnownWeight,
    /// Whether it then acts along x and along y too.
    pub three_axes: bool,
    /// Asks the person.
    pub ask: &'a mut dyn FnMut(Ask),
}

/// Result of the measurement of a known weight.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightMeasurement {
    /// The weight.
    pub weight: KnownWeight,
    /// Cell readings of the weight, as fractions of the weight, one for each repetition.
    pub gains: Vec<f64>,
    /// Readings of x, y and the press per newton of the weight, one for each repetition. Without three axes x and y are 0.
    pub responses: Vec<[f64; 3]>,
    /// Standard deviation of one gain from the noise of the readings alone.
    pub noise: f64,
}

impl WeightMeasurement {
    /// The mean of the gains.
    pub fn gain(&self) -> f64 {
        self.gains.iter().sum::<f64>() / self.gains.len().max(1) as f64
    }

    /// Returns the repeatability: standard deviation of a gain between repetitions, at least the value that the noise of the
    /// readings explains.
    pub fn gain_sd(&self) -> f64 {
        let mean = self.gain();
        let squares: f64 = self.gains.iter().map(|gain| (gain - mean).powi(2)).sum();
        (squares / (self.gains.len().max(2) - 1) as f64).sqrt().max(self.noise)
    }

    /// Returns the check as stored in a rig file.
    pub fn check(&self, date: &str, adjusted: bool) -> WeightCheck {
        let KnownWeight { weight_n, u_n: weight_u_n, pull, .. } = self.weight;
        WeightCheck {
            weight_n,
            weight_u_n,
            pull,
            gain: self.gain(),
            gain_sd: self.gain_sd(),
            times: self.gains.len() as u32,
            date: date.to_owned(),
            adjusted,
        }
    }
}

/// Result of a known weight along each of three axes: x, y and the press.
#[derive(Clone, Debug)]
pub struct AxesMeasurement(pub [WeightMeasurement; 3]);

impl AxesMeasurement {
    /// Returns the check as stored in a rig file. Its uncertainty is the largest of its numbers.
    pub fn check(&self, date: &str) -> AxesCheck {
        let mean = |weighed: &WeightMeasurement, axis: usize| {
            let sum: f64 = weighed.responses.iter().map(|response| response[axis]).sum();
            sum / weighed.responses.len().max(1) as f64
        };
        let along = self.0.each_ref().map(|weighed| [0, 1, 2].map(|axis| mean(weighed, axis)));
        let u = self.0.iter().map(|weighed| weighed.check(date, false).standard_uncertainty()).fold(0.0, f64::max);
        AxesCheck { along, u, date: date.to_owned() }
    }
}

/// Asks the operator to put the weight on and take it off. Reads the weight each time between two readings without load. It uses the
/// cell's own readings, without the rig's adjustment.
///
/// # Errors
/// Returns a halt if the operator stops the check, the cell fails, or the weight isn't put on, isn't taken off or doesn't repeat.
pub(super) async fn weigh<C: LoadCell>(
    watched_cell: &mut WatchedLoadCell<'_, C>,
    truth: &GroundTruth,
    weighing: &mut Weighing<'_>,
) -> Result<WeightMeasurement, Halt> {
    let weight = weighing.weight;
    let of_axis = |reading: &ForceReading| ForceReading { force_n: axes_n(reading)[weight.along.index()], ..*reading };
    let sign = if weight.pull { -1.0 } else { 1.0 };
    let readings = watched_cell.sound_readings(ZERO_READINGS, ZERO_S).await?;
    let readings: Vec<ForceReading> = readings.iter().map(of_axis).collect();
    let zero = Zero::of(&readings, watched_cell.cell.conversion().as_secs_f64());
    let scale = Balance { zero, weight_n: weight.weight_n, along: weight.along };
    let mut before = scale.window(watched_cell).await?.0;
    let mut weighed = WeightMeasurement { weight, gains: Vec::new(), responses: Vec::new(), noise: 0.0 };
    for time in 1..=WEIGHT_TIMES {
        (weighing.ask)(Ask::PutOn(time, weight));
        truth.put_weight(sign * weight.weight_n, weight.u_n, weight.along);
        let on = scale.wait(watched_cell, before.mean.value, Waits::On).await?;
        (weighing.ask)(Ask::TakeOff(time));
        truth.take_weight();
        let read_n = on.mean.value - before.mean.value;
        let after = scale.wait(watched_cell, before.mean.value, Waits::Off { read_n }).await?;
        // the zero at the time of the weight's reading, interpolated in time
        let share = (on.mean.middle_s - before.mean.middle_s) / (after.mean.middle_s - before.mean.middle_s);
        let per_n = |on_n: f64, before_n: f64, after_n: f64| {
            (on_n - (before_n + share * (after_n - before_n))) / (sign * weight.weight_n)
        };
        weighed.gains.push(per_n(on.mean.value, before.mean.value, after.mean.value));
        let response = [0, 1, 2].map(|axis| per_n(on.axes_n[axis], before.axes_n[axis], after.axes_n[axis]));
        weighed.responses.push(response);
        weighed.noise = (1.5f64.sqrt() * scale.zero.sigma_own_n(on.mean.readings)) / weight.weight_n;
        before = after;
    }
    let sd = weighed.gain_sd() / weighed.gain().abs().max(1.0);
    if sd > UNSTEADY {
        return Err(Trip::new(SafetyRule::WeightUnsteady, 100.0 * sd, 100.0 * UNSTEADY, "%").into());
    }
    Ok(weighed)
}

/// Event that is awaited.
#[derive(Clone, Copy)]
enum Waits {
    On,
    Off { read_n: f64 },
}

/// Load cell used as a balance.
struct Balance {
    zero: Zero,
    weight_n: f64,
    /// Axis of the weight.
    along: Axis,
}

/// Mean reading along the weight, and the means of all axes, N.
#[derive(Clone, Copy)]
struct Look {
    mean: Mean,
    axes_n: [f64; 3],
}

/// Returns the readings of x, y and the press, N.
fn axes_n(reading: &ForceReading) -> [f64; 3] {
    let [x_n, y_n] = reading.side_n.unwrap_or_default();
    [x_n, y_n, reading.force_n]
}

impl Balance {
    /// Returns the mean of a weight that is on or off, and at rest.
    async fn wait<C: LoadCell>(
        &self,
        watched_cell: &mut WatchedLoadCell<'_, C>,
        air_n: f64,
        waits: Waits,
    ) -> Result<Look, Halt> {
        let began = Instant::now();
        let mut last: Option<Look> = None;
        loop {
            let look = self.look(watched_cell, LOOK_S, LOOK_READINGS).await?;
            let rests = last.is_some_and(|last| self.agree(&last.mean, &look.mean));
            last = Some(look);
            if self.is_there(look.mean.value - air_n, look.mean.readings, waits) && rests {
                let (window, halves_agree) = self.window(watched_cell).await?;
                if halves_agree && self.is_there(window.mean.value - air_n, window.mean.readings, waits) {
                    return Ok(window);
                }
                last = None;
            }
            if began.elapsed() > WEIGHT_WAIT {
                return Err(self.in_vain(look.mean.value - air_n, look.mean.readings, waits).into());
            }
        }
    }

    fn is_there(&self, moved_n: f64, readings: u32, waits: Waits) -> bool {
        let most_n = self.threshold_n(readings, waits);
        match waits {
            Waits::On => moved_n.abs() > most_n,
            Waits::Off { .. } => moved_n.abs() < most_n,
        }
    }

    fn threshold_n(&self, readings: u32, waits: Waits) -> f64 {
        let noise_n = 2.0 * REST_SIGMAS * self.zero.sigma_own_n(readings);
        match waits {
            Waits::On => noise_n.max(MOVED_SHARE * self.weight_n),
            Waits::Off { read_n } => LEFT_SHARE * read_n.abs(),
        }
    }

    fn in_vain(&self, moved_n: f64, readings: u32, waits: Waits) -> Trip {
        let rule = match waits {
            Waits::On => SafetyRule::NoWeight,
            Waits::Off { .. } => SafetyRule::WeightLeftOn,
        };
        Trip::new(rule, moved_n, self.threshold_n(readings, waits), "N")
    }

    /// Returns the mean of a window, and whether its halves agree.
    async fn window<C: LoadCell>(&self, watched_cell: &mut WatchedLoadCell<'_, C>) -> Result<(Look, bool), Halt> {
        let first = self.look(watched_cell, WINDOW_S / 2.0, HALF_READINGS).await?;
        let second = self.look(watched_cell, WINDOW_S / 2.0, HALF_READINGS).await?;
        let (a, b) = (first.mean, second.mean);
        let mean = Mean {
            value: (a.value + b.value) / 2.0,
            middle_s: (a.middle_s + b.middle_s) / 2.0,
            readings: a.readings + b.readings,
        };
        let axes_n = [0, 1, 2].map(|axis| (first.axes_n[axis] + second.axes_n[axis]) / 2.0);
        Ok((Look { mean, axes_n }, self.agree(&a, &b)))
    }

    /// Returns the means of some readings; that along the weight over complete periods of the mains interference, N as the cell reads.
    async fn look<C: LoadCell>(
        &self,
        watched_cell: &mut WatchedLoadCell<'_, C>,
        least_s: f64,
        least: usize,
    ) -> Result<Look, Halt> {
        let least_s = self.zero.mean_s(least_s);
        let (mut read, mut sums_n): (Vec<(f64, f64)>, [f64; 3]) = (Vec::new(), [0.0; 3]);
        while read.len() < least || watched_cell.now_s() - read[0].0 < least_s {
            let reading = watched_cell.sound_reading().await?;
            let axes_n = axes_n(&reading);
            read.push((watched_cell.now_s(), axes_n[self.along.index()]));
            sums_n = [0, 1, 2].map(|axis| sums_n[axis] + axes_n[axis]);
        }
        let axes_n = sums_n.map(|sum_n| sum_n / read.len() as f64);
        let look = mean_of(&read, &self.zero).map(|mean| Look { mean, axes_n });
        look.ok_or_else(|| Trip::new(SafetyRule::Stale, 0.0, 1.0, "readings").into())
    }

    fn agree(&self, a: &Mean, b: &Mean) -> bool {
        let noise_n = self.zero.sigma_own_n(a.readings).hypot(self.zero.sigma_own_n(b.readings));
        (a.value - b.value).abs() <= REST_SIGMAS * noise_n + REST_SHARE * self.weight_n
    }
}

/// Result of a check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeightResult {
    /// Whether the cell can be relied on.
    pub verdict: LoadCellVerdict,
    /// Difference of the gain from its correct value, as a fraction. The correct value is 1, or the gain that the rig adjusts
    /// for.
    pub off: f64,
    /// Part of the difference that can be explained, as a fraction.
    pub explained: f64,
}

/// Load cell as a known weight shows it after a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellAfter {
    /// Its gain: reading of the weight, as a fraction of the weight, without the rig's adjustment.
    pub gain: f64,
    /// The gain compared with what the rig knows.
    pub judged: WeightResult,
}

impl CellAfter {
    /// Judges readings of a weight that were divided by `divisor`.
    pub(super) fn of(
        weighed: &WeightMeasurement,
        divisor: f64,
        before: &WeightCheck,
        certificate: Option<&LoadCellCertificate>,
    ) -> CellAfter {
        let gains = weighed.gains.iter().map(|gain| gain * divisor).collect();
        let found = WeightMeasurement { gains, ..weighed.clone() }.check("", false);
        CellAfter { gain: found.gain, judged: judged(&found, Some(before), certificate) }
    }

    /// Returns the problem in one line; `None` if the gain is correct.
    pub fn problem(&self) -> Option<String> {
        let WeightResult { verdict, off, explained } = self.judged;
        (verdict != LoadCellVerdict::Verified).then(|| {
            format!(
                "check failed at the end: the load cell reads {:.4} of a known weight, off by {:+.2} %, limit {:.2} %; \
                 all presses are doubtful",
                self.gain,
                100.0 * off,
                100.0 * explained
            )
        })
    }
}

/// Whether a load cell can be relied on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadCellVerdict {
    /// The gain is correct, within what weight and certificate can show.
    Verified,
    /// The gain is wrong, but the error is small enough to adjust for.
    Off,
    /// A weight that presses gives a negative reading.
    WrongSign,
    /// The gain is so wrong that there is a fault; the text states a possible cause.
    Fault(Option<&'static str>),
}

/// Ratios of a reading to the weight that indicate a wrong unit. The second constant is the largest distance of a gain from a
/// ratio, as a fraction of the ratio.
const UNITS: [(f64, &str); 6] = [
    (1.0 / GRAVITY_M_S2, "the cell's unit is the kilogram-force (9.80665 N), or its range is ten times too large"),
    (GRAVITY_M_S2, "the weight was given in kilograms-force (9.80665 N), or the cell's range is ten times too small"),
    (1000.0 / GRAVITY_M_S2, "the cell's unit is the gram-force (9.80665 mN)"),
    (1.0 / 4.448_221_6, "the cell's unit is the pound-force (4.448 N)"),
    (4.448_221_6, "the weight was given in pounds-force (4.448 N)"),
    (1000.0, "the cell's unit is the millinewton"),
];
const UNIT_NEAR: f64 = 0.03;

/// Judges a check from the cell's own readings. `before` is the check that the rig has so far.
pub fn judged(
    new: &WeightCheck,
    before: Option<&WeightCheck>,
    certificate: Option<&LoadCellCertificate>,
) -> WeightResult {
    let (off, explained) = match before.filter(|before| before.adjusted) {
        Some(before) => {
            let u = (new.standard_uncertainty() / new.gain).hypot(before.standard_uncertainty() / before.gain);
            (new.gain / before.gain - 1.0, COVERAGE * u)
        }
        None => (new.gain - 1.0, new.explained(certificate)),
    };
    let verdict = if new.gain < 0.0 {
        LoadCellVerdict::WrongSign
    } else if !new.is_adjustable() {
        let near = |(ratio, _): &&(f64, &str)| (new.gain / ratio - 1.0).abs() < UNIT_NEAR;
        LoadCellVerdict::Fault(UNITS.iter().find(near).map(|(_, text)| *text))
    } else if off.abs() <= explained {
        LoadCellVerdict::Verified
    } else {
        LoadCellVerdict::Off
    };
    WeightResult { verdict, off, explained }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(gain: f64) -> WeightCheck {
        let weight = KnownWeight { weight_n: 0.5, u_n: 0.0005, pull: false, along: Axis::Z };
        WeightMeasurement { weight, gains: vec![gain; 3], responses: Vec::new(), noise: 0.0001 }
            .check("2026-05-04", false)
    }

    fn verdict(new: &WeightCheck, before: Option<&WeightCheck>) -> LoadCellVerdict {
        judged(new, before, None).verdict
    }

    #[test]
    fn gain_is_judged_after_adjustment() {
        assert_eq!(verdict(&check(1.0005), None), LoadCellVerdict::Verified);
        assert_eq!(verdict(&check(1.01), None), LoadCellVerdict::Off);
        let adjusted = WeightCheck { adjusted: true, ..check(1.0101) };
        assert_eq!(verdict(&check(1.01), Some(&adjusted)), LoadCellVerdict::Verified);
        assert_eq!(verdict(&check(1.0), Some(&adjusted)), LoadCellVerdict::Off);
        assert_eq!(verdict(&check(1.0), Some(&check(1.02))), LoadCellVerdict::Verified);
    }

    #[test]
    fn gain_that_equals_a_ratio_of_units_is_named() {
        assert_eq!(verdict(&check(-1.0), None), LoadCellVerdict::WrongSign);
        for gain in [0.5, 0.8, 1.25, 0.0] {
            assert_eq!(verdict(&check(gain), None), LoadCellVerdict::Fault(None), "{gain}");
        }
        for (gain, word) in
            [(0.102, "kilogram"), (9.81, "given in kilograms"), (102.0, "gram-force"), (0.2248, "pound")]
        {
            let LoadCellVerdict::Fault(Some(text)) = verdict(&check(gain), None) else { panic!("{gain}") };
            assert!(text.contains(word), "{gain}: {text}");
        }
    }

    #[test]
    fn repeatability_is_no_less_than_the_noise_explains() {
        let weight = KnownWeight { weight_n: 0.5, u_n: 0.0005, pull: false, along: Axis::Z };
        let weighed =
            |gains: &[f64], noise| WeightMeasurement { weight, gains: gains.to_vec(), responses: Vec::new(), noise };
        assert_eq!(weighed(&[1.0; 3], 0.0002).gain_sd(), 0.0002);
        assert!((weighed(&[0.99, 1.0, 1.01], 0.0002).gain_sd() - 0.01).abs() < 1e-12);
    }
}
