//! Finds units that broke since the calibration, and units that work again.

use super::expectation::{Expectation, Prediction, is_near, mean_and_sd};
use super::{Broken, Fits, Fitted, OutputFault, Workspace};
use palpate_core::parallel::lock;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

/// Search for units at fault among the last contacts of a session. It answers no reading, so a program may run it in a thread of its own.
///
/// Each contact is compared with what the model expects, with each of the units left out that deviate most. A unit is at fault if the
/// misfit of the contacts that it should have felt is explained without it, clearly better than without any other unit. Two units are
/// left out together if no single one explains the contacts, such as two swapped ones. Misfits are compared as logarithms, with those
/// of held-out presses, so a misfit that all units share, such as that of a drift, names no unit.
pub struct FaultSearch {
    fits: Arc<Fits>,
    evidence: FaultEvidence,
    /// Outputs of the contacts, of all units.
    contacts: Vec<Vec<f64>>,
    /// Number of restarts of the session before.
    restarts: u64,
}

/// Result of a search.
pub struct SearchedFaults {
    pub(super) restarts: u64,
    pub(super) evidence: FaultEvidence,
    /// Units that are left out, and the method without them, if they changed.
    pub(super) found: Option<(Vec<Broken>, Option<Arc<Fitted>>)>,
    pub(super) changes: Vec<FaultChange>,
}

/// A change of the units that a session leaves out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultChange {
    /// The unit is at fault, and is left out from here on.
    LeftOut(FaultyUnit),
    /// The unit, counted from 0, agrees with the others again, and is used from here on.
    Back(usize),
    /// A unit is at fault, but the model has no presses to fit the method without it.
    Unfit,
}

/// A unit that broke since the calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultyUnit {
    /// The unit, counted from 0.
    pub unit: usize,
    /// Odds to one that it is at fault, and no other unit or none; of two units that are left out together, the odds of both. Larger odds
    /// than a billion aren't stated, because errors that rare aren't normal.
    pub odds: f64,
}

impl FaultyUnit {
    /// Names the output, counted from 1, and the odds.
    pub fn text(&self) -> String {
        format!("output {} contradicts the others (odds {} to 1)", self.unit + 1, self.odds)
    }
}

/// What the contacts so far showed about each unit. Units are those that the model uses, in its order.
#[derive(Clone, Default)]
pub(super) struct FaultEvidence {
    /// Units that broke in the session.
    left_out: Vec<usize>,
    contacts: VecDeque<TriedContact>,
    /// How much worse the misfit of the last contacts is with each unit that is left out.
    returns: BTreeMap<usize, VecDeque<f64>>,
    /// Whether a fault was found that can't be left out.
    is_unfit: bool,
}

/// A contact that was compared with what is expected without some units. Misfits are logarithms, compared with those of held-out presses.
#[derive(Clone)]
struct TriedContact {
    /// Outputs, in units of their typical size.
    reading: Vec<f32>,
    /// Misfit of all units.
    misfit: f64,
    /// Misfits without one or two units.
    tried: Vec<(Vec<usize>, f64)>,
    /// Units that should have felt the contact.
    felt: Vec<usize>,
}

/// Number of contacts that are remembered, and of those that a unit felt, which are compared: the last ones.
const REMEMBERED_MOST: usize = 500;
const CONTACTS_MOST: usize = 60;
/// Number of contacts from which a unit may be named.
const CONTACTS_LEAST: usize = 20;
/// Largest number of repeated outputs that count: those of contacts at one side of a skin aren't independent.
const REPEATED_MOST: usize = 30;
/// Number of units that are tried, alone and in pairs: those that deviate most.
const CANDIDATES_MOST: usize = 8;
/// Least number of units that are left.
const UNITS_LEAST: usize = 2;
/// Misfit from which no single unit explains a contact, in standard deviations of held-out presses.
const UNEXPLAINED_SD: f64 = 1.6;
/// Sufficient evidence (natural logarithm): ten thousand to one.
const ENOUGH: f64 = 9.2;
/// Largest odds that are stated.
const ODDS_MOST: f64 = 1e9;
/// Least mean gain, in standard deviations of held-out presses.
const GAIN_SD: f64 = 0.5;
/// Least fraction of the misfit that must be explained, unless the rest is within this fraction of the standard deviation.
const EXPLAINED: f64 = 0.5;
/// Largest mean gain of leaving out a unit that works again, in standard deviations of held-out presses.
const WORKS_SD: f64 = 0.5;

impl FaultSearch {
    pub(super) fn new(fits: Arc<Fits>, evidence: FaultEvidence, contacts: Vec<Vec<f64>>, restarts: u64) -> Self {
        FaultSearch { fits, evidence, contacts, restarts }
    }

    /// Searches. The result is for [`Session::accept`](super::Session::accept).
    pub fn run(self) -> SearchedFaults {
        let FaultSearch { fits, mut evidence, contacts, restarts } = self;
        let (mut changes, mut found, mut workspace) = (Vec::new(), None, Workspace::default());
        let _alone = lock(&fits.searching);
        let Some(expectation) = fits.expectation() else {
            return SearchedFaults { restarts, evidence, found, changes };
        };
        let kept = fits.model().fitted().kept();
        for contact in contacts {
            let outputs: Vec<f64> = kept.iter().map(|&unit| contact[unit]).collect();
            evidence.add(expectation, &outputs, &mut workspace);
        }
        if let Some(decision) = evidence.decide(expectation, kept.len()) {
            let left_out = decision.applied(&evidence.left_out);
            let broke: Vec<Broken> =
                left_out.iter().map(|&unit| Broken { unit: kept[unit], fault: OutputFault::Contradicts }).collect();
            let fitted = match broke.is_empty() {
                true => Ok(Ok(None)),
                false => fits.without(&broke).map(|fitted| fitted.map(Some)),
            };
            match fitted {
                Ok(Ok(fitted)) => {
                    changes.extend(decision.stated(&kept));
                    found = Some((broke, fitted));
                    evidence = FaultEvidence { left_out, ..FaultEvidence::default() };
                }
                Err(_) if !std::mem::replace(&mut evidence.is_unfit, true) => changes.push(FaultChange::Unfit),
                // an array that has too few units left continues with those it has
                _ => evidence.contacts.clear(),
            }
        }
        SearchedFaults { restarts, evidence, found, changes }
    }
}

enum Decision {
    LeaveOut { units: Vec<usize>, log_odds: f64 },
    TakeBack(usize),
}

impl Decision {
    /// Returns the units that are left out then.
    fn applied(&self, left_out: &[usize]) -> Vec<usize> {
        match self {
            Decision::LeaveOut { units, .. } => with(left_out, units),
            Decision::TakeBack(unit) => without(left_out, *unit),
        }
    }

    fn stated(self, kept: &[usize]) -> Vec<FaultChange> {
        match self {
            Decision::LeaveOut { units, log_odds } => {
                let odds = log_odds.exp().min(ODDS_MOST).round();
                units.into_iter().map(|unit| FaultChange::LeftOut(FaultyUnit { unit: kept[unit], odds })).collect()
            }
            Decision::TakeBack(unit) => vec![FaultChange::Back(kept[unit])],
        }
    }
}

impl FaultEvidence {
    /// Compares a contact with what is expected without each unit that may be at fault.
    fn add(&mut self, expectation: &Expectation, outputs: &[f64], workspace: &mut Workspace) {
        let left_out = self.left_out.clone();
        let mut compared = |units: &[usize]| -> Option<(f64, Prediction)> {
            let without = with(&left_out, units);
            let prediction = expectation.predict(outputs, &without, workspace)?;
            Some((expectation.usual(&without, &left_out).compared(prediction.log_misfit), prediction))
        };
        let Some((misfit, expected)) = compared(&[]) else { return };
        let is_felt = |unit: usize, by: &Prediction| by.is_felt(unit, outputs[unit]);
        let deviation = |unit: usize| (outputs[unit] - expected.outputs[unit]).abs() / expected.sd[unit];
        let mut candidates: Vec<usize> = (0..outputs.len()).filter(|unit| !left_out.contains(unit)).collect();
        let mut felt: Vec<usize> = candidates.iter().copied().filter(|&unit| is_felt(unit, &expected)).collect();
        let used = candidates.len();
        candidates.sort_by(|&a, &b| deviation(b).total_cmp(&deviation(a)).then(a.cmp(&b)));
        // a misfit as small as that of most held-out presses leaves nothing to explain
        let is_suspicious = used > UNITS_LEAST && misfit > 0.0;
        candidates.truncate(if is_suspicious { CANDIDATES_MOST } else { 0 });
        let mut tried: Vec<(Vec<usize>, f64)> = Vec::new();
        for &unit in &candidates {
            let Some((misfit, prediction)) = compared(&[unit]) else { continue };
            felt.retain(|other| *other != unit || is_felt(unit, &prediction));
            if is_felt(unit, &prediction) && !felt.contains(&unit) {
                felt.push(unit);
            }
            tried.push((vec![unit], misfit));
        }
        let unexplained = UNEXPLAINED_SD * expectation.usual(&left_out, &left_out).sd;
        if used > UNITS_LEAST + 1 && tried.iter().all(|(_, misfit)| *misfit > unexplained) {
            for (rank, one) in candidates.iter().enumerate() {
                for other in &candidates[rank + 1..] {
                    let pair = with(&[*one], &[*other]);
                    tried.extend(compared(&pair).map(|(misfit, _)| (pair, misfit)));
                }
            }
        }
        let reading = outputs.iter().enumerate().map(|(unit, &output)| expectation.scaled(unit, output)).collect();
        self.contacts.push_back(TriedContact { reading, misfit, tried, felt });
        if self.contacts.len() > REMEMBERED_MOST {
            self.contacts.pop_front();
        }
        for &unit in left_out.iter().filter(|unit| is_felt(**unit, &expected)) {
            let others = without(&left_out, unit);
            let Some(prediction) = expectation.predict(outputs, &others, workspace) else { continue };
            let gains = self.returns.entry(unit).or_default();
            gains.push_back(expectation.usual(&others, &others).compared(prediction.log_misfit) - misfit);
            if gains.len() > CONTACTS_MOST {
                gains.pop_front();
            }
        }
    }

    /// Returns the units to leave out or to use again, if the contacts so far are sufficient.
    fn decide(&self, expectation: &Expectation, units: usize) -> Option<Decision> {
        if let Some((unit, log_odds)) = (0..units).find_map(|unit| Some((unit, self.stuck(expectation, unit, units)?)))
        {
            return Some(Decision::LeaveOut { units: vec![unit], log_odds });
        }
        let tried = self.contacts.iter().flat_map(|contact| contact.tried.iter().map(|(suspect, _)| suspect));
        let suspects: BTreeSet<&Vec<usize>> = tried.collect();
        let sufficient = suspects.iter().filter_map(|&suspect| {
            // most end here, without a comparison with all others
            let felt = self.contacts.iter().rev().filter(|contact| contact.is_felt_by(suspect)).take(CONTACTS_MOST);
            let (gain, _) = mean_and_sd(felt.map(|contact| contact.misfit - contact.without(suspect)));
            let usual = expectation.usual(&with(&self.left_out, suspect), &self.left_out);
            let is_enough = gain >= GAIN_SD * usual.gain_sd;
            Some((suspect, is_enough.then(|| self.log_odds(expectation, suspect, &suspects, units))??))
        });
        if let Some((suspect, log_odds)) = sufficient.max_by(|a, b| a.1.total_cmp(&b.1)) {
            return Some(Decision::LeaveOut { units: suspect.clone(), log_odds });
        }
        let works = self.returns.iter().find(|(unit, gains)| {
            let usual = expectation.usual(&self.left_out, &without(&self.left_out, **unit));
            gains.len() == CONTACTS_MOST && mean_and_sd(gains.iter().copied()).0 <= WORKS_SD * usual.gain_sd
        });
        works.map(|(unit, _)| Decision::TakeBack(*unit))
    }

    /// Returns the last contacts that some units felt and of which no two are alike. `None` if they are too few.
    fn different(&self, units: &[usize], is_alike: impl Fn(&[f32], &[f32]) -> bool) -> Option<Vec<&TriedContact>> {
        let mut contacts: Vec<&TriedContact> = Vec::new();
        for contact in self.contacts.iter().rev().filter(|contact| contact.is_felt_by(units)) {
            let is_new = |other: &&TriedContact| !is_alike(&other.reading, &contact.reading);
            if contacts.len() < CONTACTS_MOST && contacts.iter().all(is_new) {
                contacts.push(contact);
            }
        }
        (contacts.len() >= CONTACTS_LEAST).then_some(contacts)
    }

    /// Returns the logarithm of the odds that a unit is stuck, if it reads exactly the same in all contacts that it should have felt.
    fn stuck(&self, expectation: &Expectation, unit: usize, units: usize) -> Option<f64> {
        let mut felt = self.contacts.iter().rev().filter(|contact| contact.is_felt_by(&[unit])).take(CONTACTS_LEAST);
        let first = felt.next()?.reading[unit];
        if self.left_out.contains(&unit) || !felt.all(|contact| contact.reading[unit] == first) {
            return None;
        }
        let contacts = self.different(&[unit], |one, other| is_near(one, other, &[unit]))?;
        let repeated = contacts.iter().take_while(|contact| contact.reading[unit] == first).count().min(REPEATED_MOST);
        let log_odds = -(repeated as f64) * expectation.repeats(unit, first)?.ln() - (units as f64).ln();
        (repeated >= CONTACTS_LEAST && log_odds >= ENOUGH).then_some(log_odds)
    }

    /// Returns the logarithm of the odds that these units are at fault, and no others or none, if the contacts that they felt are enough
    /// and are explained without them. Means of differences are normal; as many sets of units could have been chosen as there are.
    fn log_odds(
        &self,
        expectation: &Expectation,
        suspect: &[usize],
        suspects: &BTreeSet<&Vec<usize>>,
        units: usize,
    ) -> Option<f64> {
        let usual = expectation.usual(&with(&self.left_out, suspect), &self.left_out);
        // the model's errors at one place would count several times
        let contacts = self.different(suspect, |one, other| expectation.is_alike(one, other, suspect))?;
        let own: Vec<f64> = contacts.iter().map(|contact| contact.without(suspect)).collect();
        let rest = own.iter().sum::<f64>() / own.len() as f64;
        let sigmas = |other: &[usize]| {
            let difference = |(contact, own): (&&TriedContact, &f64)| contact.without(other) - own;
            let differences: Vec<f64> = contacts.iter().zip(&own).map(difference).collect();
            let (mean, sd) = mean_and_sd(differences.iter().copied());
            (mean, mean / sd.max(usual.gain_sd) * (contacts.len() as f64).sqrt())
        };
        let (gain, gain_sigmas) = sigmas(&[]);
        let sets = (0..suspect.len()).map(|chosen| ((units - chosen) as f64 / (chosen + 1) as f64).ln()).sum::<f64>();
        let needed = (2.0 * (ENOUGH + sets)).sqrt();
        let is_explained = rest <= EXPLAINED * usual.sd.max(rest + gain);
        if !is_explained || gain < GAIN_SD * usual.gain_sd || gain_sigmas < needed {
            return None;
        }
        let mut least = gain_sigmas;
        // with more units left out the misfit can only be smaller
        for other in suspects.iter().filter(|other| !suspect.iter().all(|unit| other.contains(unit))) {
            least = least.min(sigmas(other).1);
            if least < needed {
                return None;
            }
        }
        Some(0.5 * least * least - sets)
    }
}

impl TriedContact {
    /// Misfit without some units. A unit that wasn't tried deviates little, so its absence explains nothing; a pair that wasn't tried
    /// explains what its better unit does.
    fn without(&self, units: &[usize]) -> f64 {
        let of = |units: &[usize]| self.tried.iter().find(|(tried, _)| tried == units).map(|(_, misfit)| *misfit);
        let of_one = || units.iter().filter_map(|unit| of(&[*unit])).fold(self.misfit, f64::min);
        of(units).unwrap_or_else(of_one)
    }

    fn is_felt_by(&self, units: &[usize]) -> bool {
        units.iter().any(|unit| self.felt.contains(unit))
    }
}

/// Returns two sets of units as one, in order.
fn with(units: &[usize], others: &[usize]) -> Vec<usize> {
    let mut all = [units, others].concat();
    all.sort_unstable();
    all.dedup();
    all
}

fn without(units: &[usize], unit: usize) -> Vec<usize> {
    units.iter().copied().filter(|other| *other != unit).collect()
}
