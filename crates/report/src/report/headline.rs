//! Errors of the sensor, next to the paper's errors if these are shown, and the places found.

use super::beside_paper::CITATION;
use super::figures;
use super::frame::{Section, figures_of, none, number, section as framed, table, words};
use super::{SensorResults, Subject};
use crate::errors::{self, Detail, ErrorNumber};
use maud::{Markup, html};
use palpate_data::dataset::doubted_half_widths;
use palpate_solver::{BEST, Evaluation, LeftOut, TriedMethod};
use std::collections::BTreeSet;

/// Creates the table of the errors, and the figures of the places next to it; `None` without an evaluation.
pub(super) fn section(subject: &Subject, judged: &SensorResults) -> Option<Section> {
    let evaluations = &judged.evaluations;
    let is_beside_paper = subject.is_beside_paper();
    let places = figures::locations(judged);
    let body = html! {
        div.first { (numbers(evaluations, is_beside_paper)) (figures_of(&places)) }
        (notes(evaluations, is_beside_paper))
        @if is_beside_paper { p.note { "Paper: " cite { (CITATION) } "." } }
    };
    let markup = framed("Errors of the test presses", &body);
    (!evaluations.is_empty()).then_some(Section { markup, figures: places })
}

/// Creates the table of the cross-validated errors; `None` if there is a test.
pub(super) fn cross_validated(judged: &SensorResults) -> Option<Markup> {
    let cell =
        |key: String, value: Option<f64>, digits| value.map_or_else(none, |value| number(&key, value, digits, ""));
    let row = |TriedMethod { solver, location_error_mm, force_error_n }: &TriedMethod| {
        let location = cell(format!("{solver}.location_error_mm"), *location_error_mm, 3);
        vec![words(solver), location, cell(format!("{solver}.force_error_n"), *force_error_n, 4)]
    };
    let head = ["method", "location error, mean, mm", "force error, mean, N"].map(words);
    let body = html! {
        (table(&head, &judged.cross_validated.iter().map(row).collect::<Vec<_>>()))
        p.note { "No test presses. Each calibration press was solved by the method fitted without the press's place." }
    };
    (!judged.cross_validated.is_empty()).then(|| framed("Cross-validated errors of the calibration", &body))
}

/// Returns the table of each method's numbers, with the paper's numbers first where they are comparable.
fn numbers(evaluations: &[Evaluation], is_beside_paper: bool) -> Markup {
    let name = |evaluation: &Evaluation| match evaluation.choice {
        Some(_) => format!("{BEST}: {}", evaluation.solver),
        None => evaluation.solver.clone(),
    };
    let of_paper = |cell: String| is_beside_paper.then(|| words(cell));
    let names = evaluations.iter().map(|e| words(name(e)));
    let head: Vec<Markup> = [words("")].into_iter().chain(of_paper("paper".to_owned())).chain(names).collect();
    let cell = |number: &ErrorNumber, evaluation: &Evaluation| {
        let Some(value) = number.value(evaluation) else { return none() };
        let key = if evaluation.choice.is_some() { BEST } else { "pearson" };
        let key = if number.key.is_empty() { String::new() } else { format!("{key}.{}", number.key) };
        html! { data value=(value) data-key=(key) { (number.digits_of(value)) } " " (number.unit) }
    };
    let row = |number: &ErrorNumber| {
        let ours = evaluations.iter().map(|evaluation| cell(number, evaluation));
        [words(number.name)].into_iter().chain(of_paper(number.shown_of_paper())).chain(ours).collect::<Vec<Markup>>()
    };
    let rows = errors::known(&evaluations.iter().collect::<Vec<_>>(), Detail::All).map(row).collect::<Vec<_>>();
    table(&head, &rows)
}

fn has_load_cell(evaluations: &[Evaluation]) -> bool {
    evaluations.iter().any(|evaluation| evaluation.force_error_load_cell_n.is_some())
}

/// Returns the notes below the table.
fn notes(evaluations: &[Evaluation], is_beside_paper: bool) -> Markup {
    html! {
        p.note {
            @if has_load_cell(evaluations) {
                "Force errors are against the commanded force" @if is_beside_paper { ", as in the paper" }
                "; in the row by the load cell, calibration and test use its forces. "
            }
            "Stated error: the method's own estimate of its error; if it is right, 68 and 95 % of the errors are inside it."
        }
        @for line in evaluations.iter().flat_map(doubted_half_widths).collect::<BTreeSet<_>>() { p.note { "Warning: " (line) "." } }
        @if let Some(evaluation) = evaluations.first().filter(|evaluation| evaluation.at_calibrated_places > 0) {
            p.note { (evaluation.at_calibrated_places) " of the test presses are at places of the calibration." }
        }
        @if evaluations.iter().any(|evaluation| !evaluation.left_out.is_none()) { (left_out_note(evaluations)) }
    }
}

/// Returns the note about excluded presses. Flagged presses are excluded for all methods; presses without an answer are excluded
/// only for the method concerned.
fn left_out_note(evaluations: &[Evaluation]) -> Markup {
    let LeftOut { calibration_flagged, test_flagged, .. } = evaluations.first().map(|e| e.left_out).unwrap_or_default();
    html! {
        p.note { "Excluded: " (calibration_flagged) " calibration and " (test_flagged) " test presses that are flagged"
            @for evaluation in evaluations { ", " (evaluation.left_out.test_unsolved) " without an answer by " (evaluation.solver) }
            "." }
    }
}
