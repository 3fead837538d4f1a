//! Estimates from measurements over time: how near they are to the truth, and how often their intervals contain it.

use palpate_core::parallel::in_parallel;
use palpate_core::quantity::stream;
use palpate_solver::over_time::{
    CyclePoint, OverTimeError, PlannedTerm, TemperaturePoint, Term, Wear, allan_deviation, noise_sd, relaxation,
    relaxation_bound, temperature_coefficient, wear,
};
use palpate_testing::campaign;
use rand::distr::Distribution as _;
use rand_distr::StandardNormal;

/// Number of draws, in the quick and the full tier.
const DRAWS: (usize, usize) = (40, 1000);

/// Readings: noise, interval and number.
const NOISE: f64 = 0.005;
const INTERVAL_S: f64 = 0.01;
const READINGS: usize = 12_000;

/// Largest rms error of a time constant, relative to itself and to the bound by information.
const ERROR_MOST: f64 = 0.05;
const OF_BOUND_MOST: f64 = 1.3;

/// Share of terms in white noise.
const FALSE_MOST: f64 = 0.05;

fn draws<T: Send>(of: impl Fn(&u64) -> T + Sync) -> Vec<T> {
    let draws: Vec<u64> = (0..campaign::size(DRAWS.0, DRAWS.1) as u64).collect();
    in_parallel(&draws, of)
}

/// Independent normal numbers with sd 1.
fn normal(draw: u64, name: &str) -> impl Iterator<Item = f64> {
    StandardNormal.sample_iter(stream(11, draw, name))
}

fn planned(amplitude: f64, time_s: f64) -> PlannedTerm {
    PlannedTerm { amplitude, time_s }
}

fn times(readings: usize) -> Vec<f64> {
    (0..readings).map(|i| INTERVAL_S * i as f64).collect()
}

/// Values that relax to 1, with white noise.
fn relaxing(t_s: &[f64], terms: &[PlannedTerm], draw: u64) -> Vec<f64> {
    let value = |t: f64| 1.0 + terms.iter().map(|term| term.amplitude * (-t / term.time_s).exp()).sum::<f64>();
    t_s.iter().zip(normal(draw, "relaxation")).map(|(t, normal)| value(*t) + NOISE * normal).collect()
}

fn contains([from, to]: [f64; 2], truth: f64) -> bool {
    (from..to).contains(&truth)
}

/// Asserts that a share of intervals is 95 %, by the bar of 2 % in the full tier and by 4 standard deviations of a
/// smaller number.
fn assert_covered(name: &str, covered: &[bool]) {
    let (count, hits) = (covered.len(), covered.iter().filter(|is_covered| **is_covered).count());
    let share = hits as f64 / count as f64;
    println!("{name}: {hits} of {count} intervals contain the truth, {:.1} %", 100.0 * share);
    let most = if count < 1000 { 4.0 * (0.05 * 0.95 / count as f64).sqrt() } else { 0.02 };
    assert!((share - 0.95).abs() <= most, "{name}: {share}");
}

fn root_mean_square(errors: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = errors.len() as f64;
    (errors.map(|error| error * error).sum::<f64>() / count).sqrt()
}

fn assert_times(readings: usize, truth: &[PlannedTerm]) {
    let t_s = times(readings);
    let found: Vec<Vec<Term>> = draws(|draw| relaxation(&t_s, &relaxing(&t_s, truth, *draw)).unwrap().terms);
    let complete: Vec<&Vec<Term>> = found.iter().filter(|terms| terms.len() == truth.len()).collect();
    println!("{} of {} draws have {} terms", complete.len(), found.len(), truth.len());
    assert!(complete.len() as f64 >= 0.99 * found.len() as f64);
    for (i, (term, bound)) in truth.iter().zip(relaxation_bound(&t_s, NOISE, truth)).enumerate() {
        let name = format!("{} s of {} terms", term.time_s, truth.len());
        let rms = root_mean_square(complete.iter().map(|terms| terms[i].time_s / term.time_s - 1.0));
        println!("{name}: rms error {:.2} %, bound {:.2} %", 100.0 * rms, 100.0 * bound);
        assert!(rms <= ERROR_MOST.max(OF_BOUND_MOST * bound), "{name}: {rms} {bound}");
        assert!(campaign::is_quick() || rms >= 0.9 * bound, "{name}: better than the bound, {rms} {bound}");
        let is_in = |terms: &&Vec<Term>| contains(terms[i].time_interval_s, term.time_s);
        assert_covered(&name, &complete.iter().map(is_in).collect::<Vec<_>>());
        let amplitude = |terms: &&Vec<Term>| (terms[i].amplitude - term.amplitude).abs() < 1.96 * terms[i].amplitude_u;
        assert_covered(&format!("{name}, amplitude"), &complete.iter().map(amplitude).collect::<Vec<_>>());
    }
}

#[test]
fn one_time_constant_is_as_near_as_its_readings_allow() {
    assert_times(READINGS, &[planned(0.1, 10.0)]);
}

#[test]
fn a_faint_time_constant_is_as_near_as_its_readings_allow() {
    assert_times(1000, &[planned(0.02, 1.0)]);
}

#[test]
fn two_time_constants_are_as_near_as_their_readings_allow() {
    assert_times(READINGS, &[planned(0.1, 1.0), planned(0.1, 30.0)]);
}

#[test]
fn two_time_constants_of_opposite_sign_are_as_near_as_their_readings_allow() {
    assert_times(READINGS, &[planned(-0.05, 1.0), planned(0.1, 30.0)]);
}

#[test]
fn white_noise_has_no_time_constant() {
    for readings in [100, 1000, READINGS] {
        let t_s = times(readings);
        let found = draws(|draw| relaxation(&t_s, &relaxing(&t_s, &[], *draw)).unwrap());
        let share = |count: usize| count as f64 / found.len() as f64;
        let false_terms = share(found.iter().filter(|found| !found.terms.is_empty()).count());
        let left_out = share(found.iter().filter(|found| found.undetermined).count());
        println!("{readings} readings: {:.1} % false terms, {:.1} % left out", 100.0 * false_terms, 100.0 * left_out);
        assert!(false_terms <= FALSE_MOST && left_out <= FALSE_MOST, "{readings}: {false_terms} {left_out}");
    }
}

#[test]
fn a_time_constant_longer_than_the_span_is_left_out() {
    let t_s = times(2000);
    let truth = [planned(0.1, 1.0), planned(0.5, 400.0)];
    let found = draws(|draw| relaxation(&t_s, &relaxing(&t_s, &truth, *draw)).unwrap());
    let left_out = found.iter().filter(|found| found.undetermined && found.terms.len() == 1).count();
    println!("{left_out} of {} leave the slow term out and state the fast one", found.len());
    assert!(left_out as f64 >= 0.95 * found.len() as f64);
    // the slow time is at the end of the search, which makes the interval of the fast one a little wide
    let is_in = found.iter().filter(|found| found.terms.iter().all(|term| contains(term.time_interval_s, 1.0))).count();
    let share = is_in as f64 / found.len() as f64;
    println!("1 s with a slow change: {:.1} % of the intervals contain the truth", 100.0 * share);
    assert!(share >= if campaign::is_quick() { 0.8 } else { 0.93 }, "{share}");
}

#[test]
fn near_time_constants_are_covered_or_left_out() {
    let (t_s, truth) = (times(4000), [planned(0.1, 1.0), planned(0.1, 4.0)]);
    let found = draws(|draw| relaxation(&t_s, &relaxing(&t_s, &truth, *draw)).unwrap());
    let bound = relaxation_bound(&t_s, NOISE, &truth);
    let complete: Vec<&Vec<Term>> = found.iter().map(|found| &found.terms).filter(|terms| terms.len() == 2).collect();
    println!("{} of {} state 1 s and 4 s, bound {bound:.3?}", complete.len(), found.len());
    assert!(found.iter().all(|found| found.terms.len() == 2 || found.undetermined));
    for (i, term) in truth.iter().enumerate() {
        let is_in = |terms: &&Vec<Term>| contains(terms[i].time_interval_s, term.time_s);
        assert_covered(&format!("{} s near another", term.time_s), &complete.iter().map(is_in).collect::<Vec<_>>());
    }
}

/// Presses 6 s apart, a reference after each tenth at the worn place; the drift is a function of the hours.
fn pressed(count: usize, drift: impl Fn(f64) -> f64, draw: u64) -> Wear {
    let point = |(i, normal): (usize, f64)| {
        let (t_s, is_reference, cycle) = (6.0 * i as f64, i % 11 == 10, (i - i / 11) as f64);
        let log_gain = if is_reference { 0.3 } else { 0.1 - 1e-4 * cycle } + drift(t_s / 3600.0) + 0.002 * normal;
        CyclePoint { cycle, t_s, log_gain, is_reference }
    };
    wear(&normal(draw, "wear").take(count).enumerate().map(point).collect::<Vec<_>>()).unwrap()
}

#[test]
fn intervals_of_wear_and_drift_contain_the_truth() {
    for count in [60, 550] {
        let found = draws(|draw| pressed(count, |hours| -0.02 * hours, *draw));
        let rms = root_mean_square(found.iter().map(|found| found.wear_per_cycle.value / -1e-4 - 1.0));
        let misfits = found.iter().filter(|found| !found.fits).count();
        println!("{count} presses: rms error of the wear {:.1} %, {misfits} misfits", 100.0 * rms);
        assert!(misfits as f64 <= 0.02 * found.len() as f64 && found.iter().all(|found| found.is_separate));
        let wear: Vec<bool> = found.iter().map(|found| contains(found.wear_per_cycle.interval, -1e-4)).collect();
        assert_covered(&format!("wear by {count} presses"), &wear);
        let drift: Vec<bool> = found.iter().map(|found| contains(found.drift_per_h.unwrap().interval, -0.02)).collect();
        assert_covered(&format!("drift by {count} presses"), &drift);
    }
}

#[test]
fn intervals_of_wear_contain_the_truth_while_the_rig_warms_up() {
    let found = draws(|draw| pressed(550, |hours| 0.02 * (-hours / 0.3).exp(), *draw));
    let misfits = found.iter().filter(|found| !found.fits).count();
    println!("{misfits} of {} misfits", found.len());
    assert!(misfits as f64 <= 0.05 * found.len() as f64);
    let wear: Vec<bool> = found.iter().map(|found| contains(found.wear_per_cycle.interval, -1e-4)).collect();
    assert_covered("wear of a rig that warms up", &wear);
}

#[test]
fn allan_deviation_of_white_noise_falls_and_of_a_random_walk_rises_as_the_root_of_time() {
    let count = 1 << 12;
    let squares = |is_walk: bool| -> Vec<(f64, f64)> {
        let found = draws(|draw| {
            let white: Vec<f64> = normal(*draw, "allan").take(count).collect();
            let mut sum = 0.0;
            let walk = white.iter().map(|step| {
                sum += step;
                sum
            });
            let values: Vec<f64> = if is_walk { walk.collect() } else { white };
            let is_near = |noise: f64| is_walk || (noise - 1.0).abs() < 0.1;
            assert!(is_near(noise_sd(&values).unwrap()));
            allan_deviation(INTERVAL_S, &values)
        });
        let mean = |i: usize| found.iter().map(|points| points[i].deviation.powi(2)).sum::<f64>() / found.len() as f64;
        (0..found[0].len()).map(|i| (found[0][i].tau_s / INTERVAL_S, mean(i))).collect()
    };
    for is_walk in [false, true] {
        for (n, square) in squares(is_walk) {
            // a walk of steps of sd 1 has n / 3 + 1 / (6 n) as its variance
            let truth = if is_walk { n / 3.0 + 1.0 / (6.0 * n) } else { 1.0 / n };
            // relative sd of the mean variance: about 2 n readings make one independent pair
            let draws = campaign::size(DRAWS.0, DRAWS.1) as f64;
            let sd = (4.0 * n / count as f64 / draws).sqrt();
            println!("walk {is_walk}, mean of {n}: {:.2} % off", 100.0 * (square / truth - 1.0));
            assert!((square / truth - 1.0).abs() < 5.0 * sd + 0.002, "{is_walk} {n}: {square} {truth} {sd}");
        }
    }
}

/// Values of a zero that follows a temperature and drifts, with white noise: one each 30 s.
fn warmed(count: usize, temperature_c: impl Fn(f64) -> f64, per_c: f64, draw: u64) -> Vec<TemperaturePoint> {
    let point = |(i, normal): (usize, f64)| {
        let t_s = 30.0 * i as f64;
        let temperature_c = temperature_c(t_s);
        let value = 0.4 + per_c * temperature_c - 1e-5 * t_s + NOISE * normal;
        TemperaturePoint { t_s, temperature_c, value }
    };
    normal(draw, "temperature").take(count).enumerate().map(point).collect()
}

#[test]
fn temperature_coefficients_are_as_near_as_their_values_allow() {
    const PER_C: f64 = 0.02;
    // a room that is heated every 40 minutes and becomes warmer
    let room_c = |t_s: f64| 22.0 + 1.5 * (t_s / 382.0).sin() + t_s / 7200.0;
    let found = draws(|draw| temperature_coefficient(&warmed(240, room_c, PER_C, *draw)).unwrap());
    let covered: Vec<bool> = found.iter().map(|found| contains(found.per_c.interval, PER_C)).collect();
    assert_covered("temperature coefficient", &covered);
    let error = root_mean_square(found.iter().map(|found| found.per_c.value / PER_C - 1.0));
    // for a sine without a trend: sd of the noise over the root of the sum of squares
    let bound = NOISE / (1.5 * (240.0f64 / 2.0).sqrt()) / PER_C;
    println!("temperature coefficient: rms error {:.2} %, bound {:.2} %", 100.0 * error, 100.0 * bound);
    assert!(error < ERROR_MOST && error < OF_BOUND_MOST * bound);
}

#[test]
fn temperature_that_follows_the_time_shows_no_coefficient() {
    let rising = warmed(240, |t_s| 22.0 + t_s / 3600.0, 0.02, 1);
    assert_eq!(temperature_coefficient(&rising), Err(OverTimeError::Singular));
    let constant = warmed(240, |_| 22.0, 0.02, 1);
    assert_eq!(temperature_coefficient(&constant), Err(OverTimeError::Singular));
    assert_eq!(temperature_coefficient(&constant[..7]), Err(OverTimeError::TooFew { readings: 7, needed: 8 }));
}
