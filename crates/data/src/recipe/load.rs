//! The load of a step: its force, its depth or its levels.

use super::keys::{press, staircase, step};
use super::over_time::{read_cycles, read_wave};
use super::parse::WHOLE;
use super::{Manner, Phase, StepLoad};
use palpate_document::{Problem, Span, Table};

/// Largest number of steps of a staircase.
pub(super) const STEPS_MOST: f64 = 1000.0;

/// Load of a step that has no problem; the load itself is `None` if it has one.
pub(super) struct ReadLoad {
    pub load: Option<StepLoad>,
    /// Position in the text.
    pub span: Span,
}

/// Reads the load of a step. `random_load` is that of random places, and `inner` whether they have a force and a depth. `None` if the
/// step can't be read any further.
pub(super) fn read_load(
    table: &Table,
    phase: Option<Phase>,
    random_load: Option<StepLoad>,
    inner: [bool; 2],
) -> Option<ReadLoad> {
    if table.is_list(&step::force_n) {
        let text = "`force_n` is an interval, expected one force in N";
        let help = "an interval is a key of `random`: random = { count = 40, ..., force_n = [0.3, 2.0] }. \
                    On a rig without a load cell, use `depth_mm`";
        table.complain(Problem::new(table.span_of(&step::force_n), text).help(help));
        return None;
    }
    let force = table.number(&step::force_n).map(StepLoad::Force);
    let depths = table.has(&step::depth_mm).then(|| table.number_or_list(&step::depth_mm)).flatten();
    if depths.as_ref().is_some_and(Vec::is_empty) {
        table.complain(Problem::new(table.span_of(&step::depth_mm), "`depth_mm` is empty: nothing to press"));
    }
    // the keys of a table are checked in every phase
    let (staircase, wave, cycles) = (read_staircase(table), read_wave(table), read_cycles(table));
    let own = [&step::force_n, &step::depth_mm, &step::staircase, &step::wave].map(|key| table.has(key));
    let loads = own.into_iter().chain(inner).filter(|is_there| *is_there).count();
    if phase == Some(Phase::Rest) && loads > 0 {
        let text = "a rest has no force and no depth: it is read without load";
        table.complain(Problem::new(table.span(), text).help("remove it, or use the phase \"creep\""));
    } else if loads != 1 && phase != Some(Phase::Rest) {
        let found = if loads == 0 { "no force and no depth" } else { "more than one force or depth" };
        let help = "a step has one of `force_n`, `depth_mm`, `staircase`, `wave`, or a range `force_n` or `depth_mm` inside `random`";
        table.complain(Problem::new(table.span(), format!("this step has {found}")).help(help));
    }
    let keys = [step::force_n, step::depth_mm, step::staircase, step::wave, step::random];
    let key = keys.into_iter().find(|key| table.has(key));
    let load = match phase {
        Some(Phase::Rest) => Some(StepLoad::Rest),
        Some(Phase::Cycles) => cycles.and_then(|cycles| cycles.with_force(table, force.as_ref())),
        _ => random_load.or(force).or(depths.map(StepLoad::Depths)).or(staircase).or(wave),
    };
    Some(ReadLoad { load, span: table.span_of(&key.unwrap_or(step::phase)) })
}

fn read_staircase(step: &Table) -> Option<StepLoad> {
    let table = step.table(&step::staircase)?;
    let to_n = table.number(&staircase::to_n);
    let step_n = table.number(&staircase::step_n);
    let repeats = table.whole(&staircase::repeats);
    let rest_s = table.number(&staircase::rest_s);
    if let (Some(to), Some(step)) = (to_n, step_n) {
        let steps = to / step;
        let span = table.span_of(&staircase::step_n);
        if (steps - steps.round()).abs() > WHOLE * steps.max(1.0) || steps < 0.5 {
            let text = format!("`step_n` {step} doesn't divide `to_n` {to}");
            table.complain(Problem::new(span, text).help("levels are equal steps from 0 to `to_n`"));
        } else if steps > STEPS_MOST {
            table.complain(Problem::new(span, format!("{steps:.0} levels, but at most {STEPS_MOST} are allowed")));
        }
    }
    Some(StepLoad::Staircase { to_n: to_n?, step_n: step_n?, repeats: repeats?, rest_s: rest_s? })
}

impl StepLoad {
    /// Quantity and unit of the load, the key of its tolerance, the tolerance, and the smallest value above zero.
    pub(super) fn least(&self, manner: &Manner) -> (&'static str, &'static str, &'static str, f64, f64) {
        let force = |least_n: f64| ("force", "N", press::force_tolerance_n.name, manner.force_tolerance_n, least_n);
        let depth = |least_mm| ("depth", "mm", press::depth_tolerance_mm.name, manner.depth_tolerance_mm, least_mm);
        match self {
            StepLoad::Force(force_n) | StepLoad::Cycles { force_n, .. } => force(*force_n),
            StepLoad::Rest => force(f64::INFINITY),
            StepLoad::Wave { forces_n, .. } => {
                force(forces_n.iter().copied().filter(|force_n| *force_n > 0.0).fold(f64::INFINITY, f64::min))
            }
            StepLoad::RandomForce(range) => force(range.min),
            StepLoad::Staircase { step_n, .. } => force(*step_n),
            StepLoad::Depths(depths_mm) => depth(depths_mm.iter().copied().fold(f64::INFINITY, f64::min)),
            StepLoad::RandomDepth(range) => depth(range.min),
        }
    }

    /// Number of entries for each place.
    pub(super) fn repeats(&self) -> usize {
        match self {
            StepLoad::Staircase { repeats, .. } => *repeats as usize,
            StepLoad::Depths(depths_mm) => depths_mm.len(),
            StepLoad::Cycles { presses, reference_every, .. } => {
                presses.saturating_add(1).saturating_add(presses.div_ceil(*reference_every)) as usize
            }
            _ => 1,
        }
    }

    /// Largest force of the load, N; 0 for depths.
    pub fn most_n(&self) -> f64 {
        match self {
            StepLoad::Force(force_n) | StepLoad::Cycles { force_n, .. } => *force_n,
            StepLoad::RandomForce(range) => range.max,
            StepLoad::Staircase { to_n, .. } => *to_n,
            StepLoad::Wave { forces_n, .. } => forces_n.iter().copied().fold(0.0, f64::max),
            StepLoad::Depths(_) | StepLoad::RandomDepth(_) | StepLoad::Rest => 0.0,
        }
    }

    /// Largest depth of the load, mm; 0 for forces.
    pub fn most_mm(&self) -> f64 {
        match self {
            StepLoad::Depths(depths_mm) => depths_mm.iter().copied().fold(0.0, f64::max),
            StepLoad::RandomDepth(range) => range.max,
            _ => 0.0,
        }
    }
}
