//! Uncertainty of the forces: the uncertainty budget over all presses.

use super::Subject;
use super::frame::{none, number, section as framed, table, words};
use maud::{Markup, html};
use palpate_control::Budget;
use palpate_core::quantity::COVERAGE;
use palpate_data::dataset::Recorded;

/// Part of the budget: its name, its source, and its value, N.
type Part = (&'static str, &'static str, fn(&Budget) -> Option<f64>);

/// Parts in the order in which they are listed.
const PARTS: [Part; 5] = [
    ("load cell", "its certificate, or a check with a known weight", |budget| budget.cell_n),
    ("zero, interpolated between the air before and after", "scatter in air; drift, rectangular", |budget| {
        Some(budget.zero_n)
    }),
    ("noise in the window", "scatter in air", |budget| Some(budget.noise_n)),
    ("resolution", "smallest step read, rectangular", |budget| Some(budget.resolution_n)),
    ("mains hum", "rest after averaging whole periods, arcsine", |budget| Some(budget.hum_n)),
];

/// Creates a row for each part of the budget; `None` if no run has budgets.
pub(super) fn section(subject: &Subject) -> Option<Markup> {
    let budgets: Vec<Budget> = subject.runs.iter().flat_map(pressed).collect();
    if budgets.is_empty() {
        return None;
    }
    let shown = |values: &[f64]| match values {
        [] => [none(), none()],
        values => {
            let mean_square = values.iter().map(|n| n * n).sum::<f64>() / values.len() as f64;
            let most = values.iter().copied().fold(0.0, f64::max);
            [mean_square.sqrt(), most].map(|n| number("", 1000.0 * n, 2, ""))
        }
    };
    let row = |name: String, known: &str, values: &[f64]| {
        let [typical, most] = shown(values);
        vec![words(name), words(known), typical, most]
    };
    let mut rows: Vec<Vec<Markup>> = PARTS
        .iter()
        .map(|(name, known, of)| row((*name).to_owned(), known, &budgets.iter().filter_map(of).collect::<Vec<_>>()))
        .collect();
    let combined: Vec<f64> = budgets.iter().filter_map(Budget::u_n).collect();
    let expanded: Vec<f64> = combined.iter().map(|n| COVERAGE * n).collect();
    rows.push(row("combined, u".to_owned(), "root of the sum of squares", &combined));
    rows.push(row(format!("expanded, U (k = {COVERAGE})"), "", &expanded));
    let head = ["source", "how it is known", "standard uncertainty, root mean square, mN", "largest, mN"];
    let is_known = !combined.is_empty();
    let body = html! {
        (table(&head.map(words), &rows))
        p.note {
            "After the GUM (JCGM 100): the parts of the standard uncertainty of each force in contact, and their root of the sum of squares, "
            "column u_force_n. "
            @if !is_known {
                "The rig file has neither a certificate of the load cell nor a check with a known weight: the error of its forces in "
                "newtons is unknown, so no combined uncertainty is stated. palpate doctor --check-weight-n checks it."
            }
        }
    };
    Some(framed("Uncertainty of the force", &body))
}

/// Returns the budgets of all levels with a force.
fn pressed(run: &Recorded) -> impl Iterator<Item = Budget> {
    let levels = run.contacts.iter().flat_map(|contact| contact.levels.iter().zip(&contact.budgets));
    levels.filter(|(level, _)| level.force_set_n.is_some_and(|force_n| force_n > 0.0)).map(|(_, budget)| *budget)
}
