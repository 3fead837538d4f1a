//! An arm of Universal Robots that presses 1 N.

use super::{Finishing, Wrong};
use crate::families::{self, When};
use palpate_core::quantity::StageCertificate;
use palpate_run::rig;
use palpate_sim::emulator::UrFaultKind::{
    EmergencyStop, LocalControl, PowerOff, ProtectiveStop, RtdeLost, RtdeSilent, Sideways, SpeedSlider, Tilt,
};
use palpate_sim::emulator::{UrArm, UrEmulator, UrFaultKind};
use palpate_sim::scene::ContactLaw;
use palpate_testing::executions::{Deaths, executed_with, in_parallel, must_be_none, plan};
use palpate_testing::{campaign, exchanged, shipped_text};
use std::f64::consts::PI;
use std::sync::{Arc, Mutex};

const ARM: Finishing<UrFaultKind> = Finishing {
    family: families::ARM,
    force_n: 1.0,
    limit_n: 2.0,
    stiffnesses_n_mm: &[1.0, 2.0, 5.0],
    faults: &[
        ProtectiveStop,
        EmergencyStop,
        SpeedSlider(0.3),
        RtdeLost,
        RtdeSilent,
        LocalControl,
        Sideways { mm: 0.3 },
        Tilt { rad: 0.03 },
        PowerOff,
    ],
    is_mended: |kind| kind == SpeedSlider(0.3),
};

#[test]
fn presses_are_within_half_a_step_and_take_seconds() {
    ARM.check_presses((1.0, 80.0), 6.0);
    ARM.check_presses((5.0, 80.0), 6.0);
}

#[test]
fn no_force_is_over_the_limit_whatever_fails() {
    let ends = ARM.check_faults(&[]);
    for (wrong, end) in ends {
        if let Wrong::Stage(ProtectiveStop | EmergencyStop | PowerOff) = wrong {
            assert!(["-", "device", "stage-silent"].contains(&end), "{wrong:?}: {end}");
        }
    }
}

/// What a person reads after each fault in a press, and that nothing is pressed harder.
#[test]
fn each_fault_in_a_press_is_named() {
    let cases = [
        (ProtectiveStop, "palpate never unlocks it"),
        (EmergencyStop, "its safety mode is 7"),
        (PowerOff, "its robot mode is"),
        (RtdeSilent, "no answer to \"the next RTDE package\" within 1000 ms"),
        (LocalControl, "is it in remote control"),
        (Sideways { mm: 0.3 }, "mm off its straight way, `path_error_mm` is 0.2"),
        (Tilt { rad: 0.03 }, "its tool is tilted by"),
    ];
    for (kind, expected) in cases {
        let spec = ARM.rig(2.0, 80.0);
        let executed = executed_with(&spec, &ARM.presses(&spec, 30, 1), Deaths::Ignored, &|rig| {
            ARM.family.install(&spec, rig, Some((When::At(60.0), kind)));
        });
        let text = executed.ending.text().unwrap_or_default();
        assert!(text.contains(expected), "{kind:?}: {text}");
        assert!(executed.truth.force_n < 1.1, "{kind:?}: {} N", executed.truth.force_n);
    }
}

/// Recordings of arms at rest have noise of 13 and 20 um in each coordinate of the pose.
#[test]
fn an_arm_with_a_noisy_pose_completes_its_runs() {
    let spec = ARM.rig(2.0, 80.0);
    let seeds: Vec<u64> = (0..campaign::size(2, 50) as u64).collect();
    for noise_mm in [0.013, 0.020] {
        let halted = in_parallel(&seeds, |&seed| {
            let executed = executed_with(&spec, &ARM.presses(&spec, 10, seed), Deaths::Ignored, &|rig| {
                let pose_noise = (noise_mm, UrArm::POSE_NOISE.1);
                let arm = UrArm { rotvec_rad: [0.0, PI, 0.0], step_mm: 0.02, pose_noise, ..UrArm::default() };
                let stage = UrEmulator::new(arm, &rig.scene.lock().expect("nobody else has it"));
                rig.stage.replace(Arc::new(Mutex::new(stage)));
            });
            executed.ending.halt.map(|halt| format!("{noise_mm} mm, seed {seed}: {halt:?}"))
        });
        must_be_none(&halted.into_iter().flatten().collect::<Vec<_>>());
    }
}

#[test]
fn the_velocity_strategy_is_refused() {
    ARM.check_velocity_is_refused();
}

/// The arm gives way under a force, so its position isn't the depth.
#[test]
fn a_depth_is_as_uncertain_as_the_arm_is_soft() {
    let mut spec = ARM.rig(2.0, 80.0);
    spec.load_cell.stiffness_n_mm = Some(400.0);
    spec.stage.certificate =
        Some(StageCertificate { number: "1".to_owned(), date: "2026-05-04".to_owned(), u_mm: 0.02, k: 2.0 });
    assert_eq!(spec.u_depth_mm(0.01, 1.0), None, "its stiffness isn't stated");
    spec.stage.stiffness_n_mm = Some(20.0);
    let u_mm = spec.u_depth_mm(0.01, 1.0).expect("all is stated");
    let bent_mm = (1f64 / 400.0).hypot(1.0 / 20.0) / 3f64.sqrt();
    assert!((u_mm - 0.01f64.hypot(0.01).hypot(bent_mm)).abs() < 1e-9, "{u_mm} mm");
}

/// Where the limit is ten times its error, the arm's own force is the load cell.
#[test]
fn the_arms_own_force_presses_within_its_error() {
    let text = shipped_text("rigs/ur.toml");
    let text = exchanged(&text, "driver = { modbus = \"generic-rs485\" }", "driver = { ur = \"own force\" }");
    let text = exchanged(&text, "serial:///dev/ttyUSB0?baud=115200", "tcp://192.168.1.20:30004");
    let text = exchanged(&text, "force_n = 2.2", "force_n = 50.0");
    let text = exchanged(&text, "depth_mm = 1.6", "depth_mm = 6.0");
    let text = exchanged(&text, "stiffness_n_mm = 2.0", "stiffness_n_mm = 12.0");
    let text = exchanged(&text, "z = [-2.0, 20.0]", "z = [-7.0, 12.0]");
    let spec = rig::parse("ur.toml", &text, &|_| unreachable!("no map of its own")).expect("a rig");
    let mut spec = spec.simulated();
    spec.scene.contact = ContactLaw { linear_n_mm: 8.0, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
    spec.scene.relaxation.clear();
    let recipe = "name = \"own\"\n[press]\nforce_tolerance_n = 2.0\n[[step]]\nphase = \"calibration\"\nforce_n = 20.0\n\
                  grid = { x_mm = [-2.0, 2.0], y_mm = [-2.0, 2.0], spacing_mm = 2.0 }\n";
    let executed = executed_with(&spec, &plan(&spec, recipe, 1), Deaths::Ignored, &|_| {});
    assert!(executed.ending.halt.is_none(), "{:?}", executed.ending.text());
    for contact in executed.ledger.contacts() {
        let off_n = contact.truth[0].force_true_n - 20.0;
        assert!(off_n.abs() < 4.0, "{off_n} N off");
    }
}
