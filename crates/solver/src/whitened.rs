//! Finds the smallest angle between outputs weighted by their noise.

use super::pearson::check;
use super::scan::{Scan, to_length_one, to_order_one};
use super::{Calibration, FitError, Locate, Located, SolveError, Workspace};
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// The contact is at the calibration point whose outputs have the smallest angle with the reading. Every output is first divided
/// by its unit's noise, so a more reliable unit counts more.
///
/// If the noise has this size, is Gaussian and is independent between units, the result is the calibration point and force of
/// largest likelihood. Outputs aren't centred, so an array without contact must read 0. If several points are equally good, the
/// first one counts. A point at which no unit reads anything is never an answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Whitened {
    /// Smallest noise divided by each unit's noise, at most 1.
    weights: Vec<f64>,
    /// Smallest noise, in the outputs' unit.
    least_sd: f64,
    candidates: Vec<Candidate>,
    /// Outputs of the candidates, weighted and of length 1.
    scan: Scan,
}

/// Calibration point that can be an answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Candidate {
    place: Place,
    /// Length of the candidate's weighted outputs divided by its force, outputs' unit per newton.
    per_newton: f64,
}

impl Whitened {
    /// Prepares the calibration's rows once. `noise_sd` is one standard deviation for each unit, in the outputs' unit.
    ///
    /// # Errors
    /// The noise isn't one finite value above 0 for each unit, or no unit reads anything at any point.
    pub(crate) fn fit(calibration: &Calibration, noise_sd: &[f64]) -> Result<Self, FitError> {
        let units = calibration.units();
        if noise_sd.len() != units || !noise_sd.iter().all(|sd| *sd > 0.0 && sd.is_finite()) {
            return Err(FitError::Noise);
        }
        let least_sd = noise_sd.iter().copied().fold(f64::INFINITY, f64::min);
        let weights: Vec<f64> = noise_sd.iter().map(|sd| least_sd / sd).collect();
        let (mut candidates, mut directions, mut row) = (Vec::new(), Vec::new(), Vec::new());
        for point in calibration.points() {
            if let Some(length) = whiten(point.outputs, &weights, &mut row) {
                directions.extend_from_slice(&row);
                candidates.push(Candidate { place: point.place, per_newton: length / point.force_n });
            }
        }
        if candidates.is_empty() {
            return Err(FitError::NothingToTellApart);
        }
        Ok(Whitened { weights, least_sd, candidates, scan: Scan::new(units, directions) })
    }
}

impl Locate for Whitened {
    fn name(&self) -> &'static str {
        "whitened"
    }

    /// Locates the contact. The residue is the part of the reading that the contact doesn't explain, in units of the noise: the
    /// sum of ((y - F g) / sd)^2.
    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Located, SolveError> {
        check(outputs, self.weights.len())?;
        let Workspace { row, scratch, .. } = workspace;
        let length = whiten(outputs, &self.weights, row).ok_or(SolveError::AllEqual)?;
        let best = self.scan.best(row, scratch).ok_or(SolveError::AllEqual)?;
        let candidate = &self.candidates[best.row];
        // Both rows have length 1, so that the cosine is also the factor that fits one to the other best.
        let cosine = best.score;
        let force_n = cosine * (length / candidate.per_newton);
        let unexplained = row.iter().zip(self.scan.row(best.row)).map(|(y, x)| (y - cosine * x).powi(2)).sum::<f64>();
        let residue = unexplained * (length / self.least_sd).powi(2);
        if !(force_n.is_finite() && residue.is_finite()) {
            return Err(SolveError::OutOfProportion);
        }
        Ok(Located { place: candidate.place, force_n, residue, ..Located::PLAIN })
    }
}

/// Scales a row times the weights to length 1, and returns its original length. `None` if the length is zero.
fn whiten(outputs: &[f64], weights: &[f64], row: &mut Vec<f64>) -> Option<f64> {
    let scale = to_order_one(outputs, row);
    row.iter_mut().zip(weights).for_each(|(value, weight)| *value *= weight);
    Some(scale * to_length_one(row)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CalibrationPoint;
    use proptest::prelude::*;

    fn whitened(points: &[CalibrationPoint<'_>], noise_sd: &[f64]) -> Whitened {
        Whitened::fit(&Calibration::new(points).unwrap(), noise_sd).unwrap()
    }

    fn solve(solver: &Whitened, outputs: &[f64]) -> Result<Located, SolveError> {
        solver.locate(outputs, &mut Workspace::default())
    }

    fn point(x_mm: f64, force_n: f64, outputs: &[f64]) -> CalibrationPoint<'_> {
        CalibrationPoint { place: Place::new(x_mm, 0.0), force_n, outputs }
    }

    #[test]
    fn a_noisy_unit_counts_for_little() {
        let points = [point(0.0, 1.0, &[1.0, 0.0, 0.5]), point(1.0, 1.0, &[0.8, 0.3, 0.0])];
        let reading = [1.0, 0.0, 0.0]; // by the third unit the second point, by the others the first
        assert_eq!(solve(&whitened(&points, &[0.1; 3]), &reading).unwrap().place.x_mm, 1.0);
        assert_eq!(solve(&whitened(&points, &[0.1, 0.1, 10.0]), &reading).unwrap().place.x_mm, 0.0);
    }

    #[test]
    fn force_and_residue_are_those_of_weighted_least_squares() {
        let (y, x, sd, force_n) = ([3.0, 5.0], [1.0, 2.0], [0.5f64, 0.1], 2.0);
        let weighted = |a: [f64; 2], b: [f64; 2]| -> f64 { (0..2).map(|i| a[i] * b[i] / sd[i].powi(2)).sum() };
        let factor = weighted(y, x) / weighted(x, x);
        let left: f64 = (0..2).map(|i| ((y[i] - factor * x[i]) / sd[i]).powi(2)).sum();
        let located = solve(&whitened(&[point(0.0, force_n, &x)], &sd), &y).unwrap();
        assert!((located.force_n / (factor * force_n) - 1.0).abs() < 1e-12, "{located:?}");
        assert!((located.residue / left - 1.0).abs() < 1e-9, "{located:?}, {left}");
    }

    #[test]
    fn rows_are_not_centred() {
        let solver = whitened(&[point(1.0, 2.0, &[0.3, 0.3]), point(2.0, 1.0, &[0.1, 0.5])], &[1.0, 1.0]);
        let located = solve(&solver, &[0.6, 0.6]).unwrap();
        assert!(located.place.x_mm == 1.0 && (located.force_n - 4.0).abs() < 1e-12 && located.residue < 1e-12);
    }

    #[test]
    fn a_point_that_reads_nothing_is_never_the_answer() {
        let solver = whitened(&[point(1.0, 1.0, &[0.0, 0.0]), point(2.0, 1.0, &[1.0, 0.0])], &[1.0, 1.0]);
        let located = solve(&solver, &[-1.0, 0.0]).unwrap();
        assert!(located.place.x_mm == 2.0 && located.force_n == -1.0);
        let nothing = Calibration::new(&[point(1.0, 1.0, &[0.0, 0.0])]).unwrap();
        assert_eq!(Whitened::fit(&nothing, &[1.0, 1.0]).err(), Some(FitError::NothingToTellApart));
    }

    #[test]
    fn what_cannot_be_solved_says_why() {
        let points = [point(1.0, 1.0, &[1.0, 2.0])];
        let calibration = Calibration::new(&points).unwrap();
        for noise_sd in [&[1.0][..], &[1.0, 0.0], &[1.0, -1.0], &[1.0, f64::NAN], &[1.0, f64::INFINITY]] {
            assert_eq!(Whitened::fit(&calibration, noise_sd).err(), Some(FitError::Noise), "{noise_sd:?}");
        }
        let solver = whitened(&points, &[1.0, 1.0]);
        assert_eq!(solve(&solver, &[0.0, 0.0]), Err(SolveError::AllEqual));
        assert_eq!(solve(&solver, &[0.1]), Err(SolveError::Channels { expected: 2, found: 1 }));
        assert_eq!(solve(&solver, &[f64::NAN, 0.1]), Err(SolveError::NotFinite { unit: 1 }));
        let faint = whitened(&[point(1.0, 1.0, &[1e-300, 2e-300])], &[1.0, 1.0]);
        assert_eq!(solve(&faint, &[1e300, 2e300]), Err(SolveError::OutOfProportion));
    }

    proptest! {
        #[test]
        fn whatever_was_calibrated_and_is_read_the_answer_is_a_number_or_an_error(
            // numbers of one size have answers, those of any size mostly errors
            rows in prop_oneof![
                prop::collection::vec(prop::collection::vec(-10.0..10.0f64, 3), 1..7),
                prop::collection::vec(prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::ZERO, 3), 1..7),
            ],
            noise_sd in prop_oneof![
                prop::collection::vec(1e-6..1e6f64, 3),
                prop::collection::vec(prop::num::f64::POSITIVE | prop::num::f64::SUBNORMAL, 3),
            ],
            reading in prop_oneof![
                prop::collection::vec(-10.0..10.0f64, 3),
                prop::collection::vec(prop::num::f64::ANY, 3),
            ],
            which in 0..8usize,
            force_n in 1e-300..1e300f64,
        ) {
            let points: Vec<_> = rows.iter().map(|row| point(1.0, force_n, row)).collect();
            if let Ok(solver) = Whitened::fit(&Calibration::new(&points).unwrap(), &noise_sd) {
                // often one of the calibrated rows itself
                if let Ok(found) = solve(&solver, rows.get(which).unwrap_or(&reading)) {
                    prop_assert!(found.force_n.is_finite() && found.residue.is_finite() && found.residue >= 0.0);
                }
            }
        }

        #[test]
        fn the_force_of_a_contact_does_not_move_it(factor in 1e-6..1e6f64) {
            let points = [point(0.0, 1.0, &[1.0, 0.0, 0.5]), point(1.0, 1.0, &[0.2, 1.0, 0.3])];
            let located = solve(&whitened(&points, &[0.1, 0.2, 0.3]), &[0.2 * factor, factor, 0.3 * factor]).unwrap();
            prop_assert_eq!(located.place.x_mm, 1.0);
            prop_assert!((located.force_n / factor - 1.0).abs() < 1e-12);
        }
    }
}
