//! Figure 9: where it was pressed, and where each method found it.

use super::map::Axes;
use super::{WIDTH_PX, methods, name};
use crate::chart::{Figure, Grid, Line, Look, Mark, Shape};
use crate::quantity::Place;
use crate::report::Judged;
use crate::report::frame::{Drawn, figures, section};
use crate::solver::Evaluation;
use maud::Markup;

/// The most test presses that are drawn: of more, one in so many.
const MOST_PRESSES: usize = 500;

/// A map a method.
pub fn locations(judged: &Judged) -> Option<Markup> {
    let drawn: Vec<Drawn> = methods(&judged.evaluations).map(|(look, evaluation)| one(look, evaluation)).collect();
    (!drawn.is_empty()).then(|| section("Figure 9: true and predicted places", &figures(&drawn)))
}

fn one(look: Look, evaluation: &Evaluation) -> Drawn {
    let one_in = evaluation.presses.len().div_ceil(MOST_PRESSES).max(1);
    let pairs: Vec<(Place, Place)> =
        evaluation.presses.iter().step_by(one_in).map(|press| (press.place_true, press.place_solved)).collect();
    let mm = |place: Place| (place.x_mm, place.y_mm);
    let all = || pairs.iter().flat_map(|(place, solved)| [*place, *solved]);
    let least = |of: fn(Place) -> f64| all().map(of).fold(f64::MAX, f64::min);
    let most = |of: fn(Place) -> f64| all().map(of).fold(f64::MIN, f64::max);
    let (x, y) = (|place: Place| place.x_mm, |place: Place| place.y_mm);
    let axes = Axes::around(Place::new(least(x), least(y)), Place::new(most(x), most(y)), 0.5);
    let predicted = Look { shape: Some(Shape::Cross), line: Line::None, ..look };
    let marks = vec![
        Mark::Strokes(look.hue, pairs.iter().map(|(place, solved)| (mm(*place), mm(*solved))).collect()),
        Mark::Curve(look, pairs.iter().map(|(place, _)| mm(*place)).collect()),
        Mark::Curve(predicted, pairs.iter().map(|(_, solved)| mm(*solved)).collect()),
    ];
    let notes = if one_in > 1 { vec![format!("one press in {one_in} is drawn")] } else { Vec::new() };
    let figure = Figure {
        title: name(evaluation),
        subtitle: format!("{} test presses, each true place joined to the predicted one", evaluation.points),
        height_px: axes.height_px(1),
        panels: vec![axes.panel(marks)],
        grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
        legend: vec![vec![(look, "true".to_owned()), (predicted, "predicted".to_owned())]],
        notes,
    };
    Drawn::plain(figure)
}
