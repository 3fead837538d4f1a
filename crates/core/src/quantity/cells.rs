//! Centres of equal cells.

use super::{Place, Range};

/// Returns the centres of `columns` x `rows` equal cells of an area, row by row.
pub fn cell_centres(x_mm: Range, y_mm: Range, columns: usize, rows: usize) -> Vec<Place> {
    let at = |range: Range, index: usize, count: usize| {
        range.min + (range.max - range.min) * (index as f64 + 0.5) / count as f64
    };
    let place = |index: usize| Place::new(at(x_mm, index % columns, columns), at(y_mm, index / columns, rows));
    (0..columns * rows).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centres_are_half_a_cell_from_the_border() {
        let (x_mm, y_mm) = (Range { min: -6.0, max: 6.0 }, Range { min: 0.0, max: 2.0 });
        let expected = [(-4.0, 1.0), (0.0, 1.0), (4.0, 1.0)].map(|(x, y)| Place::new(x, y));
        assert_eq!(cell_centres(x_mm, y_mm, 3, 1), expected);
        assert_eq!(cell_centres(x_mm, x_mm, 1, 1), [Place::new(0.0, 0.0)]);
    }
}
