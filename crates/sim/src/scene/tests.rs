//! The scene as a whole: presses, noise, time.

use super::*;
use palpate_core::mechanics::Medium;
use palpate_core::quantity::{ArrayLayout, Down, Frame, Place, Position};

const CONTACT: ContactLaw = ContactLaw { linear_n_mm: 1.1, quadratic_n_mm2: 0.1556, toe_mm: 0.01 };

fn skin() -> SkinSpec {
    SkinSpec { elastomer: Some(Elastomer::half_space(5.0)), ..SkinSpec::default() }
}

/// Noise of a third of 3 % of full scale.
fn noisy_skin() -> SkinSpec {
    let noise = TaxelNoise { repeatability_percent: vec![3.0; 9], of: NoiseOf::FullScale, floor: 0.0 };
    SkinSpec { noise: Some(noise), ..skin() }
}

fn looped_skin(percent: f64) -> SkinSpec {
    SkinSpec { hysteresis_percent: Some(vec![percent; 9]), ..skin() }
}

fn plain() -> SceneSpec {
    let relaxation = [0.3, 5.0].map(|time_s| RelaxationBranch { share: 0.05, time_s }).to_vec();
    SceneSpec { relaxation, ..SceneSpec::of(skin(), CONTACT) }
}

/// A scene above the origin; stage z falls toward the specimen, whose nominal surface is at 0.
fn scene(spec: SceneSpec, seed: u64) -> Scene {
    let frame = Frame::level(0.0, 0.3, Down::Minus);
    let setting = Surroundings {
        frame,
        layout: ArrayLayout::grid(3, 3, 4.5),
        full_scale_n: 2.0,
        half_extent_mm: 6.0,
        power_on: Position { x_mm: 0.0, y_mm: 0.0, z_mm: 0.5 },
        conversions_hz: 200.0,
        latencies: spec.latencies,
    };
    Scene::new(spec, setting, seed)
}

/// Moves z to a depth below the nominal surface and gives the time of arrival.
fn go(scene: &mut Scene, depth_mm: f64, speed_mm_s: f64, acceleration_mm_s2: f64, now_s: f64) -> f64 {
    let state = scene.axis(Axis::Z, now_s);
    let trajectory = Trajectory::to(now_s, state, -depth_mm, speed_mm_s, acceleration_mm_s2);
    let end_s = trajectory.end_s();
    scene.set_motion(Axis::Z, trajectory, now_s);
    end_s
}

fn centre(scene: &mut Scene, now_s: f64) -> f64 {
    let mut outputs = [0.0; 9];
    scene.outputs(now_s, &mut outputs);
    outputs[4]
}

#[test]
fn a_sudden_load_adds_ten_percent_and_decays_to_the_relaxed_curve() {
    let mut scene = scene(plain(), 1);
    let arrived_s = go(&mut scene, 0.8, 1e6, 1e9, 0.0);
    let relaxed_n = CONTACT.force_n(0.8);
    for after_s in [0.0, 0.1, 0.3, 1.0, 5.0, 60.0f64] {
        let extra = 0.05 * (-after_s / 0.3).exp() + 0.05 * (-after_s / 5.0).exp();
        let force_n = scene.true_force_n(arrived_s + after_s);
        assert!((force_n - relaxed_n * (1.0 + extra)).abs() < 2e-4, "{after_s} s: {force_n}");
    }
}

#[test]
fn force_does_not_depend_on_observation_times() {
    let looked_at = |times: &[f64]| {
        let mut scene = scene(plain(), 1);
        go(&mut scene, 1.2, 2.0, 100.0, 0.0);
        times.iter().map(|&t| scene.true_force_n(t)).last().unwrap()
    };
    let often: Vec<f64> = (1..=1500).map(|i| f64::from(i) * 0.001).collect();
    assert!((looked_at(&often) - looked_at(&[1.5])).abs() < 1e-10);
    assert!((looked_at(&[0.3333, 0.3334, 1.5]) - looked_at(&[1.5])).abs() < 1e-10);
}

#[test]
fn toe_of_the_curve_is_smooth_and_takes_half_its_depth() {
    assert_eq!(CONTACT.force_n(-0.1), 0.0);
    for depth_mm in [1e-9, 0.005, 0.01, 0.3, 1.5] {
        let slope = (CONTACT.force_n(depth_mm + 1e-7) - CONTACT.force_n(depth_mm - 1e-7)) / 2e-7;
        assert!((slope - CONTACT.stiffness_n_mm(depth_mm)).abs() < 1e-4, "{depth_mm}");
    }
    assert!((CONTACT.force_n(1.505) - (1.1 * 1.5 + 0.1556 * 2.25)).abs() < 1e-12);
}

#[test]
fn peak_is_kept_between_observations() {
    let mut scene = scene(plain(), 1);
    let arrived_s = go(&mut scene, 1.0, 1e6, 1e9, 0.0);
    let left_s = go(&mut scene, -0.5, 1e6, 1e9, arrived_s + 0.001);
    let truth = scene.take_truth(left_s + 1.0);
    assert!((truth.force_peak_n - 1.1 * CONTACT.force_n(1.0)).abs() < 1e-3, "{truth:?}");
    assert!((truth.depth_peak_mm - 1.0).abs() < 1e-9);
    assert_eq!(scene.take_truth(left_s + 2.0).force_peak_n, 0.0);
}

#[test]
fn relaxation_does_not_carry_over_to_another_spot() {
    let mut scene = scene(plain(), 1);
    let deep_s = go(&mut scene, 1.0, 10.0, 1000.0, 0.0);
    let out_s = go(&mut scene, -0.5, 10.0, 1000.0, deep_s + 10.0);
    let first_again_s = go(&mut scene, 0.2, 10.0, 1000.0, out_s);
    let tired_n = scene.true_force_n(first_again_s);
    let out_s = go(&mut scene, -0.5, 10.0, 1000.0, first_again_s);
    let sideways = Trajectory::to(out_s, (0.0, 0.0), 3.0, 10.0, 100.0);
    let beside_s = sideways.end_s();
    scene.set_motion(Axis::X, sideways, out_s);
    let touched_s = go(&mut scene, 0.2, 10.0, 1000.0, beside_s);
    let fresh_n = scene.true_force_n(touched_s);
    assert!(tired_n < 0.97 * fresh_n, "{tired_n} {fresh_n}");
}

#[test]
fn the_readings_are_the_stress_at_the_taxels() {
    let mut scene = scene(SceneSpec { relaxation: vec![], ..plain() }, 1);
    let arrived_s = go(&mut scene, 0.8, 10.0, 100.0, 0.0);
    let force_n = scene.true_force_n(arrived_s);
    let mut outputs = [0.0; 9];
    scene.outputs(arrived_s, &mut outputs);
    assert!((outputs[4] - force_n).abs() < 1e-12);
    assert!((outputs[1] / force_n - (0.81f64 + 1.0).powf(-2.5)).abs() < 1e-12);
}

#[test]
fn a_running_scene_reads_the_skin_of_its_seed() {
    let medium = Medium::BondedLayer { poisson_ratio: 0.49 };
    let taxels = Taxels { radius_mm: 1.0, gain_spread_percent: 20.0, baseline: 0.02, ..Taxels::default() };
    let rich = SkinSpec { elastomer: Some(Elastomer { depth_mm: 5.0, medium }), taxels, ..skin() };
    let mut scene = scene(SceneSpec { skin: rich.clone(), ..plain() }, 3);
    let mut outputs = [f64::NAN; 9];
    scene.outputs(0.0, &mut outputs);
    assert_eq!(outputs, [0.02; 9], "without load");
    let arrived_s = go(&mut scene, 0.8, 10.0, 100.0, 0.0);
    scene.outputs(arrived_s, &mut outputs);
    let mut expected = [f64::NAN; 9];
    let layout = scene.setting.layout.clone();
    Skin::new(&rich, &layout, 2.0, 3).outputs(scene.true_force_n(arrived_s), Place::default(), &mut expected);
    assert_eq!(outputs, expected);
}

#[test]
fn taxel_error_is_constant_in_a_contact_and_zero_without_load() {
    let noisy = SceneSpec { skin: noisy_skin(), relaxation: vec![], ..plain() };
    let mut scene = scene(noisy, 7);
    assert_eq!(centre(&mut scene, 0.1), 0.0);
    let mut errors = Vec::new();
    let mut now_s = 0.2;
    for _ in 0..400 {
        let in_s = go(&mut scene, 0.5, 10.0, 1000.0, now_s);
        let first = centre(&mut scene, in_s) - scene.true_force_n(in_s);
        let later = centre(&mut scene, in_s + 1.0) - scene.true_force_n(in_s + 1.0);
        assert!((first - later).abs() < 1e-12, "the error changed within one contact");
        errors.push(first);
        now_s = go(&mut scene, -0.5, 10.0, 1000.0, in_s + 1.0);
        assert_eq!(centre(&mut scene, now_s), 0.0);
    }
    // a third of 3 % of the reading for 2 N
    let sd = (errors.iter().map(|e| e * e).sum::<f64>() / 400.0).sqrt();
    assert!((sd / 0.02 - 1.0).abs() < 0.1, "{sd}");
}

#[test]
fn loading_is_straight_and_unloading_adds_the_loop() {
    let looped = SceneSpec { skin: looped_skin(4.0), relaxation: vec![], ..plain() };
    let mut scene = scene(looped, 1);
    let up_s = go(&mut scene, 1.4, 10.0, 100.0, 0.0);
    let top_n = scene.true_force_n(up_s);
    assert!((centre(&mut scene, up_s) - top_n).abs() < 1e-12);
    let down_s = go(&mut scene, 0.7, 10.0, 100.0, up_s);
    let force_n = scene.true_force_n(down_s);
    assert!(top_n - force_n > 0.5);
    let u = force_n / 2.0;
    assert!((centre(&mut scene, down_s) - force_n - 0.04 * 2.0 * 4.0 * u * (1.0 - u)).abs() < 1e-12);
}

#[test]
fn the_relaxation_of_a_hold_does_not_flip_the_branch() {
    let looped = SceneSpec { skin: looped_skin(5.0), ..plain() };
    let mut scene = scene(looped, 1);
    let up_s = go(&mut scene, 0.8, 2.0, 100.0, 0.0);
    let held_s = up_s + 0.6;
    let force_n = scene.true_force_n(held_s);
    assert!(scene.true_force_n(up_s + 0.6) < 0.99 * CONTACT.force_n(0.8) * 1.1);
    let u = force_n / 2.0;
    let loop_width = 0.05 * 2.0 * 4.0 * u * (1.0 - u);
    assert!((centre(&mut scene, held_s) - force_n).abs() < 0.03 * loop_width);
}

#[test]
fn load_cell_has_one_random_value_per_conversion() {
    let spec = SceneSpec {
        load_cell: Some(LoadCellScene { noise_n: 0.003, offset_n: 0.1, ..LoadCellScene::default() }),
        ..plain()
    };
    let mut scene = scene(spec, 3);
    let first = scene.load_cell_n(0.0121);
    assert_eq!(first, scene.load_cell_n(0.0149));
    assert_ne!(first, scene.load_cell_n(0.0151));
    let readings: Vec<f64> = (10..2010).map(|i| scene.load_cell_n(f64::from(i) * 0.005)).collect();
    let mean = readings.iter().sum::<f64>() / 2000.0;
    let sd = (readings.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / 2000.0).sqrt();
    assert!((mean - 0.1).abs() < 3e-4 && (sd / 0.003 - 1.0).abs() < 0.06, "{mean} {sd}");
}

#[test]
fn random_values_of_a_press_do_not_depend_on_earlier_ones() {
    let noisy = SceneSpec {
        load_cell: Some(LoadCellScene { noise_n: 0.003, ..LoadCellScene::default() }),
        skin: noisy_skin(),
        ..plain()
    };
    let drawn = |readings_before: usize| {
        let mut scene = scene(noisy.clone(), 5);
        for i in 0..readings_before {
            scene.load_cell_n(i as f64 * 0.005);
        }
        scene.begin_press(42, 3.0);
        let in_s = go(&mut scene, 0.5, 10.0, 1000.0, 5.0);
        (scene.load_cell_n(6.0), centre(&mut scene, in_s.max(6.0)), scene.latency_s(SceneDevice::Stage, 6.0))
    };
    assert_eq!(drawn(0), drawn(500));
}

#[test]
fn surface_is_within_its_tilt_and_follows_from_the_seed() {
    let tilted = SceneSpec { surface_tilt_mm: 0.2, ..plain() };
    let mut heights = Vec::new();
    for seed in 0..200 {
        let frame = scene(tilted.clone(), seed).setting.frame;
        let surface = Surface::tilted(&frame, 0.2, 6.0, seed);
        for (x, y) in [(-6.0, -6.0), (6.0, -6.0), (-6.0, 6.0), (6.0, 6.0), (0.0, 0.0)] {
            heights.push(-surface.depth((x, 0.0, 0.0), (y, 0.0, 0.0), (0.0, 0.0, 0.0)).mm);
        }
    }
    assert!(heights.iter().all(|h| h.abs() <= 0.2 + 1e-12));
    assert!(heights.iter().any(|h| h.abs() > 0.15), "the tilt is used");
}

mod bench;
mod faults;
mod over_time;
mod plant;

#[test]
fn depth_and_force_are_inverse() {
    for contact in [
        ContactLaw { linear_n_mm: 1.1, quadratic_n_mm2: 0.1556, toe_mm: 0.01 },
        ContactLaw { linear_n_mm: 500.0, quadratic_n_mm2: 0.0, toe_mm: 0.01 },
    ] {
        assert!((contact.force_n(contact.depth_mm(1.0)) - 1.0).abs() < 1e-12);
    }
}
