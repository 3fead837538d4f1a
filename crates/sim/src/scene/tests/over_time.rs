//! Tests of the taxels' creep and lag, of temperature and of wear.

use super::*;

const LAG_S: f64 = 0.05;
const CREEP: [CreepBranch; 2] = [CreepBranch { share: 0.1, time_s: 1.0 }, CreepBranch { share: -0.05, time_s: 30.0 }];
const TEMPERATURE: Temperature = Temperature {
    mean_c: 23.0,
    wave: Some(Sine { amplitude: 2.0, period_s: 3600.0 }),
    drift_c_h: 0.5,
    reference_c: 20.0,
    taxel_zero_per_c: 0.01,
    taxel_gain_per_c: -0.002,
    load_cell_zero_n_per_c: 0.003,
    load_cell_gain_per_c: 0.0005,
};

fn creeping() -> SceneSpec {
    SceneSpec { taxel_creep: CREEP.to_vec(), taxel_lag_s: Some(LAG_S), ..plain() }
}

fn with_all_terms() -> SceneSpec {
    let wear = Some(Wear { gain_per_press: -1e-3, zero_per_press: 1e-4 });
    let load_cell = Some(LoadCellScene { noise_n: 0.003, ..LoadCellScene::default() });
    SceneSpec { skin: noisy_skin(), load_cell, wear, temperature: Some(TEMPERATURE), ..creeping() }
}

/// Presses and stays.
fn hold(scene: &mut Scene) {
    go(scene, 0.8, 4.0, 100.0, 0.0);
}

/// Presses, holds, slides off the taxel, and leaves; then nothing loads the taxels. All motions are known at the start.
fn slide(scene: &mut Scene) {
    let down = Trajectory::to(0.0, (0.5, 0.0), -0.8, 4.0, 100.0);
    let aside = Trajectory::to(0.9, (0.0, 0.0), 2.0, 8.0, 100.0);
    let up = Trajectory::to(1.4, (-0.8, 0.0), 0.3, 10.0, 100.0);
    scene.set_motion(Axis::Z, down.then(&up), 0.0);
    scene.set_motion(Axis::X, Trajectory::at_rest(0.0).then(&aside), 0.0);
}

/// Output of the taxel in the centre at the times, by Runge and Kutta from the load of a scene without memory: the lag first, then the
/// creep of the lagged load.
fn integrated(times: &[f64], play: fn(&mut Scene)) -> Vec<f64> {
    const STEP_S: f64 = 2e-5;
    let mut load = scene(plain(), 1);
    play(&mut load);
    let slopes = |[lagged, fast, slow]: [f64; 3], load: f64| {
        [(load - lagged) / LAG_S, (lagged - fast) / CREEP[0].time_s, (lagged - slow) / CREEP[1].time_s]
    };
    let (mut state, mut now_s, mut read) = ([0.0; 3], 0.0, Vec::new());
    let mut before = centre(&mut load, now_s);
    for &until_s in times {
        let steps = ((until_s - now_s) / STEP_S).ceil();
        let step_s = (until_s - now_s) / steps;
        for step in 1..=steps as usize {
            let end_s = now_s + step as f64 * step_s;
            let (middle, after) = (centre(&mut load, end_s - step_s / 2.0), centre(&mut load, end_s));
            let ahead = |by_s: f64, slope: [f64; 3]| [0, 1, 2].map(|i| state[i] + by_s * slope[i]);
            let a = slopes(state, before);
            let b = slopes(ahead(step_s / 2.0, a), middle);
            let c = slopes(ahead(step_s / 2.0, b), middle);
            let d = slopes(ahead(step_s, c), after);
            state = ahead(step_s / 6.0, [0, 1, 2].map(|i| a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
            before = after;
        }
        now_s = until_s;
        read.push(state[0] + CREEP[0].share * state[1] + CREEP[1].share * state[2]);
    }
    read
}

fn read(spec: SceneSpec, times: &[f64], play: fn(&mut Scene)) -> Vec<f64> {
    let mut scene = scene(spec, 1);
    play(&mut scene);
    times.iter().map(|&at_s| centre(&mut scene, at_s)).collect()
}

/// Times with gaps from 0.2 ms to 0.4 s, without a period. They are even multiples of 1 ns, the grain of the scene's motions.
fn irregular_times(count: u32) -> Vec<f64> {
    let gaps_us = (0..count).map(|i| 200 + 2 * (2e5 * (f64::from(i) * 0.618).fract().powi(6)) as u64);
    gaps_us
        .scan(0, |now_us, gap_us| Some(*now_us + gap_us).inspect(|next_us| *now_us = *next_us))
        .map(|us| us as f64 * 1e-6)
        .collect()
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn creep_and_lag_are_those_of_a_fine_integration() {
    for play in [hold, slide] {
        let times = irregular_times(60);
        let (closed, fine) = (read(creeping(), &times, play), integrated(&times, play));
        let off = largest_difference(&closed, &fine);

        assert!(off < 1e-6 * fine.iter().copied().fold(0.0, f64::max), "{off}");
    }
}

#[test]
fn taxel_that_stays_loaded_grows_by_its_share() {
    let spec = |taxel_lag_s| SceneSpec { relaxation: vec![], taxel_lag_s, ..creeping() };
    for lag_s in [None, Some(LAG_S)] {
        let mut scene = scene(spec(lag_s), 1);
        let arrived_s = go(&mut scene, 0.8, 1e6, 1e9, 0.0);
        let grown = centre(&mut scene, arrived_s + 3600.0) / CONTACT.force_n(0.8);
        assert!((grown - 1.05).abs() < 1e-12, "{grown}");
        let left_s = go(&mut scene, -0.3, 1e6, 1e9, arrived_s + 3600.0);
        let (early, late) = (centre(&mut scene, left_s + 0.5), centre(&mut scene, left_s + 3600.0));
        assert!(early > 0.01 && late.abs() < 1e-12, "the creep recovers without a load: {early} {late}");
    }
    let early = read(spec(None), &[0.05], |scene| _ = go(scene, 0.8, 1e6, 1e9, 0.0))[0] / CONTACT.force_n(0.8);
    let expected = 1.0 + CREEP.iter().map(|branch| branch.share * -(-0.05 / branch.time_s).exp_m1()).sum::<f64>();
    assert!((early - expected).abs() < 1e-4, "{early} {expected}");
}

#[test]
fn reading_more_often_changes_nothing() {
    let times = irregular_times(80);
    let seldom = read(creeping(), &times, slide);
    let between = |pair: &[f64]| [pair[0], (pair[0] + pair[1]) / 2.0];
    let twice: Vec<f64> = times.windows(2).flat_map(between).chain(times.last().copied()).collect();
    let often: Vec<f64> = read(creeping(), &twice, slide).into_iter().step_by(2).collect();
    let off = largest_difference(&seldom, &often);
    assert!(off < 1e-9, "{off}");

    let once = read(creeping(), &times[79..], slide)[0];
    assert!((once - seldom[79]).abs() < 1e-9, "{once} {}", seldom[79]);
}

#[test]
fn shear_creeps_too() {
    let taxels = Taxels { shear: true, ..Taxels::default() };
    let friction = Some(Friction { sticking: 2.0, sliding: 1.0, stiffness_n_mm: 1.0 });
    let spec = SceneSpec { skin: SkinSpec { taxels, ..skin() }, friction, relaxation: vec![], ..creeping() };
    let after_drag = |spec: SceneSpec, hold_s: f64| {
        let setting =
            Surroundings { layout: ArrayLayout::grid(3, 3, 4.5).with_channels(3), ..scene(plain(), 1).setting };
        let mut scene = Scene::new(spec, setting, 1);
        let pressed_s = go(&mut scene, 0.8, 4.0, 100.0, 0.0);
        let drag = Trajectory::to(pressed_s, (0.0, 0.0), 0.5, 1.0, 100.0);
        let dragged_s = drag.end_s();
        scene.set_motion(Axis::X, drag, pressed_s);
        let mut outputs = [0.0; 27];
        scene.outputs(dragged_s + hold_s, &mut outputs);
        outputs
    };
    let long = after_drag(spec.clone(), 3600.0);
    let plain = after_drag(SceneSpec { taxel_creep: vec![], taxel_lag_s: None, ..spec }, 3600.0);
    assert!(plain.iter().filter(|output| output.abs() > 0.01).count() > 9);
    assert!(long.iter().zip(plain).all(|(long, plain)| (long - 1.05 * plain).abs() < 1e-9), "{long:?} {plain:?}");
}

#[test]
fn temperature_shifts_zeros_and_gains() {
    let cell = Some(LoadCellScene::IDEAL);
    for load_cell in [None, cell] {
        let mut scene =
            scene(SceneSpec { temperature: Some(TEMPERATURE), load_cell, relaxation: vec![], ..plain() }, 1);
        let warmer_c = 23.0 + 2.0 + 0.5 / 4.0 - 20.0; // a quarter of a period
        assert!((scene.temperature_c(900.0).unwrap() - 20.0 - warmer_c).abs() < 1e-12);
        assert!((centre(&mut scene, 900.0) - 0.01 * warmer_c).abs() < 1e-12);
        assert!((scene.load_cell_n(900.0) - 0.003 * warmer_c).abs() < 1e-9);
        go(&mut scene, 0.8, 10.0, 100.0, 1000.0);
        let force_n = scene.true_force_n(2700.0);
        let warmer_c = 23.0 - 2.0 + 0.5 * 0.75 - 20.0;
        let expected = force_n * (1.0 - 0.002 * warmer_c) + 0.01 * warmer_c;
        assert!((centre(&mut scene, 2700.0) - expected).abs() < 1e-12);
        let expected_n = force_n * (1.0 + 0.0005 * warmer_c) + 0.003 * warmer_c;
        assert!((scene.load_cell_n(2700.0) - expected_n).abs() < 1e-9);
    }
    assert_eq!(scene(plain(), 1).temperature_c(900.0), None);
}

#[test]
fn each_contact_wears_once() {
    let wear = Some(Wear { gain_per_press: -0.01, zero_per_press: 0.002 });
    let mut scene = scene(SceneSpec { wear, relaxation: vec![], ..plain() }, 1);
    let mut now_s = 0.0;
    for contacts in 1..=5u32 {
        scene.begin_press(u64::from(contacts), now_s);
        scene.begin_press(u64::from(contacts), now_s);
        let touched_s = go(&mut scene, 0.5, 10.0, 100.0, now_s);
        let deeper_s = go(&mut scene, 0.8, 10.0, 100.0, touched_s);
        let (force_n, worn) = (scene.true_force_n(deeper_s), f64::from(contacts));
        let expected = force_n * (1.0 - 0.01 * worn) + 0.002 * worn;
        assert!((centre(&mut scene, deeper_s) - expected).abs() < 1e-12, "{contacts}");
        now_s = go(&mut scene, -0.3, 10.0, 100.0, deeper_s);
        assert!((centre(&mut scene, now_s) - 0.002 * worn).abs() < 1e-12);
    }
}

#[test]
fn all_terms_together_follow_from_the_seed() {
    let times = irregular_times(80);
    let [first, second] = [(); 2].map(|()| read(with_all_terms(), &times, slide));
    assert_eq!(first, second);
    assert_ne!(first, read(creeping(), &times, slide));
}
