use super::*;
use palpate_core::quantity::stream;
use rand::distr::Distribution as _;
use rand_distr::StandardNormal;

/// Independent normal numbers with sd 1, always the same ones for a name.
pub(super) fn normal(count: usize, name: &str) -> Vec<f64> {
    StandardNormal.sample_iter(stream(1, 0, name)).take(count).collect()
}

fn times(count: usize, interval_s: f64) -> Vec<f64> {
    (0..count).map(|i| 7.0 + interval_s * i as f64).collect()
}

/// A final value of 1 and terms, amplitude and time, with noise.
fn relaxing(t_s: &[f64], terms: &[(f64, f64)], noise: f64, name: &str) -> Vec<f64> {
    let value = |t: f64| 1.0 + terms.iter().map(|(amplitude, time_s)| amplitude * (-t / time_s).exp()).sum::<f64>();
    t_s.iter().zip(normal(t_s.len(), name)).map(|(t, normal)| value(t - t_s[0]) + noise * normal).collect()
}

#[test]
fn two_time_constants_are_found_with_their_amplitudes() {
    let t_s = times(12_000, 0.01);
    let found = relaxation(&t_s, &relaxing(&t_s, &[(0.1, 30.0), (-0.05, 1.0)], 0.005, "two")).unwrap();
    let [short, long] = found.terms[..] else { panic!("{found:?}") };
    assert!((short.time_s - 1.0).abs() < 0.1 && (long.time_s - 30.0).abs() < 1.0, "{found:?}");
    assert!((short.amplitude + 0.05).abs() < 0.004 && (long.amplitude - 0.1).abs() < 0.002, "{found:?}");
    assert!(short.time_interval_s[0] < 1.0 && 1.0 < short.time_interval_s[1] && !found.undetermined, "{found:?}");
    assert!((found.final_value - 1.0).abs() < 0.002 && (found.residual_sd / 0.005 - 1.0).abs() < 0.03, "{found:?}");
    assert!(found.readings == 12_000 && (found.span_s - 119.99).abs() < 1e-9, "{found:?}");
}

#[test]
fn without_noise_the_bins_cause_no_error() {
    let t_s = times(20_000, 0.01);
    let found = relaxation(&t_s, &relaxing(&t_s, &[(0.2, 2.0), (0.1, 50.0)], 0.0, "none")).unwrap();
    let [short, long] = found.terms[..] else { panic!("{found:?}") };
    assert!((short.time_s / 2.0 - 1.0).abs() < 1e-6 && (long.time_s / 50.0 - 1.0).abs() < 1e-6, "{found:?}");
}

#[test]
fn what_is_not_determined_is_left_out_and_stated() {
    let t_s = times(2000, 0.01);
    // a second term that is 20 times as slow as the span is long
    let slow = relaxation(&t_s, &relaxing(&t_s, &[(0.1, 1.0), (1.0, 400.0)], 0.005, "slow")).unwrap();
    assert!(slow.terms.len() == 1 && slow.undetermined, "{slow:?}");
    assert!((slow.terms[0].time_s - 1.0).abs() < 0.1, "{slow:?}");
    // the value at the last reading is known although the final one isn't
    assert!((slow.final_value - 1.0 - (-20f64 / 400.0).exp()).abs() < 0.005, "{slow:?}");
    for (terms, name) in [(&[][..], "white"), (&[(0.0005, 1.0)], "too small")] {
        let found = relaxation(&t_s, &relaxing(&t_s, terms, 0.005, name)).unwrap();
        assert!(found.terms.is_empty() && !found.undetermined, "{found:?}");
    }
    let constant = relaxation(&t_s, &[0.1; 2000]).unwrap();
    assert!(constant.terms.is_empty() && !constant.undetermined, "{constant:?}");
    // a small second term near the first one: its interval reaches from 1 s to 7 s
    let near = relaxation(&t_s, &relaxing(&t_s, &[(0.1, 1.0), (0.02, 2.0)], 0.003, "b")).unwrap();
    assert!(near.terms.len() == 1 && near.undetermined, "{near:?}");
    // gone before the second reading
    let mut first = relaxing(&t_s, &[], 0.005, "first");
    first[0] += 1.0;
    let found = relaxation(&t_s, &first).unwrap();
    assert!(found.terms.is_empty() && found.undetermined, "{found:?}");
}

#[test]
fn the_bound_is_that_of_a_known_case_and_infinite_where_nothing_is_known() {
    let bound = |t_s: &[f64], terms: &[(f64, f64)]| {
        let terms: Vec<PlannedTerm> =
            terms.iter().map(|(amplitude, time_s)| PlannedTerm { amplitude: *amplitude, time_s: *time_s }).collect();
        relaxation_bound(t_s, 0.005, &terms)
    };
    // readings for many time constants: the final value is known, and integrals of x^n exp(-2 x) give sqrt(8 dt / time)
    let sd = bound(&times(100_000, 0.01), &[(0.1, 1.0)])[0];
    assert!((sd / (0.05 * 0.08f64.sqrt()) - 1.0).abs() < 0.02, "{sd}");
    let both = bound(&times(12_000, 0.01), &[(0.1, 30.0), (0.1, 1.0)]);
    assert!(both[0] < 0.01 && both[1] < 0.03, "{both:?}");
    assert!(bound(&times(1000, 0.01), &[(0.1, 1000.0)])[0] > 1.0);
    for (t_s, terms) in [
        (times(100, 0.01), vec![(0.1, 1.0), (0.1, 1.0)]),
        (times(100, 0.01), vec![(0.0, 1.0)]),
        (times(100, 0.01), vec![(0.1, 1.0); 3]),
        (times(2, 0.01), vec![(0.1, 1.0)]),
        (vec![], vec![(0.1, 1.0)]),
    ] {
        assert_eq!(bound(&t_s, &terms), vec![f64::INFINITY; terms.len()], "{terms:?}");
    }
}

#[test]
fn readings_that_cannot_be_used_are_refused() {
    let t_s = times(20, 1.0);
    let value = |reading: usize, value: f64| {
        let mut values = vec![1.0; 20];
        values[reading] = value;
        values
    };
    assert_eq!(relaxation(&t_s, &[1.0; 3]), Err(OverTimeError::Reading { reading: 3 }));
    assert_eq!(relaxation(&t_s[..9], &[1.0; 9]), Err(OverTimeError::TooFew { readings: 9, needed: 10 }));
    assert_eq!(relaxation(&t_s, &value(4, f64::NAN)), Err(OverTimeError::Reading { reading: 4 }));
    assert_eq!(relaxation(&value(2, 1.0), &t_s), Err(OverTimeError::Reading { reading: 1 }));
}

/// Presses at the worn place with a reference after every tenth one, 6 s apart. The drift is a function of the hours.
fn pressed(wear: f64, drift: impl Fn(f64) -> f64, noise: f64) -> Vec<CyclePoint> {
    let point = |(i, normal): (usize, f64)| {
        let (t_s, is_reference) = (6.0 * i as f64, i % 11 == 10);
        let cycle = (i - i / 11) as f64;
        let log_gain = if is_reference { 0.3 } else { 0.1 + wear * cycle } + drift(t_s / 3600.0) + noise * normal;
        CyclePoint { cycle, t_s, log_gain, is_reference }
    };
    normal(550, "wear").into_iter().enumerate().map(point).collect()
}

fn contains(estimate: Estimate, truth: f64) -> bool {
    let [from, to] = estimate.interval;
    from < truth && truth < to && from < estimate.value && estimate.value < to
}

#[test]
fn wear_is_separated_from_the_drift_of_the_rig() {
    let mut points = pressed(-1e-4, |hours| -0.02 * hours, 0.002);
    let found = wear(&points).unwrap();
    assert!(found.is_separate && found.fits, "{found:?}");
    assert!(contains(found.wear_per_cycle, -1e-4) && contains(found.drift_per_h.unwrap(), -0.02), "{found:?}");
    assert!((found.residual_sd / 0.002 - 1.0).abs() < 0.1 && found.references == 50, "{found:?}");
    points.reverse();
    let reversed = wear(&points).unwrap();
    assert_eq!(reversed, found);
    // 500 presses take 0.92 h, so the drift is 3.7e-5 for each
    points.retain(|point| !point.is_reference);
    let mixed = wear(&points).unwrap();
    assert!(!mixed.is_separate && mixed.drift_per_h.is_none(), "{mixed:?}");
    assert!(contains(mixed.wear_per_cycle, -1e-4 - 0.02 * 6.6 / 3600.0), "{mixed:?}");
}

#[test]
fn references_that_scatter_more_make_the_wear_less_certain() {
    let width = |factor: f64| {
        let mut points = pressed(-1e-4, |_| 0.0, 0.002);
        let scatter = |point: &mut CyclePoint| point.log_gain *= factor;
        points.iter_mut().filter(|point| point.is_reference).for_each(scatter);
        let Estimate { interval: [least, most], .. } = wear(&points).unwrap().wear_per_cycle;
        assert!(least < -1e-4 && -1e-4 < most, "{least} {most}");
        most - least
    };
    assert!(width(10.0) > 3.0 * width(1.0));
}

#[test]
fn references_at_one_end_separate_nothing() {
    let mut points = pressed(-1e-4, |hours| -0.02 * hours, 0.002);
    points.retain(|point| !point.is_reference || point.t_s < 1000.0);
    let found = wear(&points).unwrap();
    assert!(!found.is_separate && found.references == 15 && found.presses == 500, "{found:?}");
}

#[test]
fn a_bent_drift_is_followed_and_wear_that_stops_is_reported() {
    let found = wear(&pressed(-1e-4, |hours| 0.05 * (-hours / 0.2).exp(), 0.002)).unwrap();
    assert!(found.fits && contains(found.wear_per_cycle, -1e-4), "{found:?}");
    let mut points = pressed(-2e-4, |hours| -0.02 * hours, 0.002);
    points.iter_mut().filter(|point| !point.is_reference).for_each(|point| {
        point.log_gain += 2e-4 * (point.cycle - 100.0).max(0.0); // the wear stops at 100 cycles
    });
    let found = wear(&points).unwrap();
    assert!(!found.fits, "{found:?}");
}

#[test]
fn presses_that_show_no_wear_are_refused() {
    let mut points = pressed(0.0, |_| 0.0, 0.002);
    assert_eq!(wear(&points[..4]), Err(OverTimeError::TooFew { readings: 4, needed: 5 }));
    points.iter_mut().for_each(|point| point.cycle = 5.0);
    assert_eq!(wear(&points), Err(OverTimeError::Singular));
    points.iter_mut().for_each(|point| point.cycle = 0.0);
    assert_eq!(wear(&points), Err(OverTimeError::Singular));
    points[7].log_gain = f64::NEG_INFINITY;
    assert_eq!(wear(&points), Err(OverTimeError::Reading { reading: 7 }));
}
