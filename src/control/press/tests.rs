use super::*;
use crate::control::SurfaceMap;

const LIMITS: Limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };

/// The nominal specimen's relaxed force at a depth below its surface.
fn force_at(depth_mm: f64) -> f64 {
    let s = depth_mm.max(0.0);
    1.1 * s + 0.1556 * s * s
}

struct Walk {
    forces: Vec<f64>,
    moves: Vec<f64>,
    end: Command,
}

/// Walks a press over a still specimen whose surface is at `surface_mm`: readings are exact, motions reach their targets
/// unless contact stops them `overrun_mm` after it is felt.
fn walk(levels: Vec<Level>, surface_mm: f64, overrun_mm: f64, force_at: impl Fn(f64) -> f64) -> (Press, Walk) {
    let zero = Zero { offset_n: 0.0, sigma_n: 0.003, offset_sigma_n: 0.0003, frozen_after: None };
    let permit = Permit::new(LIMITS, 0.05, 100.0, &zero);
    let expected = SurfaceMap::new(0.3).expect(Place::default());
    let timing =
        Timing { exchange_s: 0.02, settle_s: 0.01, conversion_s: 0.001, acceleration_mm_s2: 100.0, reaction_s: 0.05 };
    let context = Context {
        place: Place::default(),
        limits: LIMITS,
        permit,
        zero,
        expected,
        shot: None,
        clear_mm: -0.5,
        speed_mm_s: 5.0,
        timing,
    };
    let task = Task {
        levels,
        force_tolerance_n: 0.05,
        hold_s: 0.5,
        sample_s: 0.1,
        strategy: Strategy::Guarded,
        sample_after_s: None,
    };
    let mut press = Press::new(task, context);
    let (mut z, mut walk) = (-0.5, Walk { forces: vec![], moves: vec![], end: Command::Done });
    let air = Air { mean_n: force_at(z - surface_mm), sigma_n: 0.003, readings: AIR_READINGS };
    let mut event = Event::Begin { z_mm: z, air };
    let mut now_s = 0.0;
    for _ in 0..500 {
        let force = |z: f64| force_at(z - surface_mm);
        now_s += 0.2;
        event = match press.next(event, Moment { now_s, age_s: 0.0 }) {
            Command::Average(_) => Event::Averaged { force_n: force(z) },
            Command::Move(granted) | Command::Depart(granted) => {
                let felt = (0..=10_000)
                    .map(|i| z + (granted.z_mm() - z) * f64::from(i) / 10_000.0)
                    .find(|&z| press.see(force(z), now_s + 0.1) == Steer::Stop);
                z = felt.map_or(granted.z_mm(), |felt| (felt + overrun_mm).min(granted.z_mm()));
                walk.moves.push(z);
                Event::Moved { z_mm: z }
            }
            Command::Dwell(_) => Event::Dwelt,
            Command::Sample(_) => {
                walk.forces.push(force(z));
                Event::Sampled { force_n: force(z) }
            }
            end => {
                walk.end = end;
                return (press, walk);
            }
        };
    }
    panic!("the press has no end");
}

#[test]
fn a_press_reaches_its_force_from_below_and_withdraws() {
    for surface_mm in [-0.25, 0.0, 0.29] {
        for force_n in [0.1, 0.5, 1.0] {
            let (press, walk) = walk(Task::press(force_n), surface_mm, 0.02, force_at);
            assert_eq!(walk.end, Command::Done);
            assert!((walk.forces[0] - force_n).abs() < 0.0055 && walk.forces[0] <= force_n, "{:?}", walk.forces);
            assert!((press.touched_mm().unwrap() - surface_mm).abs() < 0.005, "{:?}", press.touched_mm());
            assert_eq!(walk.moves.last(), Some(&-0.5));
        }
    }
}

#[test]
fn a_staircase_reaches_loading_levels_from_below_and_unloading_levels_from_above() {
    let levels = Task::staircase(2.0, 0.5);
    let (_, walk) = walk(levels.clone(), 0.1, 0.02, force_at);
    assert_eq!(walk.end, Command::Done);
    assert_eq!(walk.forces.len(), 9);
    for (level, force_n) in levels.iter().zip(&walk.forces) {
        match level.branch {
            Branch::Loading => assert!((-0.01..=0.0).contains(&(force_n - level.force_set_n)), "{level:?} {force_n}"),
            Branch::Unloading => assert!((0.0..=0.01).contains(&(force_n - level.force_set_n)), "{level:?} {force_n}"),
        }
    }
    // the z of the steps turns round just once: up to the top, then down to the clear
    let deepest = walk.moves.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let top = walk.moves.iter().position(|&z| z == deepest).unwrap();
    assert!(walk.moves[..=top].is_sorted() && walk.moves[top..].iter().rev().is_sorted());
}

#[test]
fn a_specimen_too_soft_or_absent_is_a_trip_and_nothing_goes_deeper_than_permitted() {
    let (_, soft) = walk(Task::press(1.0), 0.0, 0.02, |depth| 0.4 * depth.max(0.0));
    assert!(matches!(&soft.end, Command::Trip(trip) if trip.rule == Rule::OutOfReach), "{:?}", soft.end);
    assert!(soft.moves.iter().all(|&z| z <= LIMITS.depth_mm));
    let (_, absent) = walk(Task::press(1.0), 0.0, 0.0, |_| 0.0);
    assert!(matches!(&absent.end, Command::Trip(trip) if trip.rule == Rule::NoContact), "{:?}", absent.end);
}

#[test]
fn a_force_in_air_is_a_drifted_zero_and_moves_nothing() {
    let (_, drifted) = walk(Task::press(1.0), 0.0, 0.0, |_| -0.04);
    assert!(matches!(&drifted.end, Command::Trip(trip) if trip.rule == Rule::ZeroDrifted), "{:?}", drifted.end);
    assert!(drifted.moves.is_empty());
}

#[test]
fn a_force_that_does_not_answer_a_step_is_a_trip_before_the_depth_limit() {
    // it slips away, or the cell gives what it gave
    let (_, stuck) = walk(Task::press(1.0), 0.0, 0.02, |depth| force_at(depth).min(0.12));
    assert!(matches!(&stuck.end, Command::Trip(trip) if trip.rule == Rule::NoResponse), "{:?}", stuck.end);
    assert!(stuck.moves.iter().all(|&z| z < 1.0), "{:?}", stuck.moves);
}
