//! Uncertainty of the forces: the uncertainty budget over all presses.

use super::Subject;
use super::frame::{number, section as framed, table, words};
use maud::{Markup, html};
use palpate_control::UncertaintyBudget;
use palpate_core::quantity::COVERAGE;
use palpate_data::dataset::Recorded;

/// Part of the budget: its name, its source, and its value, N.
type BudgetPart = (&'static str, &'static str, fn(&UncertaintyBudget) -> Option<f64>);

/// Parts in the order in which they are listed.
const PARTS: [BudgetPart; 6] = [
    ("load cell", "its certificate, or a check with a known weight", |budget| budget.cell_n),
    (
        "zero, interpolated between the readings without load before and after",
        "scatter without load; drift, rectangular",
        |budget| Some(budget.zero_n),
    ),
    ("noise in the window", "scatter without load", |budget| Some(budget.noise_n)),
    ("resolution", "smallest step read, rectangular", |budget| Some(budget.resolution_n)),
    ("mains interference", "rest after averaging whole periods, arcsine", |budget| Some(budget.hum_n)),
    ("temperature", "change of the load cell's sensitivity by its certificate, rectangular", |budget| {
        budget.temperature_n
    }),
];

/// Creates a row for each part of the budget; `None` if no run has budgets.
pub(super) fn section(subject: &Subject) -> Option<Markup> {
    let budgets: Vec<UncertaintyBudget> = subject.runs.iter().flat_map(pressed).collect();
    if budgets.is_empty() {
        return None;
    }
    let row = |name: &str, known: &str, values: Vec<f64>| {
        let name = html! { (name) br; small { (known) } };
        let most = values.iter().copied().reduce(f64::max);
        let mean_square = values.iter().map(|n| n * n).sum::<f64>() / values.len() as f64;
        let cell = |n: f64| number("", 1000.0 * n, 2, "");
        match most {
            Some(most) => vec![name, cell(mean_square.sqrt()), cell(most)],
            None => vec![name, words("not known"), words("")],
        }
    };
    let combined: Vec<f64> = budgets.iter().filter_map(UncertaintyBudget::u_n).collect();
    let expanded = combined.iter().map(|n| COVERAGE * n).collect();
    let unknown = combined
        .is_empty()
        .then_some("the load cell was not checked with a known weight, and the rig file has no certificate of it");
    // without a monitored temperature there is no such part; the load cell's is always listed
    let is_listed = |part: &&BudgetPart| part.0 == PARTS[0].0 || budgets.iter().any(|budget| part.2(budget).is_some());
    let listed = PARTS.iter().filter(is_listed);
    let parts = listed.map(|(name, known, of)| row(name, known, budgets.iter().filter_map(of).collect()));
    let whole = [
        row("combined, u", unknown.unwrap_or("root of the sum of squares"), combined),
        row(&format!("expanded, U (k = {COVERAGE})"), unknown.map_or("k times u", |_| "as above"), expanded),
    ];
    let head = ["source", "root mean square, mN", "largest, mN"];
    let body = html! {
        (table(&head.map(words), &parts.chain(whole).collect::<Vec<_>>()))
        p.note {
            "After the GUM (JCGM 100): the parts of the standard uncertainty of each force in contact, and their root of the sum of squares, "
            "column u_force_n. "
            @if unknown.is_some() { "palpate doctor --check-weight-n N checks the load cell." }
        }
    };
    Some(framed("Uncertainty of the force", &body))
}

/// Returns the budgets of all levels with a force.
fn pressed(run: &Recorded) -> impl Iterator<Item = UncertaintyBudget> {
    let levels = run.contacts.iter().flat_map(|contact| contact.levels.iter().zip(&contact.budgets));
    levels.filter(|(level, _)| level.force_set_n.is_some_and(|force_n| force_n > 0.0)).map(|(_, budget)| *budget)
}
