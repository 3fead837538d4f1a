//! A printer with Marlin: an Ender 3 that presses 0.3 N.

use super::{Finishing, Wrong};
use crate::families;
use palpate_sim::emulator::MarlinFaultKind::{Chatter, GarbledLine, LostOk, MotorsOff, Restart};
use palpate_sim::emulator::{MarlinAnnounced::Start, MarlinFaultKind};

const PRINTER: Finishing<MarlinFaultKind> = Finishing {
    family: families::MARLIN,
    force_n: 0.3,
    limit_n: 1.0,
    stiffnesses_n_mm: &[5.0, 10.0, 20.0],
    faults: &[LostOk, GarbledLine, Chatter { every_s: 0.3 }, Restart(Start), MotorsOff],
    is_mended: |kind| matches!(kind, LostOk | GarbledLine | Chatter { .. }),
};

#[test]
fn presses_are_within_half_a_step_and_take_seconds() {
    // the last one takes some 10 s at the 115,200 baud of its rig
    for (press, most_s) in [((5.0, 80.0), 6.0), ((20.0, 80.0), 6.0), ((20.0, 10.0), 12.0)] {
        PRINTER.check_presses(press, most_s);
    }
}

#[test]
fn no_force_is_over_the_limit_whatever_fails() {
    // in the last one the cell sticks slightly over its zero before the first touch
    let ends = PRINTER.check_faults(&[3553]);
    for (wrong, end) in ends.iter().filter(|(wrong, _)| *wrong == Wrong::Stage(Restart(Start))) {
        assert!(["-", "device", "stage-silent"].contains(end), "{wrong:?}: {end}");
    }
}

#[test]
fn the_velocity_strategy_is_refused() {
    PRINTER.check_velocity_is_refused();
}
