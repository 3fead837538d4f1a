//! Tests of faults that a scene simulates on request.

use super::*;

const CELL: LoadCellScene = LoadCellScene { noise_n: 0.003, offset_n: 0.1, ..LoadCellScene::IDEAL };

fn with_faults(faults: &[(FaultKind, f64, Option<f64>)]) -> Scene {
    let faults = faults.iter().map(|&(kind, from_s, value)| SceneFault { kind, from_s, value }).collect();
    scene(SceneSpec { load_cell: Some(CELL), relaxation: vec![], faults, ..plain() }, 1)
}

/// Scene pressed 0.5 mm from 1 s on, with a fault of a kind from 2 s on. Also returns the true force before the fault.
fn pressed_with(kind: FaultKind, value: Option<f64>) -> (Scene, f64) {
    let mut scene = with_faults(&[(kind, 2.0, value)]);
    go(&mut scene, 0.5, 10.0, 100.0, 0.0);
    let force_n = scene.true_force_n(1.0);
    (scene, force_n)
}

/// Mean and standard deviation of 200 successive conversions from `from_s` on, N.
fn readings(scene: &mut Scene, from_s: f64) -> (f64, f64) {
    let readings: Vec<f64> = (0..200).map(|i| scene.load_cell_n(from_s + f64::from(i) * 0.005)).collect();
    let mean = readings.iter().sum::<f64>() / 200.0;
    (mean, (readings.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / 200.0).sqrt())
}

/// Mean and standard deviation of the readings before and during a fault, and the true force.
fn before_and_after(kind: FaultKind, value: Option<f64>) -> ((f64, f64), (f64, f64), f64) {
    let (mut scene, force_n) = pressed_with(kind, value);
    let before = readings(&mut scene, 0.9);
    assert!((before.0 - force_n - 0.1).abs() < 1e-3 && (before.1 / 0.003 - 1.0).abs() < 0.2, "{kind:?}: {before:?}");
    let after = readings(&mut scene, 2.1);
    assert_eq!(scene.true_force_n(4.0), force_n, "{kind:?} is the cell's affair");
    (before, after, force_n)
}

#[test]
fn faults_of_sensor_sign_and_zero_show_in_the_readings() {
    for (kind, value, share, zero_n) in [
        (FaultKind::NoSensor, None, 0.0, 0.1),
        (FaultKind::WrongSign, None, -1.0, 0.1),
        (FaultKind::DriftedZero, None, 1.0, -0.4),
        (FaultKind::DriftedZero, Some(0.2), 1.0, 0.3),
    ] {
        let (_, (mean, sd), force_n) = before_and_after(kind, value);
        assert!((mean - share * force_n - zero_n).abs() < 1e-3, "{kind:?}: {mean}");
        assert!((sd / 0.003 - 1.0).abs() < 0.2, "{kind:?} is no quieter: {sd}");
    }
}

#[test]
fn stuck_cell_repeats_its_last_reading() {
    let (mut scene, _) = pressed_with(FaultKind::Stuck, None);
    let last = scene.load_cell_n(1.99);
    go(&mut scene, -0.5, 10.0, 100.0, 2.5);
    for at_s in [2.5, 2.6, 4.0, 90.0] {
        assert_eq!(scene.load_cell_n(at_s), last);
    }
}

#[test]
fn saturated_cell_repeats_its_largest_value() {
    let (_, (mean, sd), _) = before_and_after(FaultKind::Saturated, Some(0.4));
    assert!((mean - 0.4).abs() < 1e-12 && sd < 1e-12, "{mean} {sd}");
    let (_, (mean, _), force_n) = before_and_after(FaultKind::Saturated, None);
    assert!(force_n + 0.1 < 0.8 && (mean - force_n - 0.1).abs() < 1e-3);
}

#[test]
fn noisy_cell_has_ten_times_or_the_declared_noise() {
    for (value, times) in [(None, 10.0), (Some(3.0), 3.0)] {
        let (_, (_, sd), _) = before_and_after(FaultKind::Noisy, value);
        assert!((sd / (times * 0.003) - 1.0).abs() < 0.2, "{sd}");
    }
}

#[test]
fn slip_drops_the_force_once() {
    let (mut scene, force_n) = pressed_with(FaultKind::Slip, None);
    assert_eq!(scene.true_force_n(1.999), force_n);
    assert!((scene.true_force_n(2.0) - 0.35 * force_n).abs() < 1e-12);
    assert!((scene.true_force_n(3.0) - 0.35 * force_n).abs() < 1e-12);
    let deeper_s = go(&mut scene, 0.6, 10.0, 100.0, 3.0);
    assert!((scene.true_force_n(deeper_s) - 0.35 * CONTACT.force_n(0.6)).abs() < 1e-9, "deeper, it is still slipped");
    let out_s = go(&mut scene, -0.5, 10.0, 100.0, deeper_s);
    let again_s = go(&mut scene, 0.5, 10.0, 100.0, out_s);
    assert!((scene.true_force_n(again_s) - force_n).abs() < 1e-12);
}

#[test]
fn slip_without_contact_waits_for_the_next_contact() {
    let mut scene = with_faults(&[(FaultKind::Slip, 0.0, None)]);
    for share in [0.35, 1.0, 1.0] {
        let now_s = scene.now_s + 1.0;
        let in_s = go(&mut scene, 0.5, 10.0, 100.0, now_s);
        assert!((scene.true_force_n(in_s) - share * CONTACT.force_n(0.5)).abs() < 1e-9, "{share}");
        go(&mut scene, -0.5, 10.0, 100.0, in_s);
        scene.true_force_n(in_s + 5.0);
    }
}

#[test]
fn a_hard_contact_is_a_spring_from_the_next_contact_on() {
    let faults = vec![SceneFault { kind: FaultKind::HardContact, from_s: 2.0, value: None }];
    let mut scene = scene(SceneSpec { faults, ..plain() }, 1);
    let in_s = go(&mut scene, 0.5, 10.0, 100.0, 0.0);
    assert!(in_s < 2.0);
    assert!(scene.true_force_n(3.0) < 0.7, "the contact under way is what it was");
    let out_s = go(&mut scene, -0.5, 10.0, 100.0, 3.0);
    let again_s = go(&mut scene, 0.1, 10.0, 100.0, out_s);
    for at_s in [again_s, again_s + 10.0] {
        assert!((scene.true_force_n(at_s) - 2.0).abs() < 1e-9, "20 N/mm, no toe, nothing that relaxes");
    }
}

#[test]
fn without_a_specimen_there_is_no_force_and_no_contact() {
    let (mut scene, _) = pressed_with(FaultKind::NoContact, None);
    assert_eq!(scene.true_force_n(2.0), 0.0);
    let deeper_s = go(&mut scene, 1.5, 10.0, 100.0, 3.0);
    assert_eq!((scene.true_force_n(deeper_s), centre(&mut scene, deeper_s)), (0.0, 0.0));
    assert!((readings(&mut scene, 4.0).0 - 0.1).abs() < 1e-3, "the cell still reads its offset");
    assert!((scene.take_truth(6.0).depth_peak_mm - 1.5).abs() < 1e-9);
}

#[test]
fn fault_begins_on_time_without_observation() {
    let mut watched = with_faults(&[]);
    let end_s = go(&mut watched, 1.0, 10.0, 100.0, 0.0);
    let strikes_s = end_s - 0.05;
    let force_n = watched.true_force_n(strikes_s);
    let mut scene = with_faults(&[(FaultKind::NoContact, strikes_s, None)]);
    go(&mut scene, 1.0, 10.0, 100.0, 0.0);
    let truth = scene.take_truth(end_s + 1.0);
    assert!((truth.force_peak_n - force_n).abs() < 1e-9, "{truth:?}, not {force_n} N");
}

#[test]
fn a_silent_link_is_the_device_s_own_and_a_slow_stage_takes_longer() {
    for (kind, silent) in [
        (FaultKind::Stale, SceneDevice::LoadCell),
        (FaultKind::StageLost, SceneDevice::Stage),
        (FaultKind::ArrayLost, SceneDevice::Array),
    ] {
        let mut scene = with_faults(&[(kind, 2.0, None)]);
        for device in SceneDevice::ALL {
            assert_eq!(scene.latency_s(device, 1.999), Some(0.0));
            assert_eq!(scene.latency_s(device, 2.0).is_none(), device == silent, "{kind:?} {device:?}");
        }
    }
    let mut scene = with_faults(&[(FaultKind::SlowStage, 2.0, None), (FaultKind::SlowStage, 3.0, Some(50.0))]);
    let taken = [1.0, 2.5, 3.5].map(|now_s| scene.latency_s(SceneDevice::Stage, now_s));
    assert_eq!(taken, [Some(0.0), Some(0.2), Some(0.25)]);
    assert_eq!(scene.latency_s(SceneDevice::LoadCell, 4.0), Some(0.0));
}

#[test]
fn every_two_faults_can_be_combined() {
    for (_, first) in FaultKind::ALL {
        for (_, second) in FaultKind::ALL {
            let mut scene = with_faults(&[(first, 0.05, None), (second, 0.05, None)]);
            let in_s = go(&mut scene, 0.1, 10.0, 100.0, 0.0);
            let force_n = scene.true_force_n(in_s + 1.0);
            let read_n = scene.load_cell_n(in_s + 1.0);
            assert!(force_n.is_finite() && force_n >= 0.0 && read_n.is_finite(), "{first:?} and {second:?}");
            let kinds = [first, second];
            if kinds.contains(&FaultKind::NoContact) {
                assert_eq!(force_n, 0.0, "{kinds:?}");
            } else if kinds.contains(&FaultKind::HardContact) {
                let share = if kinds.contains(&FaultKind::Slip) { 0.35 } else { 1.0 };
                assert!((force_n - 2.0 * share).abs() < 1e-9, "{kinds:?}: {force_n}");
            }
        }
    }
}
