//! Figures of a sensor. Each part draws some figures, or none if there are no data.

mod arrangement;
mod characteristics;
mod errors;
mod expected;
mod layout;
mod locations;
mod map;
mod size;

pub(super) use errors::{dependences, distributions};
pub(super) use expected::expected;
pub(super) use locations::locations;
pub(super) use map::{Axes, cell, half_cell_mm};
pub(super) use size::{NARROW_PX, NARROW_SQUARE_PX, SQUARE_PX, WIDTH_PX};

use super::Subject;
use super::frame::{Section, counted};
use crate::chart::{Figure, Grid, Hue, LineStyle, Look, Mark, Panel, Shape};
use arrangement::Arrangement;
use maud::html;
use palpate_core::quantity::ArrayLayout;
use palpate_solver::Evaluation;
use std::ops::Range;

/// Draws the readings of each unit: under load, during loading and unloading, and in the calibration at every place.
pub(super) fn units(subject: &Subject) -> Option<Section> {
    let of_load = characteristics::characteristics(subject).map(|drawn| drawn.named("output-against-load"));
    let drawn = [layout::layout(subject), of_load].into_iter().flatten().chain(map::matrices(subject)).collect();
    let title = match subject.has_load_cell() {
        true => "Output of each unit, by load and by place",
        false => "Output of each unit, by depth and by place",
    };
    Section::of_figures(title, &html! {}, drawn)
}

/// Arranges units, given by their outputs, like the array.
fn arranged(subject: &Subject, units: &[Range<usize>]) -> Arrangement {
    let places = |layout: &ArrayLayout| units.iter().map(|unit| layout.places()[unit.start]).collect();
    Arrangement::of(subject.placed().map(places), units.len())
}

/// Creates a figure of panels, one below another.
pub(super) fn column(title: String, subtitle: &str, panels: Vec<Panel>, legend: Vec<Vec<(Look, String)>>) -> Figure {
    let grid = Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false });
    Figure { title, subtitle: subtitle.to_owned(), height_px: 200.0, panels, grid, legend, ..Figure::default() }
}

/// Returns the title of a unit's panel.
fn title(subject: &Subject, unit: &Range<usize>) -> Mark {
    Mark::Title(format!("unit {}", subject.layout().unit(unit.start) + 1))
}

/// Returns the note about units that aren't drawn.
fn left_out(units: usize) -> Vec<String> {
    if units > 0 { vec![format!("Not shown: {}.", counted(units, "more unit"))] } else { Vec::new() }
}

/// Colours and marks of the methods: first the method that takes the calibration point with the highest correlation, then the
/// best method.
pub(super) const LOOKS: [Look; 2] = [
    Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: false, line: LineStyle::None },
    Look { hue: Hue::Orange, shape: Some(Shape::Square), filled: false, line: LineStyle::None },
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
