//! Refusals, end to end: a specimen, a surface or a load cell that isn't as declared ends a run with a trip, and NaN gets no permit.

use palpate_control::{MotionContext, Permit, SafetyRule, Zero};
use palpate_core::quantity::{Limits, StageBounds};
use palpate_data::dataset::Status;
use palpate_sim::scene::LoadCellScene;
use palpate_testing::safety::{COUNT_N, SafetyBench, linear, recipe, rig_with, truthful};

#[test]
fn a_specimen_too_soft_for_the_force_trips_at_the_depth_limit() {
    for seed in 1..=5 {
        let spec = rig_with(|_, scene| {
            scene.contact = linear(0.3);
            scene.relaxation.clear();
            truthful(scene);
        });
        let depth_limit_mm = spec.limits.depth_mm;
        let mut bench = SafetyBench::new(spec, &recipe("[[2, -2]]", "force_n = 1.0"), seed);
        let executed = bench.must_trip(&[SafetyRule::OutOfReach], &format!("seed {seed}"));
        // nothing relaxes and there is no noise, so the force shows the depth
        let depth_mm = (executed.shown_most_n - COUNT_N) / 0.3;
        assert!(depth_mm <= depth_limit_mm, "seed {seed}: {depth_mm} mm");
    }
}

#[test]
fn run_without_a_specimen_trips_below_the_expected_surface() {
    let spec = rig_with(|_, scene| {
        scene.contact = linear(1e-6);
        scene.relaxation.clear();
    });
    SafetyBench::new(spec, &recipe("[[0, 0]]", "force_n = 1.0"), 1).must_trip(&[SafetyRule::NoContact], "no specimen");
}

#[test]
fn a_surface_beyond_the_declared_uncertainty_is_not_pressed_beyond_the_limit() {
    let mut tripped = 0;
    for seed in 1..=30 {
        let spec = rig_with(|spec, scene| {
            spec.limits.stiffness_n_mm = 1.98;
            scene.surface_tilt_mm = 1.2;
            scene.contact = linear(1.8);
            truthful(scene);
        });
        let mut bench = SafetyBench::new(spec, &recipe("[[-5, -5]]", "force_n = 2.0"), seed);
        let executed = bench.execute(None);
        assert!(executed.ending.unparked.is_none(), "seed {seed}: {:?}", executed.ending.text());
        assert!(executed.shown_most_n <= 2.0 + COUNT_N, "seed {seed}: {} N", executed.shown_most_n);
        let (peak_n, depth_mm) = bench.worst();
        assert!(peak_n <= 2.0 && depth_mm <= 1.6, "seed {seed}: {peak_n} N, {depth_mm} mm");
        tripped += u32::from(executed.ending.status() == Status::Tripped);
    }
    assert!(tripped > 0, "some surface lies beyond the declared uncertainty");
}

#[test]
fn specimen_stiffer_than_declared_trips_at_every_conversion_rate() {
    for conversions_hz in [20.0, 50.0, 200.0] {
        let spec = rig_with(|spec, scene| {
            spec.load_cell.conversions_hz = conversions_hz;
            spec.limits.stiffness_n_mm = 0.5;
            // more than the limit at the end of its depth, less than the range of the cell
            scene.contact = linear(2.0);
            scene.relaxation.clear();
            truthful(scene);
        });
        let output = format!("{conversions_hz} Hz");
        SafetyBench::new(spec, &recipe("[[0, 0]]", "force_n = 1.9"), 2)
            .must_trip(&[SafetyRule::OverForce, SafetyRule::HardContact], &output);
    }
}

#[test]
fn cell_beyond_its_range_without_load_trips_and_the_trip_is_recorded() {
    let spec = rig_with(|_, scene| {
        scene.load_cell = Some(LoadCellScene { noise_n: 0.003, offset_n: 6.0, ..LoadCellScene::default() })
    });
    SafetyBench::new(spec, &recipe("[[0, 0]]", "force_n = 1.0"), 1)
        .must_trip(&[SafetyRule::Unhealthy], "offset beyond range");
}

// ---- the permit ----------------------------------------------------------------------------------------------------

fn permit() -> Permit {
    let limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };
    Permit::new(limits, StageBounds::fine(100.0), 0.05, &Zero { offset_sigma_n: 0.0003, ..Zero::with_noise(0.003) })
}

#[test]
fn contact_above_the_learned_surface_counts_from_its_place() {
    // a bump: the force appears 0.2 mm before the earliest surface that the learned plane allows
    let sensor_state =
        MotionContext { z_mm: -0.2, force_n: 0.1, sigma_n: 0.001, age_s: 0.0, first_mm: 0.0, most_mm: f64::INFINITY };
    let deepest_mm = permit().deepest_mm(&sensor_state);
    let force_n = 0.1 + 2.0 * (deepest_mm + 0.2);
    assert!(force_n <= 2.0, "{force_n} N at {deepest_mm} mm");
    // with force to spare the depth limit decides, and it counts from here at the latest
    let limits = Limits { force_n: 50.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };
    let zero = Zero { offset_sigma_n: 0.0003, ..Zero::with_noise(0.003) };
    let depth_mm = Permit::new(limits, StageBounds::fine(100.0), 0.05, &zero).deepest_mm(&sensor_state) + 0.2;
    assert!(depth_mm <= 1.6, "{depth_mm} mm");
}

#[test]
fn nan_is_granted_no_motion() {
    let good =
        MotionContext { z_mm: -1.0, force_n: 0.0, sigma_n: 0.001, age_s: 0.0, first_mm: -0.1, most_mm: f64::INFINITY };
    assert!(permit().advance(&good, -0.5, 1.0).is_ok());
    for bad in [
        MotionContext { z_mm: f64::NAN, ..good },
        MotionContext { force_n: f64::NAN, ..good },
        MotionContext { sigma_n: f64::NAN, ..good },
        MotionContext { age_s: f64::NAN, ..good },
        MotionContext { first_mm: f64::NAN, ..good },
        MotionContext { force_n: f64::NEG_INFINITY, ..good },
    ] {
        assert!(permit().advance(&bad, -0.5, 1.0).is_err(), "{bad:?}");
    }
    for speed_mm_s in [0.0, -1.0, f64::NAN] {
        assert!(permit().advance(&good, -0.5, speed_mm_s).is_err(), "{speed_mm_s} mm/s");
    }
    let granted = permit().advance(&good, -0.5, f64::INFINITY).unwrap();
    assert!(granted.speed_mm_s() < 25.0, "{} mm/s", granted.speed_mm_s());
}
