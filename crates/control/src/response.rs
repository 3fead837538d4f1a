//! Outputs for each newton, compared with those of the presses around. The array is a second measurement of each contact: a load
//! cell whose gain changes, a sensor that shifts and outputs that jump all change this ratio or the pattern of the outputs.

use super::neighbours::{FieldSmoothness, LEARNED, Misses, most_changed, most_off, nearest, remember, weights};
use super::trip::{SafetyRule, Trip};
use palpate_core::quantity::Place;

/// Number of contacts that are remembered.
const CONTACTS_MAX: usize = 2048;
/// Distance over which outputs change, as a fraction of the distance between taxels; and that distance if it is unknown, mm.
const LENGTH_SHARE: f64 = 0.6;
const PITCH_MM: f64 = 4.0;
/// Standard deviation over a sensor of the logarithm of the outputs for each newton, and of their pattern as a vector of length 1.
const GAIN_SPREAD: f64 = 0.3;
const PATTERN_SPREAD: f64 = 0.6;
/// Standard deviation of both between contacts whose forces differ by a factor of e. Outputs aren't proportional to the force.
const NONLINEAR: f64 = 0.1;
/// Standard deviation of the outputs between repeated contacts, as a fraction of the largest outputs so far. A light contact repeats
/// no better than a strong one. This can't be seen without load.
const REPEATS: f64 = 0.02;

/// A contact as the array and the load cell measured it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredContact {
    /// The place, specimen frame.
    pub place: Place,
    /// The force, N.
    pub force_n: f64,
    /// Outputs relative to air, in the array's unit.
    pub outputs: Vec<f64>,
    /// Standard deviation of one output, in the array's unit, and of the force, N.
    pub sigmas: [f64; 2],
}

/// Outputs that the contacts so far have shown.
#[derive(Clone, Debug)]
pub struct LearnedOutputs {
    length_mm: f64,
    known: Vec<MeasuredContact>,
    /// Largest length of the vector of outputs.
    most: f64,
    gain: Misses,
    pattern: Misses,
}

/// Differences of a contact from the prediction, each with its predicted standard deviation.
struct Differences {
    gain: (f64, f64),
    pattern: (f64, f64),
}

impl Differences {
    fn check(&self) -> Result<(), Trip> {
        for (off, sigma) in [self.gain, self.pattern] {
            let within = off <= most_off(sigma);
            if !within {
                let percent = |share: f64| 100.0 * share;
                return Err(Trip::new(SafetyRule::OutputsDiffer, percent(off), percent(most_off(sigma)), "%"));
            }
        }
        Ok(())
    }
}

impl MeasuredContact {
    /// Outputs for each newton, in the array's unit.
    pub fn per_n(&self) -> impl Iterator<Item = f64> {
        self.outputs.iter().map(|output| output / self.force_n)
    }

    /// Length of the vector of outputs.
    fn length(&self) -> f64 {
        self.outputs.iter().map(|output| output * output).sum::<f64>().sqrt()
    }

    /// Logarithm of the outputs for each newton.
    fn gain(&self) -> f64 {
        (self.length() / self.force_n).ln()
    }

    /// Relative standard deviation by noise and by imperfect repetition alone. `most` is the largest length of the outputs so far.
    fn own(&self, most: f64) -> f64 {
        let [output, force_n] = self.sigmas;
        let outputs = (output * (self.outputs.len() as f64).sqrt()).hypot(REPEATS * most);
        (outputs / self.length()).hypot(force_n / self.force_n)
    }
}

/// Change of a contact from an earlier one at the same place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Changed {
    /// Change of the logarithm of the outputs for each newton, and its limit.
    pub gain: (f64, f64),
    /// Change of the outputs' pattern, as a vector of length 1, and its limit.
    pub pattern: (f64, f64),
}

impl LearnedOutputs {
    /// Creates a response that knows only the distance between taxels, mm, if there is one.
    pub fn new(pitch_mm: Option<f64>) -> Self {
        let length_mm = LENGTH_SHARE * pitch_mm.unwrap_or(PITCH_MM);
        LearnedOutputs { length_mm, known: Vec::new(), most: 0.0, gain: Misses::default(), pattern: Misses::default() }
    }

    /// Compares a contact with the contacts around it.
    ///
    /// # Errors
    /// A trip if the outputs for each newton, or their pattern, differ by more than the contacts so far explain.
    pub fn check(&self, felt: &MeasuredContact) -> Result<(), Trip> {
        self.differences(felt).map_or(Ok(()), |differences| differences.check())
    }

    /// Compares a contact with the contacts around it, and adds it.
    ///
    /// # Errors
    /// The same as for [`check`](Self::check); the contact isn't added then.
    pub fn take(&mut self, felt: MeasuredContact) -> Result<(), Trip> {
        let differences = self.differences(&felt);
        differences.iter().try_for_each(Differences::check)?;
        self.add(felt, differences);
        Ok(())
    }

    /// Compares a contact with an earlier one at the same place. The limits cover the noise of both, and that of the pattern also the
    /// scatter of the patterns so far. `None` if one of them shows nothing.
    pub fn compare(&self, before: &MeasuredContact, now: &MeasuredContact) -> Option<Changed> {
        if before.outputs.len() != now.outputs.len() {
            return None;
        }
        // the scatter of the gains is left out, because a changing load cell widens it
        let scatter = self.differences(now).map_or(0.0, |known| known.pattern.1);
        let nonlinear = NONLINEAR * (now.force_n / before.force_n).ln();
        let own = before.own(self.most).hypot(now.own(self.most)).hypot(nonlinear);
        let pairs = before.outputs.iter().zip(&now.outputs);
        let pattern = pairs.map(|(before_v, now_v)| now_v / now.length() - before_v / before.length());
        let changed = Changed {
            gain: (now.gain() - before.gain(), most_changed(own)),
            pattern: (pattern.map(|off| off * off).sum::<f64>().sqrt(), most_off(own.hypot(scatter))),
        };
        let all = [changed.gain.0, changed.gain.1, changed.pattern.0, changed.pattern.1];
        all.iter().all(|value| value.is_finite()).then_some(changed)
    }

    /// Share of the allowed difference that a contact uses up; `None` if too little is known.
    pub fn share(&self, felt: &MeasuredContact) -> Option<f64> {
        let Differences { gain, pattern } = self.differences(felt)?;
        Some([gain, pattern].map(|(off, sigma)| off / most_off(sigma)).into_iter().fold(0.0, f64::max))
    }

    /// Adds a contact. A contact that shows nothing isn't added. If there is no room left, it replaces the nearest one.
    pub fn learn(&mut self, felt: MeasuredContact) {
        let differences = self.differences(&felt);
        self.add(felt, differences);
    }

    fn add(&mut self, felt: MeasuredContact, differences: Option<Differences>) {
        let tells = felt.length() > 0.0 && felt.length().is_finite() && felt.force_n > 0.0;
        if !tells || self.known.first().is_some_and(|first| first.outputs.len() != felt.outputs.len()) {
            return;
        }
        if let Some(Differences { gain, pattern }) = differences {
            self.gain.learn(gain.0, gain.1);
            self.pattern.learn(pattern.0, pattern.1);
        }
        self.most = self.most.max(felt.length());
        remember(&mut self.known, felt, CONTACTS_MAX, |known| known.place);
    }

    fn differences(&self, felt: &MeasuredContact) -> Option<Differences> {
        if self.known.len() < LEARNED {
            return None;
        }
        let near: Vec<&MeasuredContact> = nearest(self.known.iter().map(|known| known.place), felt.place)
            .into_iter()
            .map(|i| &self.known[i])
            .collect();
        let places: Vec<Place> = near.iter().map(|known| known.place).collect();
        let own: Vec<f64> = near.iter().map(|known| known.own(self.most)).collect();
        let field = |spread| FieldSmoothness { length_mm: self.length_mm, spread };
        let gains = weights(&places, &own, felt.place, field(GAIN_SPREAD))?;
        let patterns = weights(&places, &own, felt.place, field(PATTERN_SPREAD))?;
        let ratios = near.iter().zip(&gains.each).map(|(known, weight)| weight * (felt.force_n / known.force_n).ln());
        // the common part isn't averaged away
        let beyond = felt.own(self.most).hypot(NONLINEAR * ratios.sum::<f64>());
        let expected: f64 = near.iter().zip(&gains.each).map(|(known, weight)| weight * known.gain()).sum();
        let mut pattern = vec![0.0; felt.outputs.len()];
        for (known, weight) in near.iter().zip(&patterns.each) {
            let scale = weight / known.length();
            pattern.iter_mut().zip(&known.outputs).for_each(|(sum, output)| *sum += scale * output);
        }
        let off = pattern.iter().zip(&felt.outputs).map(|(expected, output)| output / felt.length() - expected);
        Some(Differences {
            gain: ((felt.gain() - expected).abs(), (self.gain.scale() * gains.sigma).hypot(beyond)),
            pattern: (
                off.map(|off| off * off).sum::<f64>().sqrt(),
                (self.pattern.scale() * patterns.sigma).hypot(beyond),
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nine taxels whose outputs fall off with the distance from the contact.
    fn felt(x_mm: f64, y_mm: f64, gain: f64) -> MeasuredContact {
        let taxels = (0..9).map(|i| (4.5 * f64::from(i % 3 - 1), 4.5 * f64::from(i / 3 - 1)));
        let output = |(u, v): (f64, f64)| gain * (-((x_mm - u).powi(2) + (y_mm - v).powi(2)) / 20.0).exp();
        let (place, outputs) = (Place::new(x_mm, y_mm), taxels.map(output).collect());
        MeasuredContact { place, force_n: 1.0, outputs, sigmas: [0.001, 0.001] }
    }

    fn learned(spacing_mm: f64) -> LearnedOutputs {
        let mut response = LearnedOutputs::new(Some(4.5));
        for i in 0..49 {
            let contact = felt(spacing_mm * (f64::from(i % 7) - 3.0), spacing_mm * (f64::from(i / 7) - 3.0), 1.0);
            assert_eq!(response.check(&contact), Ok(()), "{i}");
            response.learn(contact);
        }
        response
    }

    #[test]
    fn halved_or_doubled_gain_and_shifted_or_jumping_sensor_are_found() {
        let response = learned(0.5);
        let rule = |felt: MeasuredContact| response.check(&felt).err().map(|trip| trip.rule);
        assert_eq!(rule(felt(0.3, -0.7, 1.05)), None);
        for gain in [0.5, 2.0, 1000.0] {
            assert_eq!(rule(felt(0.3, -0.7, gain)), Some(SafetyRule::OutputsDiffer), "{gain}");
        }
        let shifted = MeasuredContact { place: Place::new(0.3, -0.7), ..felt(3.3, -0.7, 1.0) };
        assert_eq!(rule(shifted), Some(SafetyRule::OutputsDiffer));
        let mut taking = response.clone();
        assert_eq!(taking.take(felt(0.3, -0.7, 2.0)).unwrap_err().rule, SafetyRule::OutputsDiffer);
        assert_eq!((taking.known.len(), taking.take(felt(0.3, -0.7, 1.05))), (49, Ok(())), "it isn't learned");
        assert_eq!(taking.known.len(), 50);
        let not_a_number = MeasuredContact { outputs: vec![f64::NAN; 9], ..felt(0.3, -0.7, 1.0) };
        assert_eq!(rule(not_a_number), Some(SafetyRule::OutputsDiffer));
    }

    #[test]
    fn a_contact_is_compared_with_an_earlier_one_at_its_place() {
        let (response, before) = (LearnedOutputs::new(Some(4.5)), felt(0.3, -0.7, 1.0));
        let changed = |now: MeasuredContact| response.compare(&before, &now);
        let Changed { gain, pattern } = changed(felt(0.3, -0.7, 1.5)).unwrap();
        assert!((gain.0 - 1.5f64.ln()).abs() < 1e-9 && gain.0 > gain.1 && pattern.0 < 1e-9, "{gain:?} {pattern:?}");
        let Changed { gain, pattern } =
            changed(MeasuredContact { place: before.place, ..felt(3.3, -0.7, 1.0) }).unwrap();
        assert!(pattern.0 > pattern.1, "{gain:?} {pattern:?}");
        assert_eq!(changed(MeasuredContact { outputs: vec![0.0; 9], ..before.clone() }), None);
        assert_eq!(changed(MeasuredContact { outputs: vec![f64::NAN; 9], ..before.clone() }), None);
        assert_eq!(changed(MeasuredContact { outputs: vec![1.0; 8], ..before.clone() }), None);
    }

    #[test]
    fn change_during_the_run_does_not_widen_the_limits_of_its_check() {
        let mut response = LearnedOutputs::new(Some(4.5));
        for i in 0..15 {
            let gain = if i < 7 { 1.0 } else { 1.0 / 0.7 };
            response.learn(felt(2.0 * f64::from(i % 4) - 3.0, 2.0 * f64::from(i / 4) - 3.0, gain));
        }
        let Changed { gain, .. } = response.compare(&felt(-3.0, -3.0, 1.0), &felt(-3.0, -3.0, 1.0 / 0.7)).unwrap();
        assert!(gain.0 > gain.1, "{gain:?}");
    }

    #[test]
    fn press_without_neighbours_has_no_prediction() {
        let response = learned(0.5);
        assert_eq!(response.check(&felt(20.0, 0.0, 0.5)), Ok(()));
        assert_eq!(LearnedOutputs::new(None).check(&felt(0.0, 0.0, 2.0)), Ok(()));
    }

    #[test]
    fn a_force_far_from_those_learned_is_compared_less_strictly() {
        let response = learned(0.5);
        let light = |gain: f64| MeasuredContact { force_n: 0.1, ..felt(0.3, -0.7, 0.1 * gain) };
        assert_eq!(response.check(&light(1.6)), Ok(()));
        assert!(response.check(&light(8.0)).is_err());
    }
}
