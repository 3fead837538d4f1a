//! How far the stage's zero moved sideways, from presses that were repeated: the array feels where it is pressed.

use palpate_control::MeasuredContact;
use palpate_core::algebra::{Matrix, Vector};
use palpate_core::quantity::Place;

/// Number of the nearest places that show how the outputs change from place to place.
const NEIGHBOURS: usize = 8;

/// Returns the sideways shift, mm, that explains best what changed between two presses of the same places. `known` has all earlier
/// presses. A common change of all gains isn't taken for a shift. `None` if the earlier presses don't show how the outputs change
/// with the place.
///
/// The outputs are linear in the place near each press; least squares over all outputs of all repeated presses.
pub(super) fn sideways_shift(
    repeated: &[(MeasuredContact, MeasuredContact)],
    known: &[MeasuredContact],
) -> Option<Place> {
    let mut normal = Matrix::<3, 3>::ZERO;
    let mut right = Vector::<3>::ZERO;
    for (before, now) in repeated {
        let gradient = gradient(before, known)?;
        for ((was, is), slope) in before.per_n().zip(now.per_n()).zip(gradient) {
            let row = Vector::column([slope[0], slope[1], was]);
            normal += row * row.transpose();
            right += row * (is - was);
        }
    }
    let shift = normal.solve(right)?;
    let (x_mm, y_mm) = (shift[0], shift[1]);
    (x_mm.is_finite() && y_mm.is_finite()).then_some(Place { x_mm, y_mm })
}

/// Returns the change of each output per mm along x and y, from the nearest other places.
fn gradient(at: &MeasuredContact, known: &[MeasuredContact]) -> Option<Vec<Vector<2>>> {
    let is_other = |felt: &&MeasuredContact| felt.place != at.place && felt.outputs.len() == at.outputs.len();
    let mut others: Vec<&MeasuredContact> = known.iter().filter(is_other).collect();
    others.sort_by(|a, b| a.place.distance_mm(at.place).total_cmp(&b.place.distance_mm(at.place)));
    others.truncate(NEIGHBOURS);
    let mut normal = Matrix::<2, 2>::ZERO;
    let mut right = vec![Vector::<2>::ZERO; at.outputs.len()];
    for other in others {
        let way = Vector::column([other.place.x_mm - at.place.x_mm, other.place.y_mm - at.place.y_mm]);
        let weight = 1.0 / way.dot(&way);
        normal += way * weight * way.transpose();
        let rises = other.per_n().zip(at.per_n()).map(|(other, at)| other - at);
        right.iter_mut().zip(rises).for_each(|(right, rise)| *right += way * (weight * rise));
    }
    let inverse = normal.inverse()?;
    Some(right.into_iter().map(|right| inverse * right).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four outputs that fall off with the distance from their units.
    fn felt(x_mm: f64, y_mm: f64, gain: f64) -> MeasuredContact {
        let units = [(-2.0, -2.0), (2.0, -2.0), (-2.0, 2.0), (2.0, 2.0)];
        let rise = |(u, v): &(f64, f64)| gain * (-((x_mm - u).powi(2) + (y_mm - v).powi(2)) / 20.0).exp();
        MeasuredContact {
            place: Place { x_mm, y_mm },
            force_n: 1.0,
            outputs: units.iter().map(rise).collect(),
            sigmas: [0.0; 2],
        }
    }

    fn grid() -> Vec<MeasuredContact> {
        (0..25).map(|n| felt(f64::from(n % 5) - 2.0, f64::from(n / 5) - 2.0, 1.0)).collect()
    }

    #[test]
    fn shift_is_found_and_a_gain_is_not_taken_for_one() {
        let places = [(-1.0, -1.0), (1.0, 0.0), (0.0, 1.0)];
        for (dx_mm, dy_mm) in [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.4)] {
            let pair = |(x_mm, y_mm): (f64, f64)| (felt(x_mm, y_mm, 1.0), felt(x_mm + dx_mm, y_mm + dy_mm, 1.1));
            let shift = sideways_shift(&places.map(pair), &grid()).expect("a shift");
            assert!((shift.x_mm - dx_mm).abs() < 0.1 && (shift.y_mm - dy_mm).abs() < 0.1, "{shift:?}");
        }
    }

    #[test]
    fn shift_of_too_few_presses_is_unknown() {
        let pair = (felt(0.0, 0.0, 1.0), felt(0.5, 0.0, 1.0));
        let pair = [pair];
        assert_eq!(sideways_shift(&pair, &[]), None);
        let line: Vec<MeasuredContact> = (1..5).map(|n| felt(f64::from(n), 0.0, 1.0)).collect();
        assert_eq!(sideways_shift(&pair, &line), None, "along one line");
    }
}
