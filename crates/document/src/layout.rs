//! Positions of the units of an array in a text. Rigs and columns files have the same keys.

use super::{Bounds, Key, Keys, Problem, Table, keys};
use palpate_core::quantity::ArrayLayout;

/// Largest number of units of an array.
pub const UNITS_MAX: u64 = 4096;
/// Largest number of outputs of all units together.
pub const OUTPUTS_MAX: usize = 4096;
/// Largest number of outputs of one unit.
pub const CHANNELS_MAX: u64 = 16;

/// Largest number of characters of a unit next to a number.
const UNIT_MOST: usize = 16;

const PITCH: Bounds = Bounds::above(0.0, 1000.0, "mm");

keys! {
    /// `grid` of `[array]`.
    grid {
        rows: Whole(1, UNITS_MAX), Refused, "number of rows along y", "3";
        columns: Whole(1, UNITS_MAX), Refused, "number of columns along x; outputs are in order, row by row", "3";
        pitch_mm: Number(PITCH), Refused, "distance of neighbouring units", "4.5";
    }
}

/// The keys of `grid`.
pub const GRID: Keys = grid::KEYS;

/// Keys of `[array]` that define its outputs.
pub struct LayoutKeys {
    /// A table of rows, columns and pitch.
    pub grid: Key,
    /// A list of the units' positions.
    pub places_mm: Key,
    /// Number of outputs of each unit.
    pub channels_per_unit: Key,
}

impl LayoutKeys {
    /// Reads the layout of an `[array]` from its grid or from its list of places.
    pub fn read(&self, table: &Table) -> Option<ArrayLayout> {
        let layout = match (table.has(&self.grid), table.has(&self.places_mm)) {
            (true, false) => table.table(&self.grid).and_then(|table| read_grid(&table)),
            (false, true) => table
                .places(&self.places_mm)
                .map(|places| ArrayLayout::from_places(places.into_iter().map(|(place, _)| place).collect())),
            (true, true) => {
                let text = "`array` gives the positions of its units twice: `grid` and `places_mm`";
                for key in [&self.grid, &self.places_mm] {
                    table.complain(Problem::new(table.span_of(key), text).help("remove one of them"));
                }
                None
            }
            (false, false) => {
                let text = "`array` has no positions of its units";
                let help = "add grid = { rows, columns, pitch_mm } or places_mm = [[x, y], ...]";
                table.complain(Problem::new(table.span(), text).help(help));
                None
            }
        };
        let channels = table.whole(&self.channels_per_unit)?;
        let layout = layout?.with_channels(channels as usize);
        if layout.is_empty() || layout.len() > OUTPUTS_MAX {
            let text = match layout.len() {
                0 => "an array without units".to_owned(),
                outputs => format!("{outputs} outputs, but at most {OUTPUTS_MAX} are allowed"),
            };
            table.complain(Problem::new(table.span_of(self.place(table)), text));
            return None;
        }
        Some(layout)
    }

    /// Returns the key that states the positions.
    pub fn place(&self, table: &Table) -> &Key {
        if table.has(&self.grid) { &self.grid } else { &self.places_mm }
    }
}

fn read_grid(table: &Table) -> Option<ArrayLayout> {
    let (rows, columns) = (table.whole(&grid::rows), table.whole(&grid::columns));
    let pitch_mm = table.number(&grid::pitch_mm);
    let (rows, columns) = (rows?, columns?);
    if rows * columns > UNITS_MAX {
        table.complain(Problem::new(table.span(), format!("more than {UNITS_MAX} units")));
        return None;
    }
    Some(ArrayLayout::grid(rows as usize, columns as usize, pitch_mm?))
}

/// Reads the unit of the outputs, as displayed next to a number: 1 to 16 printable characters.
pub fn read_unit<'d>(table: &Table<'d>, key: &Key) -> Option<&'d str> {
    let unit = table.text(key)?;
    let is_label = (1..=UNIT_MOST).contains(&unit.chars().count()) && !unit.contains(char::is_control);
    if !is_label {
        let words = format!("`unit` is {unit:?}, expected 1 to {UNIT_MOST} printable characters");
        table.complain(Problem::new(table.span_of(key), words));
    }
    is_label.then_some(unit)
}
