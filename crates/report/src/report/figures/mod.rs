//! Figures of a sensor. Each part draws some figures, or none if there are no data.

mod characteristics;
mod errors;
mod expected;
mod locations;
mod map;
mod size;

pub(super) use errors::{dependences, distributions};
pub(super) use expected::expected;
pub(super) use locations::locations;
pub(super) use map::{Axes, cell, half_cell_mm};
pub(super) use size::{SQUARE_PX, WIDTH_PX};

use super::Subject;
use super::frame::{Drawn, Section};
use crate::chart::{Hue, Line, Look, Shape};
use maud::html;
use palpate_solver::Evaluation;

/// Draws the readings of each unit: under load, during loading and unloading, and in the calibration at every place.
pub(super) fn units(subject: &Subject) -> Option<Section> {
    let of_load = characteristics::characteristics(subject).map(|drawn| drawn.named("output-against-load"));
    let of_place = map::matrix(subject).map(|drawn| drawn.named("output-by-place"));
    let drawn: Vec<Drawn> = [of_load, of_place].into_iter().flatten().collect();
    Section::of_figures("Output of each unit, by load and by place", &html! {}, drawn)
}

/// Colours and marks of the methods: first the method that takes the calibration point with the highest correlation, then the
/// best method.
pub(super) const LOOKS: [Look; 2] = [
    Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: false, line: Line::None },
    Look { hue: Hue::Orange, shape: Some(Shape::Square), filled: false, line: Line::None },
];

/// Each method with its look.
fn methods(evaluations: &[Evaluation]) -> impl Iterator<Item = (Look, &Evaluation)> {
    LOOKS.into_iter().zip(evaluations)
}

/// Displayed name of a method.
fn name(evaluation: &Evaluation) -> String {
    let best = if evaluation.choice.is_some() { " (best)" } else { "" };
    format!("{}{best}", evaluation.solver)
}

/// Name of a method in file names. The name of the best method doesn't depend on which method it is.
fn stem(evaluation: &Evaluation) -> &str {
    if evaluation.choice.is_some() { "best" } else { &evaluation.solver }
}
