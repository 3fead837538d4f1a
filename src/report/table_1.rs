//! Repeatability and hysteresis of each unit, by each definition that is in use; beside the paper's Table 1 where that stands.

use super::Subject;
use super::frame::{none, number, section as framed, table, words};
use crate::dataset::characteristics::{
    CORRECTION_DEFINITION, HYSTERESIS_DEFINITION, Repeatability, Staircases, UnitCharacteristics, characterise,
};
use crate::paper;
use crate::solver::ErrorSummary;
use maud::{Markup, html};

/// The definitions beside each other, and what each is called.
const DEFINITIONS: [(Repeatability, &str); 3] =
    [(Repeatability::ThreeSd, "3 sd"), (Repeatability::Range, "range"), (Repeatability::T95, "t95")];

type Value = fn(&UnitCharacteristics) -> Option<f64>;

/// Repeatability on both branches and hysteresis of every unit, % of full scale.
pub fn section(subject: &Subject) -> Option<Markup> {
    let staircases = Staircases::of_run(&subject.presses, &subject.layout)?;
    let measured = DEFINITIONS.map(|(definition, name)| (characterise(&staircases, definition), name));
    let [(first, _), ..] = &measured;
    let by_all: Vec<(&[UnitCharacteristics], &str)> =
        measured.iter().map(|(units, name)| (&units[..], *name)).collect();
    let is_papers = subject.is_beside_paper();
    let hysteresis = [(&first[..], "measured")];
    let body = html! {
        p.note { "% of the output at the top force." }
        div.tables {
            (one("Repeatability, loading", is_papers.then_some(0), &by_all, |unit| unit.repeatability_loading_percent))
            (one("Repeatability, unloading", is_papers.then_some(1), &by_all, |unit| unit.repeatability_unloading_percent))
            (one("Hysteresis", is_papers.then_some(2), &hysteresis, |unit| unit.hysteresis_percent))
        }
        @for (definition, name) in DEFINITIONS { p.note { strong { (name) } ". " (definition.definition()) "." } }
        p.note { (HYSTERESIS_DEFINITION) "; " (CORRECTION_DEFINITION) "." }
        @if staircases.left_out > 0 { p.note { "Left out: " (staircases.left_out) " flagged levels." } }
    };
    Some(framed("Repeatability and hysteresis of each unit", &body))
}

/// One quantity of every unit that was measured by some definitions, after the paper's where its column is named; their means last.
fn one(title: &str, papers_column: Option<usize>, by: &[(&[UnitCharacteristics], &str)], value: Value) -> Markup {
    let units = by[0].0.len();
    let papers = |unit: usize| Some(paper::TABLE_1_PERCENT.get(unit)?[papers_column?]);
    let ours = |unit: usize, (measured, _): &(&[UnitCharacteristics], &str)| value(&measured[unit]);
    let cell = |value: Option<f64>| value.map_or_else(none, |value| number("", value, 2, ""));
    let beside = |value: Option<f64>| papers_column.map(|_| cell(value));
    let told: Vec<usize> = (0..units).filter(|&unit| by.iter().any(|by| ours(unit, by).is_some())).collect();
    let mut rows: Vec<Vec<Markup>> = told
        .iter()
        .map(|&unit| {
            let cells = by.iter().map(|by| cell(ours(unit, by)));
            std::iter::once(words(unit + 1)).chain(beside(papers(unit))).chain(cells).collect()
        })
        .collect();
    let mean_of = |values: &mut dyn Iterator<Item = Option<f64>>| {
        ErrorSummary::of(&values.flatten().collect::<Vec<f64>>()).map(|sum| sum.mean)
    };
    let means = by.iter().map(|by| cell(mean_of(&mut told.iter().map(|&unit| ours(unit, by)))));
    let papers_mean = beside(mean_of(&mut told.iter().map(|&unit| papers(unit))));
    rows.push(std::iter::once(words("mean")).chain(papers_mean).chain(means).collect());
    let names = by.iter().map(|(_, name)| *name);
    let head: Vec<Markup> =
        std::iter::once("unit").chain(papers_column.map(|_| "paper")).chain(names).map(words).collect();
    html! { div { strong { (title) } (table(&head, &rows)) } }
}
