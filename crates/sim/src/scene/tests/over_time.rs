//! Tests of the taxels' creep and lag, of temperature and of wear.

use super::*;

const LAG_S: f64 = 0.05;
const CREEP: [RelaxationBranch; 2] =
    [RelaxationBranch { share: 0.1, time_s: 1.0 }, RelaxationBranch { share: -0.05, time_s: 30.0 }];
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

/// A scene that presses from 0.2 s, holds, slides off the taxel in the centre, and leaves before 1.7 s.
fn sliding(spec: SceneSpec) -> Scene {
    let mut scene = scene(spec, 1);
    let down = Trajectory::to(0.0, (0.5, 0.0), -0.8, 4.0, 100.0);
    let aside = Trajectory::to(0.9, (0.0, 0.0), 2.0, 8.0, 100.0);
    let up = Trajectory::to(1.4, (-0.8, 0.0), 0.3, 10.0, 100.0);
    scene.set_motion(Axis::Z, down.then(&up), 0.0);
    scene.set_motion(Axis::X, Trajectory::at_rest(0.0).then(&aside), 0.0);
    scene
}

/// Output of the taxel in the centre of [`sliding`] at multiples of 20 us: the lag first, then the creep of the lagged load, by the
/// midpoint rule from the load of a scene without memory.
fn integrated(times_20us: &[u32]) -> Vec<f64> {
    let mut load = sliding(plain());
    let (mut state, mut read) = ([0.0; 3], Vec::new());
    let slopes = |[lagged, fast, slow]: [f64; 3], load: f64| {
        [(load - lagged) / LAG_S, (lagged - fast) / CREEP[0].time_s, (lagged - slow) / CREEP[1].time_s]
    };
    for step in 0..=times_20us[times_20us.len() - 1] {
        if times_20us.contains(&step) {
            read.push(state[0] + CREEP[0].share * state[1] + CREEP[1].share * state[2]);
        }
        let after = |state: [f64; 3], by_s: f64, slopes: [f64; 3]| [0, 1, 2].map(|i| state[i] + by_s * slopes[i]);
        let (now_s, before) = (f64::from(step) * 2e-5, state);
        let middle = after(before, 1e-5, slopes(before, centre(&mut load, now_s)));
        state = after(before, 2e-5, slopes(middle, centre(&mut load, now_s + 1e-5)));
    }
    read
}

/// Times with gaps from 0.2 ms to 0.4 s, without a period.
fn irregular_times_20us() -> Vec<u32> {
    let gaps = (0..60).map(|i| 10 + (2e4 * (f64::from(i) * 0.618).fract().powi(6)) as u32);
    gaps.scan(0, |now, gap| Some(*now + gap).inspect(|next| *now = *next)).collect()
}

fn read(spec: SceneSpec, times_20us: &[f64]) -> Vec<f64> {
    let mut scene = sliding(spec);
    times_20us.iter().map(|&time| centre(&mut scene, time * 2e-5)).collect()
}

fn assert_near(found: &[f64], expected: &[f64], most: f64) {
    let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(found.len() == expected.len() && off <= most, "{off}");
}

#[test]
fn creep_and_lag_do_not_depend_on_reading_times_and_are_those_of_a_fine_integration() {
    let times_20us = irregular_times_20us();
    let times: Vec<f64> = times_20us.iter().map(|&time| f64::from(time)).collect();
    let seldom = read(creeping(), &times);
    assert_near(&seldom, &integrated(&times_20us), 1e-6);
    let twice: Vec<f64> = times.iter().flat_map(|&time| [(time - 5.0), time]).collect();
    let often: Vec<f64> = read(creeping(), &twice).into_iter().skip(1).step_by(2).collect();
    assert_near(&often, &seldom, 1e-9);
    assert_near(&read(creeping(), &times[59..]), &seldom[59..], 1e-9);
}

#[test]
fn taxel_that_stays_loaded_grows_by_its_shares_and_recovers() {
    for taxel_lag_s in [None, Some(LAG_S)] {
        let mut scene = scene(SceneSpec { relaxation: vec![], taxel_lag_s, ..creeping() }, 1);
        let arrived_s = go(&mut scene, 0.8, 1e6, 1e9, 0.0);
        let grown = centre(&mut scene, arrived_s + 3600.0) / CONTACT.force_n(0.8);
        let left_s = go(&mut scene, -0.3, 1e6, 1e9, arrived_s + 3600.0);
        let most = 1e-4 + 0.04 * taxel_lag_s.unwrap_or(0.0);
        let recovering = centre(&mut scene, left_s + 1.0) / CONTACT.force_n(0.8);
        let expected = CREEP.map(|branch| branch.share * (-1.0 / branch.time_s).exp()).iter().sum::<f64>();
        assert!((grown - 1.05).abs() < 1e-12 && (recovering - expected).abs() < most, "{grown} {recovering}");
    }
}

#[test]
fn shear_creeps_too() {
    let friction = Some(Friction { sticking: 2.0, sliding: 1.0, stiffness_n_mm: 1.0 });
    let taxels = Taxels { shear: true, ..Taxels::default() };
    let spec = SceneSpec { skin: SkinSpec { taxels, ..skin() }, friction, relaxation: vec![], ..creeping() };
    let layout = ArrayLayout::grid(3, 3, 4.5).with_channels(3);
    let long_after_a_drag = |spec: SceneSpec| {
        let mut scene = Scene::new(spec, Surroundings { layout: layout.clone(), ..scene(plain(), 1).setting }, 1);
        let pressed_s = go(&mut scene, 0.8, 4.0, 100.0, 0.0);
        scene.set_motion(Axis::X, Trajectory::to(pressed_s, (0.0, 0.0), 0.5, 1.0, 100.0), pressed_s);
        let mut outputs = [0.0; 27];
        scene.outputs(3600.0, &mut outputs);
        outputs
    };
    let plain = long_after_a_drag(SceneSpec { taxel_creep: vec![], taxel_lag_s: None, ..spec.clone() });
    assert!(plain.iter().filter(|output| output.abs() > 0.01).count() > 9);
    assert_near(&long_after_a_drag(spec), &plain.map(|output| 1.05 * output), 1e-9);
}

#[test]
fn temperature_shifts_zeros_and_gains() {
    let mut scene = scene(SceneSpec { temperature: Some(TEMPERATURE), relaxation: vec![], ..plain() }, 1);
    for (at_s, warmer_c) in [(900.0, 3.0 + 2.0 + 0.125), (2700.0, 3.0 - 2.0 + 0.375)] {
        assert!((scene.temperature_c(at_s).unwrap() - 20.0 - warmer_c).abs() < 1e-12);
        let force_n = scene.true_force_n(at_s);
        let read = [centre(&mut scene, at_s), scene.load_cell_n(at_s)];
        let [taxel, cell_n] =
            [(-0.002, 0.01), (0.0005, 0.003)].map(|(gain, zero)| force_n * (1.0 + gain * warmer_c) + zero * warmer_c);
        assert_near(&read, &[taxel, cell_n], 1e-9);
        go(&mut scene, 0.8, 10.0, 100.0, at_s);
    }
}

#[test]
fn each_contact_wears_once() {
    let wear = Some(Wear { gain_per_press: -0.01, zero_per_press: 0.002, radius_mm: f64::INFINITY });
    let mut scene = scene(SceneSpec { wear, relaxation: vec![], ..plain() }, 1);
    let mut now_s = 0.0;
    for contact in 1..=5u32 {
        (0..2).for_each(|_| scene.begin_press(u64::from(contact), now_s));
        let touched_s = go(&mut scene, 0.5, 10.0, 100.0, now_s);
        now_s = go(&mut scene, 0.8, 10.0, 100.0, touched_s);
        let force_n = scene.true_force_n(now_s);
        let loaded = centre(&mut scene, now_s);
        now_s = go(&mut scene, -0.3, 10.0, 100.0, now_s);
        let worn = f64::from(contact);
        let expected = [force_n * (1.0 - 0.01 * worn) + 0.002 * worn, 0.002 * worn];
        assert_near(&[loaded, centre(&mut scene, now_s)], &expected, 1e-12);
    }
}
