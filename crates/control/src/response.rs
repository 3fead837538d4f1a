//! Outputs for each newton, compared with those of the first press at the place and of the presses around. The array is a second
//! measurement of each contact: a load cell whose gain changes, a sensor that shifts and outputs that jump all change this ratio or
//! the pattern of the outputs.

use super::neighbours::{
    FieldSmoothness, LEARNED, Misses, SAME_MM, most_changed, most_off, most_off_by, nearest, remember, weights,
};
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
/// Standard deviation of the outputs between repeated contacts, as a fraction of the largest outputs until the earlier one. A light contact
/// repeats no better than a strong one. This can't be seen without load.
const REPEATS: f64 = 0.02;
/// Part of the force limit whose outputs count as the largest outputs, if no contact so far had larger ones: a run can have light presses only.
const LARGE_SHARE: f64 = 0.5;

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
    force_limit_n: f64,
    /// The first contact at each place.
    known: Vec<KnownContact>,
    gain: Misses,
    pattern: Misses,
    /// Changes of the pattern at places that were pressed again.
    again: Misses,
}

/// A contact, and the largest length of the vector of outputs until then. Later contacts, which a fault may change, don't change it.
#[derive(Clone, Debug)]
struct KnownContact {
    contact: MeasuredContact,
    most: f64,
}

/// Differences of a contact from what is expected, each with its standard deviation.
struct Differences {
    gain: (f64, f64),
    pattern: (f64, f64),
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

    fn distance_mm(&self, place: Place) -> f64 {
        self.place.distance_mm(place)
    }
}

/// Change of a contact from an earlier one at the same place, or from what other places predict.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Changed {
    /// Change of the logarithm of the outputs for each newton, and its limit.
    pub gain: (f64, f64),
    /// Change of the outputs' pattern, as a vector of length 1, and its limit.
    pub pattern: (f64, f64),
}

impl Changed {
    fn check(&self) -> Result<(), Trip> {
        for (off, limit) in [self.gain, self.pattern] {
            let is_within = off.abs() <= limit;
            if !is_within {
                return Err(Trip::new(SafetyRule::OutputsDiffer, 100.0 * off.abs(), 100.0 * limit, "%"));
            }
        }
        Ok(())
    }

    /// Share of the limits that is used up.
    fn share(&self) -> f64 {
        [self.gain, self.pattern].map(|(off, limit)| off.abs() / limit).into_iter().fold(0.0, f64::max)
    }
}

impl LearnedOutputs {
    /// Creates a response that knows only the force limit, N, and the distance between taxels, mm, if there is one.
    pub fn new(pitch_mm: Option<f64>, force_limit_n: f64) -> Self {
        let length_mm = LENGTH_SHARE * pitch_mm.unwrap_or(PITCH_MM);
        LearnedOutputs {
            length_mm,
            force_limit_n,
            known: Vec::new(),
            gain: Misses::default(),
            pattern: Misses::default(),
            again: Misses::default(),
        }
    }

    /// Compares a contact with the first one at its place, and with the contacts around it.
    ///
    /// # Errors
    /// A trip if the outputs for each newton, or their pattern, differ by more than noise, imperfect repetition and the contacts so far
    /// explain.
    pub fn check(&self, felt: &MeasuredContact) -> Result<(), Trip> {
        self.changes(felt).iter().flatten().try_for_each(Changed::check)
    }

    /// Compares a contact with an earlier one at the same place. The limits cover the noise of both. `None` if one of them shows nothing.
    pub fn compare(&self, before: &MeasuredContact, now: &MeasuredContact) -> Option<Changed> {
        let Differences { gain, pattern } = self.repeated(before, now)?;
        let changed = Changed { gain: (gain.0, most_changed(gain.1)), pattern: (pattern.0, most_off(pattern.1)) };
        let all = [changed.gain.0, changed.gain.1, changed.pattern.0, changed.pattern.1];
        all.iter().all(|value| value.is_finite()).then_some(changed)
    }

    /// Share of the allowed difference that a contact uses up; `None` if there is nothing to compare it with.
    pub fn share(&self, felt: &MeasuredContact) -> Option<f64> {
        self.changes(felt).iter().flatten().map(Changed::share).reduce(f64::max)
    }

    /// Adds a contact at a new place. A contact that shows nothing isn't added. If there is no room left, it replaces the nearest one.
    pub fn learn(&mut self, felt: MeasuredContact) {
        let tells = felt.length() > 0.0 && felt.length().is_finite() && felt.force_n > 0.0;
        if !tells || self.known.first().is_some_and(|first| first.contact.outputs.len() != felt.outputs.len()) {
            return;
        }
        if let Some(first) = self.at(felt.place) {
            if let Some(Differences { pattern, .. }) = self.repeated(&first.contact, &felt) {
                self.again.learn(pattern.0, self.again.scale() * pattern.1, 0.0);
            }
            return;
        }
        if self.known.len() >= LEARNED {
            self.learn_miss(&felt);
        }
        let most = self.known.last().map_or(0.0, |last| last.most).max(felt.length());
        remember(&mut self.known, KnownContact { contact: felt, most }, CONTACTS_MAX, |known| known.contact.place);
        if self.known.len() == LEARNED {
            let contacts: Vec<MeasuredContact> = self.known.iter().map(|known| known.contact.clone()).collect();
            contacts.iter().for_each(|contact| self.learn_miss(contact));
        }
    }

    /// Adds how far the contacts at other places miss a contact.
    fn learn_miss(&mut self, felt: &MeasuredContact) {
        if let Some((Differences { gain, pattern }, nearest_mm)) = self.predicted(felt) {
            self.gain.learn(gain.0, gain.1, nearest_mm);
            self.pattern.learn(pattern.0, pattern.1, nearest_mm);
        }
    }

    /// Relative standard deviation of a contact by noise and by imperfect repetition alone. `most` is the largest length of the outputs.
    fn own(&self, contact: &MeasuredContact, most: f64) -> f64 {
        let [output, force_n] = contact.sigmas;
        let most = most.max(LARGE_SHARE * self.force_limit_n / contact.force_n * contact.length());
        let outputs = (output * (contact.outputs.len() as f64).sqrt()).hypot(REPEATS * most);
        (outputs / contact.length()).hypot(force_n / contact.force_n)
    }

    /// First contact at a place.
    fn at(&self, place: Place) -> Option<&KnownContact> {
        self.known.iter().find(|known| known.contact.distance_mm(place) < SAME_MM)
    }

    /// Returns the changes of a contact from the first one at its place, and from what the other places predict.
    fn changes(&self, felt: &MeasuredContact) -> [Option<Changed>; 2] {
        let first = self.at(felt.place).and_then(|first| self.repeated(&first.contact, felt));
        let again = first.map(|Differences { gain, pattern }| Changed {
            gain: (gain.0, most_off(gain.1)),
            pattern: (pattern.0, most_off(self.again.scale().max(1.0) * pattern.1)),
        });
        let around = self.predicted(felt).map(|(Differences { gain, pattern }, nearest_mm)| {
            let limit = |misses: &Misses, sigma: f64| match misses.have_tested(nearest_mm) {
                true => most_off_by(misses.sigmas(), sigma),
                false => f64::INFINITY,
            };
            Changed { gain: (gain.0, limit(&self.gain, gain.1)), pattern: (pattern.0, limit(&self.pattern, pattern.1)) }
        });
        [again, around]
    }

    /// Returns the differences of a contact from an earlier one at the same place; `None` if they have other outputs.
    fn repeated(&self, before: &MeasuredContact, now: &MeasuredContact) -> Option<Differences> {
        if before.outputs.len() != now.outputs.len() {
            return None;
        }
        let most = self.at(before.place).map_or(0.0, |first| first.most).max(before.length());
        let nonlinear = NONLINEAR * (now.force_n / before.force_n).ln();
        let own = self.own(before, most).hypot(self.own(now, most)).hypot(nonlinear);
        let pairs = before.outputs.iter().zip(&now.outputs);
        let pattern = pairs.map(|(before_v, now_v)| now_v / now.length() - before_v / before.length());
        let pattern = pattern.map(|off| off * off).sum::<f64>().sqrt();
        Some(Differences { gain: (now.gain() - before.gain(), own), pattern: (pattern, own) })
    }

    /// Returns the differences of a contact from what the contacts at other places predict, and the distance of the nearest one, mm. `None`
    /// if there are too few of them.
    fn predicted(&self, felt: &MeasuredContact) -> Option<(Differences, f64)> {
        let others: Vec<&KnownContact> =
            self.known.iter().filter(|known| known.contact.distance_mm(felt.place) >= SAME_MM).collect();
        if others.len() + 1 < LEARNED {
            return None;
        }
        let near: Vec<&KnownContact> = nearest(others.iter().map(|known| known.contact.place), felt.place)
            .into_iter()
            .map(|i| others[i])
            .collect();
        let places: Vec<Place> = near.iter().map(|known| known.contact.place).collect();
        let own: Vec<f64> = near.iter().map(|known| self.own(&known.contact, known.most)).collect();
        let most = near.iter().map(|known| known.most).fold(0.0, f64::max);
        let near: Vec<&MeasuredContact> = near.into_iter().map(|known| &known.contact).collect();
        let field = |spread| FieldSmoothness { length_mm: self.length_mm, spread };
        let gains = weights(&places, &own, felt.place, field(GAIN_SPREAD))?;
        let patterns = weights(&places, &own, felt.place, field(PATTERN_SPREAD))?;
        let ratios = near.iter().zip(&gains.each).map(|(known, weight)| weight * (felt.force_n / known.force_n).ln());
        // the common part isn't averaged away
        let beyond = self.own(felt, most).hypot(NONLINEAR * ratios.sum::<f64>());
        let expected: f64 = near.iter().zip(&gains.each).map(|(known, weight)| weight * known.gain()).sum();
        let mut pattern = vec![0.0; felt.outputs.len()];
        for (known, weight) in near.iter().zip(&patterns.each) {
            let scale = weight / known.length();
            pattern.iter_mut().zip(&known.outputs).for_each(|(sum, output)| *sum += scale * output);
        }
        let off = pattern.iter().zip(&felt.outputs).map(|(expected, output)| output / felt.length() - expected);
        let differences = Differences {
            gain: ((felt.gain() - expected).abs(), (self.gain.scale() * gains.sigma).hypot(beyond)),
            pattern: (
                off.map(|off| off * off).sum::<f64>().sqrt(),
                (self.pattern.scale() * patterns.sigma).hypot(beyond),
            ),
        };
        Some((differences, near[0].distance_mm(felt.place)))
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

    /// Adds a contact that is like those before.
    fn taken(response: &mut LearnedOutputs, felt: MeasuredContact) -> Result<(), Trip> {
        response.check(&felt)?;
        response.learn(felt);
        Ok(())
    }

    fn learned(spacing_mm: f64) -> LearnedOutputs {
        let mut response = LearnedOutputs::new(Some(4.5), 2.0);
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
        assert_eq!(taken(&mut taking, felt(0.3, -0.7, 2.0)).unwrap_err().rule, SafetyRule::OutputsDiffer);
        assert_eq!(taking.known.len(), 49);
        assert_eq!(taken(&mut taking, felt(0.3, -0.7, 1.05)), Ok(()));
        assert_eq!(taking.known.len(), 50);
        let not_a_number = MeasuredContact { outputs: vec![f64::NAN; 9], ..felt(0.3, -0.7, 1.0) };
        assert_eq!(rule(not_a_number), Some(SafetyRule::OutputsDiffer));
    }

    #[test]
    fn a_contact_is_compared_with_an_earlier_one_at_its_place() {
        let (response, before) = (LearnedOutputs::new(Some(4.5), 2.0), felt(0.3, -0.7, 1.0));
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
        let mut response = LearnedOutputs::new(Some(4.5), 2.0);
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
        assert_eq!(LearnedOutputs::new(None, 2.0).check(&felt(0.0, 0.0, 2.0)), Ok(()));
    }

    #[test]
    fn a_force_far_from_those_learned_is_compared_less_strictly() {
        let response = learned(0.5);
        let light = |gain: f64| MeasuredContact { force_n: 0.1, ..felt(0.3, -0.7, 0.1 * gain) };
        assert_eq!(response.check(&light(1.6)), Ok(()));
        assert!(response.check(&light(8.0)).is_err());
    }

    #[test]
    fn a_place_that_was_pressed_before_is_compared_with_its_first_press() {
        let mut response = LearnedOutputs::new(Some(4.5), 2.0);
        for x_mm in [-4.5, 4.5] {
            assert_eq!(taken(&mut response, felt(x_mm, 0.0, 1.0)), Ok(()));
        }
        assert_eq!(response.check(&felt(0.0, 0.0, 1.5)), Ok(()), "a new place");
        assert_eq!(taken(&mut response, felt(4.505, 0.0, 1.1)), Ok(()));
        for changed in
            [felt(4.505, 0.0, 1.0 / 0.65), MeasuredContact { place: Place::new(4.5, 0.0), ..felt(1.5, 0.0, 1.0) }]
        {
            assert_eq!(response.check(&changed).unwrap_err().rule, SafetyRule::OutputsDiffer);
        }
        assert_eq!(response.known.len(), 2, "a place is known by its first press");
    }

    #[test]
    fn presses_at_few_places_predict_nothing_elsewhere() {
        let mut response = LearnedOutputs::new(Some(10.0), 2.0);
        let places = [(-4.0, 0.0), (4.0, 0.0), (0.0, -4.0), (0.0, 4.0), (0.0, 0.0)];
        for (x_mm, y_mm) in places.into_iter().flat_map(|at| [at; 20]) {
            assert_eq!(taken(&mut response, felt(x_mm, y_mm, 1.0)), Ok(()));
        }
        assert_eq!(response.check(&felt(4.0, 4.0, 3.0)), Ok(()));
    }

    #[test]
    fn outputs_that_a_fault_makes_large_do_not_widen_the_limits_of_its_check() {
        let reference = felt(-3.0, -3.0, 1.0);
        for scale in [1.3, 3.0, 100.0, 1000.0] {
            let mut response = LearnedOutputs::new(Some(4.5), 2.0);
            for i in 0..9 {
                let gain = if i < 4 { 1.0 } else { scale };
                response.learn(felt(2.0 * f64::from(i % 3) - 3.0, 2.0 * f64::from(i / 3) - 3.0, gain));
            }
            let Changed { gain, .. } = response.compare(&reference, &felt(-3.0, -3.0, scale)).unwrap();
            assert!(gain.0 > gain.1, "{scale}: {gain:?}");
        }
    }

    #[test]
    fn a_light_press_may_repeat_as_badly_as_one_of_half_the_limit() {
        let response = LearnedOutputs::new(Some(4.5), 2.0);
        let light = |gain: f64| MeasuredContact { force_n: 0.2, ..felt(0.0, 0.0, 0.2 * gain) };
        let Changed { gain, .. } = response.compare(&light(1.0), &light(1.5)).unwrap();
        assert!(gain.0 < gain.1, "{gain:?}");
        let Changed { gain, .. } = response.compare(&felt(0.0, 0.0, 1.0), &felt(0.0, 0.0, 1.5)).unwrap();
        assert!(gain.0 > gain.1, "{gain:?}");
    }
}
