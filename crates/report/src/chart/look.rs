//! Appearance of a series: colour, marker, line.

use std::fmt::Write as _;

/// Appearance of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// Colour.
    pub hue: Hue,
    /// Marker; `None` for a line only.
    pub shape: Option<Shape>,
    /// Whether the marker is filled.
    pub filled: bool,
    /// The line between the points.
    pub line: LineStyle,
}

impl Look {
    /// Creates a line without markers.
    pub const fn line(hue: Hue, line: LineStyle) -> Look {
        Look { hue, shape: None, filled: true, line }
    }

    /// Creates filled markers without a line.
    pub const fn markers(hue: Hue, shape: Shape) -> Look {
        Look { hue, shape: Some(shape), filled: true, line: LineStyle::None }
    }
}

/// Colours, which differ in lightness too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hue {
    /// A blue.
    Blue,
    /// An orange.
    Orange,
    /// A green.
    Green,
    /// A purple.
    Purple,
    /// A red.
    Red,
    /// Colour between blue and green.
    Teal,
    /// A brown.
    Brown,
    /// Colour of the text.
    Ink,
    /// Colour for marks that aren't a series.
    Grey,
}

/// The markers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Circle.
    Circle,
    /// Small circle, for a background of many points.
    Dot,
    /// Square.
    Square,
    /// Triangle, point up.
    Triangle,
    /// Square on its corner.
    Diamond,
    /// Two strokes; never filled.
    Cross,
}

/// The lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineStyle {
    /// No line, only the points.
    None,
    /// Continuous line.
    Solid,
    /// Dashed line.
    Dashed,
}

/// Style of the classes of all elements, in light colours.
pub(super) const LIGHT: &str = include_str!("light.css");

/// Style sheet in light and dark colours, following the reader's setting.
pub(crate) const STYLE: &str = concat!(include_str!("light.css"), include_str!("dark.css"));

impl Hue {
    /// Class name of the colour.
    pub(super) fn name(self) -> &'static str {
        match self {
            Hue::Blue => "blue",
            Hue::Orange => "orange",
            Hue::Green => "green",
            Hue::Purple => "purple",
            Hue::Red => "red",
            Hue::Teal => "teal",
            Hue::Brown => "brown",
            Hue::Ink => "ink",
            Hue::Grey => "grey",
        }
    }
}

/// Draws a line through points, px.
pub(super) fn write_line(svg: &mut String, look: Look, points: &[(f64, f64)]) {
    let dashed = match look.line {
        LineStyle::None => return,
        LineStyle::Solid => "",
        LineStyle::Dashed => " dashed",
    };
    let path: String = points.iter().map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
    let _ = writeln!(svg, "<polyline class=\"{} line{dashed}\" points=\"{}\"/>", look.hue.name(), path.trim_end());
}

/// Draws a marker at a point, px, `size` times its normal size.
pub(super) fn write_marker(svg: &mut String, look: Look, (x, y): (f64, f64), size: f64) {
    let Some(shape) = look.shape else { return };
    let class = format!("{} mark{}", look.hue.name(), if look.filled { "" } else { " hollow" });
    let polygon = |corners: &[(f64, f64)]| {
        let points: String =
            corners.iter().map(|(dx, dy)| format!("{:.1},{:.1} ", x + size * dx, y + size * dy)).collect();
        format!("<polygon class=\"{class}\" points=\"{}\"/>", points.trim_end())
    };
    let drawn = match shape {
        Shape::Circle => format!("<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{:.1}\"/>", 4.2 * size),
        Shape::Dot => format!("<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{:.1}\"/>", 0.6 * size),
        Shape::Square => polygon(&[(-3.8, -3.8), (3.8, -3.8), (3.8, 3.8), (-3.8, 3.8)]),
        Shape::Triangle => polygon(&[(0.0, -5.2), (4.8, 3.6), (-4.8, 3.6)]),
        Shape::Diamond => polygon(&[(0.0, -5.4), (5.4, 0.0), (0.0, 5.4), (-5.4, 0.0)]),
        Shape::Cross => {
            let (left, right, up, down) = (x - 4.0 * size, x + 4.0 * size, y - 4.0 * size, y + 4.0 * size);
            format!(
                "<path class=\"{class}\" d=\"M{left:.1} {up:.1}L{right:.1} {down:.1}M{left:.1} {down:.1}L{right:.1} {up:.1}\"/>"
            )
        }
    };
    svg.push_str(&drawn);
    svg.push('\n');
}
