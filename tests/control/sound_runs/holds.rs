//! Long holds with a sound stage whose read-back wanders slowly: none trips.

use super::super::families::{ARM, ESP301, Family, GRBL, KLIPPER, MARLIN, PROGRAM, XPS};
use super::SoundOutcome;
use super::wire::{self, Wander, Wire, tap};
use palpate_core::quantity::{Axis, stream};
use palpate_run::rig::{RigSpec, SimulatedRig};
use palpate_sim::emulator::{Shared, UrArm, UrEmulator};
use palpate_testing::campaign;
use palpate_testing::executions::{Deaths, executed_with, in_parallel, plan};
use rand::RngExt;
use std::f64::consts::PI;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::{Arc, Mutex};

/// Holds of a family, and of the arm with each noise: all of them in ten minutes on two cores. How long each is, s.
const HOLDS: (usize, usize) = (1, 160);
const HOLDS_OF_ARM: (usize, usize) = (1, 80);
const HOLD_S: (usize, usize) = (20, 600);

/// Amplitude of a read-back that wanders, in distances at which a stage at rest is said to have moved. With the second it has moved.
const WANDER: f64 = 0.9;
const MOVED: f64 = 1.5;
/// The same for an arm, whose noise counts too.
const ARM_MOVED: f64 = 3.0;

/// How much farther than it is a GRBL reports its place, mm: half a step of 1.25 um at the target and at the place, and half the last decimal.
const GRBL_ROUNDING_MM: f64 = 0.00175;

/// Period of a wander, s: slow beside the rests between the steps of a press. A hold ends anywhere in it.
const PERIOD_S: Range<f64> = 80.0..600.0;

/// Noise of an arm's pose in recordings at rest, mm.
const POSE_NOISES_MM: [f64; 2] = [0.013, 0.020];

/// At rest Marlin and Klipper report the steps that they sent, so no wander is seen there: these are holds alone. GRBL reports whole steps, so
/// its wander is that of the reports.
#[test]
fn holds_with_a_read_back_that_wanders_are_complete() {
    MARLIN.holds(wire::MARLIN, HOLDS, 0.0);
    KLIPPER.holds(wire::KLIPPER, HOLDS, 0.0);
    GRBL.holds(wire::GRBL, HOLDS, 0.0);
    ESP301.holds(wire::ESP301, HOLDS, 0.0);
    XPS.holds(wire::XPS, HOLDS, 0.0);
}

#[test]
fn holds_with_a_program_whose_read_back_wanders_are_complete() {
    PROGRAM.holds(wire::PROGRAM, HOLDS, 0.0);
}

/// The noise has its own part of the distance at which the arm has moved, beside that of the wander.
#[test]
fn holds_with_the_noisy_pose_of_an_arm_that_wanders_are_complete() {
    for noise_mm in POSE_NOISES_MM {
        ARM.holds(wire::ARM, HOLDS_OF_ARM, noise_mm);
    }
}

/// So that the tests above show something.
#[test]
fn a_read_back_that_wanders_farther_ends_a_hold() {
    GRBL.ends(wire::GRBL, MOVED);
    ESP301.ends(wire::ESP301, MOVED);
    XPS.ends(wire::XPS, MOVED);
    PROGRAM.ends(wire::PROGRAM, MOVED);
}

#[test]
fn a_pose_that_wanders_farther_than_its_noise_ends_a_hold() {
    ARM.ends(wire::ARM, ARM_MOVED);
}

impl<K: Copy + Debug + Send + Sync> Family<K> {
    /// Makes holds of 1 N with a read-back that wanders, and a pose with this noise. Prints and checks them.
    fn holds(&self, wire: Wire, (quick, full): (usize, usize), noise_mm: f64) {
        let seeds: Vec<u64> = (0..campaign::size(quick, full) as u64).collect();
        let outcomes = in_parallel(&seeds, |seed| self.hold(wire, *seed, WANDER, noise_mm));
        self.print(&seeds, &outcomes);
        self.must_be_sound(&seeds, &outcomes);
    }

    fn hold(&self, wire: Wire, seed: u64, share: f64, noise_mm: f64) -> SoundOutcome {
        let spec = self.sound_spec();
        let hold_s = if campaign::is_quick() { HOLD_S.0 } else { HOLD_S.1 };
        let text = format!(
            "name = \"hold\"\nchecks = \"none\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = {hold_s}\nsample_s = 0.2\n[[step]]\n\
             phase = \"calibration\"\nrandom = {{ count = 1, x_mm = [-1.0, 1.0], y_mm = [-1.0, 1.0] }}\nforce_n = 1.0\n"
        );
        let is_short = campaign::is_quick() || share > 1.0;
        let period_s = if is_short { PERIOD_S.start } else { stream(seed, 0, "sound holds").random_range(PERIOD_S) };
        let rounding_mm = if self.rig == GRBL.rig { GRBL_ROUNDING_MM } else { 0.0 };
        let amplitude_mm = share * spec.stage.steps.at_rest_mm(Axis::Z) - rounding_mm;
        let seen = Shared::default();
        let plan = plan(&spec, &text, seed);
        let run = executed_with(&spec, &plan, Deaths::Ignored, &|rig| {
            self.install(&spec, rig, None);
            if noise_mm > 0.0 {
                noisy_arm(&spec, rig, noise_mm);
            }
            tap(rig, wire, Some(Wander { amplitude_mm, period_s }), &seen);
        });
        SoundOutcome::of(&run, &plan, (wire.aborts)(&seen.lock().expect("the run is over").received))
    }

    /// Checks that a read-back that wanders too far ends a hold.
    fn ends(&self, wire: Wire, share: f64) {
        let SoundOutcome { text, .. } = self.hold(wire, 1, share, 0.0);
        println!("{}: {text:?}", self.rig);
        assert!(text.is_some_and(|text| text.contains("z came to rest at")), "{}", self.rig);
    }
}

fn noisy_arm(spec: &RigSpec, rig: &mut SimulatedRig, noise_mm: f64) {
    let (step_mm, pose_noise) = (spec.stage.steps.along(Axis::Z), (noise_mm, UrArm::POSE_NOISE.1));
    let arm = UrArm { rotvec_rad: [0.0, PI, 0.0], step_mm, pose_noise, ..UrArm::default() };
    let stage = UrEmulator::new(arm, &rig.scene.lock().expect("nobody else has it"));
    rig.stage.replace(Arc::new(Mutex::new(stage)));
}
