//! An entry of a plan, and the presses that teach.

use super::Phase;
use palpate_control::{Branch, PressTask, Strategy};
use palpate_core::quantity::{Limits, Place};

/// One contact of the plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Number of the press, from 0 in the order of the recipe, with the presses that teach last. Tables use this order.
    pub press: u64,
    /// Purpose of the press.
    pub phase: Phase,
    /// Place of the press.
    pub place: Place,
    /// Measurement task.
    pub task: PressTask,
    /// Rest without load after the press, s.
    pub rest_after_s: f64,
}

/// Largest number of presses that teach. They are near the four corners and the centre of the area to be learned.
pub(super) const TRAINING_PRESSES: usize = 5;

/// Least number of presses for which presses that teach are added.
const WORTH: usize = 10;

/// Largest fraction of the specimen's force limit for a training press. At the limit nothing would be learned.
const FORCE_SHARE: f64 = 0.9;

/// Adds presses that teach before a plan's steps, numbered from `next`. It adds them if enough entries find their force from
/// learned data. Their force is the largest one that these entries request, so that no extrapolation is needed. A place that was
/// just pressed to teach is measured as late as its step allows, so that its dent can recover.
pub(super) fn training(steps: &mut Vec<Vec<Entry>>, next: usize, limits: &Limits) {
    let mut pupils: Vec<&Entry> = steps.iter().flatten().filter(|entry| is_pupil(entry)).collect();
    if pupils.len() < WORTH {
        return;
    }
    pupils.sort_by_key(|entry| entry.press); // of two equally near, the first in the recipe
    let force_n = pupils.iter().map(|entry| entry.task.most_n()).fold(0.0, f64::max).min(FORCE_SHARE * limits.force_n);
    let learned_contact = |(entry, press): (&Entry, u64)| Entry {
        press,
        phase: Phase::Teach,
        place: entry.place,
        task: PressTask {
            levels: PressTask::press(force_n),
            hold_s: 0.0,
            strategy: Strategy::Guarded,
            sample_after_s: None,
            over_time: None,
            drag: None,
            ..entry.task
        },
        rest_after_s: 0.0,
    };
    let learned_contacts: Vec<Entry> = spread(&pupils).into_iter().zip(next as u64..).map(learned_contact).collect();
    for step in steps.iter_mut() {
        step.sort_by_key(|entry| learned_contacts.iter().any(|learned_contact| learned_contact.place == entry.place)); // stable: only those move
    }
    steps.insert(0, learned_contacts);
}

/// Whether an entry finds its force from learned data. A staircase approaches slowly in any case.
fn is_pupil(entry: &Entry) -> bool {
    let is_plain = matches!(entry.task.levels[..], [level] if level.branch == Branch::Loading);
    entry.task.strategy == Strategy::Map && is_plain
}

/// Returns the entries nearest to the corners and the centre of the box around all entries, each at a different place.
fn spread<'a>(entries: &[&'a Entry]) -> Vec<&'a Entry> {
    let ends = |along: fn(&Place) -> f64| {
        let all = entries.iter().map(|entry| along(&entry.place));
        (all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((left, right), (front, back)) = (ends(|place| place.x_mm), ends(|place| place.y_mm));
    let centre = ((left + right) / 2.0, (front + back) / 2.0);
    let wanted: [(f64, f64); TRAINING_PRESSES] = [(left, front), (right, front), (left, back), (right, back), centre];
    let mut chosen: Vec<&Entry> = Vec::with_capacity(TRAINING_PRESSES);
    for (x_mm, y_mm) in wanted {
        let way_mm = |entry: &&&Entry| entry.place.distance_mm(Place::new(x_mm, y_mm));
        let free = entries.iter().filter(|entry| chosen.iter().all(|other| other.place != entry.place));
        let nearest = free.min_by(|a, b| way_mm(a).total_cmp(&way_mm(b))).copied();
        chosen.extend(nearest);
    }
    chosen
}
