//! Checks of a run: the first place of the plan with a force is pressed again, and compared with the first press there.

use super::Halt;
use super::check_weight::{CellAfter, Weighing, weigh};
use super::doubt::DOUBTED;
use super::execute::{Runner, Standby};
use super::past::felt;
use palpate_control::{Changed, MeasuredContact, PressTask, SetPoint, Strategy};
use palpate_core::quantity::Place;
use palpate_data::dataset::{CheckChange, Left, Record, RecordedCheck, RecordedContact};
use palpate_data::recipe::{Checks, Entry, Phase, Plan};

/// Number of the first check, for random values. It is far above the numbers of planned contacts.
const CHECKED: u64 = 1 << 61;
/// The same of the press that shows the force before the first press.
const SHOWN: u64 = 1 << 60;

/// Largest number of calibration or test presses between two checks, and largest time of them, s.
const PRESSES_MOST: u64 = 100;
const SECONDS_MOST: f64 = 3600.0;

/// Least force of the press that checks repeat, as a fraction of the largest first force of the plan's presses, or of the largest depth if
/// it has no forces. The errors of a contact that don't grow with the force change the outputs of a weak press by too much.
const LARGE_SHARE: f64 = 0.5;

/// State of the checks of a run. It follows from the records, so that an interrupted run makes the same checks.
#[derive(Clone, Debug, Default)]
pub(super) struct Checking {
    /// Least set point of the reference.
    least: Option<SetPoint>,
    /// First press with at least that set point, with which the checks are compared.
    reference: Option<ReferencePress>,
    /// Number of checks so far.
    made: u64,
    /// Last press of the plan.
    last: Option<u64>,
    /// First press after the reference, or after the last check that passed.
    unchecked_from: Option<u64>,
    /// Whether a check is later than every press.
    is_checked: bool,
    since: Since,
}

/// Calibration and test presses since the last check.
#[derive(Clone, Debug, Default)]
pub(super) struct Since {
    presses: u64,
    seconds: f64,
    /// Time of the last contact, s since the run's start.
    before_s: Option<f64>,
}

/// Repetition of the press with which the checks are compared, with half its force.
pub(super) struct HalfPress {
    pub entry: Entry,
    /// What was felt before, and the depth, mm.
    pub before: MeasuredContact,
    pub before_mm: f64,
}

/// Press with which the checks are compared.
#[derive(Clone, Debug, PartialEq)]
struct ReferencePress {
    press: u64,
    felt: MeasuredContact,
    set: SetPoint,
    depth_mm: Option<f64>,
}

impl Since {
    /// Counts a press of a phase that ended at `t_s`.
    pub(super) fn count(&mut self, phase: Phase, t_s: f64) {
        if is_checked_between(phase) {
            self.presses += 1;
            self.seconds += (t_s - self.before_s.unwrap_or(t_s)).max(0.0);
        }
        self.before_s = Some(t_s);
    }

    /// Begins again after a check that ended at `t_s`.
    pub(super) fn restart(&mut self, t_s: f64) {
        *self = Since { before_s: Some(t_s), ..Since::default() };
    }

    /// Whether a check is due between two entries of the plan.
    pub(super) fn is_due(&self, before: &Entry, next: &Entry) -> bool {
        let are_both = [before, next].iter().all(|entry| is_checked_between(entry.phase));
        self.is_enough() && are_both && before.rest_after_s == 0.0
    }

    fn is_enough(&self) -> bool {
        self.presses >= PRESSES_MOST || self.seconds >= SECONDS_MOST
    }
}

fn is_checked_between(phase: Phase) -> bool {
    matches!(phase, Phase::Calibration | Phase::Test)
}

/// Returns the check of this number that repeats an entry of the plan with a force or a depth.
fn again(entry: &Entry, number: u64, set: SetPoint) -> Entry {
    let task = PressTask {
        levels: PressTask::one(set),
        strategy: Strategy::Guarded,
        over_time: None,
        drag: None,
        ..entry.task.clone()
    };
    Entry { press: CHECKED + number, phase: Phase::Check, place: entry.place, task, rest_after_s: 0.0 }
}

/// Returns the set point of the first loaded level of an entry.
fn first_set(entry: &Entry) -> Option<SetPoint> {
    entry.task.levels.iter().map(|level| level.set).find(|set| set.is_loaded())
}

/// Returns the least force, or in a plan without forces the least depth, of the press that the checks of a plan repeat.
fn least_set(plan: &Plan) -> SetPoint {
    let sets = || plan.entries.iter().filter_map(first_set);
    let most_n = sets().filter_map(SetPoint::force_n).fold(0.0, f64::max);
    let most_mm = sets().filter_map(SetPoint::depth_mm).fold(0.0, f64::max);
    if most_n > 0.0 { SetPoint::Force(LARGE_SHARE * most_n) } else { SetPoint::Depth(LARGE_SHARE * most_mm) }
}

/// Whether a set point is of the same kind as the least one, and no less.
fn is_large(set: SetPoint, least: SetPoint) -> bool {
    match (set, least) {
        (SetPoint::Force(force_n), SetPoint::Force(least_n)) => force_n >= least_n,
        (SetPoint::Depth(depth_mm), SetPoint::Depth(least_mm)) => depth_mm >= least_mm,
        _ => false,
    }
}

/// Expected times, s: of each entry of a plan, and of a check.
pub(super) struct CheckTimes<'a> {
    pub entries_s: &'a [f64],
    pub check_s: f64,
}

/// Returns the checks that a plan is expected to have.
pub(super) fn expected_checks(plan: &Plan, times: &CheckTimes<'_>) -> Vec<Entry> {
    let least = least_set(plan);
    let loaded = plan.entries.iter().filter_map(|entry| Some((entry, first_set(entry)?)));
    let reference = loaded.into_iter().find(|(_, set)| is_large(*set, least));
    let Some((reference, set)) = reference.filter(|_| plan.checks != Checks::None) else { return Vec::new() };
    let (mut since, mut now_s, mut made) = (Since::default(), 0.0, 0);
    for (pair, entry_s) in plan.entries.windows(2).zip(times.entries_s).filter(|_| plan.checks == Checks::Between) {
        now_s += entry_s;
        since.count(pair[0].phase, now_s);
        if since.is_due(&pair[0], &pair[1]) {
            now_s += times.check_s;
            since.restart(now_s);
            made += 1;
        }
    }
    (0..=made).map(|number| again(reference, number, set)).collect()
}

impl Checking {
    /// Creates the state before the first press of a plan.
    pub(super) fn of(plan: &Plan) -> Checking {
        Checking { least: Some(least_set(plan)), ..Checking::default() }
    }

    /// Takes in a contact of the plan.
    pub(super) fn take_contact(&mut self, contact: &RecordedContact) {
        if let Some(first) = contact.levels.first() {
            let t_s = contact.t_s().or(first.t_s).unwrap_or_default();
            first.phase.into_iter().for_each(|phase| self.since.count(phase, t_s));
        }
        (self.last, self.is_checked) = (Some(contact.press), false);
        if self.reference.is_some() {
            self.unchecked_from = self.unchecked_from.or(Some(contact.press));
        } else if let Some((felt, set)) = felt(contact)
            && self.least.is_some_and(|least| is_large(set, least))
        {
            let (press, depth_mm) = (contact.press, depth_mm(contact));
            self.reference = Some(ReferencePress { press, felt, set, depth_mm });
        }
    }

    /// Takes in a check.
    pub(super) fn take_check(&mut self, check: &RecordedCheck) {
        self.made += 1;
        self.is_checked = true;
        if !check.is_failed() {
            self.unchecked_from = None;
        }
        self.since.restart(check.contact.t_s().unwrap_or_default());
    }

    /// Returns the entry of the next check: the first loaded level of the reference; `None` before there is a reference.
    fn entry(&self, plan: &Plan) -> Option<Entry> {
        let ReferencePress { press, set, .. } = self.reference.as_ref()?;
        let entry = plan.entries.iter().find(|entry| entry.press == *press)?;
        Some(again(entry, self.made, *set))
    }

    /// Returns the repetition of the reference with half its force that comes before a press of the plan; `None` before there is a
    /// reference with a force.
    pub(super) fn half(&self, plan: &Plan, before: u64) -> Option<HalfPress> {
        let reference = self.reference.as_ref()?;
        let entry = plan.entries.iter().find(|entry| entry.press == reference.press)?;
        let half = SetPoint::Force(reference.set.force_n()? / 2.0);
        let entry = Entry { press: SHOWN + before, ..again(entry, 0, half) };
        Some(HalfPress { entry, before: reference.felt.clone(), before_mm: reference.depth_mm? })
    }

    /// Returns the check that is due before the `next` entry of a plan.
    fn due(&self, plan: &Plan, next: &Entry) -> Option<Entry> {
        if plan.checks != Checks::Between || !self.since.is_enough() {
            return None; // a long plan isn't searched for each press
        }
        let before = plan.entries.iter().find(|entry| Some(entry.press) == self.last)?;
        self.entry(plan).filter(|_| self.since.is_due(before, next))
    }

    /// Returns the check after the last press of a plan; `None` if it was made, or there is none.
    fn closing(&self, plan: &Plan) -> Option<Entry> {
        let is_due = plan.checks != Checks::None && !self.is_checked;
        if is_due { self.entry(plan) } else { None }
    }

    /// Returns the place of the check after the last press of a plan; `None` if it was made, or there is none.
    pub(super) fn closing_place(&self, plan: &Plan) -> Option<Place> {
        self.closing(plan).map(|entry| entry.place)
    }
}

impl Runner<'_> {
    /// Makes the check that is due before an entry of the plan.
    pub(super) async fn check_before(&mut self, next: &Entry) -> Result<(), Halt> {
        match self.checks.due(self.plan, next) {
            Some(entry) => self.check(&entry, Some(next.place)).await,
            None => Ok(()),
        }
    }

    /// Makes the check after the last press of the plan.
    pub(super) async fn check_at_end(&mut self) -> Result<(), Halt> {
        let Some(entry) = self.checks.closing(self.plan) else { return Ok(()) };
        self.rest(0.0, entry.place).await?; // as before every press, a person may pause or stop
        self.check(&entry, None).await
    }

    /// Asks for a known weight after the run, if a person is there. A weight that isn't put on within the time limit, or doesn't
    /// rest, leaves the load cell unchecked.
    pub(super) async fn weigh_after(&mut self) -> Option<CellAfter> {
        let (cell, weight) = (&self.conditions.spec.load_cell, self.listener.weight()?);
        let before = cell.check.as_ref()?;
        let mut weighing = Weighing { weight, three_axes: false, ask: &mut |ask| self.listener.ask(ask) };
        let weighed = weigh(&mut self.rig_control.cell, &self.rig_control.truth, &mut weighing).await.ok()?;
        Some(CellAfter::of(&weighed, cell.divisor(), before, cell.certificate.as_ref()))
    }

    async fn check(&mut self, entry: &Entry, next: Option<Place>) -> Result<(), Halt> {
        // the press before ended in the clear above its place or the next one; here the surface may be higher
        self.rig_control.retract(self.park_mm()).await?;
        self.standby = None;
        // a change is what the check measures
        self.doubts_over = None;
        let made = self.again_if_missed(async |runner: &mut Runner<'_>| runner.press(entry, next).await).await;
        self.doubts_over = Some(DOUBTED);
        let mut contact = made?;
        let number = self.checks.made;
        contact.press = number;
        contact.levels.iter_mut().for_each(|level| level.press = number);
        contact.learned_contact = None; // a check isn't learned
        self.standby = contact.left.map(|Left { z_mm }| Standby { z_mm, no_load: Some(contact.no_load_after.clone()) });
        let Some(check) = self.compared(contact, next.is_none()) else { return Ok(()) };
        let record = Record::Check(check);
        self.ledger.record(&record)?;
        if let Record::Check(check) = &record {
            self.checks.take_check(check);
            self.listener.checked(check);
        }
        Ok(())
    }

    /// Compares the press of a check with the reference.
    fn compared(&self, contact: RecordedContact, at_end: bool) -> Option<RecordedCheck> {
        let reference = self.checks.reference.as_ref()?;
        let before = self.with_noise(reference.felt.clone());
        let now = felt(&contact).map(|(felt, _)| self.with_noise(felt));
        let changed = now.as_ref().and_then(|now| self.response.compare(&before, now));
        let depths = reference.depth_mm.zip(depth_mm(&contact)).zip(now.as_ref());
        let sunk = depths.and_then(|((before_mm, now_mm), now)| {
            self.map.compare([(before.force_n, before_mm), (now.force_n, now_mm)])
        });
        let change = |(by, limit)| CheckChange { by, limit };
        let [outputs, pattern] = [changed.map(|Changed { gain, .. }| gain), changed.map(|it| it.pattern)];
        let sizes = [outputs.map(|(by, _)| by), sunk.map(|sunk| sunk.force)].into_iter().flatten().map(f64::abs);
        let mut check = RecordedCheck {
            number: contact.press,
            reference: reference.press,
            at_end,
            contact,
            outputs: outputs.map(change),
            pattern: pattern.map(change),
            depth: sunk.map(|sunk| change((sunk.depth, sunk.limit))),
            // a change of the load cell's gain shows equally in both
            cell: sizes.reduce(f64::min).unwrap_or_default(),
            doubtful_from: None,
        };
        if check.is_failed() {
            check.doubtful_from = Some(self.checks.unchecked_from.unwrap_or(reference.press));
        }
        Some(check)
    }
}

/// Depth of the first loaded level, mm.
fn depth_mm(contact: &RecordedContact) -> Option<f64> {
    let level = contact.levels.iter().find(|level| level.set_point().is_some_and(SetPoint::is_loaded))?;
    level.depth_mm.filter(|depth_mm| *depth_mm > 0.0)
}
