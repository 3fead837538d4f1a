//! The paper's method: the largest Pearson correlation.

use super::scan::{Scan, dot, to_length_one, to_order_one};
use super::tables::Points;
use super::{Calibration, CalibrationPoint, FitError, Locate, LocatedContact, SolveError, Workspace};
use palpate_core::quantity::{ArrayLayout, Place};
use serde::{Deserialize, Serialize};

/// The paper's inverse solution. The contact is at the calibration point whose outputs have the largest Pearson correlation with
/// the reading (step 3, equation 3). Its force follows from the outputs there (step 4).
///
/// If several points correlate equally well, the first one counts. A point at which all units read the same correlates with
/// nothing and is never an answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(from = "Stored")]
pub struct Pearson {
    units: usize,
    force_rule: ForceRule,
    candidates: Vec<CandidatePoint>,
    /// Outputs of the candidates, row-major candidates x units.
    outputs: Vec<f64>,
    /// The same outputs, centred and of length 1. The dot product with these is r. They aren't stored.
    #[serde(skip)]
    scan: Scan,
}

/// Data from which [`Pearson`] is made again.
#[derive(Deserialize)]
struct Stored {
    units: usize,
    force_rule: ForceRule,
    candidates: Vec<CandidatePoint>,
    outputs: Vec<f64>,
}

impl From<Stored> for Pearson {
    fn from(Stored { units, force_rule, candidates, outputs }: Stored) -> Self {
        let mut room = Vec::new();
        let mut directions = Vec::with_capacity(outputs.len());
        for row in outputs.chunks_exact(units.max(1)) {
            // a row without a direction is no candidate: only a damaged file has one
            directions.extend_from_slice(direction(row, &mut room).unwrap_or(row));
        }
        Pearson { units, force_rule, candidates, outputs, scan: Scan::new(units, directions) }
    }
}

/// Rule that gives the force once the place is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ForceRule {
    /// The paper's equation 6: the ratio of reading to calibrated output on the unit closest to the place, times the point's
    /// calibration force.
    ClosestUnit,
    /// The factor that fits the reading best over all units, y.x / x.x, times the point's calibration force.
    LeastSquares,
}

/// Returns Pearson's correlation coefficient of two equally long rows (paper equation 3), -1 to 1.
///
/// Returns `None` if the coefficient is 0/0: a row of equal values, an empty row, rows of different lengths, or a value that is
/// not finite.
pub fn correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    if a.len() != b.len() {
        return None;
    }
    let (mut a_room, mut b_room) = (Vec::new(), Vec::new());
    Some(dot(direction(a, &mut a_room)?, direction(b, &mut b_room)?).clamp(-1.0, 1.0))
}

impl Pearson {
    /// Prepares the calibration's rows once, so that a reading costs one product with a contiguous table.
    pub fn fit(
        calibration: &Calibration,
        layout: Option<&ArrayLayout>,
        force_rule: ForceRule,
    ) -> Result<Self, FitError> {
        let units = calibration.units();
        if let Some(layout) = layout.filter(|layout| layout.len() != units) {
            return Err(FitError::Layout { layout: layout.len(), calibration: units });
        }
        let (mut candidates, mut calibrated) = (Vec::new(), Vec::new());
        let mut room = Vec::new();
        for point in calibration.points() {
            if direction(point.outputs, &mut room).is_some() {
                calibrated.extend_from_slice(point.outputs);
                let closest = closest_unit(&point, layout);
                candidates.push(CandidatePoint { place: point.place, force_n: point.force_n, closest });
            }
        }
        if candidates.is_empty() {
            return Err(FitError::NothingToTellApart);
        }
        Ok(Stored { units, force_rule, candidates, outputs: calibrated }.into())
    }

    /// Returns the calibration point whose outputs correlate best with a reading: its index and its r. The index counts from 0
    /// among the points that correlate with anything. This is only the paper's step 3.
    pub fn nearest(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<(usize, f64), SolveError> {
        check(outputs, self.units)?;
        let reading = direction(outputs, &mut workspace.row).ok_or(SolveError::AllEqual)?;
        let best = self.scan.best(reading, &mut workspace.scratch).ok_or(SolveError::AllEqual)?;
        Ok((best.row, best.score))
    }

    /// Returns the place of a contact and its force, N: the paper's steps 3 and 4, without the uncertainty.
    pub fn contact(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<(Place, f64), SolveError> {
        self.locate(outputs, workspace).map(|located| (located.place, located.force_n))
    }

    /// Returns the points as tables, with the largest residue of one contact.
    pub(super) fn points(&self, most_residue: [f64; 2]) -> Points {
        Points {
            places: self.candidates.iter().map(|candidate| candidate.place).collect(),
            forces_n: self.candidates.iter().map(|candidate| candidate.force_n).collect(),
            closest: self.candidates.iter().map(|candidate| candidate.closest).collect(),
            rows: self.outputs.clone(),
            directions: self.scan.rows().to_vec(),
            force_rule: self.force_rule,
            most_residue,
        }
    }

    fn force_n(&self, row: usize, outputs: &[f64]) -> f64 {
        let candidate = &self.candidates[row];
        let calibrated = &self.outputs[row * self.units..][..self.units];
        let ratio = match self.force_rule {
            ForceRule::ClosestUnit => outputs[candidate.closest] / calibrated[candidate.closest],
            ForceRule::LeastSquares => dot(outputs, calibrated) / dot(calibrated, calibrated),
        };
        ratio * candidate.force_n
    }
}

impl Locate for Pearson {
    fn name(&self) -> &'static str {
        match self.force_rule {
            ForceRule::ClosestUnit => "pearson",
            ForceRule::LeastSquares => "pearson-lsq",
        }
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<LocatedContact, SolveError> {
        let (row, r) = self.nearest(outputs, workspace)?;
        let force_n = self.force_n(row, outputs);
        if !force_n.is_finite() {
            return Err(SolveError::OutOfProportion);
        }
        Ok(LocatedContact {
            place: self.candidates[row].place,
            force_n,
            residue: (1.0 - r).max(0.0),
            ..LocatedContact::PLAIN
        })
    }
}

/// Calibration point that can be an answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct CandidatePoint {
    place: Place,
    force_n: f64,
    /// Index of the unit whose ratio gives the force.
    closest: usize,
}

/// Returns the output that gives the force: that of the unit closest to a point. Only units with a reading at the point count,
/// because a silent unit can't scale a force (x_i = 0 in equation 6). Of a unit's channels, the largest reading counts. Without a
/// layout, it is the output with the largest magnitude, because some sensors have negative readings. Of equal outputs the first
/// counts.
fn closest_unit(point: &CalibrationPoint<'_>, layout: Option<&ArrayLayout>) -> usize {
    let heard = (0..point.outputs.len()).filter(|&output| point.outputs[output] != 0.0);
    let loudest = |a: &usize, b: &usize| point.outputs[*b].abs().total_cmp(&point.outputs[*a].abs());
    let Some(layout) = layout else { return heard.min_by(loudest).unwrap_or(0) };
    let remoteness = |output: usize| point.place.distance_mm(layout.places()[output]);
    let closest = heard.clone().min_by(|&a, &b| remoteness(a).total_cmp(&remoteness(b))).unwrap_or(0);
    heard.filter(|&output| layout.unit(output) == layout.unit(closest)).min_by(loudest).unwrap_or(0)
}

/// Checks that a reading belongs to this array and that every output is finite.
pub(super) fn check(outputs: &[f64], units: usize) -> Result<(), SolveError> {
    if outputs.len() != units {
        return Err(SolveError::Channels { expected: units, found: outputs.len() });
    }
    // all of them at once, because nearly every reading is finite
    if outputs.iter().fold(true, |all, output| all & output.is_finite()) {
        return Ok(());
    }
    let unit = outputs.iter().take_while(|output| output.is_finite()).count() + 1;
    Err(SolveError::NotFinite { unit })
}

/// Returns a row minus its mean, scaled to length 1. `None` if the difference is zero, or a value isn't finite.
pub(super) fn direction<'a>(row: &[f64], room: &'a mut Vec<f64>) -> Option<&'a [f64]> {
    // Brought to the order of 1 first: no reading, however large or small, overflows or vanishes when squared, and
    // equal values become exactly 1, so that nothing is left of them but 0.
    to_order_one(row, room);
    let mean = room.iter().sum::<f64>() / room.len() as f64;
    room.iter_mut().for_each(|value| *value -= mean);
    to_length_one(room)?;
    Some(room)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn solve(solver: &Pearson, outputs: &[f64]) -> Result<LocatedContact, SolveError> {
        solver.locate(outputs, &mut Workspace::default())
    }

    fn point(x_mm: f64, force_n: f64, outputs: &[f64]) -> CalibrationPoint<'_> {
        CalibrationPoint { place: Place::new(x_mm, 0.0), force_n, outputs }
    }

    fn pearson(points: &[CalibrationPoint<'_>], layout: Option<&ArrayLayout>) -> Pearson {
        Pearson::fit(&Calibration::new(points).unwrap(), layout, ForceRule::ClosestUnit).unwrap()
    }

    #[test]
    fn correlation_is_pearsons() {
        let rows = [([2.0, 4.0, 6.0], 1.0), ([3.0, 2.0, 1.0], -1.0), ([1.0, 3.0, 2.0], 0.5)];
        for (row, r) in rows {
            assert!((correlation(&[1.0, 2.0, 3.0], &row).unwrap() - r).abs() < 1e-12, "{row:?}");
        }
        // Neither huge nor tiny values leave the range of what can be squared.
        assert!((correlation(&[1e300, 2e300, 3e300], &[1e-300, 3e-300, 2e-300]).unwrap() - 0.5).abs() < 1e-12);
    }

    #[test]
    fn correlation_without_variance_is_undefined_not_nan() {
        let equal_by_value = [0.1; 9]; // its mean is rounded, its variance isn't exactly 0
        assert_eq!(correlation(&equal_by_value, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]), None);
        assert_eq!(correlation(&[], &[]), None);
        assert_eq!(correlation(&[1.0], &[2.0]), None);
        assert_eq!(correlation(&[0.0, 0.0], &[1.0, 2.0]), None);
        assert_eq!(correlation(&[1.0, f64::NAN], &[1.0, 2.0]), None);
        assert_eq!(correlation(&[f64::INFINITY, 1.0], &[1.0, 2.0]), None);
        assert_eq!(correlation(&[1.0, 2.0, 3.0], &[1.0, 2.0]), None);
    }

    #[test]
    fn the_force_comes_from_the_closest_unit_and_the_points_own_force() {
        let layout = ArrayLayout::grid(1, 3, 4.0); // units at -4, 0, 4
        let points = [point(-4.0, 2.0, &[1.0, 0.4, 0.1]), point(4.0, 0.5, &[0.1, 0.4, 0.5])];
        let solver = pearson(&points, Some(&layout));
        let solution = solve(&solver, &[0.5, 0.2, 0.04]).unwrap();
        assert_eq!(solution.place, Place::new(-4.0, 0.0));
        assert!((solution.force_n - 1.0).abs() < 1e-12); // 0.5 / 1.0 of 2 N
        let solution = solve(&solver, &[0.1, 0.5, 1.0]).unwrap();
        assert!((solution.force_n - 1.0).abs() < 1e-12); // 1.0 / 0.5 of 0.5 N
    }

    #[test]
    fn least_squares_uses_every_unit() {
        let calibration = Calibration::new(&[point(0.0, 2.0, &[1.0, 2.0])]).unwrap();
        let solver = Pearson::fit(&calibration, None, ForceRule::LeastSquares).unwrap();
        // (3*1 + 5*2) / (1 + 4) * 2 N
        assert!((solve(&solver, &[3.0, 5.0]).unwrap().force_n - 5.2).abs() < 1e-12);
    }

    #[test]
    fn without_layout_the_largest_output_is_closest() {
        assert_eq!(closest_unit(&point(0.0, 1.0, &[0.1, -0.9, 0.5]), None), 1);
        assert_eq!(closest_unit(&point(0.0, 1.0, &[0.5, 0.5, 0.1]), None), 0);
        let layout = ArrayLayout::grid(1, 3, 4.0);
        assert_eq!(closest_unit(&point(-4.0, 1.0, &[0.3, 0.2, 0.1]), Some(&layout)), 0);
        assert_eq!(closest_unit(&point(-4.0, 1.0, &[0.0, 0.2, 0.1]), Some(&layout)), 1);
    }

    #[test]
    fn first_of_equally_good_points_is_the_answer() {
        let solver = pearson(&[point(1.0, 1.0, &[1.0, 2.0]), point(2.0, 1.0, &[2.0, 4.0])], None);
        assert_eq!(solve(&solver, &[5.0, 10.0]).unwrap().place.x_mm, 1.0);
    }

    #[test]
    fn a_point_without_contrast_is_never_the_answer() {
        // The reading runs against the only other point (r = -1), which still counts for more than 0/0.
        let solver = pearson(&[point(1.0, 1.0, &[0.3, 0.3]), point(2.0, 1.0, &[1.0, 2.0])], None);
        let solution = solve(&solver, &[2.0, 1.0]).unwrap();
        assert_eq!(solution.place.x_mm, 2.0);
        assert!((solution.residue - 2.0).abs() < 1e-12);
        let flat = Calibration::new(&[point(1.0, 1.0, &[0.3, 0.3])]).unwrap();
        assert_eq!(Pearson::fit(&flat, None, ForceRule::ClosestUnit).err(), Some(FitError::NothingToTellApart));
    }

    #[test]
    fn unanswered_reading_has_a_reason() {
        let solver = pearson(&[point(1.0, 1.0, &[1.0, 2.0])], None);
        assert_eq!(solve(&solver, &[0.1, 0.1]), Err(SolveError::AllEqual));
        assert_eq!(solve(&solver, &[0.1]), Err(SolveError::Channels { expected: 2, found: 1 }));
        assert_eq!(solve(&solver, &[0.1, f64::NAN]), Err(SolveError::NotFinite { unit: 2 }));
        let faint = pearson(&[point(1.0, 1.0, &[1e-300, 2e-300])], None);
        assert_eq!(solve(&faint, &[1e300, 2e300]), Err(SolveError::OutOfProportion));
    }

    proptest! {
        #[test]
        fn every_reading_gives_a_number_or_an_error(
            row in prop::collection::vec(prop::num::f64::ANY, 3),
            rule in prop::bool::ANY,
        ) {
            let points = [point(0.0, 1.0, &[1.0, 0.0, 0.5]), point(1.0, 2.0, &[-0.1, 1.0, 0.0])];
            let rule = if rule { ForceRule::ClosestUnit } else { ForceRule::LeastSquares };
            let solver = Pearson::fit(&Calibration::new(&points).unwrap(), None, rule).unwrap();
            if let Ok(solution) = solve(&solver, &row) {
                prop_assert!(solution.force_n.is_finite() && solution.residue <= 2.0);
            }
        }

        #[test]
        fn the_force_of_a_contact_does_not_move_it(factor in 1e-6..1e6f64) {
            let solver = pearson(&[point(0.0, 1.0, &[1.0, 0.0, 0.5]), point(1.0, 1.0, &[0.2, 1.0, 0.3])], None);
            let solution = solve(&solver, &[0.2 * factor, factor, 0.3 * factor]).unwrap();
            prop_assert_eq!(solution.place.x_mm, 1.0);
            prop_assert!((solution.force_n / factor - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn the_force_is_that_of_the_closest_units_channel_that_reads_most() {
        let layout = ArrayLayout::from_places(vec![Place::new(0.0, 0.0), Place::new(4.0, 0.0)]).with_channels(2);
        let outputs = [[0.1, -0.5, 0.9, 0.2], [0.2, 0.3, 0.4, -0.8]];
        let closest = |x_mm: f64, outputs: &[f64], layout| closest_unit(&point(x_mm, 1.0, outputs), Some(layout));
        assert_eq!((closest(1.0, &outputs[0], &layout), closest(3.0, &outputs[1], &layout)), (1, 3));
        // its loudest channel is left out of account
        assert_eq!(closest(1.0, &[0.1, 0.9, 0.2], &layout.only(&[0, 2, 3])), 0);
    }
}
