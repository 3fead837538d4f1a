//! Decides where the paper's numbers are shown next to this program's: only for the paper's own array, calibrated and tested by
//! its protocol.

use crate::paper;
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_data::dataset::{Press, Presses};
use palpate_data::recipe::Phase;
use std::collections::BTreeSet;

/// Complete citation of the paper.
pub(super) const CITATION: &str = "Liu, W.; Gu, C.; Zeng, R.; Yu, P.; Fu, X. A Novel Inverse Solution of Contact Force Based on a \
     Sparse Tactile Sensor Array. Sensors 2018, 18(2), 351. doi:10.3390/s18020351";

/// Array of the paper: units along each side, and distance from one to the next, mm.
const SIDE: usize = 3;
const PITCH_MM: f64 = 4.5;
/// Calibration of the paper: half the side of the area, mm; spacing of the grid, mm; and force on each point, N.
const HALF_MM: f64 = 6.0;
const SPACING_MM: f64 = 0.5;
const CALIBRATION_N: f64 = 1.0;
/// Least and largest test force of the paper, N.
const LEAST_N: f64 = 0.1;
const MOST_N: f64 = 1.0;
/// Distance below which coordinates and forces are the same, mm and N.
const SAME: f64 = 1e-6;

/// Whether an array is the paper's and was calibrated and tested by its protocol. The array has 3 x 3 units 4.5 mm apart. The
/// calibration has 1 N at each of the 625 points of a grid of 0.5 mm over 12 x 12 mm. The test has 100 presses of 0.1 to 1 N
/// anywhere on this area. Flagged presses are included.
pub fn is_beside_paper(layout: &ArrayLayout, presses: &Presses) -> bool {
    is_papers_array(layout) && is_calibrated_as_there(presses) && is_tested_as_there(presses)
}

fn is_papers_array(layout: &ArrayLayout) -> bool {
    let papers = ArrayLayout::grid(SIDE, SIDE, PITCH_MM);
    let is_near = |(a, b): (&Place, &Place)| (a.x_mm - b.x_mm).hypot(a.y_mm - b.y_mm) < SAME;
    layout.len() == papers.len() && layout.places().iter().zip(papers.places()).all(is_near)
}

fn is_calibrated_as_there(presses: &Presses) -> bool {
    let side = (2.0 * HALF_MM / SPACING_MM).round() as i64;
    let index = |mm: f64| {
        let steps = (mm + HALF_MM) / SPACING_MM;
        let is_on_it = (steps - steps.round()).abs() < SAME && (0..=side).contains(&(steps.round() as i64));
        is_on_it.then(|| steps.round() as i64)
    };
    let point = |press: &Press| {
        let is_force = press.force_set_n.is_some_and(|force_n| (force_n - CALIBRATION_N).abs() < SAME);
        Some((index(press.x_mm)?, index(press.y_mm)?)).filter(|_| is_force)
    };
    let points: Option<Vec<(i64, i64)>> = of(presses, Phase::Calibration).map(point).collect();
    let count = ((side + 1) * (side + 1)) as usize;
    points.is_some_and(|points| points.len() == count && points.into_iter().collect::<BTreeSet<_>>().len() == count)
}

fn is_tested_as_there(presses: &Presses) -> bool {
    let forces: Vec<f64> = of(presses, Phase::Test).filter_map(|press| press.force_set_n).collect();
    let is_within = |press: &Press| press.x_mm.abs().max(press.y_mm.abs()) <= HALF_MM + SAME;
    let is_random = forces.windows(2).any(|pair| (pair[0] - pair[1]).abs() > SAME);
    forces.len() == paper::POINTS
        && of(presses, Phase::Test).count() == paper::POINTS
        && of(presses, Phase::Test).all(is_within)
        && forces.iter().all(|force_n| (LEAST_N - SAME..=MOST_N + SAME).contains(force_n))
        && is_random
}

fn of(presses: &Presses, phase: Phase) -> impl Iterator<Item = &Press> {
    presses.presses.iter().filter(move |press| press.is_of(phase))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_data::dataset::{Mapping, parse_table};

    /// A table with every column that the comparison reads.
    const TABLE: &str = "\
press,level,phase,x_mm,y_mm,force_set_n,force_n,out_1,out_2,flags,depth_mm,t_s,z_mm
0,0,calibration,-1,0,1,0.8,1,0.5,,0,0,0
";

    /// A run of the paper's protocol.
    fn papers() -> Presses {
        let press = |phase, x_mm, y_mm, force_n| Press {
            phase: Some(phase),
            x_mm,
            y_mm,
            force_set_n: Some(force_n),
            ..Press::default()
        };
        let at = |index: i32| -6.0 + 0.5 * f64::from(index);
        let calibration = (0..625).map(|i| press(Phase::Calibration, at(i % 25), at(i / 25), 1.0));
        let test = (0..100).map(|i| press(Phase::Test, 0.1 * f64::from(i) - 5.0, 0.3, 0.1 + 0.009 * f64::from(i)));
        let mut presses = parse_table("a.csv", TABLE.as_bytes(), &Mapping::default()).unwrap();
        presses.presses = calibration.chain(test).collect();
        presses
    }

    fn is_with(layout: &ArrayLayout, change: impl Fn(&mut Vec<Press>)) -> bool {
        let mut presses = papers();
        change(&mut presses.presses);
        is_beside_paper(layout, &presses)
    }

    #[test]
    fn paper_is_shown_only_with_its_array_and_protocol() {
        let papers = ArrayLayout::grid(3, 3, 4.5);
        assert!(is_with(&papers, |_| {}));
        assert!(is_with(&papers, |presses| presses.reverse()), "in any order");
        for other in [
            ArrayLayout::grid(4, 4, 4.5),
            ArrayLayout::grid(3, 3, 4.6),
            ArrayLayout::grid(3, 3, 4.5).with_channels(3),
            ArrayLayout::grid(1, 9, 4.5),
        ] {
            assert!(!is_with(&other, |_| {}), "{other:?}");
        }
        assert!(!is_with(&papers, |presses| presses[7].force_set_n = Some(0.9)), "another force");
        assert!(!is_with(&papers, |presses| presses[7].force_set_n = None), "no force");
        assert!(!is_with(&papers, |presses| presses[7].x_mm += 0.1), "beside the grid");
        assert!(!is_with(&papers, |presses| presses[0].x_mm = -6.5), "outside the area");
        assert!(!is_with(&papers, |presses| presses[1] = presses[0].clone()), "one point twice");
        assert!(!is_with(&papers, |presses| drop(presses.remove(0))), "a point less");
        assert!(!is_with(&papers, |presses| drop(presses.pop())), "99 test presses");
        assert!(!is_with(&papers, |presses| presses.push(presses[700].clone())), "101 test presses");
        assert!(!is_with(&papers, |presses| presses[700].force_set_n = Some(1.1)), "a strong test press");
        assert!(!is_with(&papers, |presses| presses[700].y_mm = 6.1), "a test press outside the area");
        let all_alike = |presses: &mut Vec<Press>| presses[625..].iter_mut().for_each(|p| p.force_set_n = Some(0.5));
        assert!(!is_with(&papers, all_alike), "one force for all");
    }
}
