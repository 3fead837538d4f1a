//! Places of presses: which presses are at one place, and which places lie outside others.

use palpate_core::quantity::Place;
use std::collections::HashMap;

/// Distance up to which two presses are at one place, mm.
pub const SAME_PLACE_MM: f64 = 0.001;

/// Returns the number of each place's group, in the order in which the groups first occur. Places at most `apart_mm` apart are in
/// one group, and so are places that others in between connect.
pub(super) fn same_places(places: &[Place], apart_mm: f64) -> Vec<usize> {
    // all places of a cell are at most so far apart
    let side_mm = apart_mm / std::f64::consts::SQRT_2;
    let key = |place: &Place| ((place.x_mm / side_mm).floor() as i64, (place.y_mm / side_mm).floor() as i64);
    let mut cells: Vec<Vec<Place>> = Vec::new();
    let mut cell_at = HashMap::new();
    let cell_of: Vec<usize> = places
        .iter()
        .map(|place| {
            let cell = *cell_at.entry(key(place)).or_insert_with(|| {
                cells.push(Vec::new());
                cells.len() - 1
            });
            // passes of a stage often have the same numbers
            if !cells[cell].contains(place) {
                cells[cell].push(*place);
            }
            cell
        })
        .collect();
    let mut parent: Vec<usize> = (0..cells.len()).collect();
    for (&(column, row), &cell) in &cell_at {
        for (right, up) in (0..=2).flat_map(|right| (-2..=2).map(move |up| (right, up))) {
            let near = (column.saturating_add(right), row.saturating_add(up));
            let Some(&other) = cell_at.get(&near) else { continue };
            let (first, second) = (root(&mut parent, cell), root(&mut parent, other));
            let is_near = || {
                let mut pairs = cells[cell].iter().flat_map(|a| cells[other].iter().map(move |b| (a, b)));
                pairs.any(|(a, b)| a.distance_mm(*b) <= apart_mm)
            };
            if first != second && is_near() {
                parent[first.max(second)] = first.min(second);
            }
        }
    }
    let mut numbers = HashMap::new();
    let number = |cell: usize| {
        let (root, next) = (root(&mut parent, cell), numbers.len());
        *numbers.entry(root).or_insert(next)
    };
    cell_of.into_iter().map(number).collect()
}

/// Returns the first cell that a cell is connected with, and shortens the way to it.
fn root(parent: &mut [usize], mut cell: usize) -> usize {
    while parent[cell] != cell {
        parent[cell] = parent[parent[cell]];
        cell = parent[cell];
    }
    cell
}

/// Returns for each place whether it is more than `apart_mm` outside the convex hull of others.
pub(super) fn is_outside(of: &[Place], places: &[Place], apart_mm: f64) -> Vec<bool> {
    let hull = hull(of);
    let side = |i: usize, place: &Place| {
        let (a, b) = (hull[i], hull[(i + 1) % hull.len()]);
        turn(a, b, *place) / a.distance_mm(b).max(f64::MIN_POSITIVE)
    };
    let is_outside = |place: &Place| match hull.as_slice() {
        [] => true,
        [one] => place.distance_mm(*one) > apart_mm,
        [a, b] => a.distance_mm(*place) + place.distance_mm(*b) > a.distance_mm(*b) + apart_mm,
        _ => (0..hull.len()).any(|i| side(i, place) < -apart_mm),
    };
    places.iter().map(is_outside).collect()
}

/// Returns the corners of the convex hull, counterclockwise (Andrew's monotone chain).
fn hull(of: &[Place]) -> Vec<Place> {
    let mut sorted = of.to_vec();
    sorted.sort_by(|a, b| a.x_mm.total_cmp(&b.x_mm).then(a.y_mm.total_cmp(&b.y_mm)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let half = |places: &mut dyn Iterator<Item = &Place>| {
        let mut chain: Vec<Place> = Vec::new();
        for place in places {
            while chain.len() > 1 && turn(chain[chain.len() - 2], chain[chain.len() - 1], *place) <= 0.0 {
                chain.pop();
            }
            chain.push(*place);
        }
        chain.pop();
        chain
    };
    [half(&mut sorted.iter()), half(&mut sorted.iter().rev())].concat()
}

/// Returns twice the area of a triangle, mm^2; positive if its corners are counterclockwise.
fn turn(a: Place, b: Place, c: Place) -> f64 {
    (b.x_mm - a.x_mm) * (c.y_mm - a.y_mm) - (b.y_mm - a.y_mm) * (c.x_mm - a.x_mm)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(places: &[(f64, f64)]) -> Vec<Place> {
        places.iter().map(|(x_mm, y_mm)| Place::new(*x_mm, *y_mm)).collect()
    }

    #[test]
    fn places_within_the_distance_are_one_place() {
        // rounding to 1 um would separate the first two
        let places = at(&[(0.000_499_9, 0.0), (0.000_500_1, 0.0), (5.0, 0.0), (-5.0, 0.0), (5.000_9, 0.0)]);
        assert_eq!(same_places(&places, SAME_PLACE_MM), [0, 0, 1, 2, 1]);
        // a chain is one place; a diagonal is longer than its sides
        assert_eq!(same_places(&at(&[(0.0, 0.0), (1.8, 0.0), (0.9, 0.0)]), 1.0), [0, 0, 0]);
        assert_eq!(same_places(&at(&[(0.0, 0.0), (0.8, 0.8)]), 1.0), [0, 1]);
        assert_eq!(same_places(&[], 1.0), [0; 0]);
    }

    #[test]
    fn point_outside_the_hull_is_found() {
        let square = at(&[(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (1.0, 1.0), (1.0, 0.0)]);
        let places = at(&[(1.0, 0.5), (0.0, 1.0), (2.1, 1.0), (-0.1, -0.1)]);
        assert_eq!(is_outside(&square, &places, 0.001), [false, false, true, true]);
        assert_eq!(is_outside(&square[..1], &square[..2], 0.001), [false, true]);
        assert_eq!(
            is_outside(&at(&[(0.0, 0.0), (2.0, 0.0)]), &at(&[(1.0, 0.0), (1.0, 1.0), (3.0, 0.0)]), 0.001),
            [false, true, true]
        );
    }
}
