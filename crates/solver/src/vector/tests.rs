use super::*;
use palpate_core::mechanics::traction;
use palpate_core::quantity::stream;
use rand::distr::Distribution;
use rand_distr::StandardNormal;

/// Outputs per newton along x, y and into the specimen: nine taxels of three axes, 5 mm deep.
fn columns(place: Place) -> Vec<f64> {
    let mut columns = [vec![], vec![], vec![]];
    for unit in 0..9 {
        let at = [4.5 * f64::from(unit % 3) - 4.5 - place.x_mm, 4.5 * f64::from(unit / 3) - 4.5 - place.y_mm];
        let traction = traction([at[0], at[1], 5.0]);
        for row in [2, 0, 1] {
            columns.iter_mut().zip(traction[row]).for_each(|(column, value)| column.push(value));
        }
    }
    columns.concat()
}

fn read(place: Place, force_n: [f64; 3]) -> Vec<f64> {
    let columns = columns(place);
    (0..27).map(|i| (0..3).map(|axis| force_n[axis] * columns[27 * axis + i]).sum()).collect()
}

fn known() -> VectorMap {
    VectorMap::known([Place::new(-6.0, -6.0), Place::new(6.0, 6.0)], 0.3, &[0.01; 27], columns)
}

fn solve(map: &VectorMap, outputs: &[f64]) -> VectorContact {
    map.solve(outputs, &mut VectorWorkspace::default()).unwrap()
}

const CONTACTS: [(Place, [f64; 3]); 4] = [
    (Place { x_mm: 0.3, y_mm: -1.1 }, [0.1, -0.2, 0.5]),
    (Place { x_mm: -4.2, y_mm: 3.7 }, [-0.4, 0.1, 0.9]),
    (Place { x_mm: 5.5, y_mm: 5.1 }, [0.3, 0.3, 1.0]),
    (Place { x_mm: 1.8, y_mm: 2.6 }, [0.0, 0.0, 0.4]),
];

#[test]
fn a_reading_without_noise_gives_its_contact_back() {
    for (place, force_n) in CONTACTS {
        let contact = solve(&known(), &read(place, force_n));
        let Shear::Force(shear_n) = contact.shear else { panic!("{contact:?}") };
        let off_n = [shear_n[0] - force_n[0], shear_n[1] - force_n[1], contact.press_n - force_n[2]];
        assert!(contact.place.distance_mm(place) < 2e-3, "{contact:?}");
        assert!(off_n.iter().all(|off_n| off_n.abs() < 1e-3), "{contact:?}");
        assert!(contact.misfit < 1e-3);
    }
}

/// Boussinesq's and Cerruti's array at noise of 0.01: the bound from the same information by an independent sum.
#[test]
fn a_bound_is_the_inverse_of_its_information() {
    let (place, force_n) = CONTACTS[0];
    let at = |x: f64, y: f64| read(Place::new(place.x_mm + x, place.y_mm + y), force_n);
    let slope = |a: Vec<f64>, b: Vec<f64>| a.iter().zip(&b).map(|(a, b)| (a - b) / 2e-4).collect::<Vec<f64>>();
    let unit = |axis: usize| columns(place)[27 * axis..][..27].to_vec();
    let rows = [slope(at(1e-4, 0.0), at(-1e-4, 0.0)), slope(at(0.0, 1e-4), at(0.0, -1e-4)), unit(0), unit(1), unit(2)];
    let VectorCovariance(bound) = known().bound(place, force_n).unwrap();
    for (i, j) in (0..25).map(|at| (at / 5, at % 5)) {
        let information = |row: &Vec<f64>| rows[i].iter().zip(row).map(|(a, b)| a * b / 1e-4).sum::<f64>();
        let product: f64 = rows.iter().zip(&bound).map(|(row, bound)| information(row) * bound[j]).sum();
        assert!((product - f64::from(u8::from(i == j))).abs() < 0.02, "({i}, {j}): {product}");
    }
}

#[test]
fn the_force_scales_with_the_reading_and_the_place_stays() {
    for (place, force_n) in CONTACTS {
        let outputs = read(place, force_n);
        let once = solve(&known(), &outputs);
        let twice = solve(&known(), &outputs.iter().map(|output| 2.0 * output).collect::<Vec<f64>>());
        assert!(once.place.distance_mm(twice.place) < 2e-3);
        assert!((twice.press_n - 2.0 * once.press_n).abs() < 2e-3);
        assert_eq!(once, solve(&known(), &outputs), "the same twice");
    }
}

/// The map of presses and drags at this number of places along each side.
fn fitted(side: usize, noise_sd: f64) -> VectorMap {
    let mut rng = stream(1, 0, "noise of the presses");
    let at = |i: usize| -6.0 + 12.0 * i as f64 / (side - 1) as f64;
    let mut presses = Vec::new();
    for place in (0..side * side).map(|i| Place::new(at(i % side), at(i / side))) {
        for force_n in [[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.0, 0.5, 1.1], [-0.4, -0.4, 0.9]] {
            let mut noise =
                |sd: f64| -> f64 { sd * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng) };
            let outputs: Vec<f64> = read(place, force_n).iter().map(|output| output + noise(noise_sd)).collect();
            presses.push((place, force_n, outputs));
        }
    }
    let rows: Vec<VectorRow<'_>> = presses
        .iter()
        .map(|(place, force_n, outputs)| VectorRow { place: *place, force_n: *force_n, outputs })
        .collect();
    VectorMap::fit(&VectorCalibration::new(&rows).unwrap()).unwrap()
}

#[test]
fn a_map_of_few_places_is_sparse() {
    assert!(fitted(5, 1e-2).is_sparse() && !fitted(9, 1e-2).is_sparse());
}

/// Between the last two lines of places the map is at least as uncertain as in the middle.
#[test]
fn the_error_of_the_map_does_not_vanish_near_the_border() {
    let map = fitted(9, 1e-3);
    let error = |x_mm: f64, y_mm: f64| {
        let mut error = vec![0.0; 27];
        map.axes[PRESS].as_ref().unwrap().error(Place::new(x_mm, y_mm), &mut error);
        error.iter().sum::<f64>()
    };
    for along in (0..25).map(|i| -6.0 + 0.5 * f64::from(i)) {
        for near in [error(along, 5.25), error(-5.25, along)] {
            assert!(near > 0.9 * error(0.75, 0.75), "{along}: {near} {}", error(0.75, 0.75));
        }
    }
}

#[test]
fn a_map_from_presses_and_drags_is_the_true_one() {
    let map = fitted(9, 0.0);
    assert!(map.knows_shear());
    for (place, force_n) in CONTACTS {
        let contact = solve(&map, &read(place, force_n));
        let Shear::Force(shear_n) = contact.shear else { panic!("{contact:?}") };
        assert!(contact.place.distance_mm(place) < 0.02, "{contact:?}");
        assert!((shear_n[0] - force_n[0]).hypot(shear_n[1] - force_n[1]) < 0.01, "{contact:?} {force_n:?}");
    }
}

#[test]
fn invalid_rows_and_readings_are_refused_by_name() {
    let row = |outputs: &'static [f64]| VectorRow { place: Place::default(), force_n: [0.0, 0.0, 1.0], outputs };
    let refused = |rows: &[VectorRow<'_>]| VectorCalibration::new(rows).map(|_| ()).unwrap_err();
    assert_eq!(refused(&[]), VectorError::NoPress);
    assert_eq!(refused(&[row(&[1.0, 2.0]), row(&[1.0])]), VectorError::Outputs { row: 2, found: 1, expected: 2 });
    assert_eq!(refused(&[row(&[1.0]), row(&[f64::NAN])]), VectorError::NotFinite { row: 2 });
    let unfit = |rows: &[VectorRow<'_>]| VectorMap::fit(&VectorCalibration::new(rows).unwrap()).unwrap_err();
    assert_eq!(unfit(&[row(&[1.0])]), VectorError::TooFewOutputs { outputs: 1 });
    assert_eq!(unfit(&[row(&[1.0; 3])]), VectorError::TooFewPlaces { places: 1, needed: 6 });
    let at = |i: i32| VectorRow { place: Place::new(f64::from(i), f64::from(2 * i)), ..row(&[1.0; 3]) };
    let on_a_line: Vec<VectorRow<'_>> = (0..9).map(at).collect();
    assert_eq!(unfit(&on_a_line), VectorError::TooFewPlaces { places: 9, needed: 6 });
    assert_eq!(unfit(&[VectorRow { force_n: [0.0, 0.0, -1.0], ..row(&[1.0; 3]) }]), VectorError::Pulls);
    let mut workspace = VectorWorkspace::default();
    assert!(known().solve(&[0.0; 3], &mut workspace).is_err());
    assert!(known().solve(&[f64::NAN; 27], &mut workspace).is_err());
    assert_eq!(
        known().solve(&[0.0; 27], &mut workspace).unwrap_err(),
        crate::SolveError::AllEqual,
        "nothing touches the array"
    );
    let pulled = read(CONTACTS[0].0, [0.0, 0.0, -1.0]);
    assert_eq!(known().solve(&pulled, &mut workspace).unwrap_err(), crate::SolveError::NoPress);
    let huge: Vec<f64> = pulled.iter().map(|output| -1e300 * output).collect();
    assert_eq!(known().solve(&huge, &mut workspace).unwrap_err(), crate::SolveError::OutOfProportion);
}

#[test]
fn verdicts_name_a_weak_signal_a_place_outside_and_a_missing_output() {
    let validity = crate::Validity {
        units: 27,
        presses: 0,
        places: 0,
        x_mm: [-6.0, 6.0],
        y_mm: [-6.0, 6.0],
        force_n: None,
        depth_mm: None,
    };
    let layout = palpate_core::quantity::ArrayLayout::grid(3, 3, 4.5).with_channels(3);
    let limits = crate::causes::Causes::new(known(), &layout).limits();
    let model = VectorModel { map: known(), layout, validity, limits };
    let copy = VectorModel::from_bytes(&model.to_bytes().unwrap()).unwrap();
    let mut session = VectorSession::new(std::sync::Arc::new(VectorFits::new(copy)));
    let place = Place::new(0.3, -1.1);
    let reading = read(place, [0.1, -0.2, 0.5]);
    assert_eq!(session.solve(&reading).unwrap().verdict, VectorVerdict::Ok);
    assert_eq!(session.solve(&read(place, [0.0, 0.0, 0.02])).unwrap().verdict, VectorVerdict::WeakSignal);
    // beyond the border a dead unit would explain much of the reading too
    for beyond_mm in [0.4, 1.0, 2.0, 4.0] {
        let outside = Place::new(6.0 + beyond_mm, 0.5);
        let verdict = session.solve(&read(outside, [0.0, 0.0, 0.9])).unwrap().verdict;
        assert_eq!(verdict, VectorVerdict::OutsideArea, "{beyond_mm} mm");
    }
    // three contacts aren't two
    let places = [Place::new(-5.0, -5.0), Place::new(5.0, -5.0), Place::new(0.0, 5.0)];
    let all = places.map(|place| read(place, [0.0, 0.0, 0.5]));
    let three: Vec<f64> = (0..27).map(|i| all.iter().map(|reading| reading[i]).sum()).collect();
    let solution = session.solve(&three).unwrap();
    assert!(solution.verdict == VectorVerdict::TwoNotSeparable && solution.misfit > 1.0, "{solution:?}");
    // both contacts of a pair keep their order
    let pair = |y_mm: f64| {
        let loads = [(Place::new(-3.0, y_mm), 0.5), (Place::new(3.0, -y_mm), 0.6)];
        let all = loads.map(|(place, force_n)| read(place, [0.0, 0.0, force_n]));
        (0..27).map(|i| all[0][i] + all[1][i]).collect::<Vec<f64>>()
    };
    let first = session.solve(&pair(0.5)).unwrap().pair.unwrap().places[0];
    for y_mm in [0.3, 0.1, -0.1, -0.3] {
        let next = session.solve(&pair(y_mm)).unwrap().pair.unwrap().places[0];
        assert!(next.distance_mm(first) < 1.5, "{y_mm}: {next:?} {first:?}");
    }
    // without one output of a unit, and without two whole units, of which another one doesn't read
    let without = |outputs: &[usize], reading: &[f64]| -> Vec<f64> {
        reading.iter().enumerate().map(|(i, value)| if outputs.contains(&i) { f64::NAN } else { *value }).collect()
    };
    let left = session.solve(&without(&[13], &reading)).unwrap();
    assert!(left.verdict == VectorVerdict::Ok && left.contact.place.distance_mm(place) < 2e-3, "{left:?}");
    let mut dead = read(place, [0.0, 0.0, 1.0]);
    dead[12..15].fill(0.0);
    let left = session.solve(&without(&[0, 1, 2, 3, 4, 5], &dead)).unwrap();
    assert!(left.verdict == VectorVerdict::UnitFault(4) && left.verdict.unit() == Some(5), "{left:?}");
    assert_eq!(session.solve(&[f64::NAN; 27]), Err(crate::Unanswered::NoOutputs));
    let most: Vec<usize> = (2..27).collect();
    assert_eq!(session.solve(&without(&most, &reading)), Err(crate::Unanswered::TooFewOutputs));
    assert!(matches!(session.solve(&[0.0]), Err(crate::Unanswered::Solve(_))));
}
