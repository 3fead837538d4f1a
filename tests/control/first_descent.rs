//! The first descent doesn't use the frame: for any real height of the surface and any time of a failure, the force on the declared
//! specimen is at most the force limit.
//!
//! `PALPATE_TESTS=full` tries twelve surfaces for each strategy and each failure.

use palpate_control::{FIRST_APPROACH_MM_S, Strategy};
use palpate_core::quantity::{Axis, Place, stream};
use palpate_sim::scene::{ContactLaw, FaultKind, Mounting, SceneFault};
use palpate_testing::campaign;
use palpate_testing::executions::{BENCHES, Deaths, bench, end_of, executed_with, in_parallel, must_be_none, plan};
use rand::RngExt;

/// Largest distance of the real surface from that of the frame, mm.
const OFF_MM: f64 = 10.0;

/// Height of home over the surface of the frame, mm.
const HOME_MM: f64 = 12.5;

/// Times of the failure, s since the rig was opened: any time until the surface is touched.
const FAILS_S: f64 = 60.0;

/// Largest part of a peak that a scene may miss between two looks, N.
const PEAK_N: f64 = 0.0005;

fn descents() -> u64 {
    campaign::size(1, 12) as u64
}

fn recipe(strategy: Strategy) -> String {
    format!(
        "name = \"descent\"\n[press]\nstrategy = \"{}\"\n[[step]]\nphase = \"calibration\"\n\
         random = {{ count = 1, x_mm = [-2.0, 2.0], y_mm = [-2.0, 2.0] }}\nforce_n = 1.0\n",
        strategy.name()
    )
}

/// Failures on the way: none, the load cell (silent, frozen, no longer on the indenter), or the link to the stage.
const FAILS: [Option<FaultKind>; 5] =
    [None, Some(FaultKind::Stale), Some(FaultKind::Stuck), Some(FaultKind::NoSensor), Some(FaultKind::StageLost)];

#[test]
fn force_limit_holds_on_every_surface_with_every_failure() {
    let mut jobs = Vec::new();
    for (name, _) in BENCHES {
        for strategy in Strategy::ALL {
            for fault in FAILS {
                jobs.extend((0..descents()).map(|nth| (name, strategy, fault, nth)));
            }
        }
    }
    let broken = in_parallel(&jobs, |&(name, strategy, fault, nth)| {
        let mut rng = stream(nth, fault.map_or(0, |kind| kind as u64 + 1), name);
        let off_mm = rng.random_range(-OFF_MM..=OFF_MM);
        let mut spec = bench(name);
        spec.stage.travel.axes[Axis::Z.index()].max = HOME_MM;
        spec.scene.mounting = Some(Mounting { origin: Place::default(), rotation_deg: 0.0, z_mm: off_mm });
        let from_s = rng.random_range(0.0..FAILS_S);
        spec.scene.faults = fault.into_iter().map(|kind| SceneFault { kind, from_s, value: None }).collect();
        let executed = executed_with(&spec, &plan(&spec, &recipe(strategy), nth + 1), Deaths::Tried, &|_| {});
        let end = end_of(&executed.ending);
        let output = format!("{name}, {strategy:?}, {fault:?} at {from_s:.2} s, off by {off_mm:+.2} mm: {end}");
        let worst_n = executed.truth.force_n.max(executed.orphaned.force_n);
        let most_n = spec.limits.force_n + PEAK_N;
        let mut broken = Vec::new();
        if worst_n > most_n || worst_n.is_nan() {
            broken.push(format!("{output}: {worst_n:.3} N"));
        }
        if fault.is_none() && off_mm < -1.0 && end != "surface-elsewhere" {
            broken.push(format!("{output}: a surface that is nearer isn't named"));
        }
        if fault.is_none() && off_mm > 1.0 && end != "no-contact" {
            broken.push(format!("{output}: a surface that is farther isn't named"));
        }
        (worst_n, broken)
    });
    let worst_n = broken.iter().map(|(worst_n, _)| *worst_n).fold(0.0, f64::max);
    println!(
        "{} descents, each message the last: the most that the specimen would have borne is {worst_n:.3} N",
        jobs.len()
    );
    must_be_none(&broken.into_iter().flat_map(|(_, broken)| broken).collect::<Vec<_>>());
}

/// An obstacle that is much harder than the declared specimen: a clamp, N/mm.
const HARD_N_MM: f64 = 200.0;

/// Speeds of the first approach, mm/s, with the default, and the largest forces on the clamp while host and cell work, N.
const SPEEDS: [(f64, f64); 4] = [(2.0, 15.0), (1.0, 8.0), (FIRST_APPROACH_MM_S, 3.0), (0.25, 2.0)];

#[test]
fn force_on_a_hard_obstacle_depends_on_approach_speed() {
    let mut jobs = Vec::new();
    for (speed_mm_s, _) in SPEEDS {
        for (name, _) in BENCHES {
            jobs.extend((0..descents()).map(|nth| (speed_mm_s, name, nth)));
        }
    }
    let seen = in_parallel(&jobs, |&(speed_mm_s, name, nth)| {
        let mut rng = stream(nth, 9, name);
        let off_mm = rng.random_range(-OFF_MM..=-1.0);
        let mut spec = bench(name);
        spec.stage.approach_mm_s = speed_mm_s;
        spec.stage.travel.axes[Axis::Z.index()].max = HOME_MM;
        spec.scene.mounting = Some(Mounting { origin: Place::default(), rotation_deg: 0.0, z_mm: off_mm });
        spec.scene.contact = ContactLaw { linear_n_mm: HARD_N_MM, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
        let executed = executed_with(&spec, &plan(&spec, &recipe(Strategy::Guarded), nth + 1), Deaths::Tried, &|_| {});
        (speed_mm_s, name, executed.truth.force_n, executed.orphaned.force_n)
    });
    let mut broken = Vec::new();
    for (speed_mm_s, most_n) in SPEEDS {
        for (bench, _) in BENCHES {
            let of_it = || seen.iter().filter(|(speed, name, ..)| *speed == speed_mm_s && *name == bench);
            let alive_n = of_it().map(|(_, _, alive_n, _)| *alive_n).fold(0.0, f64::max);
            let dead_n = of_it().map(|(.., dead_n)| *dead_n).fold(0.0, f64::max);
            let output = format!("{bench}, {HARD_N_MM} N/mm in the way at {speed_mm_s} mm/s: {alive_n:.2} N");
            println!("{output}; had the program died at the worst moment {dead_n:.0} N");
            // and at least the force that can be noticed
            if !(0.03..=most_n).contains(&alive_n) {
                broken.push(output);
            }
        }
    }
    must_be_none(&broken);
}
