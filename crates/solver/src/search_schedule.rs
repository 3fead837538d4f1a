//! Decides when a session searches for units at fault.

use super::fitted::Answering;
use super::{Model, Solution};
use std::collections::VecDeque;
use std::ops::Range;

/// Keeps the last contacts of a session, and decides when a search among them is due.
///
/// A search costs as much as hundreds of answers, so it needs a reason: misfits that rose, an output that repeats, units that are left
/// out. It also needs credit, which is counted in multiplications, so the same readings have the same searches on every machine. Each
/// search without a finding makes the wait for the next one half as long again, from 10 to 640 contacts; a new reason makes it 10 again.
pub(super) struct SearchSchedule {
    work: SearchWork,
    /// Work that may be spent on searches.
    credit: u64,
    /// Sets of units whose usual misfits searches have paid for.
    pub paid: Vec<Vec<usize>>,
    /// Readings of the last contacts, row-major. Contact n is in row n modulo [`CONTACTS_KEPT`].
    readings: Vec<f64>,
    units: usize,
    /// Number of contacts so far.
    count: u64,
    /// How often each output was repeated until now.
    repeats: Vec<u32>,
    ranks: MisfitRanks,
    /// What the last search showed.
    shown: Shown,
    /// Reasons of the last search, the number of contacts until the next one, and the contact from which it may begin.
    reasons: Reasons,
    wait: u64,
    from: u64,
}

/// What a search showed that found no unit at fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shown {
    /// Too few contacts, so that some units felt hardly any.
    TooFew,
    /// Misfits are as large as those of good contacts.
    Usual,
    /// Misfits are larger, and no unit explains it.
    Suspicious,
}

/// Approximate costs of predictions: the multiplications of the answers that pay for them.
#[derive(Clone, Copy)]
pub(super) struct SearchWork {
    answer: u64,
    /// A contact compared with all presses or with the map.
    pub contact: u64,
    /// A contact, or a held-out press, compared without some units.
    pub set: u64,
    /// Held-out presses that show the usual misfits without a set of units.
    held: u64,
}

/// Reasons for a search.
#[derive(Clone, Copy, Default, PartialEq)]
struct Reasons {
    rose: bool,
    repeats: bool,
    is_open: bool,
    is_out_of_date: bool,
    has_left_out: bool,
}

/// Ranks of the last misfits among those of the contacts before the last search.
#[derive(Default)]
struct MisfitRanks {
    misfits: VecDeque<f64>,
    /// Misfits until the last search, in order.
    usual: Vec<f64>,
    /// -ln(1 - rank) of a misfit by its rank among these: the mean is 1 until misfits rise, in all contacts or in those of a few units.
    scores: Vec<f64>,
    /// Scores of the last misfits, and their sum.
    last: VecDeque<f64>,
    sum: f64,
}

/// Number of contacts that are kept. A unit at the border of 192 feels one in twenty, and must feel 20.
pub(super) const CONTACTS_KEPT: usize = 500;
/// Number of contacts that show a reason, and from which a unit may be named.
pub(super) const CONTACTS_LEAST: usize = 20;
/// Number of contacts between two searches: at first, and at most.
const WAIT_LEAST: u64 = 10;
const WAIT_MOST: u64 = 640;
/// Number of misfits that show a rise, and the deviation of their mean score that counts as one, in standard deviations. Good contacts reach
/// it once in some 50,000.
const SCORES: usize = 60;
const ROSE_SD: f64 = 4.0;
/// How much more work answers are than the searches that they pay for, after the two largest searches.
const PART_OF_ANSWERS: u64 = 40;
/// Time of the product of a contact with all presses, compared with that of an answer, and of another multiplication of a search: an answer
/// uses the widest vectors of the processor.
const TIME_OF_PRODUCT: u64 = 2;
const TIME_OF_MULTIPLICATION: u64 = 8;
/// Multiplications of a prediction for each press, for each unit, and besides (10 us).
const FOR_PRESS: usize = 4;
const FOR_UNIT: usize = 75;
const BESIDES: usize = 34_000;
/// Largest number of sets of units that are tried, of contacts without each, and of held-out presses that show the usual misfits.
const SETS_MOST: u64 = 36;
const TRIED_MOST: u64 = 60;
const HELD_MOST: u64 = 100;

impl SearchWork {
    pub(crate) fn of(model: &Model) -> Self {
        let (units, presses) = (model.validity().units, model.validity().presses);
        let answer = (units * presses) as u64;
        let is_map = match model.fitted().answering() {
            Answering::Forward(_) => true,
            Answering::Appraised(_) => false,
            Answering::ByLoad(by_load) => matches!(*by_load.any, Answering::Forward(_)),
        };
        if is_map {
            // each is a descent on the map, whose usual misfits need no held-out press
            let prediction = PART_OF_ANSWERS * answer;
            return SearchWork { answer, contact: prediction, set: prediction, held: 0 };
        }
        let set = TIME_OF_MULTIPLICATION * (FOR_PRESS * presses + FOR_UNIT * units + BESIDES) as u64;
        let [contact, set] = [TIME_OF_PRODUCT * answer + set, set].map(|work| PART_OF_ANSWERS * work);
        SearchWork { answer, contact, set, held: HELD_MOST }
    }

    /// The largest search among so many contacts.
    fn most(&self, contacts: usize) -> u64 {
        contacts as u64 * self.contact + SETS_MOST * (TRIED_MOST + self.held) * self.set
    }

    /// The two largest searches.
    fn credit(&self, units: usize) -> u64 {
        2 * self.most(TRIED_MOST as usize + units)
    }
}

impl SearchSchedule {
    pub(crate) fn new(model: &Model) -> Self {
        let work = SearchWork::of(model);
        SearchSchedule {
            work,
            credit: work.credit(model.validity().units),
            paid: Vec::new(),
            readings: Vec::new(),
            units: model.validity().units,
            count: 0,
            repeats: vec![0; model.validity().units],
            ranks: MisfitRanks::default(),
            shown: Shown::TooFew,
            reasons: Reasons::default(),
            wait: WAIT_LEAST,
            from: CONTACTS_LEAST as u64,
        }
    }

    pub(crate) fn work(&self) -> SearchWork {
        self.work
    }

    /// Number of contacts so far.
    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    /// Whether the credit suffices for trying units.
    pub(crate) fn may_try(&self) -> bool {
        let held = if self.paid.is_empty() { self.work.held } else { 0 };
        self.credit >= SearchWork { held, ..self.work }.most(TRIED_MOST as usize)
    }

    /// Counts an answer, which pays for a part of a search.
    pub(crate) fn earn(&mut self) {
        self.credit += self.work.answer;
    }

    /// Keeps the reading of a contact.
    pub(crate) fn add(&mut self, outputs: &[f64], solution: &Solution) {
        if self.readings.is_empty() {
            self.readings.reserve_exact(CONTACTS_KEPT * self.units); // at once: no later answer allocates
        }
        if self.count > 0 {
            let last = &self.readings[row(self.count - 1, self.units)];
            let again = self.repeats.iter_mut().zip(last.iter().zip(outputs));
            again.for_each(|(repeats, (last, output))| *repeats = if last == output { *repeats + 1 } else { 0 });
        }
        match self.count < CONTACTS_KEPT as u64 {
            true => self.readings.extend_from_slice(outputs),
            false => self.readings[row(self.count, self.units)].copy_from_slice(outputs),
        }
        self.count += 1;
        self.ranks.add(solution.misfit);
    }

    /// Returns the last contacts if a search is due.
    pub(crate) fn due(&mut self, is_out_of_date: bool, has_left_out: bool) -> Option<Vec<Vec<f64>>> {
        if self.count < CONTACTS_LEAST as u64 {
            return None;
        }
        let reasons = Reasons {
            rose: self.ranks.rose(),
            repeats: self.repeats.iter().any(|repeats| *repeats as usize + 1 >= CONTACTS_LEAST),
            is_open: match self.shown {
                Shown::TooFew => self.count <= CONTACTS_KEPT as u64 + WAIT_MOST,
                Shown::Usual => false,
                Shown::Suspicious => true,
            },
            is_out_of_date,
            has_left_out,
        };
        if reasons.has_new(self.reasons) {
            (self.wait, self.from) = (WAIT_LEAST, self.from.min(self.count));
        }
        let is_looked_at =
            self.shown != Shown::Suspicious && self.credit >= self.count.min(CONTACTS_KEPT as u64) * self.work.contact;
        let is_paid = self.may_try() || is_looked_at;
        if reasons == Reasons::default() || self.count < self.from || !is_paid {
            return None;
        }
        self.reasons = reasons;
        self.from = self.count + self.wait;
        self.wait = (self.wait * 3 / 2).min(WAIT_MOST);
        let first = self.count.saturating_sub(CONTACTS_KEPT as u64);
        Some((first..self.count).map(|contact| self.readings[row(contact, self.units)].to_vec()).collect())
    }

    /// Returns the last contacts if a search is due, and no further contact comes.
    pub(crate) fn due_at_end(&mut self, is_out_of_date: bool, has_left_out: bool) -> Option<Vec<Vec<f64>>> {
        self.from = self.from.min(self.count);
        self.due(is_out_of_date, has_left_out)
    }

    /// Takes what a search cost and showed.
    pub(crate) fn searched(&mut self, spent: u64, shown: Shown) {
        self.credit = self.credit.saturating_sub(spent);
        if shown == Shown::Suspicious && self.shown != shown {
            (self.wait, self.from) = (WAIT_LEAST, self.count);
        }
        self.shown = shown;
        self.ranks.begin();
    }

    /// Begins again after units were left out or taken back: with another method misfits are others.
    pub(crate) fn begin_again(&mut self) {
        self.ranks = MisfitRanks::default();
        self.shown = Shown::TooFew;
        self.repeats.fill(0);
        (self.wait, self.from) = (WAIT_LEAST, self.count + WAIT_LEAST);
    }
}

/// Where the reading of a contact is.
fn row(contact: u64, units: usize) -> Range<usize> {
    let row = (contact % CONTACTS_KEPT as u64) as usize;
    row * units..(row + 1) * units
}

impl Reasons {
    /// Whether there is a reason that the last search didn't have.
    fn has_new(self, last: Reasons) -> bool {
        (self.rose && !last.rose)
            || (self.repeats && !last.repeats)
            || (self.is_out_of_date && !last.is_out_of_date)
            || (self.has_left_out && !last.has_left_out)
    }
}

impl MisfitRanks {
    fn add(&mut self, misfit: Option<f64>) {
        let Some(misfit) = misfit else { return };
        if self.misfits.len() == CONTACTS_KEPT {
            self.misfits.pop_front();
        }
        self.misfits.push_back(misfit);
        if self.usual.is_empty() {
            return;
        }
        if self.last.len() == SCORES {
            self.sum -= self.last.pop_front().unwrap_or_default();
        }
        let score = self.scores[self.usual.partition_point(|usual| *usual < misfit)];
        self.last.push_back(score);
        self.sum += score;
    }

    /// Compares the next misfits with those until now.
    fn begin(&mut self) {
        self.usual = self.misfits.iter().copied().collect();
        self.usual.sort_by(f64::total_cmp);
        let ranks = (self.usual.len() + 1) as f64;
        self.scores = (0..=self.usual.len()).map(|below| -(1.0 - (below as f64 + 0.5) / ranks).ln()).collect();
        self.last.clear();
        self.sum = 0.0;
    }

    /// Whether the last misfits are larger than those before. Scores have the variance 1 if nothing changed; those of n contacts among m
    /// others have a mean with the variance 1/n + 1/m.
    fn rose(&self) -> bool {
        let [last, usual] = [self.last.len(), self.usual.len()].map(|count| count as f64);
        self.last.len() >= CONTACTS_LEAST && self.sum - last > ROSE_SD * last * (1.0 / last + 1.0 / usual).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Calibration, CalibrationPoint, ContactVerdict, Place};

    fn schedule() -> SearchSchedule {
        let row = |i: usize| [1.0, 2.0, 3.0].map(|unit| 1.0 / (1.0 + (unit - i as f64).powi(2)));
        let rows: Vec<[f64; 3]> = (0..5).map(row).collect();
        let points: Vec<CalibrationPoint<'_>> = rows
            .iter()
            .enumerate()
            .map(|(i, outputs)| CalibrationPoint { place: Place::new(i as f64, 0.0), force_n: 1.0, outputs })
            .collect();
        let calibration = Calibration::new(&points).unwrap();
        SearchSchedule::new(&Model::fit("pearson", calibration, &crate::Setting::default()).unwrap())
    }

    /// Adds contacts with these misfits, whose searches cost this and end without a finding. Returns the contacts that were searched.
    fn searched(
        schedule: &mut SearchSchedule,
        misfits: impl Iterator<Item = f64>,
        spent: u64,
        shown: Shown,
    ) -> Vec<u64> {
        let mut searched = Vec::new();
        for (i, misfit) in misfits.enumerate() {
            let solution =
                Solution { misfit: Some(misfit), ..Solution::plain(Place::default(), 1.0, ContactVerdict::Ok) };
            schedule.earn();
            schedule.add(&[i as f64, 1.0 + i as f64, 2.0], &solution);
            schedule.repeats[2] = 0;
            if schedule.due(false, false).is_some() {
                searched.push(schedule.count());
                schedule.searched(spent, shown);
            }
        }
        searched
    }

    /// Misfits without an order.
    fn misfits(count: u64) -> impl Iterator<Item = f64> {
        (0..count).map(|i| (i * 37 % 101) as f64)
    }

    #[test]
    fn good_contacts_are_searched_once_and_larger_misfits_again() {
        let mut schedule = schedule();
        assert_eq!(searched(&mut schedule, misfits(300), 0, Shown::Usual), [20]);
        let again = searched(&mut schedule, misfits(300).map(|misfit| 80.0 + misfit), 0, Shown::Usual);
        assert!(again[0] > 300 && again[0] <= 300 + SCORES as u64, "{again:?}");
    }

    #[test]
    fn each_search_without_a_finding_makes_the_wait_longer() {
        let found = searched(&mut schedule(), misfits(3000), 0, Shown::Suspicious);
        assert_eq!(found, [20, 21, 31, 46, 68, 101, 150, 223, 332, 495, 739, 1105, 1654, 2294, 2934]);
    }

    #[test]
    fn searches_are_paid_by_credit_and_then_by_answers() {
        let mut schedule = schedule();
        let most = schedule.work.most(63);
        assert_eq!(searched(&mut schedule, misfits(2000), most, Shown::Suspicious), [20, 21]);
        let answers = most / schedule.work.answer + 1;
        (0..answers).for_each(|_| schedule.earn());
        assert_eq!(searched(&mut schedule, misfits(10), most, Shown::Suspicious).len(), 1);
    }

    #[test]
    fn an_output_that_repeats_is_a_reason() {
        let mut schedule = schedule();
        searched(&mut schedule, misfits(40), 0, Shown::Usual);
        let solution = Solution::plain(Place::default(), 1.0, ContactVerdict::Ok);
        let mut due_at = None;
        for i in 0..30 {
            schedule.add(&[0.5, f64::from(i), 2.0 * f64::from(i)], &solution);
            if schedule.due(false, false).is_some() {
                due_at.get_or_insert(i + 1);
            }
        }
        assert_eq!(due_at, Some(CONTACTS_LEAST as i32));
    }
}
