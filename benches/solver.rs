//! What a solve costs on one core, against what the processor could do at best and against numpy, and what a simulated reading
//! does: `cargo bench --bench solver`.
//!
//! It measures and prints; it doesn't judge. Times are the best of several repetitions, as whatever else runs only adds
//! to them. Numpy is looked for in the interpreter `$PALPATE_PYTHON`, else `python3`.
#![allow(clippy::print_stdout, reason = "it prints its results")]

use palpate_core::mechanics::lambda;
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_solver::{
    BEST, Calibration, CalibrationPoint, Fitted, ForceRule, Pearson, SOLVERS, Setting, Solver, Workspace, fit,
};
use palpate_study::ablation::{Cost, TermModel, cost_of_all_terms};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::hint::black_box;
use std::process::Command;
use std::time::Instant;

const REPETITIONS: usize = 50;
/// Readings that one repetition goes through; as many for a batch as numpy gets.
const READINGS: usize = 100;
const BATCH: usize = 10_000;
/// Repetitions of a batch, as many as numpy gets.
const BATCHES: usize = 7;
/// How often each method is fitted.
const FITS: usize = 3;
/// Numbers that one repetition reads of a synthetic table, however large it is.
const NUMBERS: usize = 10_000_000;

/// Units and points of synthetic tables.
const TABLES: [(usize, usize); 7] =
    [(9, 100), (9, 625), (9, 10_000), (16, 1_000), (64, 1_000), (64, 10_000), (64, 100_000)];

fn main() {
    let (calibration, readings) = papers(BATCH);
    let (units, points) = (calibration.units(), calibration.len());
    let few = &readings[..READINGS * units];
    println!("on {units} x {points} points, the paper's:");
    for name in SOLVERS {
        print_cost(name, cost_ns(&solver(name, &calibration), units, few, REPETITIONS));
    }
    let whole_ns = cost_ns(&solver("pearson", &calibration), units, &readings, BATCHES);
    print_cost("pearson, each of 10,000", whole_ns);
    // the work that numpy does, and the centring that it doesn't
    let batch_ns = nearest_ns(&calibration, units, &readings);
    print_cost("its search alone", batch_ns);
    print_roofline(units, points);
    print_numpy(units, points, batch_ns);

    println!("fitting them, errors and thresholds included:");
    for name in SOLVERS.into_iter().chain([BEST]) {
        let times = (0..FITS).map(|_| {
            let began = Instant::now();
            black_box(solver(name, black_box(&calibration)));
            began.elapsed().as_secs_f64() * 1e3
        });
        println!("  {name:<24} {:>7.1} ms", times.fold(f64::INFINITY, f64::min));
    }

    let (model, rig) = TermModel::base().expect("the shipped scene");
    let Cost { off, on, ratio, .. } = cost_of_all_terms(&model, &rig);
    println!("a reading of a simulated skin: plain {off:.0} ns, with all terms {on:.0} ns, {ratio:.2} times as long");

    println!("pearson on synthetic tables:");
    for (units, points) in TABLES {
        let (calibration, readings) = synthetic(units, points);
        let bytes = table_bytes(units, points);
        let count = (NUMBERS / (units * points)).clamp(1, READINGS);
        let ns = cost_ns(&solver("pearson", &calibration), units, &readings[..count * units], REPETITIONS);
        println!(
            "  {units:>2} x {points:>7}: {ns:>10.0} ns, {:>9.1} kB, {:.4} ns per byte ({:.0} GB/s)",
            bytes / 1e3,
            ns / bytes,
            bytes / ns,
        );
    }
}

fn solver(name: &str, calibration: &Calibration) -> Fitted {
    fit(name, calibration, &Setting::default()).expect("a listed solver and a calibration with contrast")
}

fn print_cost(what: &str, ns: f64) {
    println!("  {what:<24} {ns:>7.0} ns a solve");
}

/// Nanoseconds that the search for the best calibration point takes.
fn nearest_ns(calibration: &Calibration, units: usize, readings: &[f64]) -> f64 {
    let pearson = Pearson::fit(calibration, None, ForceRule::ClosestUnit).expect("a calibration with contrast");
    let mut workspace = Workspace::default();
    let times = (0..BATCHES).map(|_| {
        let began = Instant::now();
        for reading in readings.chunks_exact(units) {
            black_box(pearson.nearest(black_box(reading), &mut workspace)).expect("a reading with contrast");
        }
        began.elapsed().as_secs_f64() * 1e9 / (readings.len() / units) as f64
    });
    times.fold(f64::INFINITY, f64::min)
}

/// Nanoseconds that a solve takes, the best repetition; readings x units, row-major.
fn cost_ns(solver: &dyn Solver, units: usize, readings: &[f64], repetitions: usize) -> f64 {
    let mut workspace = Workspace::default();
    let readings = readings.chunks_exact(units);
    let times = (0..repetitions).map(|_| {
        let began = Instant::now();
        for reading in readings.clone() {
            black_box(solver.solve(black_box(reading), &mut workspace)).expect("a reading with contrast");
        }
        began.elapsed().as_secs_f64() * 1e9 / readings.len() as f64
    });
    times.fold(f64::INFINITY, f64::min)
}

/// The searched table in single precision, without what fills up its last panel.
fn table_bytes(units: usize, points: usize) -> f64 {
    (units * points * size_of::<f32>()) as f64
}

/// What the product alone would take if nothing but the processor's width held it up: two loads and two multiply-adds
/// a cycle, one vector each, as wide as it has them. So the loads and the sums take equally long, and each could hide
/// the other.
fn print_roofline(units: usize, points: usize) {
    let cycle_ns = cycle_ns();
    let bytes = table_bytes(units, points);
    let Some(width_bytes) = vector_bytes() else { return println!("  roofline: this processor's width isn't known") };
    let floor_ns = bytes / (2.0 * width_bytes) * cycle_ns;
    println!(
        "  roofline: {:.1} kB from L1, {:.1} GHz, two loads and two multiply-adds of {width_bytes} bytes a cycle: {:.0} ns",
        bytes / 1e3,
        1.0 / cycle_ns,
        floor_ns,
    );
}

/// The widest vector that multiplies and adds at once, bytes; none where it isn't known.
fn vector_bytes() -> Option<f64> {
    #[cfg(target_arch = "x86_64")]
    return Some(match () {
        () if is_x86_feature_detected!("avx512f") => 64.0,
        () if is_x86_feature_detected!("fma") => 32.0,
        () => 16.0,
    });
    #[cfg(target_arch = "aarch64")]
    return Some(16.0);
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    None
}

/// One clock cycle, by shifts and additions that each wait for the one before: either takes one.
fn cycle_ns() -> f64 {
    const STEPS: u64 = 1_000_000;
    let times = (0..REPETITIONS).map(|_| {
        let began = Instant::now();
        let mut sum = black_box(1u64);
        for _ in 0..STEPS {
            sum = sum.wrapping_add(sum >> 3).wrapping_add(1);
        }
        black_box(sum);
        began.elapsed().as_secs_f64() * 1e9 / (3 * STEPS) as f64
    });
    times.fold(f64::INFINITY, f64::min)
}

/// The same search as a matrix product in numpy, one thread, and how much longer it takes.
fn print_numpy(units: usize, points: usize, ours_ns: f64) {
    let python = std::env::var("PALPATE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let imports = Command::new(&python).args(["-c", "import numpy"]).output();
    if !imports.is_ok_and(|output| output.status.success()) {
        return println!("  skipped: no numpy in {python}");
    }
    let threads = ["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"];
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/numpy.py");
    let sizes = [units, points, BATCH].map(|size| size.to_string());
    let output = Command::new(&python).arg(script).args(sizes).envs(threads.map(|name| (name, "1"))).output();
    let text = output.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned()).unwrap_or_default();
    match text.parse::<f64>() {
        Ok(numpy_ns) => println!(
            "  numpy, float64 product and argmax of {BATCH} readings: {numpy_ns:.0} ns each; pearson {ours_ns:.0} ns: {:.1} \
             times faster",
            numpy_ns / ours_ns
        ),
        Err(_) => println!("  skipped: numpy.py printed no number"),
    }
}

/// The paper's array under a half-space: 1 N at 25 x 25 points, and contacts between them.
fn papers(contacts: usize) -> (Calibration, Vec<f64>) {
    let layout = ArrayLayout::grid(3, 3, 4.5);
    let outputs = |place: Place, force_n: f64| -> Vec<f64> {
        layout.places().iter().map(|unit| force_n * lambda(place.distance_mm(*unit) / 5.0)).collect()
    };
    let at = |index: usize| -6.0 + 0.5 * index as f64;
    let places = (0..625).map(|index| Place::new(at(index % 25), at(index / 25)));
    let points: Vec<(Place, Vec<f64>)> = places.map(|place| (place, outputs(place, 1.0))).collect();
    let mut random = Pcg64::seed_from_u64(1);
    let mut within = |least: f64, most: f64| random.random_range(least..most);
    let readings = (0..contacts).flat_map(|_| {
        let place = Place::new(within(-6.0, 6.0), within(-6.0, 6.0));
        outputs(place, within(0.1, 1.0))
    });
    let readings = readings.collect();
    (calibration(&points), readings)
}

/// Rows of random numbers, and readings that are some of them a little changed.
fn synthetic(units: usize, points: usize) -> (Calibration, Vec<f64>) {
    let mut random = Pcg64::seed_from_u64(2);
    let mut row = |centre: &[f64], spread: f64| -> Vec<f64> {
        centre.iter().map(|value| value + random.random_range(-spread..spread)).collect()
    };
    let nothing = vec![0.0; units];
    let points: Vec<(Place, Vec<f64>)> =
        (0..points).map(|index| (Place::new(index as f64, 0.0), row(&nothing, 1.0))).collect();
    let readings = (0..READINGS).flat_map(|index| row(&points[index * points.len() / READINGS].1, 0.05)).collect();
    (calibration(&points), readings)
}

fn calibration(points: &[(Place, Vec<f64>)]) -> Calibration {
    let points: Vec<CalibrationPoint<'_>> =
        points.iter().map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
    Calibration::new(&points).expect("finite outputs of pressed points")
}
