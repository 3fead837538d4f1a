//! Checks that every reading must pass.

use super::drift::Drift;
use super::press::NoLoadReadings;
use super::side::SideWatch;
use super::trip::{SafetyRule, Trip};
use super::zero::Zero;
use palpate_core::quantity::{ForceReading, GRAVITY_M_S2, Limits, Range};

/// Time over which a force is averaged before it is compared with the limits, s.
const MEAN_S: f64 = 0.010;

/// Least force below zero that indicates a wrong sign, N.
const NEGATIVE_LEAST_N: f64 = 0.030;

/// Largest number of readings in the running mean.
const MEAN_MAX: usize = 64;

/// Largest rise of the force while z moves away before a zero is taken, as a fraction of the force limit and in sd of a reading.
const RISE_SHARE: f64 = 0.05;
const RISE_SIGMAS: f64 = 6.0;

/// Same limit for the retraction after a press, where the direction of z is already proven.
const AWAY_SHARE: f64 = 0.1;

/// Largest deceleration of a stage at a limit switch, as a multiple of its set acceleration.
const JOLT: f64 = 2.0;

/// Checks every reading against the trip rules.
#[derive(Debug)]
pub struct Watch {
    limit_n: f64,
    /// Allowed range of the force, N from the zero, and the rules that set it.
    within_n: Range,
    rules: [SafetyRule; 2],
    /// Largest allowed rise of the force while z moves away, N.
    rise_most_n: f64,
    zero: Zero,
    recent: std::collections::VecDeque<(f64, f64)>,
    side: SideWatch,
    /// Largest allowed length of the whole force, N.
    length_most_n: f64,
    last_code: Option<f64>,
    equal: u32,
    last_s: Option<f64>,
}

impl Watch {
    /// Creates the rules of a rig with a zero measured without load.
    pub fn new(limits: &Limits, zero: Zero) -> Self {
        let within_n =
            Range { min: -NEGATIVE_LEAST_N.max(5.0 * zero.sigma_n), max: limits.force_n + 3.0 * zero.sigma_n };
        let rise_most_n = AWAY_SHARE * limits.force_n + RISE_SIGMAS * zero.sigma_n;
        Watch::of(limits, zero, within_n, [SafetyRule::WrongSign, SafetyRule::OverForce], rise_most_n)
    }

    /// Creates the rules for a stage that moves z away before there is a zero. The force must not rise above the reading at rest,
    /// `still`. It must not fall further than a contact within the limit can explain. A tool on the cell causes a force when it
    /// accelerates; its weight is at most what the cell may read without load, `air_n`.
    pub fn before_zero(limits: &Limits, still: Zero, air_n: Range, acceleration_mm_s2: f64) -> Self {
        let rise_n = Watch::rise_n(limits, air_n, acceleration_mm_s2) + RISE_SIGMAS * still.sigma_n;
        let within_n = Range { min: -limits.force_n - rise_n, max: rise_n };
        let still = Zero { frozen_after: None, ..still };
        Watch::of(limits, still, within_n, [SafetyRule::ForceFell, SafetyRule::ForceRose], rise_n)
    }

    /// Largest rise of the force without contact while a stage moves, N.
    pub fn rise_n(limits: &Limits, air_n: Range, acceleration_mm_s2: f64) -> f64 {
        RISE_SHARE * limits.force_n + Watch::jolt_n(air_n, acceleration_mm_s2)
    }

    /// Largest force of a tool that a stage accelerates, N: its weight is at most what the cell may read without load.
    pub fn jolt_n(air_n: Range, acceleration_mm_s2: f64) -> f64 {
        let tool_kg = air_n.min.abs().max(air_n.max.abs()) / GRAVITY_M_S2;
        JOLT * tool_kg * acceleration_mm_s2 / 1000.0
    }

    fn of(limits: &Limits, zero: Zero, within_n: Range, rules: [SafetyRule; 2], rise_most_n: f64) -> Self {
        Watch {
            limit_n: limits.force_n,
            within_n,
            rules,
            rise_most_n,
            zero,
            recent: std::collections::VecDeque::new(),
            side: SideWatch::default(),
            // before there is a zero, a contact within the limit may have caused the forces at rest
            length_most_n: within_n.max.max(-within_n.min),
            last_code: None,
            equal: 0,
            last_s: None,
        }
    }

    /// Zero that forces are relative to.
    pub fn zero(&self) -> &Zero {
        &self.zero
    }

    /// Largest allowed rise of the force while z moves away, N.
    pub fn rise_most_n(&self) -> f64 {
        self.rise_most_n
    }

    /// Limit of the force, N from the zero.
    pub fn limit_n(&self) -> f64 {
        self.limit_n
    }

    /// Makes forces relative to newer air from now on, which drifts so.
    pub fn count_from(&mut self, no_load: &NoLoadReadings, drift: Drift) {
        self.zero = Zero { drift, ..self.zero }.counted_from(no_load);
        self.recent.clear();
        self.side.clear();
    }

    /// States that no reading is expected for a while (the stage rests without load).
    pub fn pause(&mut self) {
        self.last_s = None;
        self.recent.clear();
        self.side.clear();
    }

    /// States that a reading arrived at this time, s, that doesn't count.
    pub fn heard(&mut self, at_s: f64) {
        self.last_s = self.last_s.map(|_| at_s);
    }

    /// Number of equal readings in a row until now.
    pub fn equal(&self) -> u32 {
        self.equal
    }

    /// Last reading, N as the cell reads; `None` before one.
    pub fn last_code(&self) -> Option<f64> {
        self.last_code
    }

    /// Mean that is compared with the limits, N; `None` before two readings.
    pub fn mean_n(&self) -> Option<f64> {
        let count = self.recent.len();
        (count >= 2).then(|| self.recent.iter().map(|(_, n)| n).sum::<f64>() / count as f64)
    }

    /// Returns the force of a reading, N from the zero.
    ///
    /// # Errors
    /// The broken rule.
    pub fn force_n(&mut self, reading: &ForceReading) -> Result<f64, Trip> {
        self.checked(reading, self.within_n)
    }

    /// Returns the same for a stage that rests without load. The zero may have moved either way since it was measured, but not beyond
    /// the limit.
    ///
    /// # Errors
    /// The broken rule.
    pub fn no_load_n(&mut self, reading: &ForceReading) -> Result<f64, Trip> {
        self.checked(reading, Range { min: -self.limit_n, ..self.within_n })
    }

    fn checked(&mut self, reading: &ForceReading, within_n: Range) -> Result<f64, Trip> {
        check_sound(reading)?;
        let gap_s = self.last_s.map_or(0.0, |last_s| reading.at_s - last_s);
        if gap_s > self.zero.stale_s() {
            return Err(Trip::new(SafetyRule::Stale, gap_s, self.zero.stale_s(), "s"));
        }
        self.last_s = Some(reading.at_s);
        self.check_frozen(reading.force_n)?;
        let force_n = self.zero.from_zero_n(reading);
        self.check_mean(reading.at_s, force_n, within_n)?;
        if let (Some(side_n), Some(zero)) = (reading.side_n, &self.zero.side) {
            let count = self.recent.len();
            let mean_n = self.recent.iter().map(|(_, n)| n).sum::<f64>() / count as f64;
            self.side.check(zero, side_n, (count, mean_n), self.length_most_n)?;
        }
        Ok(force_n)
    }

    fn check_frozen(&mut self, code: f64) -> Result<(), Trip> {
        self.equal = if self.last_code == Some(code) { self.equal + 1 } else { 1 };
        self.last_code = Some(code);
        match self.zero.frozen_after {
            Some(most) if self.equal >= most => {
                Err(Trip::new(SafetyRule::Frozen, f64::from(self.equal), f64::from(most), "equal readings"))
            }
            _ => Ok(()),
        }
    }

    fn check_mean(&mut self, at_s: f64, force_n: f64, within_n: Range) -> Result<(), Trip> {
        // a slower cell is judged by its last two readings, or it would never be judged
        let old = |(then_s, _): &(f64, f64)| at_s - then_s > MEAN_S;
        while self.recent.len() > 1 && (self.recent.front().is_some_and(old) || self.recent.len() >= MEAN_MAX) {
            self.recent.pop_front();
        }
        self.recent.push_back((at_s, force_n));
        // one reading is no mean: the loop ignores a single outlier, because every end point is safe
        let Some(mean_n) = self.mean_n() else { return Ok(()) };
        let [under, over] = self.rules;
        if mean_n > within_n.max {
            return Err(Trip::new(over, mean_n, within_n.max, "N"));
        }
        if mean_n < within_n.min {
            return Err(Trip::new(under, mean_n, within_n.min, "N"));
        }
        Ok(())
    }
}

/// Checks that a reading is a number and that the cell reports no fault.
///
/// # Errors
/// The broken rule.
pub fn check_sound(reading: &ForceReading) -> Result<(), Trip> {
    if !reading.force_n.is_finite() {
        return Err(Trip::new(SafetyRule::NotFinite, reading.force_n, 0.0, "N"));
    }
    if reading.health.saturated || reading.health.fault {
        return Err(Trip::new(SafetyRule::Unhealthy, reading.force_n, 0.0, "N (raw reading)"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::quantity::Health;

    fn watch() -> Watch {
        let limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };
        Watch::new(&limits, Zero { offset_n: 0.5, frozen_after: Some(20), ..Zero::with_noise(0.003) })
    }

    /// The rule that a series of readings, 5 ms apart, breaks at last.
    fn broken(forces: impl IntoIterator<Item = f64>) -> Option<SafetyRule> {
        let mut watch = watch();
        let reading = |(i, n): (usize, f64)| ForceReading {
            at_s: i as f64 * 0.005,
            force_n: n + 0.5,
            side_n: None,
            health: Health::default(),
        };
        forces.into_iter().enumerate().map(reading).find_map(|r| watch.force_n(&r).err()).map(|trip| trip.rule)
    }

    #[test]
    fn each_rule_trips_only_beyond_its_limit() {
        assert_eq!(broken([1.0, 2.008, 2.0, 1.99]), None);
        assert_eq!(broken([1.0, 2.02, 2.02, 2.02]), Some(SafetyRule::OverForce));
        assert_eq!(broken([0.0, -0.02, -0.04, -0.02]), None);
        assert_eq!(broken([0.0, -0.04, -0.04, -0.04]), Some(SafetyRule::WrongSign));
        assert_eq!(broken([0.7; 19]), None);
        assert_eq!(broken([0.7; 20]), Some(SafetyRule::Frozen));
        assert_eq!(broken([f64::NAN]), Some(SafetyRule::NotFinite));
        let ill =
            ForceReading { at_s: 0.0, force_n: 0.5, side_n: None, health: Health { saturated: true, fault: false } };
        assert_eq!(watch().force_n(&ill).unwrap_err().rule, SafetyRule::Unhealthy);
    }

    #[test]
    fn before_the_zero_the_force_may_fall_but_not_rise() {
        let limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };
        let still = Zero { offset_n: 1.5, ..Zero::with_noise(0.003) };
        let rule = |n: f64| {
            let mut watch = Watch::before_zero(&limits, still, Range { min: -2.0, max: 2.0 }, 100.0);
            let reading = |i: u32| ForceReading {
                at_s: 0.005 * f64::from(i),
                force_n: n,
                side_n: None,
                health: Health::default(),
            };
            (0..3).find_map(|i| watch.force_n(&reading(i)).err()).map(|trip| trip.rule)
        };
        // 0.1 N, 6 sd, and a tool of 0.2 kg stopped with twice 0.1 m/s^2: 0.159 N
        assert_eq!([1.5, 1.65, -0.5].map(rule), [None; 3]);
        assert_eq!(
            [1.67, 5.0, -0.7].map(rule),
            [Some(SafetyRule::ForceRose), Some(SafetyRule::ForceRose), Some(SafetyRule::ForceFell)]
        );
    }

    #[test]
    fn gap_between_readings_trips_unless_announced() {
        let reading = |at_s, n| ForceReading { at_s, force_n: n, side_n: None, health: Health::default() };
        let mut watched = watch();
        watched.force_n(&reading(0.0, 0.5)).unwrap();
        assert_eq!(watched.force_n(&reading(0.3, 0.51)).unwrap_err().rule, SafetyRule::Stale);
        let mut watched = watch();
        watched.force_n(&reading(0.0, 0.5)).unwrap();
        watched.pause();
        watched.force_n(&reading(300.0, 0.51)).unwrap();
    }
}
