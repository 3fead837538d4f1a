//! A person asks to stop while the stage answers wrongly, or not at all: the run ends in time, and never as if it let go of what it presses.

use super::families::{ESP301, Family, GRBL, KLIPPER, LEFT_N, MARLIN, PROGRAM, When, XPS};
use palpate_core::quantity::{Axis, stream};
use palpate_run::run::{Halt, Remaining};
use palpate_sim::emulator::{
    EspFaultKind, GrblFaultKind, KlipperFaultKind, MarlinFaultKind, ProcessStageFaultKind, XpsFaultKind,
};
use palpate_testing::campaign;
use palpate_testing::executions::{Deaths, executed_until, in_parallel, must_be_none};
use rand::RngExt;
use std::fmt::Debug;
use std::time::Duration;

/// Runs with each fault.
const RUNS: (usize, usize) = (3, 90);

/// Longest time between a fault and the request, s.
const ASKED_WITHIN_S: f64 = 2.0;

/// Longest end after the request beside two ways along z, s: 5 s, a last stop, and what is read of the force that remains.
const ENDS_WITHIN_S: f64 = 5.0 + 1.0 + 2.5;

impl<K: Copy + Debug + Send + Sync> Family<K> {
    /// Asks to stop some time after a fault in a press of 1 N that is held.
    fn asks(&self, kind: K) {
        let spec = self.over_specimen();
        let plan = self.press(&spec);
        let never = Duration::from_secs(3600);
        let run = |asked_after, fault| {
            executed_until(&spec, &plan, asked_after, Deaths::Ignored, &|rig| self.install(&spec, rig, fault))
        };
        let sound = run(never, None);
        let mut rng = stream(1, 0, "asked to stop");
        let times: Vec<(f64, f64)> = (0..campaign::size(RUNS.0, RUNS.1))
            .map(|_| [sound.ready_s..sound.virtual_s, 0.0..ASKED_WITHIN_S].map(|range| rng.random_range(range)))
            .map(|[fault_s, later_s]| (fault_s, fault_s + later_s))
            .collect();
        let ways_s = 2.0 * spec.stage.travel.along(Axis::Z).width() / spec.stage.speed_mm_s;
        let outcomes = in_parallel(&times, |&(fault_s, asked_s)| {
            let run = run(Duration::from_secs_f64(asked_s), Some((When::At(fault_s), kind)));
            let is_stated = run.ending.unparked.is_some() || run.ending.remaining != Remaining::Nothing;
            // the way out of a fault is slower
            let is_asked = matches!(run.ending.halt, Some(Halt::Cancelled));
            let took_s = if is_asked { run.virtual_s - asked_s } else { 0.0 };
            (took_s, run.left_n, is_stated, run.ending.text())
        });
        let longest_s = outcomes.iter().fold(0.0f64, |longest_s, (took_s, ..)| longest_s.max(*took_s));
        println!("{} {kind:?}: {} runs, the longest end {longest_s:.1} s", self.rig, outcomes.len());
        let is_wrong = |took_s: f64, left_n: f64, is_stated: bool| {
            took_s > ways_s + ENDS_WITHIN_S || (left_n > LEFT_N && !is_stated)
        };
        let broken =
            times.iter().zip(&outcomes).filter(|(_, (took_s, left_n, stated, _))| is_wrong(*took_s, *left_n, *stated));
        must_be_none(&broken.map(|(times, outcome)| format!("{times:?} {kind:?}: {outcome:?}")).collect::<Vec<_>>());
    }
}

#[test]
fn a_run_with_a_printer_ends_in_time() {
    use MarlinFaultKind::{Busy, Chatter, DoubledOk, LostOk};
    for kind in [Busy, Chatter { every_s: 0.001 }, DoubledOk, LostOk] {
        MARLIN.asks(kind);
    }
    KLIPPER.asks(KlipperFaultKind::McuRestart);
}

#[test]
fn a_run_with_a_stage_that_can_stop_ends_in_time() {
    for kind in [GrblFaultKind::LostOk, GrblFaultKind::DoubledOk] {
        GRBL.asks(kind);
    }
    for kind in [EspFaultKind::NeverDone, EspFaultKind::DoubledAnswer, EspFaultKind::LostAnswer] {
        ESP301.asks(kind);
    }
    for kind in [XpsFaultKind::LostAnswer, XpsFaultKind::DoubledAnswer] {
        XPS.asks(kind);
    }
    use ProcessStageFaultKind::{DoubledAnswer, IgnoresStop, LostAnswer, NeverDone};
    for kind in [NeverDone, IgnoresStop, DoubledAnswer, LostAnswer] {
        PROGRAM.asks(kind);
    }
}
