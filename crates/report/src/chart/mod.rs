//! Charts as SVG, drawn by this program. A plotting library was considered. The common library writes colours into every element,
//! so that a figure can't follow the reader's light or dark setting. It also needs a font library to lay out text well. This
//! module contains everything that a study or a report needs: axes, curves, markers, columns, cells and words. Its colours are
//! also distinguishable for colour-blind people, and its shapes in print. No text of a figure overlaps another.
//!
//! A figure can be an SVG file that follows the reader's light or dark setting ([`Figure::svg`]), or an SVG file in light colours
//! ([`Figure::saved`]). It can also be part of a page that has [`STYLE`] and prints title and notes itself ([`Figure::inline`]).

mod axis;
mod bar;
mod labels;
mod letters;
mod look;
mod panel;
mod ramp;

pub use axis::{AxisScale, ChartAxis};
pub(crate) use look::STYLE;
pub use look::{Hue, LineStyle, Look, Shape};
pub use panel::{Anchor, ColouredCell, Mark, Panel, WidthPart};
pub(crate) use ramp::Ramp;

use labels::{Label, SIZE_PX, laid_out};
use letters::{width_px, wrapped};
use look::{LIGHT, write_line, write_marker};
use panel::{PanelArea, Words};
use std::fmt::Write as _;

/// Several panels under one title.
#[derive(Clone, Debug, Default)]
pub struct Figure {
    /// Title of the figure.
    pub title: String,
    /// Basis of the figure: its data.
    pub subtitle: String,
    /// Height of the panels, px.
    pub height_px: f64,
    /// Panels, side by side or in rows.
    pub panels: Vec<Panel>,
    /// Grid of the panels; `None` for all side by side.
    pub grid: Option<Grid>,
    /// Meaning of the marks, in lines.
    pub legend: Vec<Vec<(Look, String)>>,
    /// Lines of text below the panels.
    pub notes: Vec<String>,
}

/// Small panels, row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Number of panels in a row. The vertical axis has its name only at the first panel.
    pub columns: usize,
    /// Width of the figure, px.
    pub width_px: f64,
    /// Whether all panels have the same axes. The axes are then named once, and their numbers are next to the first column and
    /// below the last row.
    pub shared: bool,
}

/// Mark in every SVG file of [`Figure::saved`]. A file with this mark may be replaced by another figure.
pub const SVG_MARK: &str = "<metadata>palpate</metadata>";

const WIDTH: f64 = 900.0;
/// Space to the left of a panel, px, with room for the numbers next to the panel's axis.
const LEFT: f64 = 72.0;
const LEFT_OF_ROWS: f64 = 172.0;
const RIGHT: f64 = 24.0;
const GAP: f64 = 44.0;
/// Space between the panels of a grid, px, with room for the numbers next to them.
const GAP_OF_GRID: f64 = 50.0;
/// Gap between panels with shared axes, px: space for the ends of two axes next to each other.
pub(crate) const SHARED_GAP_PX: f64 = 20.0;
/// Space above the panels of a figure whose title is printed by the page, px. The second constant is the part cut off below,
/// because the page has its own margins, px.
const TOP_INLINE: f64 = 14.0;
const CUT_INLINE: f64 = 22.0;
/// Height of a panel's title, px.
const TITLE_LINE: f64 = 24.0;
/// Size of markers in a grid, relative to the normal size.
const SMALL: f64 = 0.7;
const LEGEND_LINE: f64 = 22.0;
const NOTE_LINE: f64 = 17.0;
/// Margin next to title, legend and notes.
const MARGIN: f64 = 20.0;
/// Distance from the start of a legend's entry to its name. The second constant is the distance from the entry's end to the next
/// entry.
const TO_NAME: f64 = 36.0;
const TO_NEXT: f64 = 20.0;
/// Distance from a panel to the numbers of its vertical axis. The second constant is the distance from the numbers to the axis'
/// name.
const TO_NUMBERS: f64 = 9.0;
const TO_LABEL: f64 = 8.0;
/// Least distance from a panel to the name of its vertical axis.
const LEAST_TO_LABEL: f64 = 50.0;
/// Height of a line in the name of a vertical axis.
const LABEL_LINE: f64 = 15.0;

impl Figure {
    /// Returns the figure as one SVG document.
    pub fn svg(&self) -> String {
        self.document(STYLE, "")
    }

    /// Returns the figure as an SVG file for saving: always in light colours, and with [`SVG_MARK`].
    pub fn saved(&self) -> String {
        self.document(LIGHT, SVG_MARK)
    }

    fn document(&self, style: &str, mark: &str) -> String {
        let width = self.width_px();
        let lines = |text: &str, size: f64| wrapped(text, size, width - 2.0 * MARGIN);
        let (mut labels, mut y) = (Vec::new(), 0.0);
        // bold letters are wider
        for line in lines(&self.title, 19.0) {
            y += if y == 0.0 { 28.0 } else { 22.0 };
            labels.push(Label::fixed((MARGIN, y), "title", &line));
        }
        for (index, line) in lines(&self.subtitle, 12.0).iter().enumerate() {
            y += if index == 0 { 20.0 } else { NOTE_LINE };
            labels.push(Label::fixed((MARGIN, y), "small", line));
        }
        let (drawn, bottom) = self.drawn(y + 16.0, &mut labels);
        let notes: Vec<String> = self.notes.iter().flat_map(|note| lines(note, 12.0)).collect();
        for (line, note) in notes.iter().enumerate() {
            labels.push(Label::fixed((MARGIN, bottom + NOTE_LINE * line as f64), "small", note));
        }
        let height = bottom + NOTE_LINE * notes.len() as f64;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" role=\"img\">\n<title>{title}</title>\n{mark}<style>\n{style}{ramp}</style>\n\
             <rect class=\"sheet\" width=\"{width}\" height=\"{height}\"/>\n{drawn}{texts}</svg>\n",
            title = escaped(&self.title),
            ramp = if self.colours().is_some() { Ramp::style() } else { String::new() },
            texts = laid_out(&labels, width),
        )
    }

    /// Returns the figure as an element of a page that has [`STYLE`] and [`Ramp::style`]. The page prints title, subtitle and
    /// notes.
    pub fn inline(&self) -> String {
        let mut labels = Vec::new();
        let (drawn, bottom) = self.drawn(TOP_INLINE, &mut labels);
        let (width, height) = (self.width_px(), bottom - CUT_INLINE);
        format!(
            "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{}\">\n{drawn}{}</svg>\n",
            escaped(&self.title),
            laid_out(&labels, width)
        )
    }

    /// Returns legend and panels below `above_px` without their texts, and their lower end.
    fn drawn(&self, above_px: f64, labels: &mut Vec<Label>) -> (String, f64) {
        let mut svg = String::new();
        let legend = self.legend_lines();
        for (line, entries) in legend.iter().enumerate() {
            let (mut x, y) = (MARGIN, above_px + 8.0 + LEGEND_LINE * line as f64);
            for (look, name) in entries {
                write_line(&mut svg, *look, &[(x, y), (x + 28.0, y)]);
                write_marker(&mut svg, *look, (x + 14.0, y), 1.0);
                labels.push(Label::fixed((x + TO_NAME, y + 4.5), "", name));
                x += TO_NAME + width_px(name, SIZE_PX) + TO_NEXT;
            }
        }
        let has_rows = self.panels.iter().any(|panel| matches!(panel.y.scale, AxisScale::Rows(_)));
        let is_shared = self.grid.is_some_and(|grid| grid.shared);
        let names = self.upward_names(has_rows);
        let left = if has_rows { LEFT_OF_ROWS } else { names.left_px };
        let gap = match self.grid {
            Some(_) if is_shared => SHARED_GAP_PX,
            Some(_) => GAP_OF_GRID,
            None if has_rows => GAP,
            None => GAP + left,
        };
        let columns = self.columns();
        let width = (self.width_px() - left - RIGHT - gap * (columns as f64 - 1.0)) / columns as f64;
        let mut y = above_px + LEGEND_LINE * legend.len() as f64;
        let rows = self.panels.chunks(columns);
        let last = rows.len().saturating_sub(1);
        // a title may extend into the gap next to its panel
        let title_px = width + if is_shared { 0.6 * gap } else { 0.0 };
        let above_panel_px = self.above_panel_px(title_px);
        let first_y = y + above_panel_px;
        let mut last_bottom = first_y;
        for (index, row) in rows.enumerate() {
            y += above_panel_px;
            // a panel with none below it or to its left has the numbers of its axis there
            let is_drawn = |index: usize| self.panels.get(index).is_some_and(|panel| !panel.is_blank());
            let has_x = |column: usize| !is_shared || !is_drawn((index + 1) * columns + column);
            for (column, panel) in row.iter().enumerate().filter(|(_, panel)| !panel.is_blank()) {
                let area = PanelArea { x: left + column as f64 * (width + gap), y, width, height: self.height_px };
                let words = Words {
                    x: has_x(column),
                    x_label: !is_shared,
                    y: column == 0 || !(has_rows || is_shared) || (is_shared && row[column - 1].is_blank()),
                    title_px,
                    size: if self.grid.is_some() { SMALL } else { 1.0 },
                };
                panel.write(&mut svg, labels, &area, &words);
                if !is_shared && !has_rows && (column == 0 || self.grid.is_none()) {
                    names.write(labels, &panel.y.label, &area);
                }
            }
            last_bottom = y + self.height_px;
            let below_px = row.iter().map(Panel::below_px).fold(0.0, f64::max);
            y += self.height_px + if is_shared && index < last { SHARED_GAP_PX } else { below_px };
        }
        if let Some(panel) = self.panels.first().filter(|_| is_shared) {
            let whole =
                PanelArea { x: left, y: first_y, width: self.width_px() - left - RIGHT, height: last_bottom - first_y };
            names.write(labels, &panel.y.label, &whole);
            panel.write_x_label(labels, &whole);
        }
        if let Some(axis) = self.colours() {
            y = bar::write(&mut svg, labels, axis, (left, y - CUT_INLINE), self.width_px() - left - RIGHT);
        }
        (svg, y)
    }

    /// Returns the legend in the required number of lines.
    fn legend_lines(&self) -> Vec<Vec<(Look, &str)>> {
        let mut lines = Vec::new();
        for entries in &self.legend {
            let (mut line, mut x) = (Vec::new(), MARGIN);
            for (look, name) in entries {
                let length = TO_NAME + width_px(name, SIZE_PX);
                if !line.is_empty() && x + length > self.width_px() - MARGIN / 2.0 {
                    lines.push(std::mem::take(&mut line));
                    x = MARGIN;
                }
                line.push((*look, name.as_str()));
                x += length + TO_NEXT;
            }
            lines.push(line);
        }
        lines
    }

    /// Returns the positions of the vertical axes' names, so that they are next to the numbers.
    fn upward_names(&self, has_rows: bool) -> UpwardNames {
        let is_shared = self.grid.is_some_and(|grid| grid.shared);
        let rows = self.panels.len().div_ceil(self.columns()) as f64;
        let between_px = if is_shared { (rows - 1.0) * (self.height_px + SHARED_GAP_PX) } else { 0.0 };
        let length_px = self.height_px + between_px + LABEL_LINE;
        let of_numbers = |panel: &Panel| panel.numbers_upward_px(self.height_px);
        let numbers_px = if has_rows { 0.0 } else { self.panels.iter().map(of_numbers).fold(0.0, f64::max) };
        let to_label_px = (TO_NUMBERS + numbers_px + TO_LABEL).max(LEAST_TO_LABEL);
        let lines = |panel: &Panel| wrapped(&panel.y.label, SIZE_PX, length_px).len() as f64;
        let lines = self.panels.iter().map(lines).fold(1.0, f64::max);
        UpwardNames { to_label_px, length_px, left_px: (to_label_px + LABEL_LINE * lines + 4.0).max(LEFT) }
    }

    fn columns(&self) -> usize {
        self.grid.map_or(self.panels.len(), |grid| grid.columns).max(1)
    }

    /// Returns the axis that shows the meaning of the cells' colours.
    fn colours(&self) -> Option<&ChartAxis> {
        self.panels.iter().flat_map(|panel| &panel.marks).find_map(|mark| match mark {
            Mark::Cells(axis, _) => Some(axis),
            _ => None,
        })
    }

    fn width_px(&self) -> f64 {
        self.grid.map_or(WIDTH, |grid| grid.width_px)
    }

    /// Space for the panels' own titles, which are at most `title_px` wide.
    fn above_panel_px(&self, title_px: f64) -> f64 {
        let lines = self.panels.iter().map(|panel| panel.title_lines(title_px).len()).max().unwrap_or(0);
        if lines == 0 { 0.0 } else { TITLE_LINE + LABEL_LINE * (lines - 1) as f64 }
    }
}

/// Positions of the vertical axes' names.
struct UpwardNames {
    /// Distance from a panel to the baseline of a name, px.
    to_label_px: f64,
    /// Largest length of a line of a name, px.
    length_px: f64,
    /// Space for numbers and name, px.
    left_px: f64,
}

impl UpwardNames {
    fn write(&self, labels: &mut Vec<Label>, name: &str, area: &PanelArea) {
        let lines = wrapped(name, SIZE_PX, self.length_px);
        for (line, text) in lines.iter().rev().enumerate() {
            let at = (area.x - self.to_label_px - LABEL_LINE * line as f64, area.y + area.height / 2.0);
            labels.push(Label { is_upright: true, ..Label::fixed(at, "mid", text) });
        }
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn write_stroke(svg: &mut String, class: &str, from: (f64, f64), to: (f64, f64)) {
    let ((x1, y1), (x2, y2)) = (from, to);
    let _ = writeln!(svg, "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_is_drawn_at_its_fraction_of_the_range_within_the_panel() {
        let axis = ChartAxis { range: (1.0, 100.0), ..ChartAxis::log("", [], (1.0, 1.0)) };
        assert!((axis.share(10.0) - 0.5).abs() < 1e-12);
        let look = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: true, line: LineStyle::None };
        let panel = Panel {
            x: axis,
            y: ChartAxis::linear("y", (0.0, 1.0)),
            marks: vec![
                Mark::Curve(look, vec![(0.0, 2.0)]),
                Mark::Words((1.0, 1.0), (0.0, 0.0), Anchor::Start, "a < b & c".to_owned()),
            ],
        };
        let svg = Figure { height_px: 100.0, panels: vec![panel], ..Figure::default() }.svg();
        assert!(svg.contains("cx=\"72.0\" cy=\"64.0\"") && svg.contains("a &lt; b &amp; c"), "{svg}");
    }

    fn panel(y: &str, marks: Vec<Mark>) -> Panel {
        Panel { x: ChartAxis::linear("x, mm", (0.0, 10.0)), y: ChartAxis::linear(y, (0.0, 10.0)), marks }
    }

    #[test]
    fn a_line_has_a_gap_where_nothing_was_measured() {
        let look = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: true, line: LineStyle::Solid };
        let points = [1.0, 2.0, f64::NAN, 4.0, 5.0].map(|y| (y, y)).to_vec();
        let svg =
            Figure { height_px: 100.0, panels: vec![panel("y", vec![Mark::Curve(look, points)])], ..Figure::default() }
                .svg();
        assert_eq!((svg.matches("<polyline").count(), svg.matches("<circle").count()), (2, 4), "{svg}");
        assert!(!svg.contains("NaN"));
    }

    #[test]
    fn saved_figure_is_light_and_marked_and_wraps_its_title() {
        let title = "a title that is much wider than a figure of a page which is as wide as a telephone";
        let grid = Some(Grid { columns: 1, width_px: 440.0, shared: false });
        let figure = Figure {
            title: title.to_owned(),
            height_px: 100.0,
            panels: vec![panel("y", Vec::new())],
            grid,
            ..Figure::default()
        };
        let saved = figure.saved();
        assert!(saved.contains(SVG_MARK) && saved.contains(".blue{") && !saved.contains("prefers-color-scheme"));
        assert!(saved.matches("class=\"title\"").count() > 1, "{saved}");
        assert!(figure.svg().contains("prefers-color-scheme") && !figure.svg().contains(SVG_MARK));
    }

    #[test]
    fn wide_numbers_and_long_names_have_room_and_a_legend_wraps() {
        let look = Look::markers(Hue::Blue, Shape::Circle);
        let far = ChartAxis::linear("a quantity with a name that is longer than its panel is high, mN", (0.0, 4e-5));
        let figure = Figure {
            height_px: 100.0,
            panels: vec![Panel { y: far, ..panel("", Vec::new()) }],
            grid: Some(Grid { columns: 1, width_px: 440.0, shared: false }),
            legend: vec![(0..4).map(|i| (look, format!("a series of a certain length {i}"))).collect()],
            ..Figure::default()
        };
        let svg = figure.inline();
        assert!(svg.matches("rotate(-90)").count() > 1, "{svg}");
        let rows: std::collections::BTreeSet<&str> =
            svg.split("cy=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        assert_eq!(rows.len(), 4, "one entry has room in a line: {svg}");
    }

    #[test]
    fn shared_axes_are_named_once_and_colours_have_a_bar() {
        let cell = ColouredCell { x: (0.0, 1.0), y: (0.0, 1.0), value: 3.0 };
        let colours = ChartAxis::linear("output, V", (0.0, 7.0));
        let cells = || vec![Mark::Cells(colours.clone(), vec![cell]), Mark::Title("unit 1, channel 2".to_owned())];
        let figure = Figure {
            height_px: 60.0,
            panels: (0..15).map(|_| panel("y, mm", cells())).collect(),
            grid: Some(Grid { columns: 4, width_px: 440.0, shared: true }),
            ..Figure::default()
        };
        let svg = figure.inline();
        for name in ["x, mm", "y, mm", "output, V"] {
            assert_eq!(svg.matches(&format!(">{name}<")).count(), 1, "{name}: {svg}");
        }
        assert!(svg.contains(">unit 1,<") && svg.contains(">channel 2<") && svg.contains(">6<"), "{svg}");
    }
}
