//! A printer with Marlin: an Ender 3 that presses 0.3 N.

use super::{Finishing, Wrong};
use palpate_run::rig::{RigSpec, SimulatedRig};
use palpate_sim::emulator::MarlinFaultKind::{Chatter, GarbledLine, LostOk, MotorsOff, Restart};
use palpate_sim::emulator::{
    GRBL_ROOM_MM, MarlinAnnounced::Start, MarlinBoard, MarlinEmulator, MarlinFault, MarlinFaultKind,
};
use std::sync::{Arc, Mutex};

const PRINTER: Finishing<MarlinFaultKind> = Finishing {
    rig: "rigs/marlin.toml",
    force_n: 0.3,
    limit_n: 1.0,
    stiffnesses_n_mm: &[5.0, 10.0, 20.0],
    faults: &[LostOk, GarbledLine, Chatter { every_s: 0.3 }, Restart(Start), MotorsOff],
    install,
    is_mended: |kind| matches!(kind, LostOk | GarbledLine | Chatter { .. }),
};

fn install(spec: &RigSpec, rig: &mut SimulatedRig, from_s: f64, kind: MarlinFaultKind) {
    let axes = spec.stage.travel.axes;
    let board = MarlinBoard {
        min_ends_mm: axes.map(|travel| travel.min - GRBL_ROOM_MM),
        lengths_mm: axes.map(|travel| travel.max - travel.min + 2.0 * GRBL_ROOM_MM),
        faults: vec![MarlinFault { from_s, kind }],
        ..MarlinBoard::default()
    };
    let stage = MarlinEmulator::new(board, &rig.scene.lock().expect("nobody else has it"));
    rig.stage.replace(Arc::new(Mutex::new(stage)));
}

#[test]
fn presses_are_within_half_a_step_and_take_seconds() {
    for (press, most_s) in [((5.0, 80.0), 6.0), ((20.0, 80.0), 6.0), ((20.0, 10.0), 10.0)] {
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
