//! Weighted mean of the nearest calibration points.

use super::pearson::{check, direction};
use super::scan::{Hit, Scan, dot};
use super::{Calibration, FitError, Locate, Located, SolveError, Workspace};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Number of calibration points that an answer is averaged from: a cell of a grid has four corners.
pub const NEIGHBOURS: usize = 4;

/// The mean of the [`NEIGHBOURS`] calibration points that correlate best with the reading; fewer if the calibration has fewer.
/// The paper uses only the best point.
///
/// Each point is weighted by the inverse square of its distance (Shepard 1968, doi:10.1145/800186.810616). The distance is that
/// between the reading and the point's outputs, after both are centred and scaled to length 1. Its square is 2 (1 - r). The place
/// is the weighted mean of the points' places. The weighted mean of their outputs per newton is the expected reading of one newton
/// there. The force is the factor that fits this mean to the reading best over all units.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct PearsonKnn {
    units: usize,
    places: Vec<Place>,
    /// Outputs over force, 1/N, row-major points x units.
    per_newton: Vec<f64>,
    /// Outputs of the points, centred and of length 1. The dot product with these is r.
    scan: Scan,
}

impl PearsonKnn {
    /// Prepares the calibration's rows once. A point at which all units read the same correlates with nothing and is excluded.
    /// Returns an error if no point is left.
    pub(crate) fn fit(calibration: &Calibration) -> Result<Self, FitError> {
        let units = calibration.units();
        let (mut places, mut per_newton, mut directions) = (Vec::new(), Vec::new(), Vec::new());
        let mut room = Vec::new();
        for point in calibration.points() {
            if let Some(row) = direction(point.outputs, &mut room) {
                places.push(point.place);
                per_newton.extend(point.outputs.iter().map(|output| output / point.force_n));
                directions.extend_from_slice(row);
            }
        }
        if places.is_empty() {
            return Err(FitError::NothingToTellApart);
        }
        Ok(PearsonKnn { units, places, per_newton, scan: Scan::new(units, directions) })
    }

    /// Returns the weight of a neighbour among the neighbours. A distance below the rounding of r counts as this rounding. So an
    /// exactly matched point outweighs the others, and two such points have equal weights.
    fn weight(&self, neighbour: &Hit) -> f64 {
        let rounding = self.units as f64 * f64::EPSILON;
        1.0 / (1.0 - neighbour.score).max(rounding)
    }
}

impl Locate for PearsonKnn {
    fn name(&self) -> &'static str {
        "pearson-knn"
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Located, SolveError> {
        check(outputs, self.units)?;
        let Workspace { row, pattern, centred, scratch, .. } = workspace;
        let reading = direction(outputs, row).ok_or(SolveError::AllEqual)?;
        let neighbours = self.scan.nearest(reading, NEIGHBOURS, scratch);
        let total: f64 = neighbours.iter().map(|neighbour| self.weight(neighbour)).sum();
        let (mut x_mm, mut y_mm) = (0.0, 0.0);
        pattern.clear();
        pattern.resize(self.units, 0.0);
        for neighbour in neighbours {
            let share = self.weight(neighbour) / total;
            let place = self.places[neighbour.row];
            x_mm += share * place.x_mm;
            y_mm += share * place.y_mm;
            let per_newton = &self.per_newton[neighbour.row * self.units..][..self.units];
            pattern.iter_mut().zip(per_newton).for_each(|(sum, output)| *sum += share * output);
        }
        let force_n = dot(outputs, pattern) / dot(pattern, pattern);
        if !force_n.is_finite() {
            return Err(SolveError::OutOfProportion);
        }
        // Outputs that cancel out in the mean leave nothing to correlate with.
        let r = direction(pattern, centred).map_or(0.0, |pattern| dot(pattern, reading));
        Ok(Located { place: Place::new(x_mm, y_mm), force_n, residue: (1.0 - r).max(0.0), ..Located::PLAIN })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CalibrationPoint;
    use proptest::prelude::*;

    fn knn(points: &[CalibrationPoint<'_>]) -> PearsonKnn {
        PearsonKnn::fit(&Calibration::new(points).unwrap()).unwrap()
    }

    fn solve(solver: &PearsonKnn, outputs: &[f64]) -> Result<Located, SolveError> {
        solver.locate(outputs, &mut Workspace::default())
    }

    fn point(x_mm: f64, force_n: f64, outputs: &[f64]) -> CalibrationPoint<'_> {
        CalibrationPoint { place: Place::new(x_mm, 0.0), force_n, outputs }
    }

    #[test]
    fn a_contact_between_points_is_found_between_them() {
        let points = [point(0.0, 1.0, &[1.0, 0.0, 0.0]), point(1.0, 2.0, &[0.0, 2.0, 0.0])];
        let solver = knn(&points);
        let middle = solve(&solver, &[0.3, 0.3, 0.0]).unwrap();
        assert!((middle.place.x_mm - 0.5).abs() < 1e-12 && (middle.force_n - 0.6).abs() < 1e-12, "{middle:?}");
        assert!(middle.residue < 1e-12, "a mean of what was calibrated fits");
        let nearer = solve(&solver, &[0.2, 0.4, 0.0]).unwrap();
        assert!(nearer.place.x_mm > 0.5 && nearer.place.x_mm < 1.0, "{nearer:?}");
    }

    #[test]
    fn weights_are_inverse_squares_of_distances() {
        // Centred, the rows are at right angles to each other: r = 0.8 and 0.6 by Pythagoras.
        let solver = knn(&[point(0.0, 1.0, &[1.0, 0.0, -1.0]), point(1.0, 1.0, &[1.0, -2.0, 1.0])]);
        let at = |r: f64, length: f64| r / length;
        let (a, b) = (at(0.8, 2.0f64.sqrt()), at(0.6, 6.0f64.sqrt()));
        let located = solve(&solver, &[a + b, -2.0 * b, b - a]).unwrap();
        // 1 - r is 0.2 and 0.4: the first counts twice what the second does.
        assert!((located.place.x_mm - 1.0 / 3.0).abs() < 1e-12, "{located:?}");
    }

    #[test]
    fn a_calibrated_reading_is_found_at_its_point() {
        let points = [point(0.0, 1.0, &[1.0, 0.2, 0.0]), point(1.0, 1.0, &[0.2, 1.0, 0.1])];
        let solution = solve(&knn(&points), &[0.4, 2.0, 0.2]).unwrap();
        assert!((solution.place.x_mm - 1.0).abs() < 1e-6 && (solution.force_n - 2.0).abs() < 1e-6, "{solution:?}");
    }

    #[test]
    fn no_more_than_the_neighbours_count_and_fewer_do() {
        let outputs: Vec<[f64; 2]> = (0..9).map(|_| [1.0, 2.0]).collect();
        let points: Vec<_> = outputs.iter().enumerate().map(|(x, row)| point(x as f64, 1.0, row)).collect();
        // Nine points alike: the first four share.
        assert!((solve(&knn(&points), &[2.0, 4.0]).unwrap().place.x_mm - 1.5).abs() < 1e-12);
        let alone = solve(&knn(&points[5..6]), &[2.0, 4.0]).unwrap();
        assert!((alone.place.x_mm - 5.0).abs() < 1e-12 && (alone.force_n - 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_reading_without_an_answer_says_why() {
        let solver = knn(&[point(1.0, 1.0, &[1.0, 2.0])]);
        assert_eq!(solve(&solver, &[0.0, 0.0]), Err(SolveError::AllEqual));
        assert_eq!(solve(&solver, &[0.1]), Err(SolveError::Channels { expected: 2, found: 1 }));
        assert_eq!(solve(&solver, &[0.1, f64::NAN]), Err(SolveError::NotFinite { unit: 2 }));
        assert_eq!(
            solve(&knn(&[point(1.0, 1.0, &[1e-300, 2e-300])]), &[1e300, 2e300]),
            Err(SolveError::OutOfProportion)
        );
        let flat = Calibration::new(&[point(1.0, 1.0, &[0.3, 0.3])]).unwrap();
        assert_eq!(PearsonKnn::fit(&flat).err(), Some(FitError::NothingToTellApart));
    }

    proptest! {
        #[test]
        fn whatever_was_calibrated_and_is_read_the_answer_is_a_number_or_an_error(
            rows in prop::collection::vec(prop::collection::vec(prop::num::f64::NORMAL, 3), 1..7),
            reading in prop::collection::vec(prop::num::f64::ANY, 3),
            which in 0..8usize,
            force_n in 1e-300..1e300f64,
        ) {
            let points: Vec<_> = rows.iter().map(|row| point(1.0, force_n, row)).collect();
            if let Ok(solver) = PearsonKnn::fit(&Calibration::new(&points).unwrap()) {
                // often one of the calibrated rows itself
                if let Ok(found) = solve(&solver, rows.get(which).unwrap_or(&reading)) {
                    prop_assert!(found.force_n.is_finite() && found.residue >= 0.0 && found.residue < 2.0 + 1e-9);
                    prop_assert!((found.place.x_mm - 1.0).abs() < 1e-9);
                }
            }
        }
    }
}
