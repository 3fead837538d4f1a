//! A solver with a used workspace allocates nothing: neither time nor memory depends on an allocator.

use crate::HEAP;
use palpate_core::mechanics::lambda;
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_solver::{Calibration, CalibrationPoint, SOLVERS, Setting, Solver, Workspace, fit};
use palpate_testing::alone::ran_alone;

#[test]
fn a_solve_allocates_nothing() {
    if ran_alone("allocations::a_solve_allocates_nothing") {
        return;
    }
    let layout = ArrayLayout::grid(3, 3, 4.5);
    let outputs = |place: Place| -> Vec<f64> {
        layout.places().iter().map(|unit| lambda(place.distance_mm(*unit) / 5.0)).collect()
    };
    let places = (0..169).map(|index| Place::new(f64::from(index % 13) - 6.0, f64::from(index / 13) - 6.0));
    let rows: Vec<(Place, Vec<f64>)> = places.map(|place| (place, outputs(place))).collect();
    let points: Vec<CalibrationPoint<'_>> =
        rows.iter().map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
    let calibration = Calibration::new(&points).unwrap();
    let readings: Vec<Vec<f64>> = (0..50).map(|i| outputs(Place::new(0.1 * f64::from(i) - 2.0, 1.3))).collect();

    for solver in SOLVERS.map(|name| fit(name, &calibration, &Setting::default()).unwrap()) {
        let mut workspace = Workspace::default();
        solver.solve(&readings[0], &mut workspace).unwrap();
        let before = HEAP.total_allocated();
        for reading in &readings {
            solver.solve(reading, &mut workspace).unwrap();
        }
        assert_eq!(HEAP.total_allocated() - before, 0, "bytes allocated by {}", solver.name());
    }
}
