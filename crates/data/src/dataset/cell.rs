//! Content of a table cell: reading, writing and rounding.

use super::Flag;
use crate::recipe::Phase;
use palpate_core::quantity::round;
use serde::{Serialize, Serializer};
use std::fmt::Write as _;

/// Cell to be written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CellValue<'a> {
    /// An integer.
    Count(u64),
    /// A number.
    Number(f64),
    /// A word.
    Text(&'a str),
    /// An unknown value.
    Nothing,
}

/// Type of the values of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellType {
    /// Integers.
    Count,
    /// Numbers.
    Number,
    /// Words.
    Text,
}

/// Index of a row's unexpected cell in a column, and the expected content.
pub(super) type Misread = (usize, &'static str);

/// Content of a column.
pub(super) trait CellContent: Sized {
    /// Type of its values.
    const KIND: CellType;

    /// Reads the cells of one row, trimmed: one cell, or one for each channel.
    ///
    /// # Errors
    /// Returns the index of the unexpected cell, and the expected content.
    fn read(cells: &[&str]) -> Result<Self, Misread>;

    /// Writes one value for each cell.
    fn write(&self, out: &mut dyn FnMut(CellValue<'_>));

    /// Rounds to this number of decimals.
    fn round_to(&mut self, _decimals: i32) {}
}

impl CellValue<'_> {
    /// Adds the value to a line in the form used in a table.
    pub(super) fn push_to(self, line: &mut String) {
        // writing to a string can't fail
        let _ = match self {
            CellValue::Count(count) => write!(line, "{count}"),
            CellValue::Number(number) => write!(line, "{number}"),
            CellValue::Text(text) => write!(line, "{text}"),
            CellValue::Nothing => Ok(()),
        };
    }
}

impl Serialize for CellValue<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            CellValue::Count(count) => serializer.serialize_u64(*count),
            CellValue::Number(number) => serializer.serialize_f64(*number),
            CellValue::Text(text) => serializer.serialize_str(text),
            CellValue::Nothing => serializer.serialize_none(),
        }
    }
}

/// Returns the cell of a column that has one cell in each row.
fn only<'a>(cells: &[&'a str]) -> &'a str {
    cells.first().copied().unwrap_or_default()
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

const NUMBER: &str = "a finite number";

impl CellContent for u64 {
    const KIND: CellType = CellType::Count;

    fn read(cells: &[&str]) -> Result<Self, Misread> {
        only(cells).parse().map_err(|_| (0, "a whole number from 0"))
    }

    fn write(&self, out: &mut dyn FnMut(CellValue<'_>)) {
        out(CellValue::Count(*self));
    }
}

impl CellContent for f64 {
    const KIND: CellType = CellType::Number;

    fn read(cells: &[&str]) -> Result<Self, Misread> {
        number(only(cells)).ok_or((0, NUMBER))
    }

    fn write(&self, out: &mut dyn FnMut(CellValue<'_>)) {
        out(CellValue::Number(*self));
    }

    fn round_to(&mut self, decimals: i32) {
        *self = round(*self, decimals);
    }
}

/// Number that not every table has. If the table has the column, each cell is a number.
impl CellContent for Option<f64> {
    const KIND: CellType = CellType::Number;

    fn read(cells: &[&str]) -> Result<Self, Misread> {
        f64::read(cells).map(Some)
    }

    fn write(&self, out: &mut dyn FnMut(CellValue<'_>)) {
        out(self.map_or(CellValue::Nothing, CellValue::Number));
    }

    fn round_to(&mut self, decimals: i32) {
        *self = self.map(|value| round(value, decimals));
    }
}

impl CellContent for Option<Phase> {
    const KIND: CellType = CellType::Text;

    fn read(cells: &[&str]) -> Result<Self, Misread> {
        let named = Phase::ALL.into_iter().find(|phase| phase.name() == only(cells));
        named.map(Some).ok_or((0, "characterisation, calibration, test or teach"))
    }

    fn write(&self, out: &mut dyn FnMut(CellValue<'_>)) {
        out(self.map_or(CellValue::Nothing, |phase| CellValue::Text(phase.name())));
    }
}

/// Numbers, one for each channel; a number that was missed is NaN, and its cell is empty.
impl CellContent for Vec<f64> {
    const KIND: CellType = CellType::Number;

    fn read(cells: &[&str]) -> Result<Self, Misread> {
        cells.iter().enumerate().map(|(index, cell)| number(cell).ok_or((index, NUMBER))).collect()
    }

    fn write(&self, out: &mut dyn FnMut(CellValue<'_>)) {
        let cell = |number: f64| if number.is_nan() { CellValue::Nothing } else { CellValue::Number(number) };
        self.iter().for_each(|output| out(cell(*output)));
    }

    fn round_to(&mut self, decimals: i32) {
        self.iter_mut().for_each(|output| *output = round(*output, decimals));
    }
}

/// Flags, separated by blanks. An empty cell and 0 mean no flags. An unknown word is a flag too.
impl CellContent for Vec<Flag> {
    const KIND: CellType = CellType::Text;

    fn read(cells: &[&str]) -> Result<Self, Misread> {
        let words = only(cells).split_whitespace();
        let named = |word: &str| Flag::ALL.into_iter().find(|flag| flag.name() == word).unwrap_or(Flag::Other);
        Ok(if only(cells) == "0" { Vec::new() } else { words.map(named).collect() })
    }

    fn write(&self, out: &mut dyn FnMut(CellValue<'_>)) {
        out(CellValue::Text(&self.iter().map(|flag| flag.name()).collect::<Vec<_>>().join(" ")));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn number_too_large_for_decimals_is_not_rounded() {
        assert_eq!(round(1e305, 6), 1e305);
    }

    #[test]
    fn flags_are_read_as_they_are_written_and_a_foreign_word_is_one_too() {
        let flags = |text: &str| <Vec<Flag> as CellContent>::read(&[text]).unwrap();
        assert_eq!(flags("stale saturated"), [Flag::Stale, Flag::Saturated]);
        assert_eq!(flags("bad"), [Flag::Other]);
        for none in ["", "0"] {
            assert_eq!(flags(none), []);
        }
    }
}
