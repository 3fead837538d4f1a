//! Figures of the methods' studies.

mod budget;
mod coverage;
mod failures;
mod speed_accuracy;

pub use budget::{budget_figures, budget_figures_of};
pub use coverage::coverage_figures;
pub use failures::failure_figures;
pub use speed_accuracy::speed_accuracy_figures;

use super::trial::{CRAMER_RAO, MethodRow, StudiedMethod};
use palpate_report::chart::{Hue, LineStyle, Look, Shape};
use palpate_report::paper;
use palpate_solver::BEST;

/// Mean location error in the paper, mm (paper section 4).
const PAPER_MM: f64 = paper::LOCATION_ERROR_MM;

/// A figure: the name of its file and the SVG.
pub(super) type FigureFile = (String, String);

/// Look of a method. Similar methods have similar colours. The automatic choice is a thin line over the chosen method.
fn look(solver: &str) -> Look {
    let (hue, shape) = match solver {
        "pearson" => (Hue::Blue, Shape::Circle),
        "pearson-lsq" => (Hue::Teal, Shape::Diamond),
        "surrogate" => (Hue::Green, Shape::Circle),
        "physics" => (Hue::Red, Shape::Square),
        "gaussian-process" => (Hue::Brown, Shape::Triangle),
        "pattern-map" => (Hue::Green, Shape::Diamond),
        "blend" => (Hue::Brown, Shape::Circle),
        BEST => return Look::line(Hue::Ink, LineStyle::Dashed),
        _ => (Hue::Grey, Shape::Cross),
    };
    Look { hue, shape: Some(shape), filled: !matches!(solver, "pearson-lsq"), line: LineStyle::Solid }
}

/// Line style of the bound.
const BOUND: Look = Look::line(Hue::Grey, LineStyle::Solid);

/// Look and name of every method.
fn methods() -> impl Iterator<Item = (Look, String)> {
    StudiedMethod::names().map(|name| (look(name), name.to_owned()))
}

/// Look and name of every method and of the bound.
fn methods_and_bound() -> impl Iterator<Item = (Look, String)> {
    methods().chain([(BOUND, "least possible error (Cramér-Rao)".to_owned())])
}

/// Legend of the marks, with `in_a_line` entries in a line.
fn legend(entries: impl Iterator<Item = (Look, String)>, in_a_line: usize) -> Vec<Vec<(Look, String)>> {
    entries.collect::<Vec<_>>().chunks(in_a_line).map(<[_]>::to_vec).collect()
}

/// Description of the bound for a note.
fn bound_name(row: &MethodRow) -> Option<&'static str> {
    Some(match row.bound? {
        CRAMER_RAO => "bound: the least mean error of any unbiased method that knows the array exactly (Cramér-Rao)",
        _ => "stated: the mean error that surrogate expects of its own answers",
    })
}
