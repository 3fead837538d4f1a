//! Sound rigs whose calibrations once ended falsely, one for each cause.

use crate::families::{GRBL, PROGRAM, rig_of, shipped_rig};
use palpate_run::rig::RigSpec;
use palpate_sim::scene::{ContactLaw, LoadCellScene};
use palpate_testing::executions::{ExecutedRun, executed, plan};
use palpate_testing::{exchanged, shipped_text};

/// Executes some presses with forces up to this one.
fn pressed(spec: &RigSpec, most_n: f64, seed: u64) -> ExecutedRun {
    let text = format!(
        "name = \"mended\"\nchecks = \"none\"\n[press]\nforce_tolerance_n = {}\nhold_s = 0.0\nsample_s = 0.1\nstrategy = \"guarded\"\n\
         [[step]]\nphase = \"calibration\"\nrandom = {{ count = 4, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0], force_n = [{}, {most_n}] }}\n",
        most_n / 20.0,
        most_n / 3.0
    );
    executed(spec, &plan(spec, &text, seed))
}

fn must_complete(spec: &RigSpec, most_n: f64) {
    let run = pressed(spec, most_n, 1);
    assert_eq!(run.ending.text(), None);
    assert!(run.truth.force_n <= spec.limits.force_n, "{:?}", run.truth);
}

/// Its looks took longer than a force stays fresh: `stale`.
#[test]
fn a_slow_array_makes_no_force_stale() {
    let mut spec = shipped_rig("rigs/sim.toml");
    spec.scene.latencies.array_s = (0.08, 0.1);
    must_complete(&spec, 1.0);
}

/// It rests half a step beyond its travel, and was sent back there.
#[test]
fn an_axis_whose_steps_do_not_divide_its_travel_stays_in_it() {
    let text = shipped_text(PROGRAM.rig);
    let text = exchanged(&text, "speed_mm_s", "step_mm = { x = 0.0125, y = 0.0125, z = 0.0092 }\nspeed_mm_s");
    must_complete(&rig_of(PROGRAM.rig, &text), 1.0);
}

/// The force that shows as a contact was deeper than the search: `no-contact`.
#[test]
fn a_noisy_cell_finds_a_soft_specimen() {
    let mut spec = shipped_rig(GRBL.rig);
    (spec.limits.force_n, spec.limits.stiffness_n_mm) = (13.0, 1.6);
    spec.scene.contact = ContactLaw { linear_n_mm: 0.9, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
    spec.scene.load_cell = Some(LoadCellScene { noise_n: 0.13, ..LoadCellScene::IDEAL });
    must_complete(&spec, 0.8);
}
