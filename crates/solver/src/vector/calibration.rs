//! Calibration presses with a force of three axes, and the outputs per newton along each axis at each place.

use super::{PRESS, VectorError};
use faer::{Mat, Side};
use palpate_core::quantity::Place;

/// One calibration press: its place, its force and its outputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VectorRow<'a> {
    /// Place of the press, specimen frame, mm.
    pub place: Place,
    /// Measured force along x, y and into the specimen, N.
    pub force_n: [f64; 3],
    /// One value for each output.
    pub outputs: &'a [f64],
}

/// Calibration presses of known force along x, y and into the specimen. A place usually has several: a press, and drags in some
/// directions.
#[derive(Clone, Debug)]
pub struct VectorCalibration {
    pub(super) rows: Vec<OwnedRow>,
    pub(super) spots: Vec<VectorSpot>,
    pub(super) outputs: usize,
}

#[derive(Clone, Debug)]
pub(super) struct OwnedRow {
    pub force_n: [f64; 3],
    pub outputs: Vec<f64>,
}

/// Presses at one place, and what they show.
#[derive(Clone, Debug)]
pub(super) struct VectorSpot {
    pub place: Place,
    pub rows: Vec<usize>,
    /// Outputs per newton along each axis. `None` if the presses don't determine them.
    pub columns: [Option<SpotColumn>; 3],
}

#[derive(Clone, Debug)]
pub(super) struct SpotColumn {
    pub per_newton: Vec<f64>,
    /// Information about the column: the inverse of its variance in units of the noise's, N^2.
    pub weight: f64,
}

/// Distance below which two presses are at one place, mm.
const SAME_MM: f64 = 1e-3;
/// Least information about a direction of the force, as a fraction of that about the best direction. A direction in which the
/// presses have less than a thirtieth of the force only has the load cell's noise.
const LEAST_INFORMATION: f64 = 1e-3;

impl VectorCalibration {
    /// Groups presses by place, and solves each place for the outputs per newton by least squares.
    ///
    /// # Errors
    /// There are no presses, a number isn't finite, the rows have different lengths, or no place determines the outputs per
    /// newton into the specimen.
    pub fn new(rows: &[VectorRow<'_>]) -> Result<Self, VectorError> {
        let outputs = rows.first().map_or(0, |row| row.outputs.len());
        for (index, row) in rows.iter().enumerate() {
            if row.outputs.len() != outputs {
                return Err(VectorError::Outputs { row: index + 1, found: row.outputs.len(), expected: outputs });
            }
            let numbers = [row.place.x_mm, row.place.y_mm].into_iter().chain(row.force_n);
            if !numbers.chain(row.outputs.iter().copied()).all(f64::is_finite) {
                return Err(VectorError::NotFinite { row: index + 1 });
            }
        }
        let key = |row: &VectorRow<'_>| [row.place.y_mm, row.place.x_mm].map(|mm| (mm / SAME_MM).round());
        let mut order: Vec<usize> = (0..rows.len()).collect();
        let by_key = |a: &usize, b: &usize| {
            let (a, b) = (key(&rows[*a]), key(&rows[*b]));
            a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
        };
        order.sort_by(by_key);
        let spots: Vec<VectorSpot> = order
            .chunk_by(|a, b| key(&rows[*a]) == key(&rows[*b]))
            .map(|same| VectorSpot::of(rows, same.to_vec(), outputs))
            .collect();
        if outputs == 0 || !spots.iter().any(|spot| spot.columns[PRESS].is_some()) {
            return Err(VectorError::NoPress);
        }
        let owned = |row: &VectorRow<'_>| OwnedRow { force_n: row.force_n, outputs: row.outputs.to_vec() };
        Ok(VectorCalibration { rows: rows.iter().map(owned).collect(), spots, outputs })
    }
}

impl VectorSpot {
    /// Solves the presses of a place for its columns. An axis counts if the forces determine it apart from the other axes.
    fn of(rows: &[VectorRow<'_>], same: Vec<usize>, outputs: usize) -> Self {
        let squares: Mat<f64> =
            Mat::from_fn(3, 3, |i, j| same.iter().map(|&row| rows[row].force_n[i] * rows[row].force_n[j]).sum());
        let mut columns = [None, None, None];
        if let Ok(eigen) = squares.self_adjoint_eigen(Side::Lower) {
            let (values, vectors) = (eigen.S().column_vector(), eigen.U());
            let is_known = |k: &usize| values[*k] > LEAST_INFORMATION * values[2];
            let inverse = |i: usize, j: usize| -> f64 {
                (0..3).filter(is_known).map(|k| vectors[(i, k)] * vectors[(j, k)] / values[k]).sum()
            };
            for (axis, column) in columns.iter_mut().enumerate() {
                let unknown: f64 = (0..3).filter(|k| !is_known(k)).map(|k| vectors[(axis, k)].powi(2)).sum();
                if unknown > LEAST_INFORMATION || values[2] <= 0.0 {
                    continue;
                }
                let mut per_newton = vec![0.0; outputs];
                for &row in &same {
                    let share: f64 = (0..3).map(|j| inverse(axis, j) * rows[row].force_n[j]).sum();
                    per_newton.iter_mut().zip(rows[row].outputs).for_each(|(sum, output)| *sum += share * output);
                }
                *column = Some(SpotColumn { per_newton, weight: 1.0 / inverse(axis, axis) });
            }
        }
        VectorSpot { place: rows[same[0]].place, rows: same, columns }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_the_forces_do_not_determine_stay_unknown() {
        let columns = [[2.0, 1.0], [-1.0, 0.5], [3.0, 4.0]];
        let solved = |forces: &[[f64; 3]]| {
            let outputs: Vec<Vec<f64>> = forces
                .iter()
                .map(|force_n| (0..2).map(|i| (0..3).map(|axis| force_n[axis] * columns[axis][i]).sum()).collect())
                .collect();
            let rows = forces.iter().zip(&outputs);
            let rows: Vec<VectorRow<'_>> = rows
                .map(|(force_n, outputs)| VectorRow { place: Place::default(), force_n: *force_n, outputs })
                .collect();
            let same = (0..rows.len()).collect();
            VectorSpot::of(&rows, same, 2).columns.map(|column| column.map(|column| column.per_newton))
        };
        let known = |forces: &[[f64; 3]]| solved(forces).map(|column| column.is_some());
        assert_eq!(known(&[[0.0, 0.0, 1.0]]), [false, false, true]);
        assert_eq!(known(&[[0.0, 0.0, 1.0], [0.5, 0.0, 1.0]]), [true, false, true]);
        assert_eq!(known(&[[0.3, 0.0, 1.0]]), [false, false, false], "one press has one direction");
        assert_eq!(known(&[[0.0, 0.0, 1.0], [0.3, 0.3, 1.0]]), [false, false, true]);
        assert_eq!(known(&[[0.001, -0.002, 1.0], [0.0, 0.001, 0.5]]), [false, false, true], "noise of the load cell");
        let all = solved(&[[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.1, -0.4, 0.8]]);
        for (found, truth) in all.into_iter().zip(columns) {
            assert!(found.unwrap().iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }
}
