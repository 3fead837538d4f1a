//! One pair of axes and the marks between them.

use super::axis::{AxisScale, ChartAxis};
use super::labels::{BOLD, Label, LabelRank, SIZE_PX};
use super::letters::{shortened, width_px, wrapped};
use super::look::{Hue, Look, write_line, write_marker};
use super::ramp::{LEVELS, Ramp};
use super::{LABEL_LINE, LEFT_OF_ROWS, NOTE_LINE, TO_NUMBERS, write_stroke};
use std::fmt::Write as _;

/// One pair of axes and the marks between them.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Horizontal axis, to the right.
    pub x: ChartAxis,
    /// Vertical axis, upward; rows are counted downward.
    pub y: ChartAxis,
    /// Marks in drawing order.
    pub marks: Vec<Mark>,
}

/// Something drawn in a panel.
#[derive(Clone, Debug)]
pub enum Mark {
    /// Points, with or without a connecting line; a line has a gap where a point isn't finite.
    Curve(Look, Vec<(f64, f64)>),
    /// A step curve: the value starts at 0, changes at each point to the point's value, and remains there until the next.
    Steps(Look, Vec<(f64, f64)>),
    /// A ring that highlights a point.
    Ring((f64, f64)),
    /// Strokes, each from one point to another.
    Strokes(Hue, Vec<((f64, f64), (f64, f64))>),
    /// Columns, each from 0 up to a y and from one x to another, and the part of that width that they occupy.
    Columns(Hue, WidthPart, Vec<((f64, f64), f64)>),
    /// Rectangles coloured by a value on a separate axis, see [`Ramp`]; a figure has one such axis.
    Cells(ChartAxis, Vec<ColouredCell>),
    /// Title above a panel.
    Title(String),
    /// Nothing: the panel's space is left empty.
    Blank,
    /// A line across the complete panel at an x, and a word next to the line.
    At(f64, String),
    /// A line across the complete panel at a y, and a word above the line.
    Level(f64, String),
    /// Words at a point: their offset to the right and down, px, and the part of the words that is placed there.
    Words((f64, f64), (f64, f64), Anchor, String),
}

/// One of several equal parts of a width.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WidthPart {
    /// Index of the part, from 0.
    pub index: usize,
    /// Number of parts.
    pub of: usize,
}

/// A rectangle between two values along each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColouredCell {
    /// Left and right side.
    pub x: (f64, f64),
    /// Lower and upper side.
    pub y: (f64, f64),
    /// Value shown by the colour.
    pub value: f64,
}

/// Part of the words that is at their point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Their start.
    Start,
    /// Their middle.
    Middle,
    /// Their end.
    End,
}

/// Space below a panel, px. The second constant is the part for the axis' name.
const BELOW_AXIS: f64 = 68.0;
const NAME_LINE: f64 = 28.0;
/// Height of the numbers next to an axis.
const LINE_PX: f64 = 14.0;
/// Space that a number below an axis needs beyond its width.
const BESIDE_NUMBER: f64 = 5.0;

/// Area of a panel, px.
pub(super) struct PanelArea {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

/// Texts next to a panel, and the size of its markers.
pub(super) struct Words {
    /// Whether numbers are below the panel.
    pub x: bool,
    /// Whether the name of the horizontal axis is below the panel.
    pub x_label: bool,
    /// Whether numbers are next to the panel.
    pub y: bool,
    /// Largest width of the panel's title, px.
    pub title_px: f64,
    pub size: f64,
}

impl Panel {
    /// Whether the panel's space is left empty.
    pub(super) fn is_blank(&self) -> bool {
        matches!(self.marks.as_slice(), [Mark::Blank])
    }

    /// Space for the texts below the panel, px.
    pub(super) fn below_px(&self) -> f64 {
        let of_label = if self.x.label.is_empty() { NAME_LINE } else { 0.0 };
        BELOW_AXIS + NOTE_LINE * self.more_lines_below() as f64 - of_label
    }

    /// Number of lines of the numbers below the panel, without the first line.
    fn more_lines_below(&self) -> usize {
        let ticks = self.x.ticks(f64::INFINITY, |_| 0.0);
        ticks.iter().map(|(_, text)| text.lines().count()).max().unwrap_or(1).max(1) - 1
    }

    /// Width of the widest number next to the panel, px, for this height of the panel.
    pub(super) fn numbers_upward_px(&self, height_px: f64) -> f64 {
        let ticks = self.y.ticks(height_px, |_| LINE_PX);
        ticks.iter().map(|(_, text)| width_px(text, SIZE_PX)).fold(0.0, f64::max)
    }

    /// Returns the panel's title in one or two lines, each shortened to fit.
    pub(super) fn title_lines(&self, most_px: f64) -> Vec<String> {
        let title = self.marks.iter().find_map(|mark| match mark {
            Mark::Title(title) => Some(title),
            _ => None,
        });
        let Some(title) = title else { return Vec::new() };
        let size_px = BOLD * SIZE_PX;
        // a name of two parts is broken between them
        let lines = match title.split_once(", ") {
            _ if width_px(title, size_px) <= most_px => vec![title.clone()],
            Some((first, second)) => vec![format!("{first},"), second.to_owned()],
            None => {
                let lines = wrapped(title, size_px, most_px);
                [&lines[..1], &[lines[1..].join(" ")]].concat()
            }
        };
        lines.iter().map(|line| shortened(line, size_px, most_px)).collect()
    }

    /// Writes the name of the axis below the panel.
    pub(super) fn write_x_label(&self, labels: &mut Vec<Label>, area: &PanelArea) {
        let below_ticks = NOTE_LINE * self.more_lines_below() as f64;
        let at = (area.x + area.width / 2.0, area.y + area.height + 38.0 + below_ticks);
        labels.push(Label::fixed(at, "mid", &self.x.label));
    }

    /// Draws the panel. The texts are laid out later, together with those of all panels.
    pub(super) fn write(&self, svg: &mut String, labels: &mut Vec<Label>, area: &PanelArea, words: &Words) {
        self.write_axes(svg, labels, area, words);
        for (line, text) in self.title_lines(words.title_px).iter().rev().enumerate() {
            labels.push(Label::fixed((area.x, area.y - 9.0 - LABEL_LINE * line as f64), "head", text));
        }
        for mark in &self.marks {
            self.write_mark(svg, labels, area, mark, words.size);
        }
    }

    /// Returns the position of a point, px. A point outside the panel is drawn on its edge.
    fn at(&self, area: &PanelArea, (x, y): (f64, f64)) -> (f64, f64) {
        let up = self.y.share(y);
        let down = if matches!(self.y.scale, AxisScale::Rows(_)) { up } else { 1.0 - up };
        (area.x + area.width * self.x.share(x).clamp(0.0, 1.0), area.y + area.height * down.clamp(0.0, 1.0))
    }

    fn write_axes(&self, svg: &mut String, labels: &mut Vec<Label>, area: &PanelArea, words: &Words) {
        let (right, bottom) = (area.x + area.width, area.y + area.height);
        for (value, text) in self.y.ticks(area.height, |_| LINE_PX) {
            let y = self.at(area, (self.x.range.0, value)).1;
            match &self.y.scale {
                AxisScale::Rows(rows) if (value as usize).is_multiple_of(2) => {
                    let (x, width, height) = (area.x, area.width, area.height / rows.len() as f64);
                    let top = y - height / 2.0;
                    let _ = writeln!(
                        svg,
                        "<rect class=\"band\" x=\"{x:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"/>"
                    );
                }
                AxisScale::Rows(_) => {}
                _ => write_stroke(svg, "grid", (area.x, y), (right, y)),
            }
            let lines: Vec<&str> = text.lines().filter(|_| words.y).collect();
            let first_y = y + 4.5 - LINE_PX / 2.0 * (lines.len().max(1) - 1) as f64;
            for (line, text) in lines.into_iter().enumerate() {
                let (class, size) = if line == 0 { ("end", SIZE_PX) } else { ("end small", 12.0) };
                let at = (area.x - TO_NUMBERS, first_y + LINE_PX * line as f64);
                labels.push(Label::tick(at, class, &shortened(text, size, LEFT_OF_ROWS - TO_NUMBERS - 3.0)));
            }
        }
        for (value, text) in self.x.ticks(area.width, |text| width_px(text, SIZE_PX) + BESIDE_NUMBER) {
            let x = self.at(area, (value, self.y.range.0)).0;
            write_stroke(svg, "grid", (x, area.y), (x, bottom));
            for (line, text) in text.lines().enumerate().filter(|_| words.x) {
                let class = if line == 0 { "mid" } else { "mid small" };
                labels.push(Label::tick((x, bottom + 18.0 + NOTE_LINE * line as f64), class, text));
            }
        }
        let _ = writeln!(
            svg,
            "<rect class=\"axis\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
            area.x, area.y, area.width, area.height
        );
        if words.x && words.x_label {
            self.write_x_label(labels, area);
        }
    }

    fn write_mark(&self, svg: &mut String, labels: &mut Vec<Label>, area: &PanelArea, mark: &Mark, size: f64) {
        let at = |point: (f64, f64)| self.at(area, point);
        let mut word = |mark: (f64, f64), (right, down): (f64, f64), class: &'static str, text: &str| {
            let label = Label::fixed((mark.0 + right, mark.1 + down), class, text);
            labels.push(Label { rank: LabelRank::Word(mark), ..label });
        };
        match mark {
            Mark::Curve(look, points) => {
                for joined in points.split(|(x, y)| !(x.is_finite() && y.is_finite())) {
                    let joined: Vec<(f64, f64)> = joined.iter().map(|point| at(*point)).collect();
                    write_line(svg, *look, &joined);
                    joined.into_iter().for_each(|point| write_marker(svg, *look, point, size));
                }
            }
            Mark::Steps(look, points) => {
                let mut reached = 0.0;
                let mut corners = vec![(self.x.range.0, reached)];
                for (x, y) in points {
                    corners.extend([(*x, reached), (*x, *y)]);
                    reached = *y;
                }
                corners.push((self.x.range.1, reached));
                write_line(svg, *look, &corners.into_iter().map(at).collect::<Vec<_>>());
            }
            Mark::Ring(point) => {
                let (x, y) = at(*point);
                let _ = writeln!(svg, "<circle class=\"ring\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"9\"/>");
            }
            Mark::Strokes(hue, strokes) => {
                let path: String = strokes
                    .iter()
                    .map(|(from, to)| (at(*from), at(*to)))
                    .map(|((x1, y1), (x2, y2))| format!("M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}"))
                    .collect();
                let _ = writeln!(svg, "<path class=\"{} bar\" d=\"{path}\"/>", hue.name());
            }
            Mark::Columns(hue, part, columns) => {
                let column = |((from, to), value): &((f64, f64), f64)| {
                    let ((x1, y1), (x2, y2)) = (at((*from, *value)), at((*to, 0.0)));
                    let width = (x2 - x1) / part.of.max(1) as f64;
                    let (left, right) = (x1 + width * part.index as f64, x1 + width * (part.index + 1) as f64);
                    format!("M{left:.1} {y1:.1}H{right:.1}V{y2:.1}H{left:.1}z")
                };
                let path: String = columns.iter().filter(|(_, value)| *value > 0.0).map(column).collect();
                let _ = writeln!(svg, "<path class=\"{} column\" d=\"{path}\"/>", hue.name());
            }
            Mark::Cells(axis, cells) => write_cells(svg, axis, cells, at),
            Mark::Title(_) | Mark::Blank => {} // above the panel
            Mark::At(value, text) => {
                let x = at((*value, self.y.range.0)).0;
                write_stroke(svg, "rule", (x, area.y), (x, area.y + area.height));
                word((x, area.y), (6.0, 16.0), "word", text);
            }
            Mark::Level(value, text) => {
                let y = at((self.x.range.0, *value)).1;
                write_stroke(svg, "rule", (area.x, y), (area.x + area.width, y));
                word((area.x, y), (6.0, -6.0), "word", text);
            }
            Mark::Words(point, moved_px, anchor, text) => {
                let class = match anchor {
                    Anchor::Start => "word",
                    Anchor::Middle => "word mid",
                    Anchor::End => "word end",
                };
                word(at(*point), *moved_px, class, text);
            }
        }
    }
}

/// Draws cells; those of one colour are in one path, and neighbours of one colour in a row are one rectangle.
fn write_cells(svg: &mut String, axis: &ChartAxis, cells: &[ColouredCell], at: impl Fn((f64, f64)) -> (f64, f64)) {
    let tenths = |px: f64| (10.0 * px).round() as i64;
    let placed = |ColouredCell { x, y, value }: &ColouredCell| {
        let ((left, bottom), (right, top)) = (at((x.0, y.0)), at((x.1, y.1)));
        (Ramp::level(axis.share(*value)), tenths(top), tenths(bottom), tenths(left), tenths(right))
    };
    let mut placed: Vec<_> = cells.iter().filter(|cell| cell.value.is_finite()).map(placed).collect();
    placed.sort_unstable();
    placed.dedup_by(|next, row| {
        let is_next = (next.0, next.1, next.2) == (row.0, row.1, row.2) && (next.3 - row.4).abs() <= 1;
        row.4 = if is_next { next.4 } else { row.4 };
        is_next
    });
    let mut paths = vec![String::new(); LEVELS];
    for (level, top, bottom, left, right) in placed {
        let px = |tenths: i64| tenths as f64 / 10.0;
        let (top, bottom, left, right) = (px(top), px(bottom), px(left), px(right));
        let _ = write!(paths[level], "M{left} {top}H{right}V{bottom}H{left}z");
    }
    for (level, path) in paths.iter().enumerate().filter(|(_, path)| !path.is_empty()) {
        let _ = writeln!(svg, "<path class=\"{}\" shape-rendering=\"crispEdges\" d=\"{path}\"/>", Ramp::class(level));
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Figure, Grid};
    use super::*;

    #[test]
    fn equal_neighbours_are_one_rectangle_and_a_blank_panel_passes_its_numbers_on() {
        let axis = |label: &str| ChartAxis::linear(label, (0.0, 3.0));
        let cell = |x: f64, value: f64| ColouredCell { x: (x, x + 1.0), y: (0.0, 3.0), value };
        let row = vec![cell(0.0, 0.0), cell(1.0, 0.0), cell(2.0, 3.0)];
        let drawn = Panel { x: axis("x"), y: axis("y"), marks: vec![Mark::Cells(axis("output, V"), row)] };
        let blank = Panel { marks: vec![Mark::Blank], ..drawn.clone() };
        let grid = Some(Grid { columns: 2, width_px: 440.0, shared: true });
        let panels = vec![blank, drawn.clone(), drawn.clone(), drawn];
        let svg = Figure { height_px: 100.0, panels, grid, ..Figure::default() }.inline();
        assert_eq!(svg.matches("<rect class=\"axis\"").count(), 3 + 1, "three panels and the bar of colours");
        let cells = svg.split(" d=\"").skip(1).take(2).map(|path| path.matches('M').count());
        assert_eq!(cells.sum::<usize>(), 2, "{svg}");
        assert_eq!(svg.matches(">3</text>").count(), 2 + 2 + 1, "left of two panels, below two, and at the bar: {svg}");
    }
}
