//! Numbers of a figure, as a table.

use crate::chart::{ChartAxis, Figure, Hue, LineStyle, Look, Mark, Panel};
use crate::export::csv::cell;

/// A table: names of the columns, each ending with its unit, then rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Numbers {
    head: Vec<String>,
    rows: Vec<Vec<NumberCell>>,
}

/// Content of a cell.
#[derive(Clone, Debug, PartialEq)]
pub enum NumberCell {
    /// A number.
    Number(f64),
    /// Words.
    Words(String),
    /// No content.
    None,
}

impl From<f64> for NumberCell {
    fn from(number: f64) -> NumberCell {
        NumberCell::Number(number)
    }
}

impl From<&str> for NumberCell {
    fn from(words: &str) -> NumberCell {
        NumberCell::Words(words.to_owned())
    }
}

impl Numbers {
    /// Creates a table of rows, each as long as the head.
    pub fn new(head: &[&str], rows: Vec<Vec<NumberCell>>) -> Numbers {
        Numbers { head: head.iter().map(|name| (*name).to_owned()).collect(), rows }
    }

    /// Returns the numbers drawn in a figure: a row for each point, step, bar, column and cell. Columns are named after the axes.
    /// Columns that are the same in every row (panel, series, kind of mark) are omitted. Words, and lines across the complete
    /// panel, are omitted too.
    pub fn of(figure: &Figure) -> Numbers {
        let mut marks =
            Marks { figure, head: ["panel", "series", "drawn_as"].map(str::to_owned).to_vec(), rows: Vec::new() };
        figure.panels.iter().for_each(|panel| marks.panel(panel));
        let Marks { head, rows, .. } = marks;
        let whole = |row: Vec<(usize, NumberCell)>| {
            let mut cells = vec![NumberCell::None; head.len()];
            row.into_iter().for_each(|(column, value)| cells[column] = value);
            cells
        };
        Numbers { rows: rows.into_iter().map(whole).collect(), head }.without_constants(3)
    }

    /// Removes those of the first columns in which all rows have the same value.
    fn without_constants(self, first: usize) -> Numbers {
        let differs = |column: usize| self.rows.iter().any(|row| row[column] != self.rows[0][column]);
        let kept: Vec<usize> = (0..self.head.len()).filter(|column| *column >= first || differs(*column)).collect();
        let of = |row: &Vec<NumberCell>| kept.iter().map(|column| row[*column].clone()).collect();
        Numbers {
            rows: self.rows.iter().map(of).collect(),
            head: kept.iter().map(|column| self.head[*column].clone()).collect(),
        }
    }

    /// Returns the table as CSV (RFC 4180, lines ended by a line feed), numbers to twelve digits.
    pub fn csv(&self) -> String {
        let line = |cells: Vec<String>| cells.join(",") + "\n";
        let rows = self.rows.iter().map(|row| line(row.iter().map(text).collect()));
        line(self.head.iter().map(|name| cell(name).into_owned()).collect()) + &rows.collect::<String>()
    }
}

fn text(value: &NumberCell) -> String {
    match value {
        // digits after the twelfth are rounding errors
        NumberCell::Number(number) if number.is_finite() => {
            format!("{number:.11e}").parse::<f64>().unwrap_or(*number).to_string()
        }
        NumberCell::Number(_) | NumberCell::None => String::new(),
        NumberCell::Words(words) => cell(words).into_owned(),
    }
}

/// Table of a figure's numbers, while it is being filled.
struct Marks<'a> {
    figure: &'a Figure,
    head: Vec<String>,
    /// Cells with their columns.
    rows: Vec<Vec<(usize, NumberCell)>>,
}

impl Marks<'_> {
    fn panel(&mut self, panel: &Panel) {
        let title = panel.marks.iter().find_map(|mark| match mark {
            Mark::Title(title) => Some(title.as_str()),
            _ => None,
        });
        let title = title.unwrap_or(&panel.y.label);
        let (x, y) = (|part: &str| column(&panel.x, part), |part: &str| column(&panel.y, part));
        for mark in &panel.marks {
            match mark {
                Mark::Curve(look, points) | Mark::Steps(look, points) => {
                    let series = self.series(look);
                    let drawn_as = match (mark, look.line) {
                        (Mark::Steps(..), _) => "step",
                        (_, LineStyle::None) => "point",
                        _ => "line",
                    };
                    for (at_x, at_y) in points {
                        self.row([title, &series, drawn_as], [(x(""), *at_x), (y(""), *at_y)]);
                    }
                }
                Mark::Strokes(hue, strokes) => {
                    let series = self.series_of(*hue);
                    for ((from, at), (to, _)) in strokes.iter().filter(|((_, from), (_, to))| from == to) {
                        self.row([title, &series, "bar"], [(x("_from"), *from), (x("_to"), *to), (y(""), *at)]);
                    }
                }
                Mark::Columns(hue, _, columns) => {
                    let series = self.series_of(*hue);
                    for ((from, to), height) in columns {
                        self.row([title, &series, "column"], [(x("_from"), *from), (x("_to"), *to), (y(""), *height)]);
                    }
                }
                Mark::Cells(axis, cells) => {
                    for cell in cells {
                        let middle = |(from, to): (f64, f64)| 0.5 * (from + to);
                        let values = [(x(""), middle(cell.x)), (y(""), middle(cell.y)), (column(axis, ""), cell.value)];
                        self.row([title, "", "cell"], values);
                    }
                }
                Mark::Ring(_) | Mark::Title(_) | Mark::Blank | Mark::At(..) | Mark::Level(..) | Mark::Words(..) => {}
            }
        }
    }

    fn row(&mut self, names: [&str; 3], values: impl IntoIterator<Item = (String, f64)>) {
        let mut cells: Vec<(usize, NumberCell)> = names.map(NumberCell::from).into_iter().enumerate().collect();
        for (name, value) in values {
            let known = self.head.iter().position(|known| *known == name);
            let column = known.unwrap_or_else(|| {
                self.head.push(name);
                self.head.len() - 1
            });
            cells.push((column, NumberCell::Number(value)));
        }
        self.rows.push(cells);
    }

    /// Name of a series in the legend: that with the same colour and marker, otherwise that with the same colour.
    fn series(&self, look: &Look) -> String {
        let mut entries = self.figure.legend.iter().flatten();
        let alike = entries.find(|(entry, _)| entry.hue == look.hue && entry.shape == look.shape);
        alike.map_or_else(|| self.series_of(look.hue), |(_, name)| name.clone())
    }

    fn series_of(&self, hue: Hue) -> String {
        let mut entries = self.figure.legend.iter().flatten();
        entries.find(|(entry, _)| entry.hue == hue).map_or_else(String::new, |(_, name)| name.clone())
    }
}

/// Name of the column for an axis: "location error, mm" and "_from" give `location_error_from_mm`.
fn column(axis: &ChartAxis, part: &str) -> String {
    let (quantity, unit) = axis.label.rsplit_once(", ").unwrap_or((&axis.label, ""));
    let name = snake_case(quantity) + part;
    if unit.is_empty() { name } else { format!("{name}_{}", snake_case(unit)) }
}

fn snake_case(words: &str) -> String {
    let mut plain = String::new();
    for letter in words.chars() {
        match letter {
            '%' => plain += " percent ",
            '/' => plain += " per ",
            'µ' | 'μ' => plain.push('u'),
            '²' => plain.push('2'),
            '³' => plain.push('3'),
            letter if letter.is_alphanumeric() => plain.extend(letter.to_lowercase()),
            _ => plain.push(' '),
        }
    }
    plain.split_whitespace().collect::<Vec<_>>().join("_")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::{ColouredCell, Shape, WidthPart};

    #[test]
    fn columns_are_called_after_the_axes_with_the_unit_last() {
        for (label, part, name) in [
            ("location error, mm", "_from", "location_error_from_mm"),
            ("share of the presses, %", "", "share_of_the_presses_percent"),
            ("output, µT", "", "output_ut"),
            ("output over force, V/N", "", "output_over_force_v_per_n"),
            ("press", "", "press"),
        ] {
            assert_eq!(column(&ChartAxis::linear(label, (0.0, 1.0)), part), name);
        }
    }

    #[test]
    fn a_figure_has_a_row_for_each_point_column_and_cell() {
        let look = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: false, line: LineStyle::None };
        let axis = |label: &str| ChartAxis::linear(label, (0.0, 1.0));
        let columns = Mark::Columns(Hue::Blue, WidthPart { index: 0, of: 1 }, vec![((0.0, 0.1), 25.0)]);
        let panel = |marks| Panel { x: axis("error, mm"), y: axis("share, %"), marks };
        let cell = ColouredCell { x: (0.1, 0.3), y: (0.0, 1.0), value: 7.0 };
        let figure = Figure {
            panels: vec![panel(vec![Mark::Curve(look, vec![(0.1 + 0.2, 1.0)]), columns])],
            legend: vec![vec![(Look { line: LineStyle::Solid, ..look }, "one, \"two\"".to_owned())]],
            ..Figure::default()
        };
        let csv = Numbers::of(&figure).csv();
        assert_eq!(csv, "drawn_as,error_mm,share_percent,error_from_mm,error_to_mm\npoint,0.3,1,,\ncolumn,,25,0,0.1\n");
        let cells = Figure { panels: vec![panel(vec![Mark::Cells(axis("output, V"), vec![cell])])], ..figure };
        assert_eq!(Numbers::of(&cells).csv(), "error_mm,share_percent,output_v\n0.2,0.5,7\n");
    }
}
