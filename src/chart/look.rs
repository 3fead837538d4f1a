//! How a series looks: colour, marker, line.

use std::fmt::Write as _;

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

impl Look {
    /// A line without markers.
    pub const fn line(hue: Hue, line: Line) -> Look {
        Look { hue, shape: None, filled: true, line }
    }

    /// Filled markers without a line.
    pub const fn markers(hue: Hue, shape: Shape) -> Look {
        Look { hue, shape: Some(shape), filled: true, line: Line::None }
    }
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
    /// A purple.
    Purple,
    /// A red.
    Red,
    /// Between blue and green.
    Teal,
    /// A brown.
    Brown,
    /// As dark as words are.
    Ink,
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

/// What the classes of all elements mean, in light and in dark.
pub const STYLE: &str = "\
text{font:13px system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;fill:#1f2328;stroke:none}
.title{font-size:17px;font-weight:600}.small{font-size:12px;fill:#57606a}.word{font-size:11.5px}
.end{text-anchor:end}.mid{text-anchor:middle}
.paper{fill:#ffffff}.band{fill:#f3f5f7}.grid{stroke:#e4e7eb;stroke-width:1}.axis{stroke:#57606a;stroke-width:1;fill:none}
.rule{stroke:#57606a;stroke-width:1.3;stroke-dasharray:2 3}
.blue{fill:#0b5cad;stroke:#0b5cad}.orange{fill:#d9730d;stroke:#d9730d}.green{fill:#12805c;stroke:#12805c}
.grey{fill:#57606a;stroke:#57606a}.purple{fill:#8250df;stroke:#8250df}.red{fill:#c4262e;stroke:#c4262e}
.teal{fill:#16a0ad;stroke:#16a0ad}.brown{fill:#7a4a1e;stroke:#7a4a1e}.ink{fill:#1f2328;stroke:#1f2328}
.mark{stroke-width:1.8;stroke-linejoin:round}.hollow{fill:#ffffff}.line{fill:none;stroke-width:1.8}
.dashed{stroke-dasharray:6 4}.bar{stroke-width:1.4;fill:none}.column{fill-opacity:.28;stroke-width:1}.head{font-weight:600}.ring{fill:none;stroke:#1f2328;stroke-width:1.2}
@media (prefers-color-scheme:dark){
text{fill:#e6edf3}.small{fill:#9aa5b1}.paper{fill:#0d1117}.band{fill:#161b22}.hollow{fill:#0d1117}.grid{stroke:#262c34}
.axis,.rule{stroke:#9aa5b1}.ring{stroke:#e6edf3}.blue{fill:#58a6ff;stroke:#58a6ff}.orange{fill:#f0a050;stroke:#f0a050}
.green{fill:#4cc38a;stroke:#4cc38a}.grey{fill:#9aa5b1;stroke:#9aa5b1}.purple{fill:#c297ff;stroke:#c297ff}
.red{fill:#ff7b72;stroke:#ff7b72}.teal{fill:#5fdde5;stroke:#5fdde5}.brown{fill:#c9a27a;stroke:#c9a27a}
.ink{fill:#e6edf3;stroke:#e6edf3}
.mark.hollow{fill:#0d1117}.line{fill:none}}";

impl Hue {
    /// Its class.
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

/// A line through points, px.
pub(super) fn write_line(svg: &mut String, look: Look, points: &[(f64, f64)]) {
    let dashed = match look.line {
        Line::None => return,
        Line::Solid => "",
        Line::Dashed => " dashed",
    };
    let path: String = points.iter().map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
    let _ = writeln!(svg, "<polyline class=\"{} line{dashed}\" points=\"{}\"/>", look.hue.name(), path.trim_end());
}

/// A marker at a point, px, `size` times as large as it mostly is.
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
