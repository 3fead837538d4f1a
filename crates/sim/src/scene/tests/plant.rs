//! Tests of contact, relaxation and the load cell.

use super::*;

/// Scene whose load cell converts `hz` times per second, read through `cell`, on a spring that carries force at once.
fn with_cell(cell: LoadCellScene, hz: f64) -> Scene {
    let contact = ContactLaw { linear_n_mm: 1.0, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
    let spec = SceneSpec { contact, load_cell: Some(cell), relaxation: vec![], ..plain() };
    let setting = scene(spec.clone(), 1).setting;
    Scene::new(spec, Surroundings { conversions_hz: hz, ..setting }, 1)
}

/// Applies 1 N to the specimen of [`with_cell`] at once.
fn step(scene: &mut Scene, now_s: f64) {
    scene.set_motion(Axis::Z, Trajectory::at_rest(-1.0), now_s);
}

#[test]
fn low_passed_step_does_not_depend_on_observation_times() {
    let cell = LoadCellScene { low_pass_hz: Some(100.0), ..LoadCellScene::default() };
    let rate = std::f64::consts::TAU * 100.0;
    for at_every_s in [1e-4, 1e-3, 7e-3] {
        let mut scene = with_cell(cell, 10_000.0);
        step(&mut scene, 1.0);
        scene.load_cell_n(1.0 + 1e-9); // the step without the rest
        for i in 1..=10 {
            let after_s = f64::from(i) * at_every_s;
            let expected = 1.0 - (-rate * after_s).exp();
            let found = scene.load_cell_n(1.0 + after_s);
            assert!((found - expected).abs() < 1e-5, "{after_s} s: {found}, not {expected}");
        }
    }
}

#[test]
fn low_passed_press_reads_the_same_for_every_observer() {
    let cell = LoadCellScene { low_pass_hz: Some(100.0), transport_s: 0.002, ..LoadCellScene::default() };
    let read = |every_s: f64| {
        let mut scene = scene(SceneSpec { load_cell: Some(cell), ..plain() }, 1);
        go(&mut scene, 0.8, 10.0, 100.0, 0.0);
        let mut now_s = every_s;
        while now_s < 0.17 {
            scene.true_force_n(now_s);
            now_s += every_s;
        }
        (scene.load_cell_n(0.17), scene.true_force_n(0.17), scene.load_cell_n(3.0))
    };
    let (often, true_n, rested) = read(2e-4);
    assert!(true_n - often > 0.01, "it lags: {often} {true_n}");
    for every_s in [1e-3, 5e-3, 1.0] {
        let (seldom, _, later) = read(every_s);
        assert!((seldom - often).abs() < 1e-4 && (later - rested).abs() < 1e-6, "{every_s} s: {seldom} {often}");
    }
}

#[test]
fn reading_is_the_last_complete_conversion() {
    // 10 ms of transport at 200 conversions a second: two conversions late, to the instant
    for asked_between in [&[][..], &[1.001, 1.004, 1.0049, 1.006, 1.013, 1.0149]] {
        let mut scene = with_cell(LoadCellScene { transport_s: 0.010, ..LoadCellScene::default() }, 200.0);
        step(&mut scene, 1.0);
        for &at_s in asked_between {
            scene.true_force_n(at_s);
        }
        let mut before = scene.clone();
        assert_eq!((before.load_cell_n(1.0149), scene.load_cell_n(1.015)), (0.0, 1.0), "{asked_between:?}");
    }
    let mut prompt = with_cell(LoadCellScene::default(), 200.0);
    step(&mut prompt, 1.0);
    assert_eq!((prompt.clone().load_cell_n(1.0049), prompt.load_cell_n(1.005)), (0.0, 1.0));
}

#[test]
fn pending_conversions_are_kept_when_other_devices_advance_time() {
    let mut scene = with_cell(LoadCellScene { transport_s: 0.012, ..LoadCellScene::default() }, 200.0);
    for (depth_mm, from_s) in [(0.1, 1.0001), (0.2, 1.0051), (0.3, 1.0101), (0.4, 1.0151)] {
        scene.set_motion(Axis::Z, Trajectory::at_rest(-depth_mm), from_s);
    }
    // a force just after a conversion is read from the next one on, and 12 ms later
    for (at_s, expected_n) in [(1.0169, 0.0), (1.0171, 0.1), (1.0221, 0.2), (1.0271, 0.3), (1.0321, 0.4)] {
        assert!((scene.load_cell_n(at_s) - expected_n).abs() < 1e-12, "{at_s} s");
    }
}

#[test]
fn long_idle_time_has_few_knots() {
    let scene =
        with_cell(LoadCellScene { transport_s: 0.002, low_pass_hz: Some(100.0), ..LoadCellScene::default() }, 1000.0);
    let (mut now_s, mut knots) = (0.0, 0);
    let mut scene = scene;
    while now_s < 3600.0 {
        now_s = scene.next_knot(3600.0);
        scene.true_force_n(now_s);
        knots += 1;
        assert!(knots < 60, "a knot at {now_s} s");
    }
}

#[test]
fn noise_comes_after_the_low_pass() {
    let cell = LoadCellScene { noise_n: 0.003, low_pass_hz: Some(1.0), ..LoadCellScene::default() };
    let mut scene = with_cell(cell, 200.0);
    let readings: Vec<f64> = (1..=2000).map(|i| scene.load_cell_n(f64::from(i) * 0.005)).collect();
    let square = readings.iter().map(|r| r * r).sum::<f64>() / 2000.0;
    let neighbours = readings.windows(2).map(|r| r[0] * r[1]).sum::<f64>() / 2000.0;
    assert!((square.sqrt() / 0.003 - 1.0).abs() < 0.06 && neighbours.abs() < 0.1 * square, "white: {neighbours}");
}

#[test]
fn relief_acts_at_the_place_of_the_tip() {
    let relief = Relief { bumps_mm: 0.03, bumps_wavelength_mm: (6.0, 12.0), roughness_mm: 0.001 };
    let spec = SceneSpec { relief: Some(relief), relaxation: vec![], ..plain() };
    let mut forces = Vec::new();
    for i in 0..20 {
        let mut scene = scene(spec.clone(), 9);
        let x_mm = f64::from(i) * 0.5 - 5.0;
        scene.set_motion(Axis::X, Trajectory::at_rest(x_mm), 0.0);
        let in_s = go(&mut scene, 0.5, 10.0, 100.0, 0.0);
        let height_mm = scene.relief.as_mut().expect("a relief").at(Place::new(x_mm, 0.0));
        let force_n = scene.true_force_n(in_s);
        assert!((force_n - CONTACT.force_n(0.5 - height_mm)).abs() < 1e-9);
        assert!((scene.take_truth(in_s).depth_peak_mm - 0.5 + height_mm).abs() < 1e-9);
        forces.push(force_n);
    }
    let (least, most) = forces.iter().fold((f64::MAX, f64::MIN), |(l, m), &f| (l.min(f), m.max(f)));
    assert!(most - least > 0.01, "{forces:?}");
}

#[test]
fn the_stiffness_of_a_place_is_fixed_when_contact_begins() {
    let stiffness = Stiffness { smooth_percent: 6.0, white_percent: 0.5 };
    let spec = SceneSpec { stiffness: Some(stiffness), relaxation: vec![], ..plain() };
    let mut scene = scene(spec, 4);
    let share_at =
        |scene: &mut Scene, x_mm: f64| 1.0 + scene.curve.more.as_mut().expect("a map").at(Place::new(x_mm, 0.0));
    let (here, there) = (share_at(&mut scene, 0.0), share_at(&mut scene, 3.0));
    assert!((here - there).abs() > 0.005 && (here - 1.0).abs() < 0.08, "{here} {there}");
    let in_s = go(&mut scene, 0.5, 10.0, 100.0, 0.0);
    assert!((scene.true_force_n(in_s) - here * CONTACT.force_n(0.5)).abs() < 1e-9);
    let sideways = Trajectory::to(in_s, (0.0, 0.0), 3.0, 10.0, 100.0);
    let beside_s = sideways.end_s();
    scene.set_motion(Axis::X, sideways, in_s);
    assert!(
        (scene.true_force_n(beside_s) - here * CONTACT.force_n(0.5)).abs() < 1e-9,
        "the tip took its contact along"
    );
    let out_s = go(&mut scene, -0.5, 10.0, 100.0, beside_s);
    let again_s = go(&mut scene, 0.5, 10.0, 100.0, out_s);
    assert!((scene.true_force_n(again_s) - there * CONTACT.force_n(0.5)).abs() < 1e-9);
}

#[test]
fn stage_lags_by_its_servo_unknown_to_the_controller() {
    let servo = Servo { lag_s: 0.007, quantum_mm: 1e-4, ..Servo::default() };
    let mut scene = scene(SceneSpec { stage: Some(servo), relaxation: vec![], ..plain() }, 1);
    let done_s = go(&mut scene, 0.8, 10.0, 100.0, 0.0);
    assert_eq!(scene.motion(Axis::Z).end_s(), done_s);
    let then = scene.motion(Axis::Z).position_mm(0.1 - 0.007);
    assert!((scene.axis(Axis::Z, 0.1).0 - then).abs() < 1e-12);
    assert!(scene.true_force_n(done_s) < CONTACT.force_n(0.8) - 1e-3, "it isn't there yet");
    assert!((scene.true_force_n(done_s + 0.0071) - CONTACT.force_n(0.8)).abs() < 1e-9);
    assert!((scene.target_mm(0.123_46) - 0.1235).abs() < 1e-12 && (scene.target_mm(-0.123_44) + 0.1234).abs() < 1e-12);
}

#[test]
fn equal_ways_between_targets_are_equally_many_steps_of_the_stage() {
    let servo = Servo { quantum_mm: 1e-4, ..Servo::default() };
    let scene = scene(SceneSpec { stage: Some(servo), ..plain() }, 1);
    // targets as a controller is sent them: some lie just between two steps of the stage
    let hundredths_um =
        |count: i32| scene.target_mm(format!("{:.5}", f64::from(count) * 1e-5).parse().expect("a number"));
    for count in -3000..3000 {
        let way_mm = hundredths_um(count + 10) - hundredths_um(count);
        assert!((way_mm - 1e-4).abs() < 1e-9, "from {count} hundredths of a um it went {way_mm} mm");
    }
}

#[test]
fn stated_fraction_of_only_the_stages_exchanges_is_slow() {
    let spikes = Some(Spikes { share: 0.02, longer_s: 0.2 });
    let latencies =
        Latencies { stage_s: (0.001, 0.005), load_cell_s: (0.0, 0.001), array_s: (0.0, 0.001), stage_spikes: spikes };
    let mut scene = scene(SceneSpec { latencies, ..plain() }, 1);
    let mut longer = |device, most_s: f64| {
        let taken = (0..10_000).map(|_| scene.latency_s(device, 1.0).expect("an answer"));
        let longer: Vec<f64> = taken.filter(|&s| s > most_s).collect();
        assert!(longer.iter().all(|&s| (0.201..=0.205).contains(&s)), "{longer:?}");
        longer.len()
    };
    let count = longer(SceneDevice::Stage, 0.005);
    assert!((150..250).contains(&count), "{count} of 10000");
    assert_eq!((longer(SceneDevice::LoadCell, 0.001), longer(SceneDevice::Array, 0.001)), (0, 0));
}

#[test]
fn true_mean_is_over_time_and_independent_of_the_load_cell() {
    let pressed = |cell, looks: &[f64]| {
        let mut scene = scene(SceneSpec { load_cell: cell, ..plain() }, 1);
        let in_s = go(&mut scene, 0.8, 10.0, 100.0, 0.0);
        scene.open_window(in_s);
        looks.iter().for_each(|after_s| _ = scene.load_cell_n(in_s + after_s));
        scene.close_window(in_s + 0.1);
        scene.take_truth(in_s + 0.1).force_true_n
    };
    let often: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.001).collect();
    let reference_n = pressed(None, &often);
    let offset = LoadCellScene {
        offset_n: 0.5,
        noise_n: 0.1,
        transport_s: 0.05,
        low_pass_hz: Some(1.0),
        ..LoadCellScene::IDEAL
    };
    for (cell, looks) in [(Some(offset), &often[..]), (None, &often[90..]), (None, &[0.03, 0.06])] {
        let mean_n = pressed(cell, looks);
        assert!((mean_n - reference_n).abs() < 5e-6, "{mean_n} {reference_n}");
    }
    // a ramp from rest to rest, by its halves: half of the end on the mean
    let mut ramp = with_cell(LoadCellScene::default(), 1000.0);
    let top_s = go(&mut ramp, 0.0, 10.0, 100.0, 0.0);
    ramp.open_window(top_s);
    let end_s = go(&mut ramp, 0.5, 100.0, 100.0, top_s);
    (0..200).for_each(|i| _ = ramp.load_cell_n(top_s + (end_s - top_s) * f64::from(i) / 200.0));
    ramp.close_window(end_s);
    assert!((ramp.take_truth(end_s).force_true_n - 0.25).abs() < 1e-4);
}

#[test]
fn sliding_distance_counts_only_in_contact() {
    let mut scene = scene(plain(), 1);
    let sideways = |scene: &mut Scene, from_mm: f64, to_mm: f64, now_s: f64| {
        let way = Trajectory::to(now_s, (from_mm, 0.0), to_mm, 10.0, 100.0);
        let end_s = way.end_s();
        scene.set_motion(Axis::X, way, now_s);
        end_s
    };
    let beside_s = sideways(&mut scene, 0.0, 2.0, 0.0);
    let in_s = go(&mut scene, 0.5, 10.0, 100.0, beside_s);
    assert_eq!(scene.take_truth(in_s).slid_mm, 0.0);
    let slid_s = sideways(&mut scene, 2.0, 1.5, in_s);
    let out_s = go(&mut scene, -0.5, 10.0, 100.0, slid_s);
    let back_s = sideways(&mut scene, 1.5, 0.0, out_s);
    assert!((scene.take_truth(back_s).slid_mm - 0.5).abs() < 1e-9);
    assert_eq!(scene.take_truth(back_s + 1.0).slid_mm, 0.0);
}

#[test]
fn scene_run_ahead_gives_the_worst_force_and_stays_unchanged() {
    let spec = SceneSpec { stage: Some(Servo { lag_s: 0.007, quantum_mm: 0.0, ..Servo::default() }), ..plain() };
    let mut scene = scene(spec, 1);
    let end_s = go(&mut scene, 1.0, 5.0, 100.0, 0.0);
    let before = scene.axis(Axis::Z, 0.15);
    let to_come = scene.run_out(0.15);
    assert_eq!(scene.axis(Axis::Z, 0.15), before);
    let rest_s = end_s + 0.007;
    assert!((to_come.depth_peak_mm - 1.0).abs() < 1e-9);
    assert!((to_come.force_true_n - scene.true_force_n(rest_s)).abs() < 1e-9, "{to_come:?}");
    assert_eq!(to_come.force_peak_n, scene.take_truth(rest_s).force_peak_n);
    // on the way out only the remaining part counts
    go(&mut scene, -0.5, 5.0, 100.0, rest_s);
    let leaving = scene.run_out(rest_s + 0.1);
    assert!(leaving.depth_peak_mm < 0.99 && leaving.force_true_n == 0.0, "{leaving:?}");
}
