//! Two contacts at known places: shares of right answers, and pairs of recorded presses whose outputs are added.

use super::{PRESS, VectorMap, VectorRow, VectorWorkspace};
use crate::SolveError;
use crate::evaluation::{FORCE_REFERENCE_N, LOCATION_REFERENCE_MM};
use crate::two::{ContactCount, Pair, TwoContacts};
use palpate_core::quantity::Place;
use serde::Serialize;

/// Shares of the answers to readings of two contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PairShares {
    /// Both places within 1 mm and both forces within 0.1 N.
    pub right: f64,
    /// Not right, and called two contacts that aren't separable.
    pub not_separable: f64,
    /// Not right, and called two contacts.
    pub wrong: f64,
    /// Called one contact, or without an answer.
    pub one: f64,
}

/// Answers to the sums of two presses at similar distances.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SuperposedPresses {
    /// Least distance of the two places, mm. The next one is the largest.
    pub from_mm: f64,
    /// Number of pairs.
    pub pairs: usize,
    /// Shares of their answers.
    #[serde(flatten)]
    pub shares: PairShares,
}

/// Least distances, mm.
const DISTANCES_MM: [f64; 6] = [2.0, 3.0, 4.0, 5.0, 6.0, 8.0];
/// Largest number of pairs of each distance.
const MOST_PAIRS: usize = 200;
/// Largest force along the surface, as a fraction of the press. Two contacts are solved without it.
const MOST_SHEAR: f64 = 0.05;

impl PairShares {
    /// Counts answers, each with the places and the forces of its contacts.
    pub fn of(answers: impl IntoIterator<Item = (Result<ContactCount, SolveError>, [Place; 2], [f64; 2])>) -> Self {
        let (mut shares, mut count) = (PairShares::default(), 0.0);
        for (answer, places, forces_n) in answers {
            count += 1.0;
            let share = match answer {
                Ok(ContactCount::Two(pair) | ContactCount::TwoNotSeparable(pair))
                    if is_right(&pair, places, forces_n) =>
                {
                    &mut shares.right
                }
                Ok(ContactCount::Two(_)) => &mut shares.wrong,
                Ok(ContactCount::TwoNotSeparable(_)) => &mut shares.not_separable,
                Ok(ContactCount::One { .. }) | Err(_) => &mut shares.one,
            };
            *share += 1.0;
        }
        let PairShares { right, not_separable, wrong, one } = shares;
        let [right, not_separable, wrong, one] =
            [right, not_separable, wrong, one].map(|sum| sum / f64::max(count, 1.0));
        PairShares { right, not_separable, wrong, one }
    }
}

fn is_right(pair: &Pair, places: [Place; 2], forces_n: [f64; 2]) -> bool {
    let is_near = |found: usize, truth: usize| {
        pair.places[found].distance_mm(places[truth]) < LOCATION_REFERENCE_MM
            && (pair.forces_n[found] - forces_n[truth]).abs() < FORCE_REFERENCE_N
    };
    (is_near(0, 0) && is_near(1, 1)) || (is_near(0, 1) && is_near(1, 0))
}

impl SuperposedPresses {
    /// Adds the outputs of pairs of presses, as an array is linear, and solves the sums. Their noise is that of two readings. Distances
    /// without a pair are omitted.
    pub fn of<'a>(map: &VectorMap, rows: impl Iterator<Item = VectorRow<'a>>) -> Vec<SuperposedPresses> {
        let is_press = |row: &VectorRow<'_>| row.force_n[0].hypot(row.force_n[1]) <= MOST_SHEAR * row.force_n[PRESS];
        let rows: Vec<VectorRow<'_>> = rows.filter(is_press).collect();
        let mut pairs: [Vec<[usize; 2]>; DISTANCES_MM.len()] = Default::default();
        // first each press with the next one, then with the one after it, so that all presses have their turn
        for (step, first) in (1..rows.len()).flat_map(|step| (0..rows.len() - step).map(move |first| (step, first))) {
            let distance_mm = rows[first].place.distance_mm(rows[first + step].place);
            if let Some(of) = DISTANCES_MM.iter().rposition(|least_mm| distance_mm >= *least_mm)
                && pairs[of].len() < MOST_PAIRS
            {
                pairs[of].push([first, first + step]);
            }
        }
        if pairs.iter().all(Vec::is_empty) {
            return Vec::new();
        }
        let (two, mut workspace) = (TwoContacts::new(map.clone()), VectorWorkspace::default());
        let mut answer = |&[a, b]: &[usize; 2]| {
            let [a, b] = [rows[a], rows[b]];
            let outputs: Vec<f64> = a.outputs.iter().zip(b.outputs).map(|(a, b)| a + b).collect();
            (two.solve(&outputs, &mut workspace), [a.place, b.place], [a.force_n[PRESS], b.force_n[PRESS]])
        };
        let mut of_distance = |(from_mm, pairs): (f64, &Vec<[usize; 2]>)| {
            let shares = PairShares::of(pairs.iter().map(&mut answer));
            SuperposedPresses { from_mm, pairs: pairs.len(), shares }
        };
        let all = DISTANCES_MM.into_iter().zip(&pairs).filter(|(_, pairs)| !pairs.is_empty());
        all.map(&mut of_distance).collect()
    }
}
