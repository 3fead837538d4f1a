//! Charts as SVG, drawn by hand. A plotting library was considered: the common one writes colours into every element, so that
//! a figure can't follow the reader's light or dark, and it lays text out well only with a font library. This is all a study
//! or a report needs: axes, curves, markers, columns, cells and words, in colours that also the colour-blind tell apart, and
//! shapes for print.
//!
//! A figure stands alone as an SVG file ([`Figure::svg`]), or in a page that has [`STYLE`] and tells title and notes itself
//! ([`Figure::inline`]).

mod axis;
mod look;
mod ramp;

pub use axis::{ChartAxis, Scale};
pub use look::{Hue, Line, Look, STYLE, Shape};
pub use ramp::{LEVELS, Ramp};

use look::{write_line, write_marker};
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
    /// Side by side, or in rows.
    pub panels: Vec<Panel>,
    /// None: all side by side.
    pub grid: Option<Grid>,
    /// What the marks mean, in lines.
    pub legend: Vec<Vec<(Look, String)>>,
    /// Lines below.
    pub notes: Vec<String>,
}

/// Small panels, row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Panels in a row; the axis upward is named at the first.
    pub columns: usize,
    /// Width of the figure, px.
    pub width_px: f64,
    /// Whether all panels have the same axes: they are told once a row and once a column.
    pub shared: bool,
}

/// One pair of axes and what is drawn between them.
#[derive(Clone, Debug)]
pub struct Panel {
    /// To the right.
    pub x: ChartAxis,
    /// Upward; rows are counted downward.
    pub y: ChartAxis,
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
    /// Strokes from one point to another each.
    Strokes(Hue, Vec<((f64, f64), (f64, f64))>),
    /// Columns from 0 up to a y each, from one x to another.
    Columns(Hue, Vec<((f64, f64), f64)>),
    /// Rectangles coloured by a share from 0 to 1, see [`Ramp`].
    Cells(Vec<Cell>),
    /// What a panel shows, above it.
    Title(String),
    /// A line right across at an x, and a word beside it.
    At(f64, String),
    /// A line right across at a y, and a word above it.
    Level(f64, String),
    /// Words at a point: how far right and down of it, px, and which of their ends is there.
    Words((f64, f64), (f64, f64), Anchor, String),
}

/// A rectangle between two values along each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Left and right.
    pub x: (f64, f64),
    /// Below and above.
    pub y: (f64, f64),
    /// Its place on the ramp of colours, 0 to 1.
    pub share: f64,
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

const WIDTH: f64 = 900.0;
const LEFT: f64 = 72.0;
const LEFT_OF_ROWS: f64 = 172.0;
const RIGHT: f64 = 24.0;
const GAP: f64 = 44.0;
/// Between the panels of a grid, px: room for the numbers beside them.
const GAP_OF_GRID: f64 = 50.0;
/// The same where their axes are told once, px: room for the ends of two axes beside each other.
pub const SHARED_GAP_PX: f64 = 20.0;
/// Above the panels of a figure whose page tells its title, and what is cut off below: the page has distances of its own, px.
const TOP_INLINE: f64 = 14.0;
const CUT_INLINE: f64 = 22.0;
/// A panel's title, px.
const TITLE_LINE: f64 = 24.0;
/// How large markers are in a grid.
const SMALL: f64 = 0.7;
const TOP: f64 = 64.0;
const LEGEND_LINE: f64 = 22.0;
const BELOW_AXIS: f64 = 68.0;
/// The part of it that an axis' label takes.
const LABEL_LINE: f64 = 28.0;
const NOTE_LINE: f64 = 17.0;
/// Letters in a line of notes.
const NOTE_LETTERS: usize = 138;
/// Width of a letter, amply: to know where the next entry of the legend begins, and which numbers have room below an axis.
const LETTER_PX: f64 = 6.8;
/// Height of the numbers beside an axis.
const LINE_PX: f64 = 14.0;

impl Figure {
    /// The figure as one SVG document.
    pub fn svg(&self) -> String {
        let notes: Vec<Cow<'_, str>> =
            self.notes.iter().flat_map(|note| textwrap::wrap(note, self.note_letters())).collect();
        let (drawn, bottom) = self.drawn(TOP);
        let (width, height) = (self.width_px(), bottom + NOTE_LINE * notes.len() as f64);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" role=\"img\">\n<title>{title}</title>\n<style>\n{STYLE}{ramp}</style>\n\
             <rect class=\"paper\" width=\"{width}\" height=\"{height}\"/>\n",
            title = escaped(&self.title),
            ramp = if self.has_cells() { Ramp::style() } else { String::new() },
        );
        write_text(&mut svg, (20.0, 28.0), "title", &self.title);
        write_text(&mut svg, (20.0, 48.0), "small", &self.subtitle);
        svg += &drawn;
        for (line, note) in notes.iter().enumerate() {
            write_text(&mut svg, (20.0, bottom + NOTE_LINE * line as f64), "small", note);
        }
        svg + "</svg>\n"
    }

    /// The figure as an element of a page that has [`STYLE`] and [`Ramp::style`]: title, subtitle and notes are for the page to tell.
    pub fn inline(&self) -> String {
        let (drawn, bottom) = self.drawn(TOP_INLINE);
        let height = bottom - CUT_INLINE;
        format!(
            "<svg viewBox=\"0 0 {} {height}\" role=\"img\" aria-label=\"{}\">\n{drawn}</svg>\n",
            self.width_px(),
            escaped(&self.title)
        )
    }

    /// Legend and panels below so many px, and where they end.
    fn drawn(&self, above_px: f64) -> (String, f64) {
        let mut svg = String::new();
        for (line, entries) in self.legend.iter().enumerate() {
            let (mut x, y) = (20.0, above_px + 8.0 + LEGEND_LINE * line as f64);
            for (look, name) in entries {
                write_line(&mut svg, *look, &[(x, y), (x + 28.0, y)]);
                write_marker(&mut svg, *look, (x + 14.0, y), 1.0);
                write_text(&mut svg, (x + 36.0, y + 4.5), "", name);
                x += 36.0 + LETTER_PX * name.chars().count() as f64 + 20.0;
            }
        }
        let has_rows = self.panels.iter().any(|panel| matches!(panel.y.scale, Scale::Rows(_)));
        let is_shared = self.grid.is_some_and(|grid| grid.shared);
        let left = if has_rows { LEFT_OF_ROWS } else { LEFT };
        let gap = match self.grid {
            Some(_) if is_shared => SHARED_GAP_PX,
            Some(_) => GAP_OF_GRID,
            None if has_rows => GAP,
            None => GAP + LEFT,
        };
        let columns = self.grid.map_or(self.panels.len(), |grid| grid.columns).max(1);
        let width = (self.width_px() - left - RIGHT - gap * (columns as f64 - 1.0)) / columns as f64;
        let mut y = above_px + LEGEND_LINE * self.legend.len() as f64;
        let rows = self.panels.chunks(columns);
        let last = rows.len().saturating_sub(1);
        for (index, row) in rows.enumerate() {
            y += self.above_panel_px();
            // a panel with none below it tells its axis to the right
            let has_x = |column: usize| !is_shared || (index + 1) * columns + column >= self.panels.len();
            for (column, panel) in row.iter().enumerate() {
                let area = Area { x: left + column as f64 * (width + gap), y, width, height: self.height_px };
                let words = Words {
                    x: has_x(column),
                    y: column == 0 || !(has_rows || is_shared),
                    label: column == 0 || self.grid.is_none() && !has_rows,
                    size: if self.grid.is_some() { SMALL } else { 1.0 },
                };
                panel.write(&mut svg, &area, &words);
            }
            let below_px = row.iter().map(Panel::below_px).fold(0.0, f64::max);
            y += self.height_px + if is_shared && index < last { SHARED_GAP_PX } else { below_px };
        }
        (svg, y)
    }

    fn has_cells(&self) -> bool {
        self.panels.iter().flat_map(|panel| &panel.marks).any(|mark| matches!(mark, Mark::Cells(_)))
    }

    fn width_px(&self) -> f64 {
        self.grid.map_or(WIDTH, |grid| grid.width_px)
    }

    fn note_letters(&self) -> usize {
        (NOTE_LETTERS as f64 * self.width_px() / WIDTH) as usize
    }

    /// Room for the panels' own titles.
    fn above_panel_px(&self) -> f64 {
        let is_title = |mark: &Mark| matches!(mark, Mark::Title(_));
        if self.panels.iter().any(|panel| panel.marks.iter().any(is_title)) { TITLE_LINE } else { 0.0 }
    }
}

/// Where a panel is, px.
struct Area {
    x: f64,
    y: f64,
    width: f64,
    height: f64,
}

/// What is written beside a panel, and how large its markers are.
struct Words {
    x: bool,
    y: bool,
    /// What the axis upward is.
    label: bool,
    size: f64,
}

impl Panel {
    /// Room for what stands below it, px.
    fn below_px(&self) -> f64 {
        let lines =
            self.x.ticks(f64::INFINITY, |_| 0.0).iter().map(|(_, told)| told.lines().count()).max().unwrap_or(1).max(1);
        let of_label = if self.x.label.is_empty() { LABEL_LINE } else { 0.0 };
        BELOW_AXIS + NOTE_LINE * (lines - 1) as f64 - of_label
    }

    fn write(&self, svg: &mut String, area: &Area, words: &Words) {
        let (right, bottom) = (area.x + area.width, area.y + area.height);
        let at = |(x, y): (f64, f64)| {
            let up = self.y.share(y);
            let down = if matches!(self.y.scale, Scale::Rows(_)) { up } else { 1.0 - up };
            (area.x + area.width * self.x.share(x).clamp(0.0, 1.0), area.y + area.height * down.clamp(0.0, 1.0))
        };
        for (value, told) in self.y.ticks(area.height, |_| LINE_PX) {
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
            if words.y {
                write_text(svg, (area.x - 9.0, y + 4.5), "end", &told);
            }
        }
        let mut below_ticks = 0.0;
        for (value, told) in self.x.ticks(area.width, |told| LETTER_PX * (told.chars().count() + 1) as f64) {
            let x = at((value, self.y.range.0)).0;
            write_stroke(svg, "grid", (x, area.y), (x, bottom));
            for (line, told) in told.lines().enumerate().filter(|_| words.x) {
                let class = if line == 0 { "mid" } else { "mid small" };
                write_text(svg, (x, bottom + 18.0 + NOTE_LINE * line as f64), class, told);
            }
            below_ticks = NOTE_LINE * (told.lines().count().max(1) - 1) as f64;
        }
        let _ = writeln!(
            svg,
            "<rect class=\"axis\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
            area.x, area.y, area.width, area.height
        );
        if words.x && !self.x.label.is_empty() {
            write_text(svg, (area.x + area.width / 2.0, bottom + 38.0 + below_ticks), "mid", &self.x.label);
        }
        if words.label && !self.y.label.is_empty() {
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
                    points.into_iter().for_each(|point| write_marker(svg, *look, point, words.size));
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
                Mark::Columns(hue, columns) => {
                    let column = |((from, to), value): &((f64, f64), f64)| {
                        let ((x1, y1), (x2, y2)) = (at((*from, *value)), at((*to, 0.0)));
                        format!("M{x1:.1} {y1:.1}H{x2:.1}V{y2:.1}H{x1:.1}z")
                    };
                    let path: String = columns.iter().filter(|(_, value)| *value > 0.0).map(column).collect();
                    let _ = writeln!(svg, "<path class=\"{} column\" d=\"{path}\"/>", hue.name());
                }
                Mark::Cells(cells) => write_cells(svg, cells, at),
                Mark::Title(told) => write_text(svg, (area.x, area.y - 9.0), "head", told),
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

fn write_stroke(svg: &mut String, class: &str, from: (f64, f64), to: (f64, f64)) {
    let ((x1, y1), (x2, y2)) = (from, to);
    let _ = writeln!(svg, "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>");
}

fn write_text(svg: &mut String, (x, y): (f64, f64), class: &str, told: &str) {
    let _ = writeln!(svg, "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>", escaped(told));
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Cells, those of one colour in one path.
fn write_cells(svg: &mut String, cells: &[Cell], at: impl Fn((f64, f64)) -> (f64, f64)) {
    let mut paths = vec![String::new(); LEVELS];
    for Cell { x, y, share } in cells.iter().filter(|cell| cell.share.is_finite()) {
        let ((left, bottom), (right, top)) = (at((x.0, y.0)), at((x.1, y.1)));
        let _ = write!(paths[Ramp::level(*share)], "M{left:.1} {top:.1}H{right:.1}V{bottom:.1}H{left:.1}z");
    }
    for (level, path) in paths.iter().enumerate().filter(|(_, path)| !path.is_empty()) {
        let _ = writeln!(svg, "<path class=\"{}\" shape-rendering=\"crispEdges\" d=\"{path}\"/>", Ramp::class(level));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_where_its_share_of_the_range_is_and_stays_in_the_panel() {
        let axis = ChartAxis { range: (1.0, 100.0), ..ChartAxis::log("", [], (1.0, 1.0)) };
        assert!((axis.share(10.0) - 0.5).abs() < 1e-12);
        let look = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: true, line: Line::None };
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
}
