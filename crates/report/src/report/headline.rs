//! States whether the sensor is accepted, and its errors; next to the paper's errors if these are shown.

use super::beside_paper::CITATION;
use super::frame::{none, number, percent, section as framed, table, words};
use super::verdict;
use super::{Judged, Subject};
use crate::paper;
use maud::{Markup, html};
use palpate_data::dataset::doubted_half_widths;
use palpate_solver::{BEST, Coverage, ErrorSummary, Evaluation, LeftOut};
use std::collections::BTreeSet;

/// Creates the first section of the page.
pub(super) fn section(subject: &Subject, judged: &Judged) -> Option<Markup> {
    let is_beside_paper = subject.is_beside_paper();
    Some(html! {
        (verdict::section(subject, judged))
        @if !judged.evaluations.is_empty() {
            (framed("Errors of the test presses", &numbers(&judged.evaluations, is_beside_paper)))
        }
        @if is_beside_paper { p.note { "Paper: " cite { (CITATION) } "." } }
    })
}

type Cell<'a> = &'a dyn Fn(&str, &Evaluation) -> Option<Markup>;

/// Returns the numbers of each method, with the paper's numbers first where they are comparable.
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
    let has_load_cell = evaluations.iter().any(|evaluation| evaluation.force_error_load_cell_n.is_some());
    if has_load_cell {
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
    rows.push(row("verdict of the method not ok", blank(), &|_, e| {
        Some(words(e.verdicts.doubts().map(|(count, _)| count).iter().sum::<usize>()))
    }));
    html! {
        (table(&head, &rows))
        p.note {
            @if has_load_cell {
                "Force errors are against the commanded force" @if is_beside_paper { ", as in the paper" }
                "; in the row by the load cell, calibration and test use its forces. "
            }
            "Stated half-width: the method's own estimate of its error; if it is right, 68 and 95 % of the errors are within it."
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
    ("location within the stated half-width of 68 %", "location_68", |c| c.location_68),
    ("location within the stated half-width of 95 %", "location_95", |c| c.location_95),
    ("force within the stated half-width of 68 %", "force_68", |c| c.force_68),
    ("force within the stated half-width of 95 %", "force_95", |c| c.force_95),
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
