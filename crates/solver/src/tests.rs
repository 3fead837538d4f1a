//! Input that says little or nothing: every method answers with an error or a verdict, never NaN, never a panic.

use super::*;
use palpate_core::mechanics::{Passage, TaxelResponse};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::ArrayLayout;
use proptest::prelude::*;

fn points<'a>(rows: &'a [(f64, f64, f64, Vec<f64>)]) -> Vec<CalibrationPoint<'a>> {
    let point = |(x_mm, y_mm, force_n, outputs): &'a (f64, f64, f64, Vec<f64>)| CalibrationPoint {
        place: Place::new(*x_mm, *y_mm),
        force_n: *force_n,
        outputs,
    };
    rows.iter().map(point).collect()
}

/// Fits every method to a calibration and solves every reading: every answer is a number, or an error with its reason.
fn assert_sane(rows: &[(f64, f64, f64, Vec<f64>)], readings: &[Vec<f64>]) {
    let calibrations = [Calibration::new(&points(rows)).unwrap(), Calibration::without_forces(&points(rows)).unwrap()];
    let of_load = |load| [false, true].map(|common_offset| Setting { load, common_offset, ..Setting::default() });
    let settings = [ForceKnown::Unknown, ForceKnown::Constant].map(of_load).concat();
    let fits: Vec<_> = calibrations.iter().flat_map(|all| settings.iter().map(move |setting| (all, setting))).collect();
    in_parallel(&fits, |(calibration, setting)| {
        for name in SOLVERS.into_iter().chain([BEST]) {
            let Ok(fitted) = fit(name, calibration, setting) else { continue };
            let mut workspace = Workspace::default();
            for reading in readings {
                if let Ok(solution) = fitted.solve(reading, &mut workspace) {
                    assert_finite(&solution, name, reading);
                }
            }
        }
    });
}

fn assert_finite(solution: &Solution, name: &str, reading: &[f64]) {
    let place = solution.place;
    let text = [place.x_mm, place.y_mm, solution.force_n];
    assert!(text.iter().all(|value| value.is_finite()), "{name}: {solution:?} of {reading:?}");
    assert!(solution.misfit.is_none_or(f64::is_finite), "{name}: {solution:?} of {reading:?}");
    if let Some(sd) = solution.covariance {
        let sds = [sd.x_mm(), sd.y_mm(), sd.force_n()];
        assert!(sds.iter().all(|sd| sd.is_finite() && *sd >= 0.0), "{name}: {solution:?} of {reading:?}");
    }
}

/// Returns the output of a unit at one place for 1 N at another place.
fn output(x_mm: f64, y_mm: f64, at_mm: (f64, f64)) -> f64 {
    (1.0 + (x_mm - at_mm.0).powi(2) / 9.0 + (y_mm - at_mm.1).powi(2) / 9.0).powf(-2.5)
}

const UNITS: [(f64, f64); 3] = [(-2.0, 0.0), (2.0, 0.0), (0.0, 2.0)];

fn row(x_mm: f64, y_mm: f64, units: usize) -> (f64, f64, f64, Vec<f64>) {
    (x_mm, y_mm, 1.0, UNITS[..units].iter().map(|unit| output(x_mm, y_mm, *unit)).collect())
}

fn grid(side: i32, units: usize) -> Vec<(f64, f64, f64, Vec<f64>)> {
    (0..side * side).map(|i| row(f64::from(i % side) - 2.0, f64::from(i / side) - 2.0, units)).collect()
}

#[test]
fn uninformative_readings() {
    let readings = [
        vec![0.0, 0.0, 0.0],
        vec![0.3, 0.3, 0.3],
        vec![-1.0, -1.0, -1.0],
        vec![1e-300, 0.0, 0.0],
        vec![1e300, -1e300, 1e300],
        vec![f64::NAN, 0.0, 0.0],
        vec![f64::INFINITY, 0.0, 0.0],
    ];
    assert_sane(&grid(5, 3), &readings);
}

#[test]
fn uninformative_calibrations() {
    let readings = [vec![0.4, 0.2, 0.1], vec![0.0, 0.0, 0.0], vec![0.3, 0.3, 0.3]];
    assert_sane(&[row(0.0, 0.0, 3)], &readings); // one point
    assert_sane(&[row(0.0, 0.0, 3), row(1.0, 0.0, 3)], &readings);
    assert_sane(&vec![row(0.0, 0.0, 3); 30], &readings); // one place, thirty times
    assert_sane(&(0..30).map(|i| row(f64::from(i) / 10.0, 0.0, 3)).collect::<Vec<_>>(), &readings); // on a line
    assert_sane(&(0..30).map(|i| row(f64::from(i) / 10.0, f64::from(i) / 10.0, 3)).collect::<Vec<_>>(), &readings);
    let twice: Vec<_> = grid(5, 3).into_iter().flat_map(|row| [row.clone(), row]).collect();
    assert_sane(&twice, &readings);
    let flat: Vec<_> = grid(5, 3).into_iter().map(|(x, y, force_n, _)| (x, y, force_n, vec![0.3; 3])).collect();
    assert_sane(&flat, &readings);
    let silent: Vec<_> = grid(5, 3).into_iter().map(|(x, y, force_n, _)| (x, y, force_n, vec![0.0; 3])).collect();
    assert_sane(&silent, &readings);
}

#[test]
fn arrays_of_one_and_two_units() {
    assert_sane(&grid(5, 2), &[vec![0.4, 0.2], vec![0.2, 0.2], vec![0.0, 0.0]]);
    assert_sane(&grid(5, 1), &[vec![0.4], vec![0.0]]);
}

#[test]
fn output_dead_in_calibration_is_ignored() {
    let mut rows = grid(6, 3);
    rows.iter_mut().for_each(|row| row.3.insert(1, 0.7));
    let (whole, with_dead) = (grid(6, 3), rows);
    for name in SOLVERS {
        let setting = Setting::default();
        let reference = fit(name, &Calibration::new(&points(&whole)).unwrap(), &setting).unwrap();
        let fitted = fit(name, &Calibration::new(&points(&with_dead)).unwrap(), &setting).unwrap();
        assert_eq!(fitted.broken(), [Broken { unit: 1, fault: OutputFault::Dead }]);
        let (mut a, mut b) = (Workspace::default(), Workspace::default());
        let expected = reference.solve(&[0.4, 0.2, 0.1], &mut a).unwrap();
        assert_eq!(fitted.solve(&[0.4, f64::NAN, 0.2, 0.1], &mut b).unwrap(), expected, "{name}");
    }
}

fn calibration() -> Calibration {
    let places = (0..16).map(|i| Place::new(f64::from(i % 4), f64::from(i / 4)));
    let output = |place: Place, x_mm: f64| (-0.2 * place.distance_mm(Place::new(x_mm, 1.0)).powi(2)).exp();
    let rows: Vec<_> = places.map(|place| (place, [0.0, 1.5, 3.0].map(|x_mm| output(place, x_mm)))).collect();
    let points = rows.iter().map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs });
    Calibration::new(&points.collect::<Vec<_>>()).unwrap()
}

#[test]
fn every_listed_solver_can_be_fitted_and_answers_to_its_name() {
    for name in SOLVERS {
        assert_eq!(fit(name, &calibration(), &Setting::default()).unwrap().name(), name);
    }
}

#[test]
fn an_unknown_name_and_a_foreign_layout_are_refused() {
    let refusal = fit("person", &calibration(), &Setting::default()).err().unwrap();
    assert!(refusal.to_string().contains("pearson-lsq"), "{refusal}");
    let layout = ArrayLayout::grid(3, 3, 4.5);
    let refusal = fit("pearson", &calibration(), &Setting::of_layout(Some(&layout))).err().unwrap();
    assert_eq!(refusal, FitError::Layout { layout: 9, calibration: 3 });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]
    #[test]
    fn every_calibration_and_reading_gives_a_number_or_an_error(
        rows in prop::collection::vec((-5.0..5.0f64, -5.0..5.0f64, 0.1..2.0f64, prop::collection::vec(-1.0..1.0f64, 3)), 1..40),
        readings in prop::collection::vec(prop::collection::vec(prop::num::f64::ANY, 3), 4),
    ) {
        assert_sane(&rows, &readings);
    }
}

#[test]
fn answers_are_the_same_without_stated_errors() {
    let rows = grid(5, 3);
    let calibration = Calibration::new(&points(&rows)).unwrap();
    let readings = [row(0.3, -0.8, 3), row(-1.7, 1.1, 3)];
    for name in SOLVERS {
        let solved = |appraised: bool| {
            let fitted = fit(name, &calibration, &Setting { appraised, ..Setting::default() }).unwrap();
            let solve = |(.., outputs): &(f64, f64, f64, Vec<f64>)| fitted.solve(outputs, &mut Workspace::default());
            readings.iter().map(|reading| solve(reading).unwrap()).collect::<Vec<Solution>>()
        };
        for (with, without) in solved(true).iter().zip(solved(false)) {
            assert_eq!((with.place, with.force_n), (without.place, without.force_n), "{name}");
            let has_map = matches!(name, "surrogate" | "physics");
            assert_eq!(without.covariance.is_some(), has_map, "{name}");
        }
    }
}

/// What units of three channels read of a force: the stress, and its slopes along x and y times the depth.
fn of_three_channels(units: &ArrayLayout, place: Place, force_n: f64) -> Vec<f64> {
    let response = TaxelResponse::new(Passage::half_space(5.0));
    let read = |unit: &Place| {
        let distance_mm = place.distance_mm(*unit);
        let (value, slope) = response.with_slope(distance_mm);
        let along = |mm: f64| if distance_mm == 0.0 { 0.0 } else { 5.0 * slope * mm / distance_mm };
        [value, along(place.x_mm - unit.x_mm), along(place.y_mm - unit.y_mm)].map(|output| force_n * output)
    };
    units.places().iter().flat_map(read).collect()
}

#[test]
fn every_solver_finds_a_contact_on_units_of_three_channels() {
    let units = ArrayLayout::grid(3, 3, 4.5);
    let layout = units.clone().with_channels(3);
    let rows: Vec<(f64, f64, f64, Vec<f64>)> = (0..81)
        .map(|n| {
            let place = Place::new(f64::from(n % 9) - 4.0, f64::from(n / 9) - 4.0);
            (place.x_mm, place.y_mm, 1.0, of_three_channels(&units, place, 1.0))
        })
        .collect();
    let calibration = Calibration::new(&points(&rows)).unwrap();
    for name in SOLVERS {
        let fitted = fit(name, &calibration, &Setting::of_layout(Some(&layout))).unwrap();
        for (place, force_n) in [(Place::new(0.4, -2.3), 0.7), (Place::new(-3.2, 2.7), 0.4)] {
            let found = fitted.solve(&of_three_channels(&units, place, force_n), &mut Workspace::default()).unwrap();
            let apart_mm = found.place.distance_mm(place);
            assert!(apart_mm < 0.75, "{name}: {apart_mm} mm");
            assert!((found.force_n / force_n - 1.0).abs() < 0.2, "{name}: {} N of {force_n} N", found.force_n);
        }
    }
}
