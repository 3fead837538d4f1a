//! Distribution of the errors, and their dependence on force and on distance from the edge of the area.

use super::{WIDTH_PX, methods, name};
use crate::chart::{Anchor, ChartAxis, Figure, Grid, LineStyle, Look, Mark, Panel, Shape, WidthPart};
use crate::report::frame::{PageFigure, Section, capital};
use crate::report::{SensorResults, Subject};
use maud::html;
use palpate_core::quantity::Place;
use palpate_data::dataset::Press;
use palpate_data::recipe::Phase;
use palpate_solver::{Evaluation, FORCE_REFERENCE_N, LOCATION_REFERENCE_MM, PressError};

/// One of the two errors of a press.
#[derive(Clone, Copy)]
struct PlottedError {
    name: &'static str,
    label: &'static str,
    of: fn(&PressError) -> Option<f64>,
    /// Reference value for comparison, and its label.
    reference: (f64, &'static str),
    /// Possible column widths of a histogram.
    widths: [f64; 6],
}

const LOCATION: PlottedError = PlottedError {
    name: "location error",
    label: "location error, mm",
    of: |press| Some(press.location_error_mm),
    reference: (LOCATION_REFERENCE_MM, "1 mm"),
    widths: [0.02, 0.05, 0.1, 0.2, 0.5, 1.0],
};
const FORCE: PlottedError = PlottedError {
    name: "force error",
    label: "force error, N",
    of: |press| press.force_error_n,
    reference: (FORCE_REFERENCE_N, "0.1 N"),
    widths: [0.002, 0.005, 0.01, 0.02, 0.05, 0.1],
};

const DEPTH: PlottedError = PlottedError {
    name: "depth error",
    label: "depth error, mm",
    of: |press| press.depth_error_mm,
    reference: (0.1, "0.1 mm"),
    widths: [0.002, 0.005, 0.01, 0.02, 0.05, 0.1],
};

/// Largest number of columns of a histogram. Values beyond are in the last column.
const MOST_COLUMNS: usize = 24;
/// Largest number of points that are drawn for a method. If there are more, every nth point is drawn.
const MOST_POINTS: usize = 1000;
/// Number of parts of the axis for which a mean is drawn.
const PARTS: usize = 6;
/// Least number of presses for a mean.
const FEWEST: usize = 3;

/// Draws a histogram of each error, with the cumulative fraction below it.
pub(crate) fn distributions(judged: &SensorResults) -> Option<Section> {
    let drawn: Vec<PageFigure> =
        [LOCATION, FORCE, DEPTH].into_iter().filter_map(|kind| distribution(kind, judged)).collect();
    Section::of_figures("Distribution of the errors", &html! {}, drawn)
}

fn distribution(kind: PlottedError, judged: &SensorResults) -> Option<PageFigure> {
    let errors = |evaluation: &Evaluation| {
        let mut errors: Vec<f64> = evaluation.presses.iter().filter_map(kind.of).collect();
        errors.sort_by(f64::total_cmp);
        errors
    };
    let all: Vec<(Look, &Evaluation, Vec<f64>)> =
        methods(&judged.evaluations).map(|(look, evaluation)| (look, evaluation, errors(evaluation))).collect();
    let largest = all.iter().filter_map(|(.., errors)| errors.last()).copied().reduce(f64::max)?;
    let fits = |width: &&f64| largest / **width <= MOST_COLUMNS as f64;
    let width = *kind.widths.iter().find(fits).unwrap_or(&kind.widths[5]);
    let columns = ((largest / width).ceil() as usize).clamp(4, MOST_COLUMNS);
    let last = columns as f64 * width;
    let (mut counted, mut summed, mut legend) = (Vec::new(), Vec::new(), Vec::new());
    for (index, (look, evaluation, errors)) in all.iter().enumerate() {
        let count = errors.len() as f64;
        let mut heights = vec![0.0; columns];
        errors.iter().for_each(|error| heights[((error / width) as usize).min(columns - 1)] += 100.0 / count);
        let at = |column: usize| (column as f64 * width, (column + 1) as f64 * width);
        let heights = heights.iter().enumerate().map(|(i, h)| (at(i), *h)).collect();
        counted.push(Mark::Columns(look.hue, WidthPart { index, of: all.len() }, heights));
        let line = if index == 0 { LineStyle::Solid } else { LineStyle::Dashed };
        let one_in = errors.len().div_ceil(MOST_POINTS).max(1);
        let share = |index: usize| 100.0 * (index + 1) as f64 / count;
        let is_drawn = |index: &usize| index.is_multiple_of(one_in) || index + 1 == errors.len();
        let points = (0..errors.len()).filter(is_drawn).map(|index| (errors[index].min(last), share(index)));
        summed.push(Mark::Steps(Look { shape: None, line, ..*look }, points.collect()));
        legend.push(vec![(Look { shape: Some(Shape::Square), filled: true, line, ..*look }, name(evaluation))]);
    }
    let (reference, text) = kind.reference;
    if reference < last {
        counted.push(Mark::At(reference, text.to_owned()));
        summed.push(Mark::At(reference, String::new()));
        summed.push(Mark::Words((reference, 50.0), (6.0, 0.0), Anchor::Start, text.to_owned()));
    }
    let notes = if largest > last {
        vec![format!("The last column holds all larger errors, up to {largest:.1} {}.", unit(kind))]
    } else {
        Vec::new()
    };
    let highest = counted.iter().filter_map(|mark| match mark {
        Mark::Columns(_, _, columns) => columns.iter().map(|(_, height)| *height).reduce(f64::max),
        _ => None,
    });
    let most = 1.1 * highest.fold(0.0, f64::max);
    let panel = |label: &str, most: f64, marks| Panel {
        x: ChartAxis::linear(kind.label, (0.0, last)),
        y: ChartAxis::linear(label, (0.0, most)),
        marks,
    };
    let figure = Figure {
        title: format!("{}s", capital(kind.name)),
        subtitle: format!("above: share of the presses in each {width} {}; below: share up to an error", unit(kind)),
        height_px: 150.0,
        panels: vec![panel("share of the presses, %", most, counted), panel("cumulative share, %", 100.0, summed)],
        grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
        legend,
        notes,
    };
    Some(PageFigure::plain(figure).named(&format!("{}s", kind.name)))
}

/// Draws the errors as functions of the force, or of the depth if depths are solved, and of the distance from the edge.
pub(crate) fn dependences(subject: &Subject, judged: &SensorResults) -> Option<Section> {
    let (least, most) = subject.area()?;
    let edge_mm = |place: Place| {
        let x = (place.x_mm - least.x_mm).min(most.x_mm - place.x_mm);
        x.min((place.y_mm - least.y_mm).min(most.y_mm - place.y_mm))
    };
    let by_depth = judged.evaluations.iter().any(|evaluation| evaluation.depth_error_mm.is_some());
    let load = |press: &Press| match by_depth {
        true => press.depth_set_mm.or(press.depth_mm),
        false => press.force_set_n.or(press.force_n),
    };
    let loads: Vec<f64> = subject.presses.sound(Phase::Test).map(|press| load(press).unwrap_or_default()).collect();
    let load_of = |press: &PressError| loads.get(press.index).copied().unwrap_or(0.0);
    let (load, unit) = if by_depth { ("depth", "mm") } else { ("force", "N") };
    let to_edge = |press: &PressError| edge_mm(press.place_true);
    let dependence = |title: &str, stem: &str, label: &str, of: &dyn Fn(&PressError) -> f64| {
        let is_negative =
            judged.evaluations.iter().flat_map(|evaluation| &evaluation.presses).any(|press| of(press) < 0.0);
        let outside = if is_negative { "; negative: outside it" } else { "" };
        let panels: Vec<Panel> =
            [LOCATION, FORCE, DEPTH].into_iter().filter_map(|kind| panel(kind, label, of, judged)).collect();
        let legend =
            methods(&judged.evaluations).map(|(look, e)| vec![(Look { line: LineStyle::Solid, ..look }, name(e))]);
        let figure = Figure {
            title: title.to_owned(),
            subtitle: format!("a mark for each press; bars: mean of each part with {FEWEST} or more presses{outside}"),
            height_px: 160.0,
            panels,
            grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
            legend: legend.collect(),
            ..Figure::default()
        };
        (!figure.panels.is_empty()).then(|| PageFigure::plain(figure).named(stem))
    };
    let drawn: Vec<PageFigure> = [
        dependence(
            &format!("Errors against the {load}"),
            &format!("errors-against-{load}"),
            &format!("{load}, {unit}"),
            &load_of,
        ),
        dependence(
            "Errors against the distance from the edge",
            "errors-against-edge",
            "distance from the edge of the area, mm",
            &to_edge,
        ),
    ]
    .into_iter()
    .flatten()
    .collect();
    let title = format!("Errors against the {load} and against the distance from the edge");
    Section::of_figures(&title, &html! {}, drawn)
}

fn panel(kind: PlottedError, label: &str, of: &dyn Fn(&PressError) -> f64, judged: &SensorResults) -> Option<Panel> {
    let points = |evaluation: &Evaluation| -> Vec<(f64, f64)> {
        evaluation.presses.iter().filter_map(|press| Some((of(press), (kind.of)(press)?))).collect()
    };
    let all: Vec<(Look, Vec<(f64, f64)>)> =
        methods(&judged.evaluations).map(|(look, evaluation)| (look, points(evaluation))).collect();
    let every = || all.iter().flat_map(|(_, points)| points);
    let most = every().map(|point| point.1).reduce(f64::max)?;
    let (first, last) = every().fold((0.0f64, 0.0f64), |(l, m), point| (l.min(point.0), m.max(point.0)));
    let width = (last - first).max(f64::MIN_POSITIVE) / PARTS as f64;
    let mut marks = Vec::new();
    for (look, points) in &all {
        let one_in = points.len().div_ceil(MOST_POINTS).max(1);
        marks.push(Mark::Curve(*look, points.iter().step_by(one_in).copied().collect()));
    }
    for (look, points) in &all {
        // a bar for each part of the axis; none for a part without presses
        let mean = |part: usize| {
            let of_it = || points.iter().filter(move |point| part_of(point.0, first, width) == part);
            let (count, sum) = (of_it().count(), of_it().map(|point| point.1).sum::<f64>());
            let edge = |part: usize| first + part as f64 * width;
            let mean = sum / count as f64;
            (count >= FEWEST).then(|| ((edge(part), mean), (edge(part + 1), mean)))
        };
        marks.push(Mark::Strokes(look.hue, (0..PARTS).filter_map(mean).collect()));
    }
    Some(Panel {
        x: ChartAxis::linear(label, (first, 1.03 * last)),
        y: ChartAxis::linear(kind.label, (0.0, 1.05 * most.max(f64::MIN_POSITIVE))),
        marks,
    })
}

/// Returns the index of an axis' part that contains a value. The last part includes its end.
fn part_of(value: f64, first: f64, width: f64) -> usize {
    (((value - first) / width) as usize).min(PARTS - 1)
}

fn unit(kind: PlottedError) -> &'static str {
    kind.label.rsplit(' ').next().unwrap_or_default()
}
