//! Arrangement of panels: one for each unit, where the array has it.

use super::WIDTH_PX;
use crate::chart::{Grid, Mark, Panel, SHARED_GAP_PX};
use palpate_core::quantity::{ArrayLayout, Place};

/// Largest number of units that are drawn. If there are more, the first are drawn.
pub(super) const MOST_UNITS: usize = 144;
/// Largest number of panels in a row: more would be too narrow for their names.
const MOST_COLUMNS: usize = 12;
/// Width of the widest figure, px, and the part of any figure that isn't panels.
const WIDEST_PX: f64 = 1056.0;
const BESIDE_PX: f64 = 96.0;
/// Distance along an axis from which units are in different rows or columns, as a fraction of the pitch.
const APART: f64 = 0.25;

/// Panels of units, row by row.
#[derive(Debug, PartialEq)]
pub(super) struct Arrangement {
    /// Index among the units in each panel; `None` where the array has none.
    cells: Vec<Option<usize>>,
    columns: usize,
}

impl Arrangement {
    /// Arranges units like the array: rows from the largest y down, each from the smallest x. Units without positions, or in more
    /// columns than fit, or with more gaps than units, follow each other in their order.
    pub(super) fn of(places: Option<Vec<Place>>, count: usize) -> Arrangement {
        places.and_then(Arrangement::as_placed).unwrap_or_else(|| Arrangement {
            cells: (0..count).map(Some).collect(),
            columns: ((count as f64).sqrt().ceil() as usize).clamp(1, MOST_COLUMNS),
        })
    }

    fn as_placed(places: Vec<Place>) -> Option<Arrangement> {
        let apart_mm = APART * ArrayLayout::from_places(places.clone()).pitch_mm()?;
        let (column, columns) = ranks(places.iter().map(|place| place.x_mm), apart_mm);
        let (row, rows) = ranks(places.iter().map(|place| -place.y_mm), apart_mm);
        let mut cells = vec![None; rows * columns];
        for (unit, (row, column)) in row.into_iter().zip(column).enumerate() {
            if cells[row * columns + column].replace(unit).is_some() {
                return None;
            }
        }
        (columns <= MOST_COLUMNS && cells.len() <= 2 * places.len()).then_some(Arrangement { cells, columns })
    }

    /// Returns the panels, with empty space where the array has no unit.
    pub(super) fn panels(&self, panel: impl Fn(usize) -> Panel) -> Vec<Panel> {
        let blank = || Panel { marks: vec![Mark::Blank], ..panel(0) };
        self.cells.iter().map(|cell| cell.map_or_else(blank, &panel)).collect()
    }

    /// Returns the grid of the panels, each about this wide, and their exact width, px.
    pub(super) fn grid(&self, panel_px: f64) -> (Grid, f64) {
        let columns = self.columns as f64;
        let beside_px = BESIDE_PX + SHARED_GAP_PX * (columns - 1.0);
        let width_px = (beside_px + panel_px * columns).clamp(WIDTH_PX, WIDEST_PX);
        (Grid { columns: self.columns, width_px, shared: true }, (width_px - beside_px) / columns)
    }
}

/// Returns the index of each value among the distinct values in rising order, and how many there are.
fn ranks(values: impl Iterator<Item = f64> + Clone, apart: f64) -> (Vec<usize>, usize) {
    let mut distinct: Vec<f64> = values.clone().collect();
    distinct.sort_by(f64::total_cmp);
    distinct.dedup_by(|next, first| *next - *first < apart);
    (values.map(|value| distinct.partition_point(|first| *first <= value) - 1).collect(), distinct.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arranged(places: &[(f64, f64)]) -> (Vec<Option<usize>>, usize) {
        let places: Vec<Place> = places.iter().map(|(x, y)| Place::new(*x, *y)).collect();
        let Arrangement { cells, columns } = Arrangement::of(Some(places.clone()), places.len());
        (cells, columns)
    }

    #[test]
    fn units_are_drawn_at_their_places() {
        let grid = [(0.0, 0.0), (4.0, 0.1), (0.1, 4.0), (4.0, 4.1), (0.0, 8.0), (4.1, 8.0)];
        assert_eq!(arranged(&grid), ([4, 5, 2, 3, 0, 1].map(Some).to_vec(), 2), "measured places");
        let five = [(0.0, 0.0), (-7.0, -7.0), (7.0, -7.0), (-7.0, 7.0), (7.0, 7.0)];
        let cells = [Some(3), None, Some(4), None, Some(0), None, Some(1), None, Some(2)];
        assert_eq!(arranged(&five), (cells.to_vec(), 3));
    }

    #[test]
    fn units_anywhere_or_in_too_many_columns_follow_each_other() {
        let scattered = [(0.0, 0.0), (1.0, 5.0), (2.0, 9.0), (3.5, 2.0), (5.0, 7.0)];
        assert_eq!(arranged(&scattered), ((0..5).map(Some).collect(), 3));
        let strip: Vec<(f64, f64)> = (0..20).map(|i| (f64::from(i), 0.0)).collect();
        assert_eq!(arranged(&strip).1, 5);
        assert_eq!(arranged(&[(0.0, 0.0), (0.0, 0.0)]), (vec![Some(0), Some(1)], 2), "one place");
        assert_eq!(Arrangement::of(None, MOST_UNITS).columns, MOST_COLUMNS);
    }

    #[test]
    fn figure_width_follows_from_its_panels_within_bounds() {
        let width = |count: usize| Arrangement::of(None, count).grid(100.0);
        assert_eq!(width(1).0.width_px, WIDTH_PX);
        assert_eq!((width(16).0.width_px, width(16).1), (556.0, 100.0));
        assert_eq!(width(MOST_UNITS).0.width_px, WIDEST_PX);
    }
}
