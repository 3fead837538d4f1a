//! Characteristics of each unit, with the repeatability by each common definition; next to the paper's Table 1 if it is shown.

use super::Subject;
use super::frame::{capital, none, number, section as framed, table, words};
use crate::paper;
use maud::{Markup, html};
use palpate_control::Branch;
use palpate_data::dataset::characteristics::{Repeatability, Staircases, UnitCharacteristics, characterise, terms};
use palpate_solver::ErrorSummary;

/// Definitions of repeatability in the table, with their names.
const DEFINITIONS: [(Repeatability, &str); 3] =
    [(Repeatability::ThreeSd, "3 sd"), (Repeatability::Range, "range"), (Repeatability::T95, "t95")];

/// Largest number of rows of a table without a fold. The second constant is the number of rows above the fold.
const LISTED_MOST: usize = 12;
const WORST: usize = 6;

type ItemValue = fn(&UnitCharacteristics) -> Option<f64>;
type Interval = fn(&UnitCharacteristics) -> Option<(f64, f64)>;

/// Column with this program's values: name of the item, its units, the value, and the interval of the true value.
struct ItemColumn<'a> {
    name: &'a str,
    units: &'a [UnitCharacteristics],
    value: ItemValue,
    interval: Interval,
}

/// Repeatability on both branches, hysteresis, linearity and zero return of every unit.
pub(super) fn section(subject: &Subject) -> Option<Markup> {
    let staircases = Staircases::of_run(&subject.presses, subject.layout())?;
    let measured = DEFINITIONS.map(|(definition, name)| (characterise(&staircases, definition), name));
    let [(first, _), ..] = &measured;
    let repeats = |value: ItemValue, interval: Interval| -> Vec<ItemColumn<'_>> {
        measured.iter().map(|(units, name)| ItemColumn { name, units, value, interval }).collect()
    };
    let plain = |name, value: ItemValue| ItemColumn { name, units: first, value, interval: |_| None };
    let loading: Interval = |unit| unit.repeatability_interval_percent(Branch::Loading);
    let unloading: Interval = |unit| unit.repeatability_interval_percent(Branch::Unloading);
    let hysteresis = [
        plain("found", |unit| unit.hysteresis_percent),
        plain("of reading", |unit| unit.hysteresis_of_reading_percent),
    ];
    let others =
        [plain("linearity", |unit| unit.linearity_percent), plain("zero return", |unit| unit.zero_return_percent)];
    let papers = |column: usize| subject.is_beside_paper().then_some(column);
    let body = html! {
        p.note { "% of full scale, except the hysteresis of the reading. Below each repeatability: its 95 % interval." }
        div.tables {
            (one("Repeatability, loading", papers(0), &repeats(|unit| unit.repeatability_loading_percent, loading)))
            (one("Repeatability, unloading", papers(1), &repeats(|unit| unit.repeatability_unloading_percent, unloading)))
            (one("Hysteresis", papers(2), &hysteresis))
            (one("Linearity and zero return", None, &others))
        }
        details {
            summary { "definitions" }
            @for (definition, name) in DEFINITIONS { p.note { strong { "Repeatability, " (name) } ": " (definition.definition()) "." } }
            @for term in terms::COMMON { p.note { strong { (capital(term.name)) } ": " (term.definition) "." } }
            p.note { (terms::SOURCES) }
        }
        @if staircases.left_out > 0 { p.note { "Excluded: " (staircases.left_out) " flagged levels." } }
    };
    Some(framed("Characteristics of each unit", &body))
}

/// Returns the table of one quantity for every measured unit. If a column of the paper is named, it comes first. The means are in
/// the last row.
fn one(title: &str, papers: Option<usize>, columns: &[ItemColumn<'_>]) -> Markup {
    let units = columns[0].units.len();
    let papers = papers.map(|column| move |unit: usize| Some(paper::TABLE_1_PERCENT.get(unit)?[column]));
    let ours = |unit: usize, column: &ItemColumn<'_>| (column.value)(&column.units[unit]);
    let cell = |value: Option<f64>| value.map_or_else(none, |value| number("", value, 2, ""));
    let with_interval = |unit: usize, column: &ItemColumn<'_>| {
        let interval = (column.interval)(&column.units[unit]);
        html! {
            (cell(ours(unit, column)))
            @if let Some((least, most)) = interval {
                br;
                small { (number("", least, 2, "")) " to " (number("", most, 2, "")) }
            }
        }
    };
    let text: Vec<usize> =
        (0..units).filter(|&unit| columns.iter().any(|column| ours(unit, column).is_some())).collect();
    let row = |&unit: &usize| -> Vec<Markup> {
        let cells = columns.iter().map(|column| with_interval(unit, column));
        [words(columns[0].units[unit].name())]
            .into_iter()
            .chain(papers.iter().map(|papers| cell(papers(unit))))
            .chain(cells)
            .collect()
    };
    let (shown, folded) = worst(&text, |&unit| ours(unit, &columns[0]));
    let mut rows: Vec<Vec<Markup>> = shown.iter().map(row).collect();
    let mean_of = |values: &mut dyn Iterator<Item = Option<f64>>| {
        ErrorSummary::of(&values.flatten().collect::<Vec<f64>>()).map(|sum| sum.mean)
    };
    let papers_mean = papers.iter().map(|papers| cell(mean_of(&mut text.iter().map(|&unit| papers(unit)))));
    let means = columns.iter().map(|column| cell(mean_of(&mut text.iter().map(|&unit| ours(unit, column)))));
    rows.push([words("mean")].into_iter().chain(papers_mean).chain(means).collect());
    let names = papers.iter().map(|_| "paper").chain(columns.iter().map(|column| column.name));
    let head: Vec<Markup> = ["unit"].into_iter().chain(names).map(words).collect();
    let others: Vec<Vec<Markup>> = folded.iter().map(row).collect();
    html! {
        div {
            strong { (title) }
            (table(&head, &rows))
            @if !others.is_empty() {
                p.note { "The " (shown.len()) " largest of " (text.len()) ", and the mean of all." }
                details { summary { "the other " (others.len()) } (table(&head, &others)) }
            }
        }
    }
}

/// Splits a long list into the units with the largest values and the others, each in their order.
fn worst(units: &[usize], value: impl Fn(&usize) -> Option<f64>) -> (Vec<usize>, Vec<usize>) {
    if units.len() <= LISTED_MOST {
        return (units.to_vec(), Vec::new());
    }
    let mut by_value: Vec<usize> = units.to_vec();
    by_value.sort_by(|a, b| value(b).unwrap_or_default().total_cmp(&value(a).unwrap_or_default()));
    units.iter().partition(|unit| by_value[..WORST].contains(unit))
}
