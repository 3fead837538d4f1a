//! A table of text whose columns are as wide as their widest cells.

use super::tables::WIDTH;
use std::fmt;

/// Blanks between columns; one where the table would be wider than [`WIDTH`].
const GAP: usize = 2;

/// Rows of cells. Some columns are aligned left, all others right.
#[derive(Debug, Default)]
pub(super) struct TextTable {
    left: usize,
    rows: Vec<Row>,
}

#[derive(Debug)]
enum Row {
    Cells(Vec<String>),
    Line(String),
}

/// The cells of a row, of any types that can be printed.
macro_rules! cells {
    ($($cell:expr),* $(,)?) => { [$($cell.to_string()),*] };
}
pub(super) use cells;

impl TextTable {
    /// Starts a table whose first columns, this many, are aligned left.
    pub(super) fn new<T: Into<String>>(left: usize, head: impl IntoIterator<Item = T>) -> Self {
        let mut table = TextTable { left, rows: Vec::new() };
        table.row(head);
        table
    }

    pub(super) fn row<T: Into<String>>(&mut self, cells: impl IntoIterator<Item = T>) {
        self.rows.push(Row::Cells(cells.into_iter().map(Into::into).collect()));
    }

    /// Adds a line that has no columns.
    pub(super) fn line(&mut self, text: impl Into<String>) {
        self.rows.push(Row::Line(text.into()));
    }

    /// Whether there is nothing but the head.
    pub(super) fn is_empty(&self) -> bool {
        self.rows.len() < 2
    }

    /// Width of the widest row, columns of a terminal.
    pub(super) fn width(&self) -> usize {
        let widths = self.widths();
        widths.iter().sum::<usize>() + self.gap(&widths) * widths.len().saturating_sub(1)
    }

    /// The lines of the table, without blanks at their ends.
    pub(super) fn lines(&self) -> Vec<String> {
        let widths = self.widths();
        let gap = " ".repeat(self.gap(&widths));
        let aligned = |(column, cell): (usize, &String)| match widths[column] {
            width if column < self.left => format!("{cell:<width$}"),
            width => format!("{cell:>width$}"),
        };
        let line = |row: &Row| match row {
            Row::Cells(cells) => cells.iter().enumerate().map(aligned).collect::<Vec<_>>().join(&gap),
            Row::Line(text) => text.clone(),
        };
        self.rows.iter().map(|row| line(row).trim_end().to_owned()).collect()
    }

    /// Width of each column.
    fn widths(&self) -> Vec<usize> {
        let mut widths: Vec<usize> = Vec::new();
        for row in &self.rows {
            let Row::Cells(cells) = row else { continue };
            widths.resize(widths.len().max(cells.len()), 0);
            for (width, cell) in widths.iter_mut().zip(cells) {
                *width = (*width).max(cell.chars().count());
            }
        }
        widths
    }

    fn gap(&self, widths: &[usize]) -> usize {
        let gaps = widths.len().saturating_sub(1);
        if widths.iter().sum::<usize>() + GAP * gaps <= WIDTH { GAP } else { 1 }
    }
}

impl fmt::Display for TextTable {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.lines().iter().try_for_each(|line| writeln!(out, "{line}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cells() {
        let mut table = TextTable::new(1, ["", "mm", "N"]);
        table.row(cells!["pearson", 0.5, "-"]);
        table.line("a line of its own, wider than the columns");
        table.row(["best"]);
        let text = "          mm  N\npearson  0.5  -\na line of its own, wider than the columns\nbest\n";
        assert_eq!((table.to_string().as_str(), table.width()), (text, 15));
    }

    #[test]
    fn columns_are_narrowed_on_a_narrow_terminal() {
        let table = |cells: usize| TextTable::new(0, vec!["12345"; cells]).width();
        assert_eq!((table(11), table(12), table(13)), (75, 71, 77));
    }
}
