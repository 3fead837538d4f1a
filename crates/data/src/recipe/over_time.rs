//! What a step does over time: levels that are followed, ramps, cycles and waves.

use super::keys::{self, cycles, step, wave};
use super::load::STEPS_MOST;
use super::{Manner, Phase, StepLoad};
use palpate_control::OverTime;
use palpate_core::quantity::Place;
use palpate_document::{Key, Problem, Table};

/// Reads what the presses of a step do over time. Each key belongs to one phase or two.
pub(super) fn read_over_time(
    table: &Table,
    phase: Option<Phase>,
    manner: &Manner,
    load: Option<&StepLoad>,
) -> OverTime {
    let only_in = |is_there: bool, key: &Key, phases: &[Phase], needs: &str| {
        let Some(phase) = phase else { return };
        let names: Vec<String> = phases.iter().map(|phase| format!("{:?}", phase.name())).collect();
        let problem = match (is_there, phases.contains(&phase)) {
            (true, false) => {
                Problem::new(table.span(), format!("`{}` isn't used in the phase {:?}", key.name, phase.name()))
                    .help(format!("write the phase {}", names.join(" or ")))
            }
            (false, true) if !needs.is_empty() => {
                Problem::new(table.span(), format!("the phase {:?} needs `{}`", phase.name(), key.name))
                    .help(format!("write {needs}"))
            }
            _ => return,
        };
        table.complain(problem);
    };
    let (follow_s, has) = (manner.follow_s, |key| table.has(key));
    only_in(
        follow_s > 0.0,
        &keys::press::follow_s,
        &[Phase::Creep, Phase::Rest],
        "for how long, such as follow_s = 600.0",
    );
    only_in(has(&step::holds), &step::holds, &[Phase::Creep], "");
    only_in(has(&step::ramps_mm_s), &step::ramps_mm_s, &[Phase::Ramp], "the speeds, such as ramps_mm_s = [0.1, 1.0]");
    let example = "cycles = { presses = 10000, reference_mm = [[5.0, 5.0]] }";
    only_in(has(&step::cycles), &step::cycles, &[Phase::Cycles], example);
    only_in(has(&step::wave), &step::wave, &[Phase::Wave], "wave = { force_n = [0.2, 0.8, 0.4], for_s = 5.0 }");
    let holds_force = table.word(&step::holds, &keys::HELD).unwrap_or(false);
    let ramps_mm_s = table.has(&step::ramps_mm_s).then(|| table.number_or_list(&step::ramps_mm_s)).flatten();
    let ramps_mm_s = ramps_mm_s.unwrap_or_default();
    if ramps_mm_s.is_empty() && has(&step::ramps_mm_s) {
        table.complain(Problem::new(table.span_of(&step::ramps_mm_s), "`ramps_mm_s` is empty: no ramp"));
    }
    match load {
        Some(StepLoad::Wave { for_s, .. }) => OverTime { follow_s: for_s.clone(), holds_force: true, ramps_mm_s },
        _ if follow_s > 0.0 => {
            let before_last = match load {
                // up and down; a staircase with more steps is refused
                Some(StepLoad::Staircase { to_n, step_n, .. }) => {
                    2 * (to_n / step_n).round().clamp(1.0, STEPS_MOST) as usize
                }
                _ => 0,
            };
            let mut each_s = vec![0.0; before_last];
            each_s.push(follow_s);
            OverTime { follow_s: each_s, holds_force, ramps_mm_s }
        }
        _ => OverTime { ramps_mm_s, ..OverTime::default() },
    }
}

/// Presses that are repeated, without their force.
pub(super) struct Cycles {
    presses: u64,
    reference_every: u64,
    reference: Place,
}

impl Cycles {
    /// Returns the load of a step with these cycles, which has one force.
    pub(super) fn with_force(self, table: &Table, force: Option<&StepLoad>) -> Option<StepLoad> {
        let Some(StepLoad::Force(force_n)) = force else {
            table.complain(Problem::new(table.span(), "`cycles` needs one force").help("add force_n = 1.0"));
            return None;
        };
        let Cycles { presses, reference_every, reference } = self;
        Some(StepLoad::Cycles { force_n: *force_n, presses, reference_every, reference })
    }
}

/// Reads many presses at one place: their number, that between reference presses, and the reference place.
pub(super) fn read_cycles(step_table: &Table) -> Option<Cycles> {
    let table = step_table.table(&step::cycles)?;
    let (presses, every) = (table.whole(&cycles::presses), table.whole(&cycles::reference_every));
    let references = table.places(&cycles::reference_mm)?;
    let [(reference, _)] = references[..] else {
        let text = format!("`reference_mm` has {} places, expected one", references.len());
        table.complain(Problem::new(table.span_of(&cycles::reference_mm), text).help("write [[x, y]]"));
        return None;
    };
    Some(Cycles { presses: presses?, reference_every: every?, reference })
}

/// Reads a wave: forces one after another, each with its time.
pub(super) fn read_wave(step_table: &Table) -> Option<StepLoad> {
    let table = step_table.table(&step::wave)?;
    let (forces_n, for_s) = (table.number_or_list(&wave::force_n), table.number_or_list(&wave::for_s));
    let (forces_n, mut for_s) = (forces_n?, for_s?);
    if for_s.len() == 1 {
        for_s.resize(forces_n.len(), for_s[0]);
    }
    let problem = if forces_n.len() != for_s.len() {
        Some((&wave::for_s, format!("`for_s` has {} times for {} forces", for_s.len(), forces_n.len())))
    } else if !forces_n.iter().any(|force_n| *force_n > 0.0) {
        Some((&wave::force_n, "`force_n` has no force above 0: nothing to press".to_owned()))
    } else {
        None
    };
    match problem {
        Some((key, text)) => {
            table.complain(Problem::new(table.span_of(key), text).help("write force_n = [0.2, 0.8], for_s = 5.0"));
            None
        }
        None => Some(StepLoad::Wave { forces_n, for_s }),
    }
}
