//! Finds units that broke since the calibration, and units that work again.

use super::expectation::{Expectation, ExpectedContact, MOST_SETS, UsualMisfit, is_near, mean_and_sd};
use super::search_schedule::{CONTACTS_LEAST, SearchWork, Shown};
use super::{Broken, Fits, Fitted, OutputFault, Workspace};
use std::sync::Arc;

/// Search for units at fault among the last contacts of a session. It answers no reading, so a program may run it in a thread of its own.
///
/// Each contact is compared with what the model expects, with each of the units left out that deviate most. A unit is at fault if the
/// misfit of the contacts that it should have felt is explained without it, clearly better than without any other unit. Two units are
/// left out together if no single one explains the contacts, such as two swapped ones. Misfits are compared as logarithms, with those
/// of held-out presses, so a misfit that all units share, such as that of a drift, names no unit.
pub struct FaultSearch {
    pub(super) fits: Arc<Fits>,
    /// Outputs of the contacts, of all units; the newest last.
    pub(super) contacts: Vec<Vec<f64>>,
    /// Units that broke in the session.
    pub(super) broke: Vec<Broken>,
    pub(super) work: SearchWork,
    /// Sets of units whose usual misfits the session has paid for.
    pub(super) paid: Vec<Vec<usize>>,
    /// Whether the credit suffices for trying units.
    pub(super) may_try: bool,
    /// Number of restarts of the session before.
    pub(super) restarts: u64,
}

/// Result of a search.
pub struct SearchedFaults {
    pub(super) restarts: u64,
    /// Work that it needed.
    pub(super) spent: u64,
    pub(super) shown: Shown,
    /// Sets of units whose usual misfits the session has paid for.
    pub(super) paid: Vec<Vec<usize>>,
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

/// The contacts of a search, compared with what is expected without some units. Units are those that the model uses, in its order.
struct Comparison<'a> {
    expectation: &'a Expectation,
    units: usize,
    /// Units that broke in the session.
    left_out: Vec<usize>,
    /// The newest first.
    contacts: Vec<ComparedContact>,
    /// Number of contacts that each unit felt.
    felt: Vec<usize>,
    /// Misfits of good contacts without the units that are left out.
    usual: UsualMisfit,
    /// Sets of one or two units that are tried.
    suspects: Vec<Vec<usize>>,
    work: SearchWork,
    paid: Vec<Vec<usize>>,
    spent: u64,
    workspace: Workspace,
}

/// A contact that was compared with what is expected without some units. Misfits are logarithms, compared with those of held-out presses.
struct ComparedContact {
    contact: ExpectedContact,
    /// Outputs, in units of their typical size.
    reading: Vec<f32>,
    /// Misfit of all units.
    misfit: f64,
    /// Deviation of each unit from what is expected, in standard deviations.
    deviations: Vec<f64>,
    /// Misfits without each set of suspects; `None` if it wasn't tried.
    tried: Vec<Option<f64>>,
    /// Whether each unit felt the contact, or should have felt it.
    is_felt: Vec<bool>,
}

/// Number of units that are tried, alone and in pairs: those that deviate most.
const CANDIDATES_MOST: usize = 8;
/// Least number of units that are left.
const UNITS_LEAST: usize = 2;
/// Largest number of repeated outputs that count: those of contacts at one side of a skin aren't independent.
const REPEATED_MOST: usize = 30;
/// Largest number of contacts that a unit felt, which are compared: the last ones. Least number of them from which it may be used again.
const CONTACTS_MOST: usize = 60;
const FELT_AGAIN_LEAST: usize = 30;
/// Mean misfit from which misfits are larger than usual, in standard errors.
const SUSPICIOUS_SD: f64 = 2.5;
/// Mean deviation from which a unit is suspicious, in standard deviations; that of a single contact counts up to the second constant. Least
/// number of such contacts.
const DEVIATES_SD: f64 = 2.0;
const DEVIATES_MOST_SD: f64 = 5.0;
const DEVIATES_IN: usize = 5;
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
    /// Searches. The result is for [`Session::accept`](super::Session::accept).
    pub fn run(self) -> SearchedFaults {
        let FaultSearch { fits, contacts, broke, work, paid, may_try, restarts } = self;
        let nothing =
            |spent, shown, paid| SearchedFaults { restarts, spent, shown, paid, found: None, changes: Vec::new() };
        let Some(expectation) = fits.expectation() else { return nothing(0, Shown::Usual, paid) };
        let kept = fits.model().fitted().kept();
        let left_out = broke.iter().filter_map(|broken| kept.iter().position(|unit| *unit == broken.unit)).collect();
        let mut comparison = Comparison::new(expectation, kept.len(), left_out, work, paid);
        for contact in contacts.iter().rev() {
            comparison.add(kept.iter().map(|&unit| contact[unit]).collect());
            if comparison.all_felt(CONTACTS_MOST) {
                break;
            }
        }
        let shown = comparison.shown();
        let mut decision = comparison.stuck();
        if decision.is_none() && shown == Shown::Suspicious && may_try && comparison.may_name() {
            comparison.try_candidates();
            decision = comparison.contradicting();
        }
        let decision = decision.or_else(|| comparison.works_again());
        let Comparison { left_out, spent, paid, .. } = comparison;
        let searched = nothing(spent, shown, paid);
        let Some(decision) = decision else { return searched };
        let broke: Vec<Broken> = decision
            .applied(&left_out)
            .iter()
            .map(|&unit| Broken { unit: kept[unit], fault: OutputFault::Contradicts })
            .collect();
        let fitted = match broke.is_empty() {
            true => Ok(Ok(None)),
            false => fits.without(&broke).map(|fitted| fitted.map(Some)),
        };
        match fitted {
            Ok(Ok(fitted)) => {
                SearchedFaults { found: Some((broke, fitted)), changes: decision.stated(&kept), ..searched }
            }
            Err(_) => SearchedFaults { changes: vec![FaultChange::Unfit], ..searched },
            // an array that has too few units left continues with those it has
            Ok(Err(_)) => searched,
        }
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

impl<'a> Comparison<'a> {
    fn new(
        expectation: &'a Expectation,
        units: usize,
        left_out: Vec<usize>,
        work: SearchWork,
        paid: Vec<Vec<usize>>,
    ) -> Self {
        Comparison {
            expectation,
            units,
            usual: expectation.usual(&left_out, &left_out),
            left_out,
            contacts: Vec::new(),
            felt: vec![0; units],
            suspects: Vec::new(),
            work,
            paid,
            spent: 0,
            workspace: Workspace::default(),
        }
    }

    /// Compares a contact with what is expected without the units that are left out.
    fn add(&mut self, outputs: Vec<f64>) {
        self.spent += self.work.contact;
        let contact = self.expectation.contact(outputs);
        let Some(expected) = self.expectation.predict(&contact, &self.left_out, &mut self.workspace) else { return };
        let misfit = self.usual.compared(expected.log_misfit);
        let outputs = contact.outputs();
        let deviation = |(unit, output): (usize, &f64)| (output - expected.outputs[unit]).abs() / expected.sd[unit];
        let scaled = |(unit, output): (usize, &f64)| self.expectation.scaled(unit, *output);
        let is_felt: Vec<bool> = (0..self.units).map(|unit| expected.is_felt(unit, outputs[unit])).collect();
        self.felt.iter_mut().zip(&is_felt).for_each(|(felt, is_felt)| *felt += usize::from(*is_felt));
        self.contacts.push(ComparedContact {
            reading: outputs.iter().enumerate().map(scaled).collect(),
            misfit,
            deviations: outputs.iter().enumerate().map(deviation).collect(),
            tried: Vec::new(),
            is_felt,
            contact,
        });
    }

    /// Units that aren't left out.
    fn used(&self) -> impl Iterator<Item = usize> {
        (0..self.units).filter(|unit| !self.left_out.contains(unit))
    }

    /// Whether each unit felt so many contacts.
    fn all_felt(&self, least: usize) -> bool {
        self.contacts.len() >= least && self.used().all(|unit| self.felt[unit] >= least)
    }

    /// Whether the mean misfit is larger than that of good contacts, or a unit deviates in most contacts that it felt.
    fn shown(&self) -> Shown {
        let last = || self.contacts.iter().take(CONTACTS_MOST).map(|contact| contact.misfit);
        let ((mean, _), count) = (mean_and_sd(last()), last().count() as f64);
        if mean * count.sqrt() > SUSPICIOUS_SD * self.usual.sd
            || self.used().any(|unit| self.deviates(unit, DEVIATES_IN))
        {
            Shown::Suspicious
        } else if self.all_felt(CONTACTS_LEAST) {
            Shown::Usual
        } else {
            Shown::TooFew
        }
    }

    /// Whether the contacts may suffice for naming a unit: many misfits are large, or a unit deviates in as many as are needed.
    fn may_name(&self) -> bool {
        let last = self.contacts.iter().take(CONTACTS_MOST);
        let large = last.filter(|contact| contact.misfit > self.usual.sd).count();
        2 * large >= CONTACTS_LEAST || self.used().any(|unit| self.deviates(unit, CONTACTS_LEAST))
    }

    /// Whether a unit deviates in the last contacts that it felt, if it felt so many.
    fn deviates(&self, unit: usize, least: usize) -> bool {
        let felt = self.contacts.iter().filter(|contact| contact.is_felt[unit]).take(CONTACTS_MOST);
        let (count, sum) = felt
            .fold((0, 0.0), |(count, sum), contact| (count + 1, sum + contact.deviations[unit].min(DEVIATES_MOST_SD)));
        count >= least && sum > DEVIATES_SD * count as f64
    }

    /// Compares the contacts without each unit that may be at fault, and without pairs of them.
    fn try_candidates(&mut self) {
        let used = self.units - self.left_out.len();
        if used <= UNITS_LEAST {
            return;
        }
        let candidates = self.candidates();
        for &unit in &candidates {
            self.try_without(vec![unit], |contact| contact.misfit > 0.0);
        }
        let unexplained = UNEXPLAINED_SD * self.usual.sd;
        if used > UNITS_LEAST + 1 {
            let singles = candidates.len();
            let is_unexplained = |contact: &ComparedContact| {
                contact.misfit > 0.0 && contact.tried[..singles].iter().flatten().all(|misfit| *misfit > unexplained)
            };
            for (rank, one) in candidates.iter().enumerate() {
                for other in &candidates[rank + 1..] {
                    self.try_without(with(&[*one], &[*other]), is_unexplained);
                }
            }
        }
    }

    /// Returns the units that deviate most in the contacts with the larger misfits: a misfit as small as that of most held-out presses
    /// leaves nothing to explain.
    fn candidates(&self) -> Vec<usize> {
        let mut scores: Vec<(f64, usize)> =
            (0..self.units).filter(|unit| !self.left_out.contains(unit)).map(|unit| (0.0, unit)).collect();
        for contact in self.contacts.iter().filter(|contact| contact.misfit > 0.0) {
            let by_deviation = |a: &(f64, usize), b: &(f64, usize)| {
                contact.deviations[b.1].total_cmp(&contact.deviations[a.1]).then(a.1.cmp(&b.1))
            };
            let most = CANDIDATES_MOST.min(scores.len());
            scores.select_nth_unstable_by(most - 1, by_deviation);
            scores[..most].sort_by(by_deviation);
            scores[..most].iter_mut().enumerate().for_each(|(rank, score)| score.0 += 1.0 / (rank + 1) as f64);
        }
        scores.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        scores.into_iter().take(CANDIDATES_MOST).filter(|(score, _)| *score > 0.0).map(|(_, unit)| unit).collect()
    }

    /// Compares those contacts without a set of units.
    fn try_without(&mut self, suspect: Vec<usize>, is_tried: impl Fn(&ComparedContact) -> bool) {
        let without = with(&self.left_out, &suspect);
        let usual = self.expectation.usual(&without, &self.left_out);
        self.pay_usual(&without);
        let mut count = 0;
        for contact in self.contacts.iter_mut() {
            let mut tried = None;
            if count < CONTACTS_MOST && is_tried(contact) && contact.may_show(&suspect) {
                count += 1;
                self.spent += self.work.set;
                if let Some(prediction) = self.expectation.predict(&contact.contact, &without, &mut self.workspace) {
                    if let [unit] = suspect[..] {
                        contact.is_felt[unit] = prediction.is_felt(unit, contact.contact.outputs()[unit]);
                    }
                    tried = Some(usual.compared(prediction.log_misfit));
                }
            }
            contact.tried.push(tried);
        }
        self.suspects.push(suspect);
    }

    /// Pays for the usual misfits without these units, once.
    fn pay_usual(&mut self, without: &[usize]) {
        if !self.paid.iter().any(|units| units == without) {
            self.spent += self.expectation.held_out_count() as u64 * self.work.set;
            if self.paid.len() == MOST_SETS {
                self.paid.remove(0);
            }
            self.paid.push(without.to_vec());
        }
    }

    /// Returns a unit that reads exactly the same in all contacts that it should have felt.
    fn stuck(&self) -> Option<Decision> {
        (0..self.units).find_map(|unit| {
            let log_odds = self.stuck_log_odds(unit)?;
            Some(Decision::LeaveOut { units: vec![unit], log_odds })
        })
    }

    /// Returns the units that contradict all others, if the contacts are sufficient.
    fn contradicting(&self) -> Option<Decision> {
        let sufficient = (0..self.suspects.len()).filter_map(|suspect| Some((suspect, self.log_odds(suspect)?)));
        let (suspect, log_odds) = sufficient.max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Decision::LeaveOut { units: self.suspects[suspect].clone(), log_odds })
    }

    /// Returns a unit that was left out and agrees with the others again.
    fn works_again(&mut self) -> Option<Decision> {
        for unit in self.left_out.clone() {
            let others = without(&self.left_out, unit);
            self.pay_usual(&others);
            let usual = self.expectation.usual(&others, &others);
            let mut gains = Vec::new();
            for contact in self.contacts.iter().filter(|contact| contact.is_felt[unit]).take(CONTACTS_MOST) {
                self.spent += self.work.set;
                let prediction = self.expectation.predict(&contact.contact, &others, &mut self.workspace);
                gains.extend(prediction.map(|with| usual.compared(with.log_misfit) - contact.misfit));
            }
            let gain_sd = self.expectation.usual(&self.left_out, &others).gain_sd;
            if gains.len() >= FELT_AGAIN_LEAST && mean_and_sd(gains.iter().copied()).0 <= WORKS_SD * gain_sd {
                return Some(Decision::TakeBack(unit));
            }
        }
        None
    }

    /// Returns the last contacts that some units felt and of which no two are alike. `None` if they are too few.
    fn different(&self, units: &[usize], is_alike: impl Fn(&[f32], &[f32]) -> bool) -> Option<Vec<&ComparedContact>> {
        let mut contacts: Vec<&ComparedContact> = Vec::new();
        for contact in self.contacts.iter().filter(|contact| contact.is_felt_by(units)) {
            let is_new = |other: &&ComparedContact| !is_alike(&other.reading, &contact.reading);
            if contacts.len() < CONTACTS_MOST && contacts.iter().all(is_new) {
                contacts.push(contact);
            }
        }
        (contacts.len() >= CONTACTS_LEAST).then_some(contacts)
    }

    /// Returns the logarithm of the odds that a unit is stuck, if it reads exactly the same in all contacts that it should have felt.
    fn stuck_log_odds(&self, unit: usize) -> Option<f64> {
        let mut felt = self.contacts.iter().filter(|contact| contact.is_felt[unit]).take(CONTACTS_LEAST);
        let first = felt.next()?.reading[unit];
        if self.left_out.contains(&unit) || !felt.all(|contact| contact.reading[unit] == first) {
            return None;
        }
        let contacts = self.different(&[unit], |one, other| is_near(one, other, &[unit]))?;
        let repeated = contacts.iter().take_while(|contact| contact.reading[unit] == first).count().min(REPEATED_MOST);
        let log_odds = -(repeated as f64) * self.expectation.repeats(unit, first)?.ln() - (self.units as f64).ln();
        (repeated >= CONTACTS_LEAST && log_odds >= ENOUGH).then_some(log_odds)
    }

    /// Returns the logarithm of the odds that these units are at fault, and no others or none, if the contacts that they felt are enough
    /// and are explained without them. Means of differences are normal; as many sets of units could have been chosen as there are.
    fn log_odds(&self, suspect: usize) -> Option<f64> {
        let units = &self.suspects[suspect];
        let usual = self.expectation.usual(&with(&self.left_out, units), &self.left_out);
        // the model's errors at one place would count several times
        let contacts = self.different(units, |one, other| self.expectation.is_alike(one, other, units))?;
        let own: Vec<f64> = contacts.iter().map(|contact| self.misfit_without(contact, suspect)).collect();
        let rest = own.iter().sum::<f64>() / own.len() as f64;
        let sigmas = |others: &dyn Fn(&ComparedContact) -> f64| {
            let differences: Vec<f64> = contacts.iter().zip(&own).map(|(contact, own)| others(contact) - own).collect();
            let (mean, sd) = mean_and_sd(differences.iter().copied());
            (mean, mean / sd.max(usual.gain_sd) * (contacts.len() as f64).sqrt())
        };
        let (gain, gain_sigmas) = sigmas(&|contact| contact.misfit);
        let sets =
            (0..units.len()).map(|chosen| ((self.units - chosen) as f64 / (chosen + 1) as f64).ln()).sum::<f64>();
        let needed = (2.0 * (ENOUGH + sets)).sqrt();
        let is_explained = rest <= EXPLAINED * usual.sd.max(rest + gain);
        if !is_explained || gain < GAIN_SD * usual.gain_sd || gain_sigmas < needed {
            return None;
        }
        let mut least = gain_sigmas;
        // with more units left out the misfit can only be smaller
        let is_rival = |other: &usize| !units.iter().all(|unit| self.suspects[*other].contains(unit));
        for other in (0..self.suspects.len()).filter(is_rival) {
            least = least.min(sigmas(&|contact| self.misfit_without(contact, other)).1);
            if least < needed {
                return None;
            }
        }
        Some(0.5 * least * least - sets)
    }

    /// Misfit of a contact without some units. A pair that wasn't tried explains what its better unit does.
    fn misfit_without(&self, contact: &ComparedContact, suspect: usize) -> f64 {
        contact.tried[suspect].unwrap_or_else(|| {
            let is_part = |(single, _): &(&Vec<usize>, &Option<f64>)| {
                single.len() == 1 && self.suspects[suspect].contains(&single[0])
            };
            let singles = self.suspects.iter().zip(&contact.tried).filter(is_part);
            singles.filter_map(|(_, misfit)| *misfit).fold(contact.misfit, f64::min)
        })
    }
}

impl ComparedContact {
    /// Whether the contact says something about one of these units: it felt it, or deviates.
    fn may_show(&self, units: &[usize]) -> bool {
        units.iter().any(|&unit| self.is_felt[unit] || self.deviations[unit] > DEVIATES_SD)
    }

    fn is_felt_by(&self, units: &[usize]) -> bool {
        units.iter().any(|&unit| self.is_felt[unit])
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
