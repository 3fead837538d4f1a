//! Charts as SVG, drawn by hand. A plotting library was considered: the common one writes colours into every element, so that
//! a figure can't follow the reader's light or dark, and it lays text out well only with a font library. This is all a study
//! needs: axes, curves, markers, rules and words, in colours that also the colour-blind tell apart, and shapes for print.

mod axis;

pub use axis::{Axis, Scale};

use std::borrow::Cow;
use std::fmt::Write as _;

/// Some panels under one title.
#[derive(Clone, Debug, Default)]
pub struct Figure {
    /// What it shows.
    pub title: String,
    /// On what that rests.
    pub subtitle: String,
    /// Height of the panels, px.
    pub height_px: f64,
    /// Side by side.
    pub panels: Vec<Panel>,
    /// What the marks mean, in lines.
    pub legend: Vec<Vec<(Look, String)>>,
    /// Lines below.
    pub notes: Vec<String>,
}

/// One pair of axes and what is drawn between them.
#[derive(Clone, Debug)]
pub struct Panel {
    /// To the right.
    pub x: Axis,
    /// Upward; rows are counted downward.
    pub y: Axis,
    /// In the order they are drawn.
    pub marks: Vec<Mark>,
}

/// Something drawn in a panel.
#[derive(Clone, Debug)]
pub enum Mark {
    /// Points, joined by a line or not.
    Curve(Look, Vec<(f64, f64)>),
    /// A ring around a point: it stands out.
    Ring((f64, f64)),
    /// A line right across at an x, and a word beside it.
    At(f64, String),
    /// A line right across at a y, and a word above it.
    Level(f64, String),
    /// Words at a point: how far right and down of it, px, and which of their ends is there.
    Words((f64, f64), (f64, f64), Anchor, String),
}

/// Which part of some words is at their point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Their start.
    Start,
    /// Their middle.
    Middle,
    /// Their end.
    End,
}

/// How a series looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// Which of the colours.
    pub hue: Hue,
    /// The marker; none: a line only.
    pub shape: Option<Shape>,
    /// Whether the marker is filled.
    pub filled: bool,
    /// The line between the points.
    pub line: Line,
}

/// The colours: they differ in lightness too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hue {
    /// A blue.
    Blue,
    /// An orange.
    Orange,
    /// A green.
    Green,
    /// For what is not a series.
    Grey,
}

/// The markers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Round.
    Circle,
    /// Four sides.
    Square,
    /// Point up.
    Triangle,
    /// A square on its corner.
    Diamond,
    /// Two strokes: never filled.
    Cross,
}

/// The lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// The points alone.
    None,
    /// Drawn through.
    Solid,
    /// Broken.
    Dashed,
}

const WIDTH: f64 = 900.0;
const LEFT: f64 = 72.0;
const LEFT_OF_ROWS: f64 = 172.0;
const RIGHT: f64 = 24.0;
const GAP: f64 = 44.0;
const TOP: f64 = 64.0;
const LEGEND_LINE: f64 = 22.0;
const BELOW_AXIS: f64 = 68.0;
const NOTE_LINE: f64 = 17.0;
/// Letters in a line of notes.
const NOTE_LETTERS: usize = 138;
/// Width of a letter, amply: to know where the next entry of the legend begins.
const LETTER_PX: f64 = 6.8;

const STYLE: &str = "\
text{font:13px system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;fill:#1f2328;stroke:none}
.title{font-size:17px;font-weight:600}.small{font-size:12px;fill:#57606a}.word{font-size:11.5px}
.end{text-anchor:end}.mid{text-anchor:middle}
.paper{fill:#ffffff}.band{fill:#f3f5f7}.grid{stroke:#e4e7eb;stroke-width:1}.axis{stroke:#57606a;stroke-width:1;fill:none}
.rule{stroke:#57606a;stroke-width:1.3;stroke-dasharray:2 3}
.blue{fill:#0b5cad;stroke:#0b5cad}.orange{fill:#d9730d;stroke:#d9730d}.green{fill:#12805c;stroke:#12805c}
.grey{fill:#57606a;stroke:#57606a}
.mark{stroke-width:1.8;stroke-linejoin:round}.hollow{fill:#ffffff}.line{fill:none;stroke-width:1.8}
.dashed{stroke-dasharray:6 4}.ring{fill:none;stroke:#1f2328;stroke-width:1.2}
@media (prefers-color-scheme:dark){
text{fill:#e6edf3}.small{fill:#9aa5b1}.paper{fill:#0d1117}.band{fill:#161b22}.hollow{fill:#0d1117}.grid{stroke:#262c34}
.axis,.rule{stroke:#9aa5b1}.ring{stroke:#e6edf3}.blue{fill:#58a6ff;stroke:#58a6ff}.orange{fill:#f0a050;stroke:#f0a050}
.green{fill:#4cc38a;stroke:#4cc38a}.grey{fill:#9aa5b1;stroke:#9aa5b1}
.mark.hollow{fill:#0d1117}.line{fill:none}}";

impl Figure {
    /// The figure as one SVG document.
    pub fn svg(&self) -> String {
        let notes: Vec<Cow<'_, str>> = self.notes.iter().flat_map(|note| textwrap::wrap(note, NOTE_LETTERS)).collect();
        let top = TOP + LEGEND_LINE * self.legend.len() as f64;
        let height = top + self.height_px + BELOW_AXIS + NOTE_LINE * notes.len() as f64;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} {height}\" \
             role=\"img\">\n<title>{title}</title>\n<style>\n{STYLE}\n</style>\n\
             <rect class=\"paper\" width=\"{WIDTH}\" height=\"{height}\"/>\n",
            title = escaped(&self.title)
        );
        write_text(&mut svg, (20.0, 28.0), "title", &self.title);
        write_text(&mut svg, (20.0, 48.0), "small", &self.subtitle);
        for (line, entries) in self.legend.iter().enumerate() {
            let (mut x, y) = (20.0, TOP + 8.0 + LEGEND_LINE * line as f64);
            for (look, name) in entries {
                write_line(&mut svg, *look, &[(x, y), (x + 28.0, y)]);
                write_marker(&mut svg, *look, (x + 14.0, y));
                write_text(&mut svg, (x + 36.0, y + 4.5), "", name);
                x += 36.0 + LETTER_PX * name.chars().count() as f64 + 20.0;
            }
        }
        let has_rows = self.panels.iter().any(|panel| matches!(panel.y.scale, Scale::Rows(_)));
        let left = if has_rows { LEFT_OF_ROWS } else { LEFT };
        let count = self.panels.len().max(1) as f64;
        let gap = if has_rows { GAP } else { GAP + LEFT };
        let width = (WIDTH - left - RIGHT - gap * (count - 1.0)) / count;
        for (index, panel) in self.panels.iter().enumerate() {
            let area = Area { x: left + index as f64 * (width + gap), y: top, width, height: self.height_px };
            panel.write(&mut svg, &area, index == 0 || !has_rows);
        }
        for (line, note) in notes.iter().enumerate() {
            let y = top + self.height_px + BELOW_AXIS + NOTE_LINE * line as f64;
            write_text(&mut svg, (20.0, y), "small", note);
        }
        svg + "</svg>\n"
    }
}

/// Where a panel is, px.
struct Area {
    x: f64,
    y: f64,
    width: f64,
    height: f64,
}

impl Panel {
    fn write(&self, svg: &mut String, area: &Area, names: bool) {
        let (right, bottom) = (area.x + area.width, area.y + area.height);
        let at = |(x, y): (f64, f64)| {
            let up = self.y.share(y);
            let down = if matches!(self.y.scale, Scale::Rows(_)) { up } else { 1.0 - up };
            (area.x + area.width * self.x.share(x).clamp(0.0, 1.0), area.y + area.height * down.clamp(0.0, 1.0))
        };
        for (value, told) in self.y.ticks() {
            let y = at((self.x.range.0, value)).1;
            match &self.y.scale {
                Scale::Rows(rows) if (value as usize).is_multiple_of(2) => {
                    let (x, width, height) = (area.x, area.width, area.height / rows.len() as f64);
                    let top = y - height / 2.0;
                    let _ = writeln!(
                        svg,
                        "<rect class=\"band\" x=\"{x:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"/>"
                    );
                }
                Scale::Rows(_) => {}
                _ => write_stroke(svg, "grid", (area.x, y), (right, y)),
            }
            if names {
                write_text(svg, (area.x - 9.0, y + 4.5), "end", &told);
            }
        }
        for (value, told) in self.x.ticks() {
            let x = at((value, self.y.range.0)).0;
            write_stroke(svg, "grid", (x, area.y), (x, bottom));
            write_text(svg, (x, bottom + 18.0), "mid", &told);
        }
        let _ = writeln!(
            svg,
            "<rect class=\"axis\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
            area.x, area.y, area.width, area.height
        );
        write_text(svg, (area.x + area.width / 2.0, bottom + 38.0), "mid", &self.x.label);
        if names && !self.y.label.is_empty() {
            let (x, y) = (area.x - 50.0, area.y + area.height / 2.0);
            let told = escaped(&self.y.label);
            let _ =
                writeln!(svg, "<text class=\"mid\" transform=\"translate({x:.1} {y:.1}) rotate(-90)\">{told}</text>");
        }
        for mark in &self.marks {
            match mark {
                Mark::Curve(look, points) => {
                    let points: Vec<(f64, f64)> = points.iter().map(|point| at(*point)).collect();
                    write_line(svg, *look, &points);
                    points.into_iter().for_each(|point| write_marker(svg, *look, point));
                }
                Mark::Ring(point) => {
                    let (x, y) = at(*point);
                    let _ = writeln!(svg, "<circle class=\"ring\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"9\"/>");
                }
                Mark::At(value, told) => {
                    let x = at((*value, self.y.range.0)).0;
                    write_stroke(svg, "rule", (x, area.y), (x, bottom));
                    write_text(svg, (x + 6.0, area.y + 16.0), "word", told);
                }
                Mark::Level(value, told) => {
                    let y = at((self.x.range.0, *value)).1;
                    write_stroke(svg, "rule", (area.x, y), (right, y));
                    write_text(svg, (area.x + 6.0, y - 6.0), "word", told);
                }
                Mark::Words(point, (right_px, down_px), anchor, told) => {
                    let (x, y) = at(*point);
                    let class = match anchor {
                        Anchor::Start => "word",
                        Anchor::Middle => "word mid",
                        Anchor::End => "word end",
                    };
                    write_text(svg, (x + right_px, y + down_px), class, told);
                }
            }
        }
    }
}

fn write_line(svg: &mut String, look: Look, points: &[(f64, f64)]) {
    let dashed = match look.line {
        Line::None => return,
        Line::Solid => "",
        Line::Dashed => " dashed",
    };
    let path: String = points.iter().map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
    let _ = writeln!(svg, "<polyline class=\"{} line{dashed}\" points=\"{}\"/>", look.hue.name(), path.trim_end());
}

fn write_marker(svg: &mut String, look: Look, (x, y): (f64, f64)) {
    let Some(shape) = look.shape else { return };
    let class = format!("{} mark{}", look.hue.name(), if look.filled { "" } else { " hollow" });
    let polygon = |corners: &[(f64, f64)]| {
        let points: String = corners.iter().map(|(dx, dy)| format!("{:.1},{:.1} ", x + dx, y + dy)).collect();
        format!("<polygon class=\"{class}\" points=\"{}\"/>", points.trim_end())
    };
    let drawn = match shape {
        Shape::Circle => format!("<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.2\"/>"),
        Shape::Square => polygon(&[(-3.8, -3.8), (3.8, -3.8), (3.8, 3.8), (-3.8, 3.8)]),
        Shape::Triangle => polygon(&[(0.0, -5.2), (4.8, 3.6), (-4.8, 3.6)]),
        Shape::Diamond => polygon(&[(0.0, -5.4), (5.4, 0.0), (0.0, 5.4), (-5.4, 0.0)]),
        Shape::Cross => {
            let (left, right, up, down) = (x - 4.0, x + 4.0, y - 4.0, y + 4.0);
            format!(
                "<path class=\"{class}\" d=\"M{left:.1} {up:.1}L{right:.1} {down:.1}M{left:.1} {down:.1}L{right:.1} {up:.1}\"/>"
            )
        }
    };
    svg.push_str(&drawn);
    svg.push('\n');
}

fn write_stroke(svg: &mut String, class: &str, from: (f64, f64), to: (f64, f64)) {
    let ((x1, y1), (x2, y2)) = (from, to);
    let _ = writeln!(svg, "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>");
}

fn write_text(svg: &mut String, (x, y): (f64, f64), class: &str, told: &str) {
    let _ = writeln!(svg, "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>", escaped(told));
}

impl Hue {
    fn name(self) -> &'static str {
        match self {
            Hue::Blue => "blue",
            Hue::Orange => "orange",
            Hue::Green => "green",
            Hue::Grey => "grey",
        }
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_where_its_share_of_the_range_is_and_stays_in_the_panel() {
        let axis = Axis { range: (1.0, 100.0), ..Axis::log("", [], (1.0, 1.0)) };
        assert!((axis.share(10.0) - 0.5).abs() < 1e-12);
        let look = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: true, line: Line::None };
        let panel = Panel {
            x: axis,
            y: Axis::linear("y", (0.0, 1.0)),
            marks: vec![
                Mark::Curve(look, vec![(0.0, 2.0)]),
                Mark::Words((1.0, 1.0), (0.0, 0.0), Anchor::Start, "a < b & c".to_owned()),
            ],
        };
        let svg = Figure { height_px: 100.0, panels: vec![panel], ..Figure::default() }.svg();
        assert!(svg.contains("cx=\"72.0\" cy=\"64.0\"") && svg.contains("a &lt; b &amp; c"), "{svg}");
    }
}
