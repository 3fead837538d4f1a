//! How often the guarded rule accepts a sensor exactly at a limit, and how often stated intervals contain the truth: for random errors of
//! three distributions with known figures.
//!
//! `cargo test --release --test solving acceptance -- --nocapture` prints the fractions.

use palpate_core::quantity::{ArrayLayout, Place, RandomStream, percentile, stream};
use palpate_data::acceptance::bound::{mean_interval, quantile_interval, sd_interval_factors};
use palpate_data::acceptance::{
    AcceptanceRule, Decision, Limit, LimitedFigure, Measured, SensorVerdict, TestErrors, judge,
};
use palpate_sim::scene::Skin;
use palpate_solver::{Calibration, CalibrationPoint, Setting, Solver as _, Workspace, fit};
use palpate_testing::campaign;
use palpate_testing::skins::scene_t;
use rand::RngExt as _;
use rand::distr::Distribution as _;
use rand_distr::StandardNormal;
use statrs::statistics::Statistics as _;
use std::cell::RefCell;

/// Sensors for each cell in the full tier, and test presses of each.
const SENSORS: usize = 10_000;
const PRESSES: [usize; 6] = [5, 10, 25, 59, 100, 500];

/// Largest fraction of sensors at a limit that a guarded rule may accept. With fewer sensors three standard deviations of a fraction of 5 %
/// are added.
fn accepted_most(sensors: usize) -> f64 {
    let by_chance = |count: usize| (0.05f64 * 0.95 / count as f64).sqrt();
    0.06 + 3.0 * (by_chance(sensors) - by_chance(SENSORS)).max(0.0)
}

/// One error, and the true mean and 95th percentile of its distribution, in units of its scale.
struct AcceptanceShape {
    name: &'static str,
    draw: fn(&mut dyn FnMut() -> f64, f64) -> f64,
    mean: f64,
    p95: f64,
}

/// Made from normal numbers and a uniform one.
const SHAPES: [AcceptanceShape; 3] = [
    // a force error
    AcceptanceShape {
        name: "half-normal",
        draw: |normal, _| normal().abs(),
        mean: 0.797_884_560_8,
        p95: 1.959_963_985,
    },
    // a location error: Rayleigh
    AcceptanceShape {
        name: "Rayleigh",
        draw: |normal, _| normal().hypot(normal()),
        mean: 1.253_314_137,
        p95: 2.447_746_831,
    },
    // errors with a long tail
    AcceptanceShape { name: "exponential", draw: |_, uniform| -(1.0 - uniform).ln(), mean: 1.0, p95: 2.995_732_274 },
];

fn errors(shape: &AcceptanceShape, n: usize, sensor: u64) -> Vec<f64> {
    let mut rng = stream(sensor, n as u64, shape.name);
    (0..n)
        .map(|_| {
            let uniform: f64 = rng.random();
            (shape.draw)(&mut || StandardNormal.sample(&mut rng), uniform)
        })
        .collect()
}

fn limits(shape: &AcceptanceShape) -> [(LimitedFigure, f64, Option<f64>); 3] {
    [
        (LimitedFigure::LocationMean, shape.mean, None),
        (LimitedFigure::LocationP95, shape.p95, None),
        (LimitedFigure::LocationWithin, 0.95, Some(shape.p95)),
    ]
}

fn verdict(
    decision: Decision,
    figure: LimitedFigure,
    limit: f64,
    reach: Option<f64>,
    sizes: Vec<f64>,
) -> SensorVerdict {
    let rule = AcceptanceRule {
        decision,
        method: "best".to_owned(),
        calibration_presses_least: 0,
        test_presses_least: 1,
        holdout: false,
        limits: vec![Limit { figure, limit, reach }],
        called_sound: false,
        afterwards_by: None,
    };
    let measured = Measured {
        test_presses: sizes.len(),
        location: Some(TestErrors { sizes, u_truth: Some(0.0) }),
        ..Measured::default()
    };
    judge(&rule, &measured).verdict
}

#[test]
fn guarded_rule_accepts_at_most_six_percent_at_a_limit() {
    let sensors = campaign::size(300, SENSORS);
    println!("{sensors} sensors a cell");
    let mut broken = Vec::new();
    for shape in &SHAPES {
        for (figure, limit, reach) in limits(shape) {
            let mut output = Vec::new();
            for n in PRESSES {
                let count = |decision| {
                    let is_accepted = |sensor: &u64| {
                        verdict(decision, figure, limit, reach, errors(shape, n, *sensor)) == SensorVerdict::Accepted
                    };
                    (0..sensors as u64).filter(is_accepted).count() as f64 / sensors as f64
                };
                let (guarded, simple) = (count(Decision::Guarded), count(Decision::Simple));
                output.push(format!("n {n}: {:.1} % ({:.0} %)", 100.0 * guarded, 100.0 * simple));
                if guarded > accepted_most(sensors) {
                    broken.push(format!("{}, {}, n {n}: {guarded}", shape.name, figure.name()));
                }
            }
            println!("{}, {}, guarded (simple): {}", shape.name, figure.name(), output.join(", "));
        }
    }
    assert!(broken.is_empty(), "{broken:?}");
}

/// The cost: good sensors that the guarded rule doesn't accept, by their distance from the limit.
#[test]
fn sensor_farther_from_a_limit_is_accepted_more_often() {
    let (shape, sensors) = (&SHAPES[1], campaign::size(200, 2000));
    for (figure, limit, reach) in [limits(shape)[0], limits(shape)[1]] {
        for n in [59, 100, 500] {
            let mut before = 0.0;
            let mut output = Vec::new();
            for share in [1.0, 0.95, 0.9, 0.8, 0.7, 0.6, 0.5] {
                let is_accepted = |sensor: &u64| {
                    let sizes = errors(shape, n, *sensor).into_iter().map(|size| share * size).collect();
                    verdict(Decision::Guarded, figure, limit, reach, sizes) == SensorVerdict::Accepted
                };
                let accepted = (0..sensors as u64).filter(is_accepted).count() as f64 / sensors as f64;
                output.push(format!("{share}: {:.0} %", 100.0 * accepted));
                assert!(accepted >= before - 0.02, "{figure:?}, n {n}, {share}: {accepted} after {before}");
                before = accepted;
            }
            println!("{}, n {n}, accepted by the true figure over its limit: {}", figure.name(), output.join(", "));
            assert!(before > 0.9, "{figure:?}, n {n}: {before}");
        }
    }
}

#[test]
fn stated_intervals_cover_the_truth_of_a_thousand_sensors() {
    let covered = |name: &str, n: usize, covers: &dyn Fn(u64) -> bool| {
        let share = (0..1000).filter(|sensor| covers(*sensor)).count() as f64 / 1000.0;
        println!("{name}, n {n}: {:.1} %", 100.0 * share);
        (share, format!("{name}, n {n}: {share}"))
    };
    let mut shares = Vec::new();
    for shape in &SHAPES {
        for n in [59, 100, 500] {
            let within = |(lower, upper): (f64, f64), truth: f64| lower <= truth && truth <= upper;
            shares.push(covered(&format!("{}, mean", shape.name), n, &|sensor| {
                within(mean_interval(&errors(shape, n, sensor)).unwrap(), shape.mean)
            }));
            if n > 59 {
                // exact up to the steps between order statistics: at least 95 %
                let (share, output) = covered(&format!("{}, 95th percentile", shape.name), n, &|sensor| {
                    let mut sizes = errors(shape, n, sensor);
                    sizes.sort_by(f64::total_cmp);
                    quantile_interval(&sizes, 0.95).is_some_and(|interval| within(interval, shape.p95))
                });
                assert!(share >= 0.925, "{output}");
            }
        }
    }
    for n in [50, 100, 500] {
        let (lower, upper) = sd_interval_factors((n - 1) as f64).unwrap();
        shares.push(covered("normal, standard deviation", n, &|sensor| {
            let mut rng = stream(sensor, n as u64, "sd");
            let sd = (0..n).map(|_| -> f64 { StandardNormal.sample(&mut rng) }).collect::<Vec<f64>>().std_dev();
            lower * sd <= 1.0 && 1.0 <= upper * sd
        }));
    }
    let outside: Vec<&String> =
        shares.iter().filter(|(share, _)| !(0.925..=0.975).contains(share)).map(|(_, output)| output).collect();
    assert!(outside.is_empty(), "{outside:?}");
}

/// Whole sensors in the full tier, test presses of each, and presses that determine its true figures.
const WHOLE: usize = 200;
const TESTED: usize = 100;
const TRUTH: usize = 4000;
/// Six in a hundred, and two standard deviations of the count.
fn whole_accepted_most(sensors: usize) -> f64 {
    0.06 + 0.034 * (WHOLE as f64 / sensors as f64).sqrt().max(1.0)
}

/// Location errors of a simulated sensor, calibrated at 13 x 13 places, for so many random contacts.
fn sensor(seed: u64, counts: [usize; 2]) -> [Vec<f64>; 2] {
    let layout = ArrayLayout::grid(3, 3, 4.5);
    let skin = RefCell::new(Skin::new(&scene_t(), &layout, 2.0, seed));
    let mut rng = stream(seed, 2, "whole");
    let press = |rng: &mut RandomStream, place: Place, force_n: f64| {
        let mut skin = skin.borrow_mut();
        skin.draw_contact(rng);
        let mut outputs = vec![0.0; skin.len()];
        skin.outputs(force_n, place, &mut outputs);
        outputs
    };
    let places: Vec<Place> =
        (0..169).map(|at| Place::new(f64::from(at % 13) - 6.0, f64::from(at / 13) - 6.0)).collect();
    let read: Vec<Vec<f64>> = places.iter().map(|place| press(&mut rng, *place, 1.0)).collect();
    let pressed = places.iter().zip(&read);
    let points: Vec<CalibrationPoint<'_>> =
        pressed.map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
    let calibration = Calibration::new(&points).unwrap();
    let fitted = fit("surrogate", &calibration, &Setting::of_layout(Some(&layout))).unwrap();
    let mut workspace = Workspace::default();
    counts.map(|count| {
        (0..count)
            .map(|_| {
                let place = Place::new(rng.random_range(-6.0..=6.0), rng.random_range(-6.0..=6.0));
                let force_n = rng.random_range(0.1..=1.0);
                let outputs = press(&mut rng, place, force_n);
                fitted.solve(&outputs, &mut workspace).unwrap().place.distance_mm(place)
            })
            .collect()
    })
}

#[test]
fn guarded_rule_accepts_few_whole_sensors_at_a_limit() {
    let whole = campaign::size(6, WHOLE);
    let sensors: Vec<[Vec<f64>; 2]> = (0..whole).map(|seed| sensor(seed as u64 + 1, [TRUTH, TESTED])).collect();
    for (figure, of) in [
        (LimitedFigure::LocationMean, (|sorted: &[f64]| sorted.mean()) as fn(&[f64]) -> f64),
        (LimitedFigure::LocationP95, |sorted| percentile(sorted, 0.95)),
    ] {
        let is_accepted = |sensor: &&[Vec<f64>; 2]| {
            let [truth, tested] = sensor;
            let mut truth = truth.clone();
            truth.sort_by(f64::total_cmp);
            verdict(Decision::Guarded, figure, of(&truth), None, tested.clone()) == SensorVerdict::Accepted
        };
        let accepted = sensors.iter().filter(is_accepted).count() as f64 / whole as f64;
        println!("{whole} whole sensors at the limit, {}, {TESTED} presses: {:.1} %", figure.name(), 100.0 * accepted);
        assert!(accepted <= whole_accepted_most(whole), "{figure:?}: {accepted}");
    }
}
