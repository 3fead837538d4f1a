//! Colour bar of a figure's cells.

use super::axis::ChartAxis;
use super::labels::{Label, SIZE_PX};
use super::letters::width_px;
use super::ramp::{LEVELS, Ramp};
use super::write_stroke;
use std::fmt::Write as _;

const HEIGHT: f64 = 12.0;
/// Space above the bar. The second constant is the space below the name of its axis. A page cuts off the same amount as below a
/// panel.
const ABOVE: f64 = 10.0;
const BELOW: f64 = 28.0;
const TICK: f64 = 4.0;
const TO_NUMBERS: f64 = 19.0;
const TO_NAME: f64 = 38.0;

/// Draws the bar below a point, px, with the given width in px, the numbers of its axis and the axis' name. Returns the lower
/// end.
pub(super) fn write(svg: &mut String, labels: &mut Vec<Label>, axis: &ChartAxis, at: (f64, f64), width: f64) -> f64 {
    let (left, top) = (at.0, at.1 + ABOVE);
    let bottom = top + HEIGHT;
    for level in 0..LEVELS {
        let share = |level: usize| left + width * level as f64 / LEVELS as f64;
        let (from, to) = (share(level), share(level + 1));
        let class = Ramp::class(level);
        let _ = writeln!(
            svg,
            "<path class=\"{class}\" shape-rendering=\"crispEdges\" d=\"M{from:.1} {top:.1}H{to:.1}V{bottom:.1}H{from:.1}z\"/>"
        );
    }
    let _ = writeln!(
        svg,
        "<rect class=\"axis\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{HEIGHT:.1}\"/>"
    );
    for (value, text) in axis.ticks(width, |text| width_px(text, SIZE_PX) + 8.0) {
        let x = left + width * axis.share(value).clamp(0.0, 1.0);
        write_stroke(svg, "axis", (x, bottom), (x, bottom + TICK));
        labels.push(Label::tick((x, bottom + TO_NUMBERS), "mid", &text));
    }
    labels.push(Label::fixed((left + width / 2.0, bottom + TO_NAME), "mid", &axis.label));
    bottom + TO_NAME + BELOW
}
