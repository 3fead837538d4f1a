//! Verdict at the top of the page, with the rule, each limit and the measured value.

use super::frame::{capital, none, number, table, words};
use super::{SensorResults, Subject};
use maud::{Markup, html};
use palpate_data::acceptance::{Decision, Judgement, LimitCheck, SensorVerdict};
use palpate_data::dataset::Status;

/// Creates the verdict, or the reason why there is none.
pub(super) fn section(subject: &Subject, judged: &SensorResults) -> Markup {
    let broken = subject.runs.iter().find(|run| run.manifest.status != Status::Complete);
    let class = match (broken, judged.judgement.as_ref().map(|judgement| judgement.verdict)) {
        (Some(_), _) | (None, Some(SensorVerdict::NotAccepted)) => "sides verdict bad",
        (None, Some(SensorVerdict::Accepted)) => "sides verdict good",
        (None, Some(SensorVerdict::NotDecided) | None) => "sides verdict",
    };
    html! {
        div class=(class) {
            div {
                @if let Some(run) = broken {
                    strong { (run.name()) " is " (run.manifest.status.name()) ": " (run.manifest.presses_done) " of "
                        (run.manifest.facts.presses_planned) " presses" }
                    @match (&run.manifest.trip, &run.manifest.failure) {
                        // the failure already reports a trip
                        (Some(trip), _) => p { (trip) }
                        (None, Some(failure)) => p { (failure) }
                        (None, None) => {}
                    }
                }
                @match &judged.judgement {
                    Some(judgement) => (by_rule(judgement)),
                    None => (without_rule(judged)),
                }
                @for output in judged.evaluations.first().iter().flat_map(|evaluation| &evaluation.broken_outputs) {
                    p { "Broken: " (output) "." }
                }
                @if let Some(why) = &judged.why_not { p { (why) } }
            }
            @if let Some(judgement) = &judged.judgement {
                (checks(judgement))
                div.reasons {
                    @for note in &judgement.notes { p.note { (capital(note)) "." } }
                    @for reason in judgement.all_reasons() { p.note { (capital(&reason)) "." } }
                }
            }
        }
    }
}

fn without_rule(judged: &SensorResults) -> Markup {
    html! {
        strong { "No verdict" }
        p { "No acceptance rule was given."
            @if let Some(evaluation) = judged.decisive() {
                " Mean errors of " (number("", evaluation.location_error_mm.mean, 3, " mm"))
                @if let Some(error) = evaluation.depth_error_mm { " and " (number("", error.mean, 3, " mm of depth")) }
                @if let Some(error) = evaluation.force_error_n { " and " (number("", error.mean, 4, " N")) }
                " by " (evaluation.solver) ", on " (evaluation.points) " test presses."
            }
        }
    }
}

fn by_rule(judgement: &Judgement) -> Markup {
    let Judgement { verdict, method, calibration_presses, test_presses, .. } = judgement;
    let meaning = match is_guarded(judgement) {
        true => {
            "Guarded rule: the one-sided 95 % bound of each value must be within its limit. A sensor exactly at a limit passes at \
             most about 1 time in 20."
        }
        false => {
            "Simple rule: each value must be within its limit. A sensor exactly at a limit passes about half of the time."
        }
    };
    html! {
        strong { (capital(verdict.text())) }
        p { (meaning) " Judged by the method " (method) ", on " (calibration_presses) " calibration and " (test_presses) " test presses."
            @if let Some(file) = &judgement.judged_afterwards_by { " Judged afterwards by " (file) "." }
        }
    }
}

fn is_guarded(judgement: &Judgement) -> bool {
    judgement.rule == Decision::Guarded.word()
}

/// Returns the table of the checked figures.
fn checks(judgement: &Judgement) -> Markup {
    let is_guarded = is_guarded(judgement);
    let mut head = vec![words(""), words("found")];
    head.extend(is_guarded.then(|| words("95 % bound")));
    head.extend(["limit", "n", ""].map(words));
    let row = |check: &LimitCheck| {
        let mut cells = vec![words(check.kind.full_name(check.reach)), value(check, check.value)];
        cells.extend(is_guarded.then(|| value(check, check.bound)));
        cells.extend([value(check, Some(check.limit)), words(check.n), words(check.verdict.text())]);
        cells
    };
    table(&head, &judgement.checks.iter().map(row).collect::<Vec<_>>())
}

/// Returns a value of a checked figure with its unit.
fn value(check: &LimitCheck, value: Option<f64>) -> Markup {
    let unit = match check.kind.unit() {
        "" => String::new(),
        unit => format!(" {unit}"),
    };
    value.map_or_else(none, |value| html! { data value=(value) data-key="" { (check.shown(Some(value))) } (unit) })
}
