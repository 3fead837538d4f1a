//! The presses of a recipe.

use super::accept::force_limits;
use super::drags::check_drags;
use super::keys::{press, record, root};
use super::training::{Entry, training};
use super::{Checks, GridOrder, OnMiss, PRESSES_CEILING, Places, Recipe, SeriesScope, Step, StepLoad, UnitChoice};
use palpate_control::{DEPTH_MARGIN_MM, Drag, DragLimits, OverTime, PressLevel, PressTask, SetPoint, Strategy};
use palpate_core::quantity::{
    ArrayLayout, Axis, Frame, Limits, Place, Range, StageAbilities, Steps, Travel, cell_centres, round, stream,
};
use palpate_document::{PROBLEMS_MAX, Problem, Problems, Span, positions};
use rand::RngExt;
use std::sync::Arc;

/// The presses of a recipe on one rig with one seed.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The recipe's name.
    pub name: String,
    /// Random seed of places and forces.
    pub seed: u64,
    /// Presses in the order of execution, which may differ from the order of their numbers.
    pub entries: Vec<Entry>,
    /// When places are checked in addition to these presses.
    pub checks: Checks,
    /// What becomes of a press with a missed reading.
    pub on_miss: OnMiss,
    /// Which readings are kept.
    pub series: SeriesScope,
}

/// Data that a plan is checked against.
#[derive(Clone, Debug)]
pub struct Ground<'a> {
    /// Travel limits of the axes.
    pub travel: &'a Travel,
    /// Position of the specimen.
    pub frame: &'a Frame,
    /// Limits of the specimen.
    pub limits: &'a Limits,
    /// Positions of the array's units.
    pub layout: &'a ArrayLayout,
    /// Largest depth of a press on a rig without a load cell, mm; `None` with a load cell.
    pub unforced_mm: Option<f64>,
    /// What the rig allows in a drag; `None`: nothing, or its load cell has one axis.
    pub drag: Option<DragLimits>,
    /// Whether the load cell has three axes.
    pub three_axes: bool,
    /// What the stage can do in a motion.
    pub abilities: StageAbilities,
    /// Steps of the stage.
    pub steps: Steps,
    /// Whether the rig is simulated without friction, so that a drag has no force.
    pub is_slippery: bool,
}

impl Plan {
    /// Creates the plan of a recipe. If enough presses find their force from earlier presses (`strategy = "map"`), the plan
    /// begins with presses that teach.
    ///
    /// # Errors
    /// Every step that leaves the stage's travel, exceeds the specimen's force limit, names a unit that doesn't exist, or makes
    /// the plan too long, with its line. Without a load cell, also every strategy and every limit of a force error.
    pub fn new(recipe: &Recipe, ground: &Ground, seed: u64) -> Result<Plan, Problems> {
        let mut problems = Vec::new();
        let mut steps: Vec<Vec<Entry>> = Vec::new();
        let mut presses = 0;
        let mut of_rule = Vec::new();
        if ground.unforced_mm.is_some() {
            problems.extend(recipe.strategies());
            match &recipe.rule_file {
                Some((_, text)) => of_rule = force_limits(text, None),
                None => problems.extend(force_limits(&recipe.text, Some(root::accept.name))),
            }
        }
        problems.extend(recipe.unkept_series(ground));
        problems.extend(recipe.unkept_follows());
        for (index, step) in recipe.steps.iter().enumerate() {
            check_force(step, ground, &mut problems);
            check_depth(step, ground, &mut problems);
            check_ramps(step, ground, &mut problems);
            check_drags(step, ground, &mut problems);
            check_strategy(step, ground, &mut problems);
            // counted before any is made
            if step.count(ground.layout).saturating_add(presses) > recipe.presses_max {
                problems.push(recipe.too_long(step, ground.layout));
                break;
            }
            let places = step.places(ground.layout, seed, index, &mut problems);
            check_travel(&places, ground, &mut problems);
            check_travel(&step.drag_ends(&places), ground, &mut problems);
            check_travel(&step.reference(), ground, &mut problems);
            let mut entries = step.entries(&places, seed, index);
            entries.iter_mut().zip(presses as u64..).for_each(|(entry, press)| entry.press = press);
            presses += entries.len();
            steps.push(step.visited(entries));
        }
        if let (Some((file, text)), true, false) = (&recipe.rule_file, problems.is_empty(), of_rule.is_empty()) {
            return Err(Problems::new(file, text, of_rule));
        }
        if problems.is_empty() {
            training(&mut steps, presses, ground.limits);
            let mut entries = Vec::with_capacity(steps.iter().map(Vec::len).sum());
            steps.into_iter().for_each(|step| entries.extend(step)); // each step's own are freed on the way
            // a check compares forces
            let checks = if ground.unforced_mm.is_none() { recipe.checks } else { Checks::None };
            let Recipe { on_miss, series, .. } = *recipe;
            Ok(Plan { name: recipe.name.clone(), seed, entries, checks, on_miss, series })
        } else {
            Err(Problems::new(&recipe.file, &recipe.text, problems))
        }
    }

    /// Largest force in the plan, N.
    pub fn most_n(&self) -> f64 {
        self.entries.iter().map(|entry| entry.task.most_n()).fold(0.0, f64::max)
    }

    /// Largest set depth in the plan, mm; 0 if no press is by depth.
    pub fn most_mm(&self) -> f64 {
        self.entries.iter().map(|entry| entry.task.most_mm()).fold(0.0, f64::max)
    }

    /// Returns the intervals of x and y that contain the plan's places and the ends of its drags, mm.
    pub fn envelope(&self) -> [Range; 2] {
        let ends = |entry: &Entry| [entry.place, entry.task.drag().map_or(entry.place, |drag| drag.end(entry.place))];
        let span = |along: fn(&Place) -> f64| {
            let all = self.entries.iter().flat_map(ends).map(|place| along(&place));
            let min = all.clone().fold(f64::INFINITY, f64::min);
            Range { min, max: all.fold(f64::NEG_INFINITY, f64::max) }
        };
        [span(|place| place.x_mm), span(|place| place.y_mm)]
    }
}

impl Recipe {
    /// Returns a problem for each strategy that the text states. Only a rig with a load cell follows a force.
    fn strategies(&self) -> impl Iterator<Item = Problem> {
        let places = [root::press, root::step].map(|table| positions(&self.text, &[table.name, press::strategy.name]));
        let text = "a rig without a load cell has no strategy: no force is followed";
        places.into_iter().flatten().map(move |place| Problem::new(place, text).help("remove `strategy`"))
    }

    /// Returns a problem for each step that is followed over time, if no readings are kept.
    fn unkept_follows(&self) -> impl Iterator<Item = Problem> {
        let is_followed = |step: &&Step| step.over_time != OverTime::default();
        let follows = self.steps.iter().filter(move |step| is_followed(step) && self.series == SeriesScope::None);
        follows.map(|step| {
            let text = "this step follows a level over time, but no readings are kept";
            Problem::new(step.load_span.clone(), text).help("add [record] with series = \"window\"")
        })
    }

    /// Returns a problem if readings can't be kept: they are a file of Arrow, and relative to a reading of the load cell without load.
    fn unkept_series(&self, ground: &Ground) -> Option<Problem> {
        let (text, help) = match self.series {
            SeriesScope::None => return None,
            _ if cfg!(not(feature = "files")) => (
                "`series` needs the feature `files`, which this program was built without",
                "install it with `cargo install --path . --features files`, in the program's repository, or remove `series`",
            ),
            _ if ground.unforced_mm.is_some() => (
                "`series` needs a load cell, and this rig has none",
                "remove `series`: without a load cell, a press is one row of means",
            ),
            _ => return None,
        };
        let place = positions(&self.text, &[root::record.name, record::series.name]).pop().unwrap_or(0..0);
        Some(Problem::new(place, text).help(help))
    }

    /// Returns the problem of too many presses. This step is the first one above the limit.
    fn too_long(&self, step: &Step, layout: &ArrayLayout) -> Problem {
        let presses = self.steps.iter().map(|step| step.count(layout)).fold(0, usize::saturating_add);
        let is_possible = presses <= PRESSES_CEILING;
        let most = if is_possible { self.presses_max } else { PRESSES_CEILING };
        let text = format!("the plan has {presses} presses, but at most {most} are allowed");
        let help = match is_possible {
            true => format!("split the recipe, or add --presses-max {presses}"),
            false => "use a coarser `spacing_mm`, or split the recipe".to_owned(),
        };
        Problem::new(step.places_span.clone(), text).help(help)
    }
}

impl Places {
    fn count(&self, layout: &ArrayLayout) -> usize {
        match self {
            Places::Grid { x_mm, y_mm, spacing_mm, .. } => {
                points(*x_mm, *spacing_mm).saturating_mul(points(*y_mm, *spacing_mm))
            }
            Places::Cells { columns, rows, .. } => columns.saturating_mul(*rows),
            Places::List(places) => places.len(),
            Places::Random { count, .. } => *count as usize,
            Places::Units(UnitChoice::All) => layout.units().len(),
            Places::Units(UnitChoice::Some(units)) => units.len(),
        }
    }
}

impl Step {
    /// Number of presses of the step.
    fn count(&self, layout: &ArrayLayout) -> usize {
        self.places.count(layout).saturating_mul(self.load.repeats()).saturating_mul(self.drags.len().max(1))
    }

    /// Returns where the drags of the step end.
    fn drag_ends(&self, places: &[(Place, Span)]) -> Vec<(Place, Span)> {
        let end = |place: &Place, drag: &Drag| (drag.end(*place), self.drag_span.clone());
        places.iter().flat_map(|(place, _)| self.drags.iter().map(move |drag| end(place, drag))).collect()
    }

    /// Returns the step's places, each with its position in the text.
    fn places(&self, layout: &ArrayLayout, seed: u64, index: usize, problems: &mut Vec<Problem>) -> Vec<(Place, Span)> {
        let here = |place: Place| (place, self.places_span.clone());
        match &self.places {
            Places::Grid { x_mm, y_mm, spacing_mm, .. } => {
                let along = |range: Range| {
                    let last = points(range, *spacing_mm) - 1;
                    (0..=last).map(move |i| range.min + range.width() * i as f64 / last.max(1) as f64)
                };
                along(*y_mm).flat_map(|y| along(*x_mm).map(move |x| Place::new(x, y))).map(here).collect()
            }
            Places::Cells { x_mm, y_mm, columns, rows } => {
                cell_centres(*x_mm, *y_mm, *columns, *rows).into_iter().map(here).collect()
            }
            Places::List(places) => places.clone(),
            Places::Random { count, x_mm, y_mm } => {
                let mut rng = stream(seed, index as u64, "plan places");
                let mut draw = |range: &Range| to_grain(rng.random_range(range.min..=range.max), 1e-3, range);
                (0..*count).map(|_| here(Place::new(draw(x_mm), draw(y_mm)))).collect()
            }
            Places::Units(UnitChoice::All) => layout.one_per_unit().places().iter().copied().map(here).collect(),
            Places::Units(UnitChoice::Some(units)) => {
                let there = layout.one_per_unit();
                let place = |(unit, span): &(usize, Span)| match there.places().get(unit.wrapping_sub(1)) {
                    Some(place) => Some((*place, span.clone())),
                    None => {
                        let text = format!("there is no unit {unit}: the rig's array has {}", there.len());
                        problems.push(Problem::new(span.clone(), text));
                        None
                    }
                };
                units.iter().filter_map(place).collect()
            }
        }
    }

    /// Returns the step's entries in the order in which their places are visited. Entries of one place stay together.
    fn visited(&self, entries: Vec<Entry>) -> Vec<Entry> {
        match &self.places {
            Places::Grid { x_mm, y_mm, spacing_mm, order: GridOrder::Interleaved } => {
                let by_place: Vec<&[Entry]> = entries.chunks(self.load.repeats() * self.drags.len().max(1)).collect();
                let order = GridOrder::Interleaved.visits(points(*x_mm, *spacing_mm), points(*y_mm, *spacing_mm));
                order.into_iter().flat_map(|place| by_place[place]).cloned().collect()
            }
            _ => entries, // as they are numbered
        }
    }

    /// Returns the reference place of the step, if it has one.
    fn reference(&self) -> Vec<(Place, Span)> {
        match &self.load {
            StepLoad::Cycles { reference, .. } => vec![(*reference, self.load_span.clone())],
            _ => Vec::new(),
        }
    }

    /// Adds an entry once for each drag; once if there is none.
    fn dragged(entry: Entry, drags: &[Arc<Drag>], entries: &mut Vec<Entry>) {
        let with = |drag: &Arc<Drag>| {
            let task = PressTask { drag: Some(drag.clone()), ..entry.task.clone() };
            Entry { task, ..entry.clone() }
        };
        entries.extend(drags.iter().map(with));
        if drags.is_empty() {
            entries.push(entry);
        }
    }

    /// Returns the step's entries in the order of their numbers, which aren't assigned yet.
    fn entries(&self, places: &[(Place, Span)], seed: u64, index: usize) -> Vec<Entry> {
        let mut rng = stream(seed, index as u64, "plan forces");
        let drags: Vec<Arc<Drag>> = self.drags.iter().copied().map(Arc::new).collect();
        let mut entries = Vec::with_capacity(places.len() * self.load.repeats() * drags.len().max(1));
        // one for all: a staircase may have thousands
        let same = match &self.load {
            StepLoad::Force(force_n) | StepLoad::Cycles { force_n, .. } => PressTask::press(*force_n),
            StepLoad::Rest => PressTask::press(0.0),
            StepLoad::Wave { forces_n, .. } => PressTask::forces(forces_n),
            StepLoad::RandomForce(_) | StepLoad::Depths(_) | StepLoad::RandomDepth(_) => Arc::default(),
            StepLoad::Staircase { to_n, step_n, .. } => PressTask::staircase(*to_n, *step_n),
        };
        let over_time = (self.over_time != OverTime::default()).then(|| Arc::new(self.over_time.clone()));
        for (place, _) in places {
            let entry = |levels: Arc<[PressLevel]>, rest_after_s| Entry {
                press: 0,
                phase: self.phase,
                place: *place,
                task: PressTask {
                    levels,
                    force_tolerance_n: self.manner.force_tolerance_n,
                    depth_tolerance_mm: self.manner.depth_tolerance_mm,
                    hold_s: self.manner.hold_s,
                    sample_s: self.manner.sample_s,
                    // a depth is found by steps below the touch
                    strategy: if self.load.most_mm() > 0.0 { Strategy::Guarded } else { self.manner.strategy },
                    sample_after_s: self.manner.sample_after_s,
                    over_time: over_time.clone(),
                    drag: None,
                },
                rest_after_s,
            };
            match &self.load {
                StepLoad::Rest | StepLoad::Wave { .. } => entries.push(entry(same.clone(), 0.0)),
                StepLoad::Cycles { presses, reference_every, reference, .. } => {
                    let cycle = entry(same.clone(), 0.0);
                    let at_reference = Entry { place: *reference, ..cycle.clone() };
                    entries.push(at_reference.clone());
                    for made in 1..=*presses {
                        entries.push(cycle.clone());
                        if made % reference_every == 0 || made == *presses {
                            entries.push(at_reference.clone());
                        }
                    }
                }
                StepLoad::Force(_) => Step::dragged(entry(same.clone(), 0.0), &drags, &mut entries),
                StepLoad::RandomForce(range) => {
                    let force_n = to_grain(rng.random_range(range.min..=range.max), 1e-3, range);
                    Step::dragged(entry(PressTask::press(force_n), 0.0), &drags, &mut entries);
                }
                StepLoad::Depths(depths_mm) => {
                    let levels = depths_mm.iter().map(|depth_mm| PressTask::one(SetPoint::Depth(*depth_mm)));
                    entries.extend(levels.map(|levels| entry(levels, 0.0)));
                }
                StepLoad::RandomDepth(range) => {
                    let depth_mm = to_grain(rng.random_range(range.min..=range.max), 1e-3, range);
                    entries.push(entry(PressTask::one(SetPoint::Depth(depth_mm)), 0.0));
                }
                StepLoad::Staircase { repeats, rest_s, .. } => {
                    for repeat in 1..=*repeats {
                        let rest_after_s = if repeat < *repeats { *rest_s } else { 0.0 };
                        entries.push(entry(same.clone(), rest_after_s));
                    }
                }
            }
        }
        entries
    }
}

/// Number of points on an interval, including both ends.
fn points(range: Range, spacing_mm: f64) -> usize {
    ((range.width() / spacing_mm).round() as usize).saturating_add(1)
}

/// Rounds to the resolution of the instruments, inside the range.
fn to_grain(value: f64, grain: f64, range: &Range) -> f64 {
    ((value / grain).round() * grain).clamp(range.min, range.max)
}

fn check_force(step: &Step, ground: &Ground, problems: &mut Vec<Problem>) {
    let (most_n, limits) = (step.load.most_n(), ground.limits);
    if most_n > 0.0 && ground.unforced_mm.is_some() {
        let text = "this step presses by force, but the rig has no load cell (`load_cell = \"none\"`)";
        let help = "press by depth: `depth_mm`, or a range `depth_mm` inside `random`";
        problems.push(Problem::new(step.load_span.clone(), text).help(help));
        return;
    }
    if most_n > limits.force_n {
        let text = format!("this step presses with {most_n} N, over the specimen's limit of {} N", limits.force_n);
        let help = format!(
            "use at most {} N, or raise `limits.force_n` in the rig if the specimen can take it",
            limits.force_n
        );
        problems.push(Problem::new(step.load_span.clone(), text).help(help));
    }
}

fn check_depth(step: &Step, ground: &Ground, problems: &mut Vec<Problem>) {
    let limits = ground.limits;
    let most_mm = step.load.most_mm();
    if let Some(unforced_mm) = ground.unforced_mm.filter(|unforced_mm| most_mm > *unforced_mm) {
        let text = format!(
            "this step presses {most_mm} mm deep, over the {} mm that are allowed without a load cell: `limits.force_n` of {} N over \
             `limits.stiffness_n_mm` of {} N/mm, minus the uncertainty of a surface that a person confirmed",
            round(unforced_mm, 3),
            limits.force_n,
            limits.stiffness_n_mm
        );
        let help = "press less deep, or find the surface more exactly: a smaller `surface_mm.uncertainty`";
        problems.push(Problem::new(step.load_span.clone(), text).help(help));
        return;
    }
    let room_mm = limits.depth_mm - DEPTH_MARGIN_MM;
    if most_mm > room_mm {
        let text = format!(
            "this step presses {most_mm} mm deep, over the {} mm that the specimen's depth limit of {} mm leaves",
            round(room_mm, 3),
            limits.depth_mm
        );
        let help = "press less deep, or raise `limits.depth_mm` in the rig if the specimen can take it";
        problems.push(Problem::new(step.load_span.clone(), text).help(help));
    }
}

/// Checks ramps as the permit does: their way back begins above the surface, with no force.
fn check_ramps(step: &Step, ground: &Ground, problems: &mut Vec<Problem>) {
    let (most_mm, limits) = (step.load.most_mm(), ground.limits);
    let most_n = most_mm * limits.stiffness_n_mm;
    if !step.over_time.ramps_mm_s.is_empty() && most_n > limits.force_n {
        let text = format!(
            "a ramp to {most_mm} mm may press with {} N at `limits.stiffness_n_mm`, over the limit of {} N",
            round(most_n, 3),
            limits.force_n
        );
        problems.push(Problem::new(step.load_span.clone(), text).help("press less deep"));
    }
}

/// Checks that a stage isn't asked to change the speed of a motion if it can't.
fn check_strategy(step: &Step, ground: &Ground, problems: &mut Vec<Problem>) {
    if !ground.abilities.changes_speed && step.manner.strategy == Strategy::Velocity && step.load.most_mm() == 0.0 {
        let text = "the strategy \"velocity\" needs a stage that changes its speed, and this one finishes each motion unchanged";
        problems.push(Problem::new(step.places_span.clone(), text).help("write `strategy = \"guarded\"`"));
    }
}

fn check_travel(places: &[(Place, Span)], ground: &Ground, problems: &mut Vec<Problem>) {
    // one problem a stretch of text: a grid that is off isn't reported 625 times
    let mut text: Option<Span> = None;
    for (place, span) in places {
        let position = ground.frame.to_stage(*place, 0.0);
        let Some(axis) = [Axis::X, Axis::Y].into_iter().find(|&a| !ground.travel.along(a).contains(position.along(a)))
        else {
            continue;
        };
        if text.as_ref() == Some(span) {
            continue;
        }
        if problems.len() > PROBLEMS_MAX {
            break; // more than are reported
        }
        let (travel, name) = (ground.travel.along(axis), axis.name());
        let at = position.along(axis);
        let place = format!("({}, {}) mm", place.x_mm, place.y_mm);
        // where the frame is moved or turned, the stage's own coordinate is another one
        let is_moved =
            ground.frame.to_stage(Place::default(), 0.0).along(axis) != 0.0 || ground.frame.rotation_deg != 0.0;
        let where_ = match is_moved {
            true => format!("{place} is at {name} = {} mm of the stage, outside its travel", round(at, 3)),
            false => format!("{place} is outside the stage's travel"),
        };
        let message = format!("{where_}: {name} goes from {} to {} mm", travel.min, travel.max);
        problems.push(Problem::new(span.clone(), message).help("keep places within `stage.travel_mm` of the rig"));
        text = Some(span.clone());
    }
}
