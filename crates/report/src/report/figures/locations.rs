//! True places of presses, and the places found by each method.

use super::map::Axes;
use super::{NARROW_PX, NARROW_SQUARE_PX, methods, name, stem};
use crate::chart::{Figure, Grid, Hue, LineStyle, Look, Mark, Shape};
use crate::report::SensorResults;
use crate::report::frame::PageFigure;
use crate::report::numbers::{NumberCell, Numbers};
use palpate_core::quantity::Place;
use palpate_solver::{Evaluation, PressError};

/// Largest number of test presses that are drawn. If there are more, every nth press is drawn.
const MOST_PRESSES: usize = 500;
/// Margin beyond the outermost places, mm.
const ROOM_MM: f64 = 0.5;
/// Look of a true place, for every method.
const TRUE: Look = Look { hue: Hue::Ink, shape: Some(Shape::Circle), filled: false, line: LineStyle::None };

/// Draws a map for each method, all over the same area.
pub(crate) fn locations(judged: &SensorResults) -> Vec<PageFigure> {
    let shown = || judged.evaluations.iter().flat_map(presses);
    let all = || shown().flat_map(|press| [press.place_true, press.place_solved]);
    let corner = |of: fn(f64, f64) -> f64| all().reduce(|a, b| Place::new(of(a.x_mm, b.x_mm), of(a.y_mm, b.y_mm)));
    let Some((least, most)) = corner(f64::min).zip(corner(f64::max)) else { return Vec::new() };
    let axes = Axes::around(least, most, ROOM_MM);
    methods(&judged.evaluations).map(|(look, evaluation)| one(look, evaluation, &axes)).collect()
}

/// Returns n if every nth press is drawn.
fn one_in(evaluation: &Evaluation) -> usize {
    evaluation.presses.len().div_ceil(MOST_PRESSES).max(1)
}

/// Returns the presses that are drawn.
fn presses(evaluation: &Evaluation) -> impl Iterator<Item = &PressError> {
    evaluation.presses.iter().step_by(one_in(evaluation))
}

fn one(look: Look, evaluation: &Evaluation, axes: &Axes) -> PageFigure {
    let mm = |place: Place| (place.x_mm, place.y_mm);
    let predicted = Look { shape: Some(Shape::Cross), line: LineStyle::None, ..look };
    let marks = vec![
        Mark::Strokes(look.hue, presses(evaluation).map(|p| (mm(p.place_true), mm(p.place_solved))).collect()),
        Mark::Curve(TRUE, presses(evaluation).map(|press| mm(press.place_true)).collect()),
        Mark::Curve(predicted, presses(evaluation).map(|press| mm(press.place_solved)).collect()),
    ];
    let one_in = one_in(evaluation);
    let notes = if one_in > 1 { vec![format!("One press in {one_in} is shown.")] } else { Vec::new() };
    let figure = Figure {
        title: format!("Places by {}", name(evaluation)),
        subtitle: "each true place joined to the predicted one".to_owned(),
        height_px: axes.height_px(NARROW_SQUARE_PX),
        panels: vec![axes.panel(marks)],
        grid: Some(Grid { columns: 1, width_px: NARROW_PX, shared: false }),
        legend: vec![vec![(TRUE, "true".to_owned()), (predicted, "predicted".to_owned())]],
        notes,
    };
    PageFigure::plain(figure).named(&format!("locations-{}", stem(evaluation))).with(numbers(evaluation))
}

/// Returns a table with a row for each drawn press. The number is that of the test press, from 1.
fn numbers(evaluation: &Evaluation) -> Numbers {
    let row = |press: &PressError| {
        let (at, found) = (press.place_true, press.place_solved);
        let number = (press.index + 1) as f64;
        [number, at.x_mm, at.y_mm, found.x_mm, found.y_mm, press.location_error_mm].map(NumberCell::Number).to_vec()
    };
    let head = ["test_press", "x_true_mm", "y_true_mm", "x_predicted_mm", "y_predicted_mm", "location_error_mm"];
    Numbers::new(&head, presses(evaluation).map(row).collect())
}
