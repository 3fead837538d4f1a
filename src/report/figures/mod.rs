//! The paper's figures as measured, and those it lacks: each part draws one of them, or none where there is nothing to draw.

mod characteristics;
mod errors;
mod expected;
mod locations;
mod map;
mod size;

pub use errors::{dependences, distributions};
pub use expected::expected;
pub use locations::locations;
pub use size::{SQUARE_PX, WIDTH_PX};

use super::Subject;
use super::frame::{figures, section};
use crate::chart::{Hue, Line, Look, Shape};
use crate::solver::Evaluation;
use maud::Markup;

/// What each unit reads: of a load on it, up and down, and of the calibration's at every place.
pub fn units(subject: &Subject) -> Option<Markup> {
    let drawn: Vec<_> =
        [characteristics::characteristics(subject), map::matrix(subject)].into_iter().flatten().collect();
    (!drawn.is_empty()).then(|| section("Figure 8 and the calibration matrix: what each unit reads", &figures(&drawn)))
}

/// How the methods look, the paper's first.
pub const LOOKS: [Look; 2] = [
    Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: false, line: Line::None },
    Look { hue: Hue::Orange, shape: Some(Shape::Square), filled: false, line: Line::None },
];

/// Each method with its look.
fn methods(evaluations: &[Evaluation]) -> impl Iterator<Item = (Look, &Evaluation)> {
    LOOKS.into_iter().zip(evaluations)
}

/// How a method is called.
fn name(evaluation: &Evaluation) -> String {
    let best = if evaluation.choice.is_some() { " (best)" } else { "" };
    format!("{}{best}", evaluation.solver)
}
