//! Tests of a real bench's imperfections: a zero that drifts and changes slowly, mains interference, a wrong gain, filtered noise, play, a
//! stage that yields, a surface that creeps.

use super::*;

/// Scene of [`plain`] with another cell, without load.
fn without_load(cell: LoadCellScene) -> Scene {
    scene(SceneSpec { load_cell: Some(cell), ..plain() }, 1)
}

#[test]
fn zero_has_drift_slow_drift_and_mains() {
    let slow_drift = Some(Sine { amplitude: 0.005, period_s: 24.0 });
    let mains = Some(Sine { amplitude: 0.01, period_s: 0.02 });
    let mut scene = without_load(LoadCellScene { drift_n_s: 5e-4, slow_drift, mains, ..LoadCellScene::IDEAL });
    // conversions come every 5 ms: 6.005 s is a quarter of a turn of both
    let read_n = scene.load_cell_n(6.005);
    let expected_n = 5e-4 * 6.005 + 0.005 * (std::f64::consts::TAU * 6.005 / 24.0).sin() + 0.01;
    assert!((read_n - expected_n).abs() < 1e-9, "{read_n}, not {expected_n}");
    scene.begin_press(7, 12.0);
    let after_n = scene.load_cell_n(12.005);
    assert!((after_n - 5e-4 * 12.005 - 0.01).abs() < 1e-5, "absolute time, whatever press it is: {after_n}");
}

#[test]
fn a_wrong_gain_scales_the_force_and_nothing_else() {
    let mut scene = without_load(LoadCellScene { gain: 0.5, offset_n: 0.2, ..LoadCellScene::IDEAL });
    let arrived_s = go(&mut scene, 0.8, 10.0, 100.0, 0.0);
    let true_n = scene.true_force_n(arrived_s + 10.0);
    assert!((scene.load_cell_n(arrived_s + 10.004) - 0.2 - 0.5 * true_n).abs() < 1e-4);
}

#[test]
fn noise_before_the_low_pass_has_its_size_and_is_correlated() {
    let mut scene =
        without_load(LoadCellScene { noise_ahead_n: 0.002, low_pass_hz: Some(20.0), ..LoadCellScene::IDEAL });
    let read: Vec<f64> = (1..4000).map(|i| scene.load_cell_n(f64::from(i) * 0.005 + 1e-6)).collect();
    let square = read.iter().map(|n| n * n).sum::<f64>() / read.len() as f64;
    let shared = read.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / read.len() as f64 / square;
    let expected = (-std::f64::consts::TAU * 20.0 * 0.005f64).exp();
    assert!((square.sqrt() - 0.002).abs() < 1e-4, "{}", square.sqrt());
    assert!((shared - expected).abs() < 0.04, "{shared}, not {expected}");
}

#[test]
fn long_transport_repeats_no_conversion_at_a_press() {
    let mut scene = without_load(LoadCellScene { noise_n: 0.003, transport_s: 0.05, ..LoadCellScene::IDEAL });
    scene.begin_press(3, 1.0);
    let read: Vec<f64> = (0..20).map(|i| scene.load_cell_n(1.0 + f64::from(i) * 0.005 + 1e-6)).collect();
    assert!(read.windows(2).all(|pair| pair[0] != pair[1]), "{read:?}");
}

#[test]
fn indenter_follows_a_reversal_after_the_backlash() {
    let stage = Some(Servo { backlash_mm: 0.01, ..Servo::default() });
    let relaxation = vec![];
    let mut scene = scene(SceneSpec { stage, relaxation, ..plain() }, 1);
    let force_at = |scene: &mut Scene, depth_mm: f64, from_s: f64| {
        let arrived_s = go(scene, depth_mm, 5.0, 100.0, from_s);
        (scene.true_force_n(arrived_s), arrived_s)
    };
    let (down_n, at_s) = force_at(&mut scene, 0.5, 0.0);
    assert!((down_n - CONTACT.force_n(0.495)).abs() < 1e-9, "engaged downward, half the play behind: {down_n}");
    let (turned_n, at_s) = force_at(&mut scene, 0.492, at_s);
    assert!((turned_n - down_n).abs() < 1e-9, "within the play nothing moves: {turned_n}");
    let (up_n, at_s) = force_at(&mut scene, 0.4, at_s);
    assert!((up_n - CONTACT.force_n(0.405)).abs() < 1e-9, "{up_n}");
    assert_eq!(scene.axis(Axis::Z, at_s).0, -0.4, "the read-back shows none of it");
}

#[test]
fn bench_yields_by_force_over_stiffness() {
    let cell = LoadCellScene { stiffness_n_mm: Some(10.0), ..LoadCellScene::IDEAL };
    for relaxation in [vec![], plain().relaxation] {
        let mut scene = scene(SceneSpec { load_cell: Some(cell), relaxation: relaxation.clone(), ..plain() }, 1);
        let arrived_s = go(&mut scene, 0.8, 5.0, 100.0, 0.0);
        let later_s = arrived_s + 0.2;
        let force_n = scene.true_force_n(later_s);
        if relaxation.is_empty() {
            assert!((force_n - CONTACT.force_n(0.8 - force_n / 10.0)).abs() < 1e-6, "{force_n}");
        } else {
            let least_n = CONTACT.force_n(0.8 - force_n / 10.0);
            assert!(force_n > least_n && force_n < 1.1 * least_n, "{force_n} {least_n}");
        }
        let back_s = go(&mut scene, -0.3, 5.0, 100.0, later_s);
        assert_eq!(scene.true_force_n(back_s), 0.0);
    }
}

#[test]
fn a_surface_that_creeps_changes_the_force_of_a_stage_at_rest() {
    let wave = Some(Sine { amplitude: 0.005, period_s: 60.0 });
    let mut scene = scene(SceneSpec { surface_wave: wave, relaxation: vec![], ..plain() }, 1);
    go(&mut scene, 0.5, 10.0, 100.0, 0.0);
    for i in 1..=15_000 {
        scene.true_force_n(f64::from(i) * 0.001);
    }
    let force_n = scene.true_force_n(15.0);
    assert!((force_n - CONTACT.force_n(0.495)).abs() < 1e-6, "a quarter turn: the surface sank by 5 um: {force_n}");
}

#[test]
fn a_corrupt_conversion_stays_corrupt_and_the_others_are_unchanged() {
    let noisy = LoadCellScene { noise_n: 0.003, offset_n: 0.21, ..LoadCellScene::IDEAL };
    let glitches = Some(CorruptSamples::of(GlitchKind::MinusOne, 0.1));
    let (mut sound, mut corrupt) = (without_load(noisy), without_load(LoadCellScene { glitches, ..noisy }));
    let mut count = 0;
    for i in 1..1000 {
        let at_s = f64::from(i) * 0.005 + 1e-4;
        let [sound_n, read_n] = [&mut sound, &mut corrupt].map(|scene| scene.load_cell_n(at_s));
        assert_eq!(corrupt.load_cell_n(at_s + 0.004), read_n, "conversion {i}");
        let is_corrupt = read_n.abs() < 0.01;
        assert!(is_corrupt || read_n == sound_n, "conversion {i}: {read_n} N");
        count += u32::from(is_corrupt);
    }
    assert!((70..130).contains(&count), "{count} of 999");
}
