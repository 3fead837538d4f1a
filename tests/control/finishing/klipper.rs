//! A printer with Klipper: the Ender 3 of its Marlin twin.

use super::{Finishing, Wrong};
use crate::families;
use palpate_sim::emulator::KlipperFaultKind;
use palpate_sim::emulator::KlipperFaultKind::{
    IdleTimeout, LostAnswer, McuRestart, MoonrakerRestart, Shutdown, SlowAnswer,
};

const PRINTER: Finishing<KlipperFaultKind> = Finishing {
    family: families::KLIPPER,
    force_n: 0.3,
    limit_n: 1.0,
    stiffnesses_n_mm: &[5.0, 10.0, 20.0],
    faults: &[Shutdown, McuRestart, MoonrakerRestart, LostAnswer, SlowAnswer(1.0), IdleTimeout],
    is_mended: |_| false,
};

#[test]
fn presses_are_within_half_a_step_and_take_seconds() {
    for (press, most_s) in [((5.0, 80.0), 6.0), ((20.0, 80.0), 8.0), ((20.0, 10.0), 14.0)] {
        PRINTER.check_presses(press, most_s);
    }
}

#[test]
fn no_force_is_over_the_limit_whatever_fails() {
    let ends = PRINTER.check_faults(&[]);
    for (wrong, end) in ends {
        if let Wrong::Stage(Shutdown | McuRestart | IdleTimeout) = wrong {
            assert!(["-", "device", "stage-silent"].contains(&end), "{wrong:?}: {end}");
        }
    }
}

#[test]
fn the_velocity_strategy_is_refused() {
    PRINTER.check_velocity_is_refused();
}
