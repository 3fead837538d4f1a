//! Rehearsal of a plan: some presses of each kind on the simulated rig, in virtual time, before anything moves. It shows whether the plan
//! works, and how long it takes.

use super::checks::{CheckTimes, expected_checks};
use super::motion::way_mm;
use super::{Cancel, Halt, Listener, RunJob, execute_on};
use crate::rig::RigSpec;
use palpate_control::{DragLimits, MotionProfile, OverTime, PressTask, Trip};
use palpate_core::quantity::Place;
use palpate_data::dataset::{Memory, RecordedCheck, RecordedContact};
use palpate_data::recipe::{Entry, Plan, SeriesScope};
use palpate_link::device::DeviceError;
use palpate_link::time::{Instant, run_virtually};
use palpate_sim::scene::Friction;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Presses of one kind that are rehearsed, and of all kinds. After ten presses their times are those of the whole plan within 5 %, and 60
/// presses take less than half a second of computing on the slowest shipped rig.
const EACH_MOST: usize = 20;
/// First presses of a kind that take longer, because they are still learned from.
const LEARNING: usize = 5;
const ALL_MOST: usize = 60;

/// Time at rest or on ramps that the presses of one kind take together, s: it is computed from reading to reading.
const BUSY_MOST_S: f64 = 25.0;

/// Longest hold, window or time followed that is rehearsed, s. Nothing but readings happens in the rest of it.
const REST_MOST_S: f64 = 5.0;

/// Assumed way of a ramp, mm.
const RAMP_MM: f64 = 1.0;

/// What a rehearsal has shown.
#[derive(Clone, Debug)]
pub struct Rehearsal {
    /// Number of presses that it made.
    pub presses: usize,
    /// Time until the first press begins, s.
    pub ready_s: f64,
    /// Expected time of each entry of the plan, with its rest and the travel to the next one, s.
    pub entries_s: Vec<f64>,
    /// Checks that are expected during and after the plan.
    pub checks: Vec<Entry>,
    /// Expected time of one check, s.
    pub check_s: f64,
    /// Time after the last press or check until the stage is parked, s.
    pub parked_s: f64,
    /// Where and why it ended early; `None`: it is complete.
    pub early: Option<EarlyEnd>,
}

/// End of a rehearsal before its last press.
#[derive(Clone, Debug)]
pub struct EarlyEnd {
    /// Number and place of the press that was under way; `None` before the first and after the last one.
    pub press: Option<(u64, Place)>,
    /// The trip, if a safety rule was broken.
    pub trip: Option<Trip>,
    /// The reason.
    pub text: String,
}

impl Rehearsal {
    /// Expected time from the beginning until the stage is parked, s.
    pub fn total_s(&self) -> f64 {
        let checks_s = self.check_s * self.checks.len() as f64;
        self.ready_s + self.entries_s.iter().sum::<f64>() + checks_s + self.parked_s
    }

    /// Expected time of a press, s: the median.
    pub fn press_s(&self) -> f64 {
        let mut sorted = self.entries_s.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Rehearses a plan on a rig, with emulators instead of its devices. A rig with real links has no faults in its scene.
///
/// # Errors
/// A device has no emulator.
pub fn rehearse(plan: &Plan, spec: &RigSpec) -> Result<Rehearsal, DeviceError> {
    let mut simulated = spec.clone().simulated();
    if !spec.is_simulated() {
        let scene = &mut simulated.scene;
        scene.faults.clear();
        scene.friction = scene.friction.or_else(|| spec.drag.as_ref().map(usual_friction));
    }
    let kinds = kinds(plan);
    let first = first_ones(plan, &kinds);
    let chosen: Vec<usize> = first.iter().copied().chain(largest(plan)).collect::<BTreeSet<_>>().into_iter().collect();
    let shortened: Vec<Entry> = chosen.iter().map(|&index| shortened(&plan.entries[index])).collect();
    let part = Plan { entries: shortened, series: SeriesScope::None, ..plan.clone() };
    Ok(performed(&part, &simulated)?.extrapolated(plan, spec, &kinds, (&first, &chosen)))
}

/// Returns a friction within what a rig declares, for a real specimen whose own is not known.
fn usual_friction(most: &DragLimits) -> Friction {
    const SHARE: f64 = 0.8;
    let sticking = SHARE * most.friction;
    Friction { sticking, sliding: SHARE * sticking, stiffness_n_mm: SHARE * most.stiffness_n_mm }
}

/// Times of a rehearsal, s since its beginning.
#[derive(Default)]
struct Performed {
    begins_s: Vec<f64>,
    recorded_s: Vec<f64>,
    checked_s: Option<f64>,
    parked_s: f64,
    /// Why it ended early.
    early: Option<(Option<Trip>, String)>,
}

/// Notes the times of a rehearsal.
struct Times {
    began: Instant,
    performed: Performed,
}

impl Listener for Times {
    fn begins(&mut self, _: &Entry) {
        self.performed.begins_s.push(self.began.elapsed().as_secs_f64());
    }
    fn recorded(&mut self, _: &RecordedContact) {
        self.performed.recorded_s.push(self.began.elapsed().as_secs_f64());
    }
    fn checked(&mut self, _: &RecordedCheck) {
        self.performed.checked_s = Some(self.began.elapsed().as_secs_f64());
    }
}

fn performed(part: &Plan, spec: &RigSpec) -> Result<Performed, DeviceError> {
    run_virtually(async {
        let (mut ledger, cancel, began) = (Memory::default(), Cancel::default(), Instant::now());
        let rig = spec.open(part.seed)?;
        let mut times = Times { began, performed: Performed::default() };
        let job = RunJob { plan: part, spec, ledger: &mut ledger, cancel: &cancel, shown: &|_| {} };
        let ending = execute_on(rig, job, &mut times).await;
        let trip = match &ending.halt {
            Some(Halt::Tripped(trip)) => Some(trip.clone()),
            _ => None,
        };
        let early = ending.text().map(|text| (trip, text));
        Ok(Performed { parked_s: began.elapsed().as_secs_f64(), early, ..times.performed })
    })
}

impl Performed {
    /// Returns the times of the whole plan by those of the entries chosen from it, the first ones of each kind among them.
    fn extrapolated(
        self,
        plan: &Plan,
        spec: &RigSpec,
        kinds: &[usize],
        (first, chosen): (&[usize], &[usize]),
    ) -> Rehearsal {
        let entries = &plan.entries;
        let travel_s = |from: usize, to: Option<&usize>| {
            let Some(&to) = to.filter(|to| **to < entries.len()) else { return 0.0 };
            let way_mm = way_mm(entries[from].place, entries[to].place);
            MotionProfile::new(way_mm, spec.stage.speed_mm_s, spec.stage.acceleration_mm_s2).duration_s()
        };
        // nobody waits after the last press
        let rest_s = |index: usize, is_last: bool| if is_last { 0.0 } else { entries[index].rest_after_s };
        // what each press took without its travel, and without what the rehearsal left out
        let ends_s = self.begins_s.iter().skip(1).chain(self.recorded_s.last());
        let took_s: Vec<(usize, f64)> = (self.begins_s.iter().zip(ends_s).zip(chosen).enumerate())
            .map(|(nth, ((begins_s, ends_s), &index))| {
                let next = chosen.get(nth + 1);
                (index, ends_s - begins_s - travel_s(index, next) - rest_s(index, next.is_none()))
            })
            .collect();
        let usual_s = |kind: usize| {
            // the first press of all finds the surface; a press before another place than the plan's next one has another way
            let is_usual =
                |nth: usize, index: usize| nth > 0 && chosen.get(nth + 1).is_none_or(|next| *next == index + 1);
            let own = |is_any: bool| {
                let own = took_s.iter().enumerate().filter(move |(_, (index, _))| kinds[*index] == kind);
                let usual =
                    own.filter(move |(nth, (index, _))| is_any || first.contains(index) && is_usual(*nth, *index));
                usual.map(|(_, (_, s))| *s).collect::<Vec<f64>>()
            };
            let own = Some(own(false)).filter(|own| !own.is_empty()).unwrap_or_else(|| own(true));
            let learned = &own[LEARNING.min(own.len() / 2)..];
            learned.iter().sum::<f64>() / learned.len().max(1) as f64
        };
        let kind_most = kinds.iter().copied().max().map_or(0, |kind| kind + 1);
        let usual_s: Vec<f64> = (0..kind_most).map(usual_s).collect();
        let known_s = |index: usize| took_s.iter().find(|(known, _)| *known == index).map(|(_, s)| *s);
        let entries_s = (0..entries.len()).map(|index| {
            let own_s = known_s(index).unwrap_or(usual_s[kinds[index]]);
            let is_last = index + 1 == entries.len();
            own_s + left_out_s(&entries[index].task) + travel_s(index, Some(&(index + 1))) + rest_s(index, is_last)
        });
        let entries_s: Vec<f64> = entries_s.collect();
        let recorded_s = self.recorded_s.last().copied().unwrap_or(self.parked_s);
        let check_s = self.checked_s.map(|checked_s| checked_s - recorded_s);
        let checks = check_s
            .map_or_else(Vec::new, |check_s| expected_checks(plan, &CheckTimes { entries_s: &entries_s, check_s }));
        let under_way = chosen.get(self.recorded_s.len()).filter(|_| self.begins_s.len() > self.recorded_s.len());
        let early = self.early.map(|(trip, text)| EarlyEnd {
            press: under_way.map(|&index| (entries[index].press, entries[index].place)),
            trip,
            text,
        });
        Rehearsal {
            presses: self.recorded_s.len(),
            ready_s: self.begins_s.first().copied().unwrap_or(self.parked_s),
            entries_s,
            checks,
            check_s: check_s.unwrap_or(0.0),
            parked_s: self.parked_s - self.checked_s.unwrap_or(recorded_s),
            early,
        }
    }
}

/// Returns the kind of each entry. Entries of one kind differ in their place, in the direction of their drag, and by less than a factor
/// of two in their largest force and depth.
fn kinds(plan: &Plan) -> Vec<usize> {
    let mut first: Vec<&Entry> = Vec::new();
    let kind = |entry| {
        first.iter().position(|other| is_alike(other, entry)).unwrap_or_else(|| {
            first.push(entry);
            first.len() - 1
        })
    };
    plan.entries.iter().map(kind).collect()
}

fn is_alike(a: &Entry, b: &Entry) -> bool {
    let (a, b, phases) = (&a.task, &b.task, a.phase == b.phase);
    let times = |task: &PressTask| (task.hold_s, task.sample_s, task.sample_after_s);
    let drag = |task: &PressTask| task.drag().map(|drag| (drag.way_mm(), drag.speed_mm_s));
    let level = |task: &PressTask, nth: usize| {
        let level = task.levels[nth];
        (level.branch, level.set.is_loaded(), level.set.force_n().is_some())
    };
    let levels = || a.levels.len() == b.levels.len() && (0..a.levels.len()).all(|nth| level(a, nth) == level(b, nth));
    let alike_over_time = a.over_time == b.over_time;
    let size =
        |task: &PressTask| [task.most_n(), task.most_mm()].map(|most| most.max(f64::MIN_POSITIVE).log2().round());
    phases
        && size(a) == size(b)
        && a.strategy == b.strategy
        && times(a) == times(b)
        && drag(a) == drag(b)
        && alike_over_time
        && levels()
}

/// Returns the first entries of each kind.
fn first_ones(plan: &Plan, kinds: &[usize]) -> Vec<usize> {
    let count = kinds.iter().copied().max().map_or(0, |kind| kind + 1);
    let each = (ALL_MOST / count.max(1)).clamp(1, EACH_MOST);
    let mut left: Vec<Option<usize>> = vec![None; count];
    let mut first = Vec::new();
    for (index, (entry, &kind)) in plan.entries.iter().zip(kinds).enumerate() {
        let affordable = || ((BUSY_MOST_S / busy_s(&entry.task)) as usize).clamp(each.min(3), each);
        let left = left[kind].get_or_insert_with(affordable);
        if *left > 0 && first.len() < ALL_MOST {
            *left -= 1;
            first.push(index);
        }
    }
    first
}

/// Returns the entries with the largest force, depth and drag, and with the longest way.
fn largest(plan: &Plan) -> impl Iterator<Item = usize> {
    let entries = &plan.entries;
    let most = |of: &dyn Fn(usize) -> f64| {
        // of equals the first one
        let largest = (0..entries.len()).rev().max_by(|a, b| of(*a).total_cmp(&of(*b)));
        largest.filter(|index| of(*index) > 0.0)
    };
    let way_mm = |index: usize| {
        let before = index.checked_sub(1).map(|before| entries[before].place);
        before.map_or(0.0, |before| before.distance_mm(entries[index].place))
    };
    let most = [
        most(&|index| entries[index].task.most_n()),
        most(&|index| entries[index].task.most_mm()),
        most(&|index| entries[index].task.drag().map_or(0.0, |drag| drag.way_mm())),
        most(&way_mm),
    ];
    most.into_iter().flatten()
}

/// Time for which a rehearsed task reads at rest or on ramps, s.
fn busy_s(task: &PressTask) -> f64 {
    let shortened = shortened_task(task);
    let ramps_s: f64 = shortened.ramps_mm_s().iter().map(|speed_mm_s| 2.0 * RAMP_MM / speed_mm_s).sum();
    let drag_s = shortened.drag().map_or(0.0, |drag| drag.way_mm() / drag.speed_mm_s);
    shortened.levels.len() as f64 * (1.0 + shortened.hold_s + shortened.sample_s)
        + shortened.followed_s()
        + ramps_s
        + drag_s
}

fn shortened(entry: &Entry) -> Entry {
    Entry { task: shortened_task(&entry.task), ..entry.clone() }
}

/// Returns a task without long times at rest.
fn shortened_task(task: &PressTask) -> PressTask {
    let over_time = task.over_time.as_ref().map(|over_time| {
        let follow_s = over_time.follow_s.iter().map(|s| s.min(REST_MOST_S)).collect();
        Arc::new(OverTime { follow_s, ..(**over_time).clone() })
    });
    PressTask {
        hold_s: task.hold_s.min(REST_MOST_S),
        sample_s: task.sample_s.min(REST_MOST_S),
        sample_after_s: task.sample_after_s.map(|s| s.min(REST_MOST_S)),
        over_time,
        ..task.clone()
    }
}

/// Time at rest that a task has more than its rehearsal, s.
fn left_out_s(task: &PressTask) -> f64 {
    let over_s = |s: f64| (s - REST_MOST_S).max(0.0);
    let levels = task.levels.len() as f64;
    // the first window begins at a fixed time after contact, if there is one
    let first_s = task.sample_after_s.map_or(over_s(task.hold_s), over_s);
    let held_s = first_s + (levels - 1.0).max(0.0) * over_s(task.hold_s);
    let followed_s: f64 = (0..task.levels.len()).map(|level| over_s(task.follow_s(level))).sum();
    held_s + levels * over_s(task.sample_s) + followed_s
}
