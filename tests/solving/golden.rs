//! Golden values of an independent program: the correlations of the paper's Figures 3 to 5, and a whole evaluation without noise.

use palpate_core::mechanics::lambda;
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_solver::{Calibration, CalibrationPoint, Evaluation, Setting, TestPress, correlation, evaluate, fit};

/// A row of `golden/correlation.csv`: r of loads at d1 and d2 over a line of n units of spacing s, all in depths; `null` where r is 0/0.
const CORRELATIONS: &str = include_str!("../golden/correlation.csv");

#[test]
fn correlations_of_figures_4_and_5() {
    let mut reader = csv::Reader::from_reader(CORRELATIONS.as_bytes());
    let mut rows = 0;
    for row in reader.deserialize::<(usize, f64, f64, f64, String)>() {
        let (n, s, d1, d2, golden) = row.unwrap();
        let line = |d: f64| (0..n).map(|i| lambda(i as f64 * s - d)).collect::<Vec<f64>>();
        let r = correlation(&line(d1), &line(d2));
        match golden.as_str() {
            "null" => assert_eq!(r, None, "n {n}, s {s}, d {d1} {d2}"),
            golden => {
                let golden: f64 = golden.parse().unwrap();
                assert!((r.unwrap() - golden).abs() < 1e-9, "n {n}, s {s}, d {d1} {d2}: {r:?} instead of {golden}");
            }
        }
        rows += 1;
    }
    assert_eq!(rows, 169, "rows of the golden file");
}

#[test]
fn the_papers_solver_end_to_end() {
    let evaluation = end_to_end("pearson");
    let force = evaluation.force_error_n.unwrap();
    assert_near(evaluation.location_error_mm.mean, 0.207937677);
    assert!((evaluation.location_error_mm.max - 0.511031).abs() < 1e-6);
    assert_near(force.mean, 0.019258730);
    let within = &evaluation.within;
    assert_eq!((within.location_1mm, within.force_0_1n, within.both), (1.0, Some(1.0), Some(1.0)));
    for (press, (x_mm, y_mm, force_n)) in evaluation.presses.iter().zip([
        (3.0, 1.0, 0.68432694),
        (0.0, -4.5, 0.31106763),
        (-3.0, 2.5, 0.83484008),
        (-5.5, -2.5, 0.52345662),
        (3.5, 4.0, 0.17602072),
    ]) {
        assert_eq!(press.place_solved, Place::new(x_mm, y_mm));
        assert_near(press.force_solved_n, force_n);
    }
}

#[test]
fn least_squares_over_all_units_end_to_end() {
    let evaluation = end_to_end("pearson-lsq");
    assert_near(evaluation.location_error_mm.mean, 0.207937677);
    assert_near(evaluation.force_error_n.unwrap().mean, 0.010445463);
}

/// The paper's array under a half-space, 1 N at 25 x 25 points (y outer, x inner), 100 deterministic contacts; no noise.
fn end_to_end(solver: &str) -> Evaluation {
    let layout = ArrayLayout::grid(3, 3, 4.5);
    let outputs = |place: Place, force_n: f64| -> Vec<f64> {
        layout.places().iter().map(|unit| force_n * lambda(place.distance_mm(*unit) / 5.0)).collect()
    };
    let at = |index: usize| -6.0 + 0.5 * index as f64;
    let grid: Vec<(Place, Vec<f64>)> = (0..625)
        .map(|index| Place::new(at(index % 25), at(index / 25)))
        .map(|place| (place, outputs(place, 1.0)))
        .collect();
    let points: Vec<CalibrationPoint<'_>> =
        grid.iter().map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
    let contacts: Vec<(Place, f64, Vec<f64>)> = (1..=100)
        .map(|i| {
            let fraction = |step: f64| (step * f64::from(i)).fract();
            let place = Place::new(-6.0 + 12.0 * fraction(0.754877666), -6.0 + 12.0 * fraction(0.569840291));
            let force_n = 0.1 + 0.9 * fraction(0.618033989);
            (place, force_n, outputs(place, force_n))
        })
        .collect();
    let test: Vec<TestPress<'_>> = contacts
        .iter()
        .map(|(place, force_n, outputs)| TestPress { place: *place, force_n: Some(*force_n), depth_mm: None, outputs })
        .collect();
    let solver = fit(solver, &Calibration::new(&points).unwrap(), &Setting::of_layout(Some(&layout))).unwrap();
    evaluate(&solver, &test).unwrap()
}

fn assert_near(found: f64, golden: f64) {
    assert!((found - golden).abs() < 1e-8, "{found} instead of {golden}");
}
