//! Force vectors of the test presses: their errors, and the forces along the surface as arrows.

use super::Subject;
use super::figures::{Axes, SQUARE_PX, WIDTH_PX};
use super::frame::{PageFigure, Section, counted, none, number, section as framed, table, words};
use super::numbers::{NumberCell, Numbers};
use crate::chart::{Anchor, Figure, Grid, Hue, LineStyle, Look, Mark, Shape};
use maud::{Markup, html};
use palpate_core::quantity::{Place, round};
use palpate_data::dataset::{Press, Presses};
use palpate_data::recipe::Phase;
use palpate_solver::vector::{Shear, VectorErrors, VectorMap, VectorWorkspace};
use std::collections::BTreeMap;

/// Number of parts of the area along x, and along y. Of more windows than parts of the area, one in each part is drawn.
const PARTS: usize = 8;
/// Length of the longest arrow, as a fraction of the larger side of the area.
const LONGEST: f64 = 0.11;
/// Least force of an arrow of this length, N. Smaller forces are drawn with this scale.
const LEAST_N: f64 = 0.01;
/// Along and across an arrow: the two strokes of its head, as fractions of its length.
const HEAD: (f64, f64) = (0.26, 0.13);

const TITLE: &str = "Force vectors of the test presses";
const TRUE: Look = Look { hue: Hue::Ink, shape: Some(Shape::Circle), filled: false, line: LineStyle::Solid };
const PREDICTED: Look = Look { hue: Hue::Orange, shape: Some(Shape::Cross), ..TRUE };

type Stroke = ((f64, f64), (f64, f64));

/// True place of a window, and the predicted one, each with the force along the surface, N.
type Window = [(Place, Option<[f64; 2]>); 2];

/// Creates the section of a run with drags; `None` if there is nothing to solve.
pub(super) fn section(subject: &Subject) -> Option<Section> {
    let [calibration, test] = [Phase::Calibration, Phase::Test].map(|phase| subject.presses.of_phase(phase));
    let rows = calibration.dragged_rows();
    if !subject.has_drags() || rows.is_empty() || test.vector_rows().next().is_none() {
        return None;
    }
    let fitted = VectorMap::fit_dragged(&rows).map_err(|error| error.to_string());
    let solved = fitted.and_then(|map| {
        let errors = VectorErrors::of(&map, test.vector_rows());
        errors.map(|errors| (map, errors)).ok_or_else(|| "no test press has an answer".to_owned())
    });
    Some(match solved {
        Ok((map, errors)) => Section::new(TITLE, &numbers(&errors), arrows(&map, &test, &errors).into_iter().collect()),
        Err(reason) => framed(TITLE, &html! { p { "The force vectors can't be solved: " (reason) "." } }).into(),
    })
}

/// Returns the table of the errors, with the numbers of `evaluate --vector`.
fn numbers(errors: &VectorErrors) -> Markup {
    let VectorErrors { presses, unsolved, shear_not_determinable, location_mm, press_n, shear_n, .. } = errors;
    let row = |name: &str, key: &str, values: Option<[f64; 2]>, digits| {
        let cell = |index: usize| values.map_or_else(none, |values| number(key, values[index], digits, ""));
        vec![words(name), cell(0), cell(1)]
    };
    let rows = [
        row("location, mm", "vector.location_mm", Some(*location_mm), 3),
        row("press, N", "vector.press_n", Some(*press_n), 4),
        row("along the surface, N", "vector.shear_n", *shear_n, 4),
    ];
    html! {
        (table(&["error", "mean", "95th percentile"].map(words), &rows))
        p.note {
            "A map of the presses and drags of the calibration solved " (counted(*presses, "window")) " of the test, before a drag or after it. "
            "In the other sections, places and errors are those of the windows before a drag. "
            @if *unsolved > 0 { "Without an answer: " (counted(*unsolved, "window")) ". " }
            @if *shear_not_determinable > 0 {
                "The outputs don't determine the force along the surface: " (counted(*shear_not_determinable, "window")) "."
            }
        }
    }
}

/// Draws the windows after a drag, or all windows of a test without drags.
fn arrows(map: &VectorMap, test: &Presses, errors: &VectorErrors) -> Option<PageFigure> {
    let has_drags = test.presses.iter().any(Press::is_dragged);
    let all: Vec<&Press> =
        test.presses.iter().filter(|press| press.vector_row().is_some() && press.is_dragged() == has_drags).collect();
    let mut workspace = VectorWorkspace::default();
    let drawn: Vec<Window> = chosen(&all)?.into_iter().filter_map(|press| solved(map, press, &mut workspace)).collect();
    let ends = || drawn.iter().flat_map(|window| *window);
    let (least, most) = corners(ends().map(|(place, _)| place))?;
    let longest_n = ends().filter_map(|(_, along)| along).map(|[x, y]| x.hypot(y)).fold(LEAST_N, f64::max);
    let room_mm = LONGEST * (most.x_mm - least.x_mm).max(most.y_mm - least.y_mm).max(1.0);
    let mm_per_n = room_mm / longest_n;
    // above the arrows is one of a round force
    let scale_n = round_below(longest_n);
    let scale_at = (least.x_mm, most.y_mm + 1.6 * room_mm);
    let mut marks = vec![
        Mark::Strokes(Hue::Grey, arrow(scale_at, [scale_n * mm_per_n, 0.0]).to_vec()),
        Mark::Words((scale_at.0 + scale_n * mm_per_n, scale_at.1), (8.0, 4.5), Anchor::Start, format!("{scale_n} N")),
    ];
    for (index, look) in [TRUE, PREDICTED].into_iter().enumerate() {
        let of_it: Vec<_> = drawn.iter().map(|window| window[index]).collect();
        let along =
            |(place, along): &(Place, Option<[f64; 2]>)| Some((mm(*place), along.as_ref()?.map(|n| n * mm_per_n)));
        let strokes = of_it.iter().filter_map(along).flat_map(|(from, along)| arrow(from, along)).collect();
        let places = of_it.iter().map(|(place, _)| mm(*place)).collect();
        marks.extend([Mark::Strokes(look.hue, strokes), Mark::Curve(Look { line: LineStyle::None, ..look }, places)]);
    }
    let axes = Axes::around(least, Place::new(most.x_mm, most.y_mm + room_mm), room_mm);
    let along = errors.shear_n.map_or_else(String::new, |[mean, _]| format!(", along the surface {mean:.4} N"));
    let part =
        format!("One arrow in each of {PARTS} x {PARTS} parts of the area is shown, {} of {}.", drawn.len(), all.len());
    let arrows = if has_drags { "an arrow from each place after a drag" } else { "an arrow from each place" };
    let figure = Figure {
        title: "Force along the surface".to_owned(),
        subtitle: format!(
            "{arrows}; mean errors of {}: location {:.3} mm, press {:.4} N{along}",
            counted(errors.presses, "window"),
            errors.location_mm[0],
            errors.press_n[0],
        ),
        height_px: axes.height_px(SQUARE_PX),
        panels: vec![axes.panel(marks)],
        grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
        legend: vec![vec![(TRUE, "true".to_owned()), (PREDICTED, "predicted".to_owned())]],
        notes: if all.len() > PARTS * PARTS { vec![part] } else { Vec::new() },
    };
    let row = |window: &Window| {
        let cells = |(place, along): (Place, Option<[f64; 2]>)| {
            let along = [0, 1].map(|axis| along.map_or(NumberCell::None, |along| NumberCell::Number(along[axis])));
            [place.x_mm, place.y_mm].map(NumberCell::Number).into_iter().chain(along)
        };
        window.iter().copied().flat_map(cells).collect()
    };
    let of_true = ["x_true_mm", "y_true_mm", "force_true_x_n", "force_true_y_n"];
    let head = [of_true, ["x_predicted_mm", "y_predicted_mm", "force_predicted_x_n", "force_predicted_y_n"]].concat();
    Some(PageFigure::plain(figure).named("force-vectors").with(Numbers::new(&head, drawn.iter().map(row).collect())))
}

fn solved(map: &VectorMap, press: &Press, workspace: &mut VectorWorkspace) -> Option<Window> {
    let row = press.vector_row()?;
    let contact = map.solve(row.outputs, workspace).ok()?;
    let along = match contact.shear {
        Shear::Force(along) => Some(along),
        Shear::NotDeterminable { .. } => None,
    };
    Some([(row.place, Some([row.force_n[0], row.force_n[1]])), (contact.place, along)])
}

/// Returns all windows, or one in each part of the area: in turn another one, so that it isn't always the same direction.
fn chosen<'a>(all: &[&'a Press]) -> Option<Vec<&'a Press>> {
    let (least, most) = corners(all.iter().map(|press| press.place()))?;
    if all.len() <= PARTS * PARTS {
        return Some(all.to_vec());
    }
    let part = |mm: f64, least_mm: f64, most_mm: f64| {
        ((PARTS as f64 * (mm - least_mm) / (most_mm - least_mm)) as usize).min(PARTS - 1)
    };
    let mut parts: BTreeMap<[usize; 2], Vec<&Press>> = BTreeMap::new();
    for press in all {
        let part = [part(press.x_mm, least.x_mm, most.x_mm), part(press.y_mm, least.y_mm, most.y_mm)];
        parts.entry(part).or_default().push(press);
    }
    Some(parts.into_values().enumerate().map(|(index, its)| its[index % its.len()]).collect())
}

fn corners(places: impl Iterator<Item = Place> + Clone) -> Option<(Place, Place)> {
    let corner =
        |of: fn(f64, f64) -> f64| places.clone().reduce(|a, b| Place::new(of(a.x_mm, b.x_mm), of(a.y_mm, b.y_mm)));
    corner(f64::min).zip(corner(f64::max))
}

fn mm(place: Place) -> (f64, f64) {
    (place.x_mm, place.y_mm)
}

/// Returns a shaft and the two strokes of its head.
fn arrow(from: (f64, f64), [x, y]: [f64; 2]) -> [Stroke; 3] {
    let to = (from.0 + x, from.1 + y);
    let (back, beside) = HEAD;
    let head = |side: f64| (to, (to.0 - back * x - side * beside * y, to.1 - back * y + side * beside * x));
    [(from, to), head(1.0), head(-1.0)]
}

/// Returns the largest force of one digit, 1, 2 or 5, that isn't larger.
fn round_below(n: f64) -> f64 {
    let decade = 10f64.powf(n.log10().floor());
    let digit = [5.0, 2.0].into_iter().find(|digit| digit * decade <= n).unwrap_or(1.0);
    round(digit * decade, 6)
}
