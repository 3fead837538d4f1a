//! Table 1 as measured, by each definition that the paper may have meant.

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
    let hysteresis = [(&first[..], "ours")];
    let body = html! {
        p.note { "% of the output at the top force." }
        div.tables {
            (one("Repeatability, loading", 0, &by_all, |unit| unit.repeatability_loading_percent))
            (one("Repeatability, unloading", 1, &by_all, |unit| unit.repeatability_unloading_percent))
            (one("Hysteresis", 2, &hysteresis, |unit| unit.hysteresis_percent))
        }
        @for (definition, name) in DEFINITIONS { p.note { strong { (name) } ". " (definition.definition()) "." } }
        p.note { (HYSTERESIS_DEFINITION) "; " (CORRECTION_DEFINITION) "." }
        @if staircases.left_out > 0 { p.note { "Left out: " (staircases.left_out) " flagged levels." } }
    };
    Some(framed("Table 1: repeatability and hysteresis", &body))
}

/// One quantity of every unit that was measured: the paper's, then ours by some definitions; their means last.
fn one(title: &str, column: usize, by: &[(&[UnitCharacteristics], &str)], value: Value) -> Markup {
    let units = by[0].0.len();
    let is_papers = units == paper::TABLE_1_PERCENT.len();
    let papers = |unit: usize| is_papers.then(|| paper::TABLE_1_PERCENT[unit][column]);
    let ours = |unit: usize, (measured, _): &(&[UnitCharacteristics], &str)| value(&measured[unit]);
    let cell = |value: Option<f64>| value.map_or_else(none, |value| number("", value, 2, ""));
    let told: Vec<usize> = (0..units).filter(|&unit| by.iter().any(|by| ours(unit, by).is_some())).collect();
    let mut rows: Vec<Vec<Markup>> = told
        .iter()
        .map(|&unit| {
            let cells = by.iter().map(|by| cell(ours(unit, by)));
            [words(unit + 1), cell(papers(unit))].into_iter().chain(cells).collect()
        })
        .collect();
    let mean_of = |values: &mut dyn Iterator<Item = Option<f64>>| {
        ErrorSummary::of(&values.flatten().collect::<Vec<f64>>()).map(|sum| sum.mean)
    };
    let means = by.iter().map(|by| cell(mean_of(&mut told.iter().map(|&unit| ours(unit, by)))));
    rows.push(
        [words("mean"), cell(mean_of(&mut told.iter().map(|&unit| papers(unit))))].into_iter().chain(means).collect(),
    );
    let head: Vec<Markup> = ["unit", "paper"].into_iter().chain(by.iter().map(|(_, name)| *name)).map(words).collect();
    html! { div { strong { (title) } (table(&head, &rows)) } }
}
