//! The paper's Figures 3 to 5, and two figures of an array.

use super::line::{FIGURE_4_TO, LineCurve};
use super::{Curves, DesignFindings};
use palpate_core::mechanics::lambda;
use palpate_report::chart::{Anchor, ChartAxis, Figure, Grid, Hue, LineStyle, Look, Mark, Panel, Shape};

/// Figure: its file name and the SVG.
type NamedSvg = (String, String);

/// Colours of the curves. Neighbouring curves differ in colour, and the second curve of a colour is dashed.
const HUES: [Hue; 7] = [Hue::Blue, Hue::Orange, Hue::Green, Hue::Red, Hue::Teal, Hue::Purple, Hue::Brown];
/// Grid of one panel per row. In a grid, marks are small.
const GRID: Option<Grid> = Some(Grid { columns: 1, width_px: 900.0, shared: false });
const HEIGHT_PX: f64 = 460.0;
/// Number of curves in a line of the legend.
const NAMES: usize = 7;
/// Explanation of the marks on curves.
const TURNS: &str = "dots: where r turns and rises again";

fn line(index: usize) -> Look {
    Look::line(HUES[index % HUES.len()], if index < HUES.len() { LineStyle::Solid } else { LineStyle::Dashed })
}

/// Draws the four figures of the paper.
pub fn figures(found: &Curves) -> Vec<NamedSvg> {
    let drawn = [
        ("figure-3.svg", figure_3(&found.lambda)),
        ("figure-4a.svg", figure_4(found, "4a", "how many units there are", &|curve| format!("n = {}", curve.n))),
        ("figure-4b.svg", figure_4(found, "4b", "how far apart the units are", &|curve| format!("s = {:.1}", curve.s))),
        ("figure-5.svg", figure_5(found)),
    ];
    drawn.map(|(name, figure)| (name.to_owned(), figure.svg())).to_vec()
}

fn figure_3(curve: &[(f64, f64)]) -> Figure {
    let field = 2.0;
    let text = format!("{:.1} % of the peak at k = 2", 100.0 * lambda(field));
    let panel = Panel {
        x: ChartAxis::linear("k: distance over depth", (0.0, curve.last().map_or(1.0, |(k, _)| *k))),
        y: ChartAxis::linear("lambda: stress over its peak", (0.0, 1.05)),
        marks: vec![
            Mark::At(field, String::new()),
            Mark::Curve(line(0), curve.to_vec()),
            Mark::Curve(Look::markers(Hue::Blue, Shape::Circle), vec![(field, lambda(field))]),
            Mark::Words((field, lambda(field)), (8.0, -10.0), Anchor::Start, text),
        ],
    };
    Figure {
        title: "Figure 3: output of a unit for a point load at a distance".to_owned(),
        subtitle: "elastic half-space: lambda = (k^2 + 1)^(-5/2)".to_owned(),
        height_px: 320.0,
        panels: vec![panel],
        grid: GRID,
        ..Figure::default()
    }
}

fn figure_4(found: &Curves, number: &str, by: &str, name: &dyn Fn(&LineCurve) -> String) -> Figure {
    let curves = found.curves.iter().filter(|curve| curve.figure == number);
    let y = ChartAxis::linear("Pearson's r", (-1.05, 1.05));
    let (mut marks, mut names) = (Vec::new(), Vec::new());
    for (index, curve) in curves.enumerate() {
        let look = line(index);
        marks.extend(joined(look, &curve.points));
        let turning = curve.turnings()[1].and_then(|d| Some((d, nearest(&curve.points, d)?)));
        marks.extend(turning.map(|turning| Mark::Curve(Look::markers(look.hue, Shape::Circle), vec![turning])));
        names.push((look, name(curve)));
    }
    Figure {
        title: format!("Figure {number}: r by {by}"),
        subtitle: "n units (9), s H apart (1) at depth H; F1 above the first".to_owned(),
        height_px: HEIGHT_PX,
        panels: vec![Panel { x: ChartAxis::linear("distance from F1 to F2, depths H", (0.0, FIGURE_4_TO)), y, marks }],
        grid: GRID,
        legend: names.chunks(NAMES).map(<[_]>::to_vec).collect(),
        notes: vec![TURNS.to_owned()],
    }
}

fn figure_5(found: &Curves) -> Figure {
    let curves = found.curves.iter().filter(|curve| curve.figure == "5");
    let (mut marks, mut to) = (Vec::new(), 0.0f64);
    for (index, curve) in curves.enumerate() {
        let look = line(index);
        marks.extend(joined(look, &curve.points));
        for (d, sign) in curve.turnings().into_iter().zip([-1.0, 1.0]) {
            let turning = d.and_then(|d| Some((curve.d1 + sign * d, nearest(&curve.points, curve.d1 + sign * d)?)));
            marks.extend(turning.map(|turning| Mark::Curve(Look::markers(look.hue, Shape::Circle), vec![turning])));
        }
        marks.push(Mark::Words((curve.d1, 1.0), (0.0, -8.0), Anchor::Middle, format!("d1 = {}", curve.d1)));
        to = curve.points.last().map_or(to, |(d2, _)| to.max(*d2));
    }
    Figure {
        title: "Figure 5: r by where the first contact is".to_owned(),
        subtitle: "9 units at 0 to 8, H apart at depth H; F1 at d1".to_owned(),
        height_px: HEIGHT_PX,
        panels: vec![Panel {
            x: ChartAxis::linear("d2: where F2 is, depths H", (-0.25, to + 0.25)),
            y: r_axis(found.curves.iter().filter(|curve| curve.figure == "5").flat_map(|curve| &curve.points)),
            marks,
        }],
        grid: GRID,
        notes: vec![TURNS.to_owned()],
        ..Figure::default()
    }
}

/// Draws the readings of a rig's array next to a contact, and r along its row.
pub fn design_figures(found: &DesignFindings) -> Vec<NamedSvg> {
    let drawn = [("array-field.svg", field(found)), ("array-r.svg", courses(found))];
    drawn.map(|(name, figure)| (name.to_owned(), figure.svg())).to_vec()
}

fn field(found: &DesignFindings) -> Figure {
    let space = Look::line(Hue::Grey, LineStyle::Dashed);
    let depth_mm = found.passage.depth_mm;
    let least = found.field.iter().map(|(_, share)| *share).fold(0.0, f64::min);
    let mut marks = vec![
        Mark::At(2.0 * depth_mm, "two depths".to_owned()),
        Mark::At(found.pitch_mm, "pitch".to_owned()),
        Mark::Level(0.0, String::new()),
    ];
    let mut legend = Vec::new();
    if !found.is_papers() {
        marks.push(Mark::Curve(space, found.half_space_field.clone()));
        legend.push(vec![
            (line(0), "this array's".to_owned()),
            (space, "a point load over a point, half-space of the same depth".to_owned()),
        ]);
    }
    marks.push(Mark::Curve(line(0), found.field.clone()));
    let to_mm = found.field.last().map_or(depth_mm, |(mm, _)| *mm);
    Figure {
        title: "Output of a unit for a contact at a distance".to_owned(),
        subtitle: format!("units {depth_mm} mm deep, pitch {:.3} mm: s = {:.3}", found.pitch_mm, found.spacing),
        height_px: 320.0,
        panels: vec![Panel {
            x: ChartAxis::linear("distance, mm", (0.0, to_mm)),
            y: ChartAxis::linear("reading over its peak", ((1.2 * least).min(-0.02), 1.05)),
            marks,
        }],
        grid: GRID,
        legend,
        ..Figure::default()
    }
}

fn courses(found: &DesignFindings) -> Figure {
    let mut marks = Vec::new();
    for (index, course) in found.courses.iter().enumerate() {
        marks.extend(joined(line(index), &course.points));
        let text = format!("{:.1}", course.first_mm);
        marks.push(Mark::Words((course.first_mm, 1.0), (0.0, -8.0), Anchor::Middle, text));
    }
    let along = if found.row_is_column { "y" } else { "x" };
    let ends = found.courses.first().zip(found.courses.last());
    let (from, to) = ends.map_or((0.0, 1.0), |(first, last)| (first.first_mm, last.first_mm));
    let room = 0.03 * (to - from);
    let points = found.courses.iter().flat_map(|course| &course.points);
    Figure {
        title: "Similarity of the array's outputs for two contacts".to_owned(),
        subtitle: format!(
            "both on the line through the middle along {along}, which has {} of the {} units",
            found.row_units, found.units
        ),
        height_px: HEIGHT_PX,
        panels: vec![Panel {
            x: ChartAxis::linear(&format!("{along} of F2, mm"), (from - room, to + room)),
            y: r_axis(points),
            marks,
        }],
        grid: GRID,
        notes: vec![format!("above each curve: {along} of F1, mm")],
        ..Figure::default()
    }
}

/// Axis of r from 1, with room for text above, down to the lowest value.
fn r_axis<'a>(points: impl Iterator<Item = &'a (f64, Option<f64>)>) -> ChartAxis {
    let least = points.filter_map(|(_, r)| *r).fold(-0.2, f64::min);
    ChartAxis::linear("Pearson's r", (least - 0.05, 1.12))
}

/// Returns the marks of a curve. The curve is split where r is 0/0, or jumps from one end of its range toward the other.
fn joined(look: Look, points: &[(f64, Option<f64>)]) -> Vec<Mark> {
    let (mut pieces, mut piece): (Vec<Mark>, Vec<(f64, f64)>) = (Vec::new(), Vec::new());
    for (x, r) in points {
        let is_step = piece.last().zip(*r).is_some_and(|((_, before), r)| (before - r).abs() > 1.0);
        if r.is_none() || is_step {
            pieces.push(Mark::Curve(look, std::mem::take(&mut piece)));
        }
        piece.extend(r.map(|r| (*x, r)));
    }
    pieces.push(Mark::Curve(look, piece));
    pieces.retain(|mark| !matches!(mark, Mark::Curve(_, points) if points.is_empty()));
    pieces
}

/// Value of r at the point of a curve nearest to a place, which is accurate enough for a mark.
fn nearest(points: &[(f64, Option<f64>)], place: f64) -> Option<f64> {
    points.iter().min_by(|a, b| (a.0 - place).abs().total_cmp(&(b.0 - place).abs()))?.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curve_is_interrupted_at_steps_and_undefined_values() {
        let step = [(0.0, Some(1.0)), (0.4, Some(1.0)), (0.5, None), (0.6, Some(-1.0)), (0.7, Some(1.0))];
        let lengths = joined(line(0), &step)
            .iter()
            .map(|mark| match mark {
                Mark::Curve(_, points) => points.len(),
                _ => 0,
            })
            .collect::<Vec<_>>();
        assert_eq!(lengths, [2, 1, 1]);
    }
}
