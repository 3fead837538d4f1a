//! Readings that the stage can't have caused: one is left out, two in a row are doubted, and the median of seven decides.
//!
//! A converter that is read while it converts, or a line with a disturbance, gives single samples that are no force: minus one, full scale,
//! a turned sign. They come before a cell breaks, and most cells have some.

use super::trip::{SafetyRule, Trip};
use super::watch::check_sound;
use super::zero::{DETECT_LEAST_N, Zero};
use palpate_core::quantity::{ForceReading, Health};
use serde::{Deserialize, Serialize};
use std::f64::consts::SQRT_2;

/// Change between two readings that noise doesn't explain, in sd of their difference.
const NOISE_SIGMAS: f64 = 6.0 * SQRT_2;

/// Fastest relaxation of a force at rest, as a fraction of it per second. The fastest branch of a soft elastomer that we know loses a sixth
/// in the first second.
const RELAXES_PER_S: f64 = 2.0;

/// Readings whose median decides, the doubted ones among them.
const DECIDING: usize = 7;

/// Readings in a row, none of them where the force was, that show a change before that: another host may move the stage. Three glitches in a
/// row are as many as a converter gives.
const CHANGED: usize = 4;

/// Least ratio of the speed of a rise to the one before it in a force that rises steadily, as another host causes it that moves the stage. It is seen at the
/// second reading, because what moves by itself has to be given up soon. Two glitches are equal.
const STEADY_SHARE: f64 = 0.5;

/// Largest spread of the readings after a step, as a fraction of it: noise that has grown spreads more. And the step, in changes that are never
/// doubted, that is one with any spread: a count near its end turns around and back.
const STEP_SHARE: f64 = 0.125;
const STEP_FLOORS: f64 = 10.0;

/// Readings of the seven that are where the force was, from which it is still there: a force that has changed doesn't come back, and two glitches
/// are followed by two more in one of a hundred cases.
const RETURNED: usize = 2;

/// Largest fraction of readings that may be left out, and the number from which it is compared.
const LEFT_OUT_MOST: f64 = 0.05;
const COMPARED_FROM: u64 = 1000;

/// Largest fraction of the readings of a zero that may be left out, and a number that always may: of 20 readings with 2 % of glitches, five are
/// some in one of a hundred thousand cases. And the largest fraction that is still called glitches: a force that changed shows more.
const BATCH_MOST: f64 = 0.1;
const BATCH_LEAST: usize = 4;
const SOME_MOST: f64 = 0.35;

/// Ratio of a standard deviation to the median distance from the median, for a normal distribution.
const SD_PER_MEDIAN: f64 = 1.4826;

/// Readings that were left out, and all readings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Glitches {
    /// Number of all readings.
    pub readings: u64,
    /// Number of those that were left out.
    pub left_out: u64,
    /// The largest one that was left out and is a number, N from the zero.
    pub largest_n: f64,
}

impl Glitches {
    /// Whether every reading was believed.
    pub fn are_none(&self) -> bool {
        self.left_out == 0
    }

    /// Adds those of another time.
    pub fn add(&mut self, other: &Glitches) {
        self.readings += other.readings;
        self.left_out += other.left_out;
        self.enlarge(other.largest_n);
    }

    fn leave_out(&mut self, force_n: f64) {
        self.left_out += 1;
        self.enlarge(force_n);
    }

    fn enlarge(&mut self, force_n: f64) {
        if force_n.abs() > self.largest_n.abs() {
            self.largest_n = force_n;
        }
    }

    /// Returns it in words; `None` if every reading was believed.
    pub fn text(&self) -> Option<String> {
        let Glitches { readings, left_out, largest_n } = self;
        (!self.are_none()).then(|| {
            format!("{left_out} of {readings} readings of the load cell were left out as impossible, the largest {largest_n:.3} N")
        })
    }
}

/// What becomes of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Belief {
    /// It counts.
    Believed(ForceReading),
    /// The doubted ones have shown that the force changed at once, and by how much, N.
    Changed(ForceReading, f64),
    /// The stage can't have caused it: it is left out, and the next one shows whether it was wrong.
    LeftOut,
    /// The second one in a row, or a later one: a motion toward contact is stopped.
    Doubted,
    /// The same, but the force rises steadily: both readings count.
    Rises([ForceReading; 2]),
}

/// Decides which readings are believed.
#[derive(Clone, Debug)]
pub struct Believed {
    /// Largest stiffness that may be met, N/mm.
    stiffness_n_mm: f64,
    /// Time of a conversion, s: two readings may be a conversion farther apart than their answers.
    conversion_s: f64,
    /// Largest force of a tool that the stage accelerates, N.
    jolt_n: f64,
    /// Speed of the motion under way, mm/s; 0 at rest.
    speed_mm_s: f64,
    /// Last reading that was believed.
    last: Option<ForceReading>,
    /// Readings since the first one that is doubted.
    doubted: Vec<ForceReading>,
    glitches: Glitches,
}

impl Believed {
    /// Creates the belief of a rig: its stiffness, N/mm, the time of a conversion, s, and the largest force of an accelerated tool, N.
    pub fn new(stiffness_n_mm: f64, conversion_s: f64, jolt_n: f64) -> Believed {
        let (last, doubted, glitches) = (None, Vec::new(), Glitches::default());
        Believed { stiffness_n_mm, conversion_s, jolt_n, speed_mm_s: 0.0, last, doubted, glitches }
    }

    /// States the speed of the motion that begins, mm/s; 0 if the stage rests.
    pub fn moves(&mut self, speed_mm_s: f64) {
        self.speed_mm_s = speed_mm_s;
    }

    /// States the force of a cell at rest, N as it reads, at this time, s.
    pub fn rests_at(&mut self, force_n: f64, at_s: f64) {
        self.last = Some(ForceReading { at_s, force_n, side_n: None, health: Health::default() });
        self.doubted.clear();
    }

    /// Counts the readings of a zero.
    pub fn count(&mut self, glitches: &Glitches) {
        self.glitches.add(glitches);
    }

    /// Readings so far.
    pub fn glitches(&self) -> Glitches {
        self.glitches
    }

    /// Takes a reading.
    ///
    /// # Errors
    /// Most of seven readings report a fault, or too many readings were left out.
    pub fn take(&mut self, reading: &ForceReading, zero: &Zero) -> Result<Belief, Trip> {
        self.glitches.readings += 1;
        let is_possible = self.is_possible(reading, zero);
        if self.doubted.is_empty() && is_possible {
            return Ok(self.believe(*reading));
        }
        if self.doubted.len() == 1 && is_possible {
            self.leave_out(zero)?;
            return Ok(self.believe(*reading));
        }
        self.doubted.push(*reading);
        match self.doubted.len() {
            1 => Ok(Belief::LeftOut),
            2 if self.rises_steadily(zero) => {
                let first = self.doubted[0];
                self.believe(*reading);
                Ok(Belief::Rises([first, *reading]))
            }
            2..DECIDING if !self.has_changed(zero) => Ok(Belief::Doubted),
            _ => self.decide(zero),
        }
    }

    /// Whether the stage, the specimen or the noise can have caused the change since the last reading that was believed.
    fn is_possible(&self, reading: &ForceReading, zero: &Zero) -> bool {
        if check_sound(reading).is_err() {
            return false;
        }
        let Some(last) = &self.last else { return true };
        let apart_s = (reading.at_s - last.at_s).max(0.0);
        let last_n = zero.from_zero_n(last);
        let (jolt_n, moved_n) = match self.speed_mm_s > 0.0 {
            true => (self.jolt_n, self.stiffness_n_mm * self.speed_mm_s * (apart_s + self.conversion_s)),
            false => (0.0, 0.0),
        };
        let still_n = floor_n(zero) + jolt_n + RELAXES_PER_S * last_n.abs() * apart_s;
        let change_n = reading.force_n - last.force_n;
        // a motion takes away no more than there is
        let fell_n = moved_n.min(last_n.max(0.0));
        (-still_n - fell_n..=still_n + moved_n).contains(&change_n)
    }

    /// Whether a rise between two readings of a motion with this speed, mm/s, is more than it can cause.
    pub fn jumps(&self, from: &ForceReading, to: &ForceReading, speed_mm_s: f64, zero: &Zero) -> bool {
        let apart_s = (to.at_s - from.at_s).max(0.0) + self.conversion_s;
        to.force_n - from.force_n > floor_n(zero) + self.jolt_n + self.stiffness_n_mm * speed_mm_s * apart_s
    }

    /// Whether enough doubted readings show a change: none of them is where the force was, and none comes back toward it.
    fn has_changed(&self, zero: &Zero) -> bool {
        let last_n = self.last.map_or(zero.offset_n, |last| last.force_n);
        let away_n = |reading: &ForceReading| (reading.force_n - last_n).abs();
        let stays = self.doubted.windows(2).all(|pair| away_n(&pair[1]) >= away_n(&pair[0]) - floor_n(zero));
        self.doubted.len() >= CHANGED && stays && !self.doubted.iter().any(|reading| self.is_possible(reading, zero))
    }

    /// Whether two doubted readings continue a rise.
    fn rises_steadily(&self, zero: &Zero) -> bool {
        let (Some(last), [first, second]) = (&self.last, &self.doubted[..]) else { return false };
        let (before_n, after_n) = (first.force_n - last.force_n, second.force_n - first.force_n);
        let (before_s, after_s) = (first.at_s - last.at_s, second.at_s - first.at_s);
        let is_sound = check_sound(first).is_ok() && check_sound(second).is_ok();
        is_sound && before_n > floor_n(zero) && after_n * before_s >= STEADY_SHARE * before_n * after_s
    }

    fn believe(&mut self, reading: ForceReading) -> Belief {
        self.last = Some(reading);
        self.doubted.clear();
        Belief::Believed(reading)
    }

    /// Counts the doubted readings that stay impossible as left out.
    fn leave_out(&mut self, zero: &Zero) -> Result<(), Trip> {
        for reading in std::mem::take(&mut self.doubted) {
            if self.is_possible(&reading, zero) {
                continue;
            }
            self.glitches.leave_out(zero.from_zero_n(&reading));
        }
        let Glitches { readings, left_out, .. } = self.glitches;
        let share = left_out as f64 / readings as f64;
        if readings >= COMPARED_FROM && share > LEFT_OUT_MOST {
            return Err(Trip::new(SafetyRule::Glitches, 100.0 * share, 100.0 * LEFT_OUT_MOST, "% of the readings"));
        }
        Ok(())
    }

    /// Decides by the doubted readings: either the force is where it was, or it has changed to their median.
    fn decide(&mut self, zero: &Zero) -> Result<Belief, Trip> {
        let returned: Vec<ForceReading> =
            self.doubted.iter().filter(|reading| self.is_possible(reading, zero)).copied().collect();
        if let [.., last] = returned[..]
            && returned.len() >= RETURNED
        {
            self.leave_out(zero)?;
            return Ok(self.believe(last));
        }
        let mut sound: Vec<ForceReading> =
            self.doubted.iter().filter(|reading| check_sound(reading).is_ok()).copied().collect();
        if let Some(unsound) = self.doubted.iter().rfind(|reading| check_sound(reading).is_err())
            && 2 * sound.len() < self.doubted.len()
        {
            check_sound(unsound)?;
        }
        let at_s = self.doubted.last().map_or(0.0, |reading| reading.at_s);
        sound.sort_by(|a, b| a.force_n.total_cmp(&b.force_n));
        let changed = ForceReading { at_s, ..sound[sound.len() / 2] };
        let by_n = self.last.map_or(0.0, |last| changed.force_n - last.force_n);
        let spread_n = sound[sound.len() - 1].force_n - sound[0].force_n;
        let believed = self.believe(changed);
        let is_step = spread_n < STEP_SHARE * by_n.abs() || by_n.abs() > STEP_FLOORS * floor_n(zero);
        Ok(if is_step { Belief::Changed(changed, by_n) } else { believed })
    }
}

/// Change of a force that is never doubted, N: at least the least force that counts as contact.
fn floor_n(zero: &Zero) -> f64 {
    DETECT_LEAST_N.max(NOISE_SIGMAS * zero.sigma_n).max(zero.step_n)
}

/// Returns the readings of a cell at rest without those that are far from the others, and what was left out, N from the median. All are returned if there are
/// no others: then it is no glitch, and the caller's checks say what it is.
///
/// # Errors
/// Too many are left out.
pub fn without_glitches(readings: &[ForceReading]) -> Result<(Vec<ForceReading>, Glitches), Trip> {
    let mut sorted: Vec<f64> =
        readings.iter().filter(|reading| check_sound(reading).is_ok()).map(|reading| reading.force_n).collect();
    let middle = |sorted: &mut Vec<f64>| {
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
    };
    let median_n = middle(&mut sorted);
    let mut off: Vec<f64> = sorted.iter().map(|force_n| (force_n - median_n).abs()).collect();
    let most_n = DETECT_LEAST_N.max(NOISE_SIGMAS * SD_PER_MEDIAN * middle(&mut off));
    let is_near =
        |reading: &&ForceReading| check_sound(reading).is_ok() && (reading.force_n - median_n).abs() <= most_n;
    let (near, far): (Vec<ForceReading>, Vec<ForceReading>) = readings.iter().partition(is_near);
    let left_out = far.len();
    let share = left_out as f64 / readings.len().max(1) as f64;
    if left_out <= BATCH_LEAST || share <= BATCH_MOST {
        let mut glitches = Glitches { readings: readings.len() as u64, ..Glitches::default() };
        far.iter().for_each(|reading| glitches.leave_out(reading.force_n - median_n));
        return Ok((near, glitches));
    }
    match share <= SOME_MOST {
        true => Err(Trip::new(SafetyRule::Glitches, 100.0 * share, 100.0 * BATCH_MOST, "% of the readings")),
        false => Ok((readings.to_vec(), Glitches { readings: readings.len() as u64, ..Glitches::default() })),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ZERO: Zero = Zero { offset_n: 0.5, ..Zero::with_noise(0.003) };

    fn reading(nth: usize, force_n: f64) -> ForceReading {
        let health = Health { saturated: force_n > 20.0, fault: false };
        ForceReading { at_s: 0.005 * nth as f64, force_n: force_n + 0.5, side_n: None, health }
    }

    /// What becomes of forces 5 ms apart at this speed: the forces that are believed, and the letters of the others.
    fn taken(speed_mm_s: f64, forces: &[f64]) -> (Vec<String>, Glitches) {
        let mut believed = Believed::new(2.0, 0.005, 0.0);
        believed.moves(speed_mm_s);
        let text = |(nth, force_n): (usize, &f64)| match believed.take(&reading(nth, *force_n), &ZERO) {
            Ok(Belief::Believed(reading) | Belief::Changed(reading, _)) => format!("{:.2}", reading.force_n - 0.5),
            Ok(Belief::LeftOut) => "-".to_owned(),
            Ok(Belief::Doubted) => "?".to_owned(),
            Ok(Belief::Rises([_, reading])) => format!("?{:.2}", reading.force_n - 0.5),
            Err(trip) => trip.rule.name().to_owned(),
        };
        let texts = forces.iter().enumerate().map(text).collect();
        (texts, believed.glitches())
    }

    #[test]
    fn one_impossible_reading_is_left_out_and_counted() {
        for wrong in [-0.5, 8.0, -1.0, 99.0, f64::NAN] {
            let (texts, glitches) = taken(0.0, &[1.0, 1.0, wrong, 1.0, 1.0]);
            assert_eq!(texts, ["1.00", "1.00", "-", "1.00", "1.00"], "{wrong}");
            assert_eq!((glitches.readings, glitches.left_out), (5, 1));
        }
        assert_eq!(taken(0.0, &[1.0, 8.0, 1.0]).1.largest_n, 8.0);
    }

    #[test]
    fn two_in_a_row_are_doubted_and_the_median_of_seven_decides() {
        let (texts, glitches) = taken(0.0, &[1.0, 8.0, 8.0, 1.0, 1.0, 1.0, 1.0, 1.01, 1.0]);
        assert_eq!(texts, ["1.00", "-", "?", "?", "?", "?", "?", "1.01", "1.00"]);
        assert_eq!(glitches.left_out, 2);
        assert_eq!(taken(0.0, &[1.0, 8.0, 8.0, 1.0, 8.0, 8.0, 1.0, 1.0]).0.last().map(String::as_str), Some("1.00"));
        // the force has changed
        let (texts, glitches) = taken(0.0, &[1.0, 1.8, 1.8, 1.8, 1.8, 1.8]);
        assert_eq!(texts, ["1.00", "-", "?", "?", "1.80", "1.80"]);
        assert_eq!(glitches.left_out, 0);
        // the cell reports a fault
        let (texts, _) = taken(0.0, &[1.0, 99.0, 99.0, 99.0, 99.0]);
        assert_eq!(texts.last().map(String::as_str), Some("unhealthy"));
    }

    #[test]
    fn what_the_stage_and_the_specimen_cause_is_believed() {
        // 10 mm/s into 2 N/mm, 0.1 N each 5 ms; then relaxation of a sixth in a second
        let rises: Vec<f64> = (0..20).map(|nth| 0.1 * f64::from(nth)).collect();
        assert!(taken(10.0, &rises).0.iter().all(|text| !text.contains(['-', '?'])));
        let relaxes: Vec<f64> = (0..200).map(|nth| 1.5 + 0.3 * (-f64::from(nth) * 0.005 / 0.3).exp()).collect();
        assert!(taken(0.0, &relaxes).0.iter().all(|text| !text.contains(['-', '?'])));
        assert!(taken(0.0, &rises).0.iter().any(|text| text.starts_with('?')), "the same rise at rest");
        assert_eq!(taken(10.0, &[0.0, -0.05, 0.0]).0, ["0.00", "-", "0.00"], "no motion pulls");
    }

    #[test]
    fn a_steady_rise_counts_from_its_second_reading() {
        let texts = taken(0.0, &[1.0, 1.13, 1.26, 1.39, 1.52]).0;
        assert_eq!(texts, ["1.00", "-", "?1.26", "-", "?1.52"]);
        // the first one came after twice the time
        let mut believed = Believed::new(2.0, 0.005, 0.0);
        let beliefs = [(0, 1.0), (2, 1.36), (3, 1.53)].map(|(nth, n)| believed.take(&reading(nth, n), &ZERO).unwrap());
        assert!(matches!(beliefs, [Belief::Believed(_), Belief::LeftOut, Belief::Rises(_)]), "{beliefs:?}");
        assert_eq!(taken(0.0, &[1.0, 8.0, 8.0, 1.0]).0[..3], ["1.00", "-", "?"], "equal ones");
        assert_eq!(taken(0.0, &[1.0, 8.0, 99.0, 1.0]).0[..3], ["1.00", "-", "?"], "one of them saturated");
        assert_eq!(taken(0.0, &[1.0, 0.8, 0.6, 0.4]).0[..3], ["1.00", "-", "?"], "a fall endangers nothing");
    }

    #[test]
    fn after_a_pause_the_median_shows_where_the_force_has_gone() {
        let mut believed = Believed::new(2.0, 0.005, 0.0);
        believed.rests_at(0.5, 0.0);
        let at = |nth: usize, force_n: f64| ForceReading { at_s: 10.0 + 0.005 * nth as f64, ..reading(0, force_n) };
        let mut last = Belief::LeftOut;
        for (nth, force_n) in [9.0, 9.0, 0.2, 0.2, 0.2, 0.2, 0.2].into_iter().enumerate() {
            last = believed.take(&at(nth, force_n), &ZERO).unwrap();
        }
        assert_eq!(last, Belief::Believed(at(6, 0.2)));
    }

    #[test]
    fn too_many_end_the_run_and_fewer_do_not() {
        let series =
            |every: usize| -> Vec<f64> { (0..3000).map(|nth| if nth % every == 3 { 8.0 } else { 1.0 }).collect() };
        assert!(taken(0.0, &series(25)).0.iter().all(|text| text != "glitches"), "4 %");
        let (texts, glitches) = taken(0.0, &series(10));
        assert!(texts.iter().any(|text| text == "glitches") && glitches.readings >= COMPARED_FROM, "10 %");
    }

    #[test]
    fn readings_of_a_zero_are_counted_without_glitches() {
        let noisy = |nth: usize| 0.003 * ((nth * 7919 % 13) as f64 - 6.0) / 4.0;
        let with = |wrong: &[usize]| -> Vec<ForceReading> {
            (0..100).map(|nth| reading(nth, if wrong.contains(&nth) { 8.0 } else { noisy(nth) })).collect()
        };
        let (kept, left_out) = without_glitches(&with(&[3, 40, 99])).unwrap();
        assert_eq!((kept.len(), left_out.left_out), (97, 3));
        assert!((left_out.largest_n - 8.0).abs() < 0.01, "{left_out:?}");
        assert_eq!(without_glitches(&with(&[])).unwrap().1.left_out, 0);
        let many = |count: usize| with(&(0..count).collect::<Vec<_>>());
        assert_eq!(without_glitches(&many(20)).unwrap_err().rule, SafetyRule::Glitches);
        assert_eq!(without_glitches(&many(40)).unwrap().1.left_out, 0, "the force has changed");
    }
}
