//! Errors of the sensor, next to the paper's errors if these are shown, and the places found.

use super::beside_paper::CITATION;
use super::figures;
use super::frame::{Section, figures_of, none, number, percent, section as framed, table, words};
use super::{Judged, Subject};
use crate::paper;
use maud::{Markup, html};
use palpate_data::dataset::doubted_half_widths;
use palpate_solver::{BEST, Candidate, Coverage, ErrorSummary, Evaluation, LeftOut};
use std::collections::BTreeSet;

/// Creates the table of the errors, and the figures of the places next to it; `None` without an evaluation.
pub(super) fn section(subject: &Subject, judged: &Judged) -> Option<Section> {
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
pub(super) fn cross_validated(judged: &Judged) -> Option<Markup> {
    let cell =
        |key: String, value: Option<f64>, digits| value.map_or_else(none, |value| number(&key, value, digits, ""));
    let row = |Candidate { solver, location_error_mm, force_error_n }: &Candidate| {
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

type Cell<'a> = &'a dyn Fn(&str, &Evaluation) -> Option<Markup>;

/// Returns the table of each method's numbers, with the paper's numbers first where they are comparable.
fn numbers(evaluations: &[Evaluation], is_beside_paper: bool) -> Markup {
    let name = |evaluation: &Evaluation| match evaluation.choice {
        Some(_) => format!("{BEST}: {}", evaluation.solver),
        None => evaluation.solver.clone(),
    };
    let of_paper = |told: &str| is_beside_paper.then(|| words(told));
    let names = evaluations.iter().map(|e| words(name(e)));
    let head: Vec<Markup> = std::iter::once(words("")).chain(of_paper("paper")).chain(names).collect();
    let row = |label: &str, paper: String, cell: Cell<'_>| {
        let key = |evaluation: &Evaluation| if evaluation.choice.is_some() { BEST } else { "pearson" };
        let ours = evaluations.iter().map(|e| cell(key(e), e).unwrap_or_else(none));
        std::iter::once(words(label)).chain(of_paper(&paper)).chain(ours).collect::<Vec<Markup>>()
    };
    let of_location = |part: Part, name: &'static str| {
        move |key: &str, e: &Evaluation| {
            Some(number(&format!("{key}.location_error_mm.{name}"), part(&e.location_error_mm), 3, " mm"))
        }
    };
    let of_force = |part: Part, name: &'static str| {
        move |key: &str, e: &Evaluation| {
            Some(number(&format!("{key}.force_error_n.{name}"), part(e.force_error_n.as_ref()?), 4, " N"))
        }
    };
    let shares = |told: f64| format!("{:.0} %", 100.0 * told);
    let blank = String::new;
    let mut rows = vec![
        row("test presses", paper::POINTS.to_string(), &|key, e| {
            Some(number(&format!("{key}.points"), e.points as f64, 0, ""))
        }),
        row("location error, mean", format!("{} mm", paper::LOCATION_ERROR_MM), &of_location(|e| e.mean, "mean")),
        row("location error, median", blank(), &of_location(|e| e.median, "median")),
        row("location error, 95th percentile", blank(), &of_location(|e| e.p95, "p95")),
        row("location error, largest", blank(), &of_location(|e| e.max, "max")),
        row("force error, mean", format!("{} N", paper::FORCE_ERROR_N), &of_force(|e| e.mean, "mean")),
        row("force error, median", blank(), &of_force(|e| e.median, "median")),
        row("force error, 95th percentile", blank(), &of_force(|e| e.p95, "p95")),
        row("force error, largest", blank(), &of_force(|e| e.max, "max")),
        row("location error under 1 mm", shares(paper::WITHIN_1MM), &|key, e| {
            Some(percent(&format!("{key}.within.location_1mm"), e.within.location_1mm))
        }),
        row("force error under 0.1 N", shares(paper::WITHIN_0_1N), &|key, e| {
            Some(percent(&format!("{key}.within.force_0_1n"), e.within.force_0_1n?))
        }),
        row("both under", shares(paper::WITHIN_BOTH), &|key, e| {
            Some(percent(&format!("{key}.within.both"), e.within.both?))
        }),
    ];
    if has_load_cell(evaluations) {
        let by_load_cell = row("force error, mean, by the load cell", blank(), &|key, e| {
            Some(number(&format!("{key}.force_error_load_cell_n.mean"), e.force_error_load_cell_n?.mean, 4, " N"))
        });
        rows.insert(AFTER_FORCE_ERRORS, by_load_cell);
    }
    for (label, name, part) in COVERAGES {
        let cell =
            |key: &str, e: &Evaluation| Some(percent(&format!("{key}.coverage.{name}"), part(e.coverage.as_ref()?)?));
        rows.push(row(label, blank(), &cell));
    }
    rows.push(row("presses that the method itself doubted", blank(), &|_, e| {
        Some(words(e.verdicts.doubts().map(|(count, _)| count).iter().sum::<usize>()))
    }));
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
        @if evaluations.iter().any(|evaluation| !evaluation.left_out.is_none()) { (left_out_told(evaluations)) }
    }
}

type Part = fn(&ErrorSummary) -> f64;

/// Number of rows before the load cell's row: the number of presses, and four rows for each error.
const AFTER_FORCE_ERRORS: usize = 9;

/// Function that returns the fraction of errors within a stated half-width. The table below has the label, the name in the
/// evaluation, and the function.
type Share = fn(&Coverage) -> Option<f64>;
const COVERAGES: [(&str, &str, Share); 4] = [
    ("location inside its stated 68 % error", "location_68", |c| c.location_68),
    ("location inside its stated 95 % error", "location_95", |c| c.location_95),
    ("force inside its stated 68 % error", "force_68", |c| c.force_68),
    ("force inside its stated 95 % error", "force_95", |c| c.force_95),
];

/// Returns the note about excluded presses. Flagged presses are excluded for all methods; presses without an answer are excluded
/// only for the method concerned.
fn left_out_told(evaluations: &[Evaluation]) -> Markup {
    let LeftOut { calibration_flagged, test_flagged, .. } = evaluations.first().map(|e| e.left_out).unwrap_or_default();
    html! {
        p.note { "Excluded: " (calibration_flagged) " calibration and " (test_flagged) " test presses that are flagged"
            @for evaluation in evaluations { ", " (evaluation.left_out.test_unsolved) " without an answer by " (evaluation.solver) }
            "." }
    }
}
