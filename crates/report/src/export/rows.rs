//! Frames that only a lake has: a row about a run, its verdict, and the errors of its test.

use super::frame::{self, Column, Frame, Values};
use palpate_data::acceptance::{Judgement, Verdict};
use palpate_data::dataset::Recorded;
use palpate_run::rig::Bench;
use palpate_solver::Evaluation;
use std::borrow::Cow;

/// Returns a frame with the run's name in the lake as its first column.
pub fn of_run(mut frame: Frame, id: &str) -> Frame {
    let ids = vec![Some(Cow::Owned(id.to_owned())); frame.rows];
    frame.columns.insert(0, Column::new("run", "Name of the run in the lake.", Values::Text(ids)));
    frame
}

/// Returns a row about a run with this number of rows in the table of presses.
pub(crate) fn run(run: &Recorded, bench: &Bench, id: &str, rows: u64) -> Frame {
    let manifest = &run.manifest;
    let (facts, labels) = (&manifest.facts, &manifest.facts.labels);
    let (first, last) = (manifest.sessions.first(), manifest.sessions.last());
    let text = |text: Option<&str>| Values::Text(vec![text.map(|text| Cow::Owned(text.to_owned()))]);
    let count = |count: u64| Values::I64(vec![count as i64]);
    let began = first.map(|first| utc(&first.started));
    let columns = vec![
        Column::new("name", "Name of the run's folder.", text(Some(&run.name()))),
        Column::new("recipe", "Name of the recipe.", text(Some(&facts.recipe))),
        Column::new("mounting", "Mounting of the sensor on the bench.", text(labels.mounting.as_deref())),
        Column::new("operator", "Person who made the run.", text(labels.operator.as_deref())),
        Column::new("note", "Any other note.", text(labels.note.as_deref())),
        Column::new(
            "status",
            "Ending of the run: complete, stopped, tripped or failed.",
            text(Some(manifest.status.name())),
        ),
        Column::new("started", "Start of the run, in UTC.", text(began.as_deref())),
        Column::new("ended", "End of the last session, in UTC.", text(manifest.ended.as_deref().map(utc).as_deref())),
        Column::new("bench", "Name of the machine that measured last.", text(last.map(|last| last.host.as_str()))),
        Column::new(
            "palpate",
            "Version of the program that began the run.",
            text(first.map(|first| first.palpate.as_str())),
        ),
        Column::new(
            "simulated",
            "Whether emulators were at the other ends of the links.",
            Values::Bool(vec![facts.simulated]),
        ),
        Column::new("seed", "Random seed for places, forces and simulated noise.", count(facts.seed)),
        Column::new("presses_planned", "Number of entries of the plan.", count(facts.presses_planned)),
        Column::new("presses_done", "Number of entries on disk.", count(manifest.presses_done)),
        Column::new("rows", "Number of rows in the table of presses.", count(rows)),
        Column::new("rows_flagged", "Number of flagged rows.", count(manifest.rows_flagged)),
        Column::new("outputs", "Number of outputs of the array.", count(bench.layout.len() as u64)),
        Column::new("output_unit", "Unit of the outputs.", text(Some(&bench.unit))),
        Column::new("manifest", "The manifest of the run, as JSON.", text(Some(&frame::manifest(run)))),
    ];
    of_run(Frame { name: "runs", rows: 1, columns }, id)
}

/// Returns a row for each limit of a rule.
pub(crate) fn verdict(judgement: &Judgement) -> Frame {
    let checks = &judgement.checks;
    let all = |text: &str| Values::Text(vec![Some(Cow::Owned(text.to_owned())); checks.len()]);
    let numbers = |of: &dyn Fn(usize) -> Option<f64>| {
        Values::F64((0..checks.len()).map(|index| of(index).unwrap_or(f64::NAN)).collect())
    };
    let texts = |of: &dyn Fn(usize) -> Option<Cow<'static, str>>| Values::Text((0..checks.len()).map(of).collect());
    let columns = vec![
        Column::new(
            "verdict",
            "Verdict on the sensor: accepted, not-accepted or not-decided.",
            all(word(judgement.verdict)),
        ),
        Column::new("rule", "Kind of the rule: simple or guarded.", all(judgement.rule)),
        Column::new("method", "Method that finds places and forces.", all(&judgement.method)),
        Column::new("figure", "Key that sets the limit.", texts(&|index| Some(Cow::Borrowed(checks[index].figure)))),
        Column::new("value", "Measured value, in the figure's unit.", numbers(&|index| checks[index].value)),
        Column::new(
            "bound",
            "One-sided 95 % bound of the value, with a guarded rule.",
            numbers(&|index| checks[index].bound),
        ),
        Column::new("limit", "The limit, in the figure's unit.", numbers(&|index| Some(checks[index].limit))),
        Column::new(
            "figure_unit",
            "Unit of value, bound and limit.",
            texts(&|index| Some(Cow::Borrowed(checks[index].kind.unit()))),
        ),
        Column::new(
            "n",
            "Number of presses or readings.",
            Values::I64(checks.iter().map(|check| check.n as i64).collect()),
        ),
        Column::new(
            "figure_verdict",
            "Verdict by this limit alone.",
            texts(&|index| Some(Cow::Borrowed(word(checks[index].verdict)))),
        ),
        Column::new(
            "reason",
            "Reason why the value isn't accepted.",
            texts(&|index| checks[index].reason.clone().map(Cow::Owned)),
        ),
    ];
    Frame { name: "verdicts", rows: checks.len(), columns }
}

/// Returns the errors of a method, a row for each test press that it solved.
pub(crate) fn errors(evaluation: &Evaluation) -> Frame {
    let presses = &evaluation.presses;
    let numbers = |of: fn(&palpate_solver::PressError) -> f64| Values::F64(presses.iter().map(of).collect());
    let method = Values::Text(vec![Some(Cow::Owned(evaluation.solver.clone())); presses.len()]);
    let columns = vec![
        Column::new("method", "Method that found place and force.", method),
        Column::new("x_mm", "True x, specimen frame, mm.", numbers(|press| press.place_true.x_mm)),
        Column::new("y_mm", "True y, specimen frame, mm.", numbers(|press| press.place_true.y_mm)),
        Column::new("x_solved_mm", "Solved x, mm.", numbers(|press| press.place_solved.x_mm)),
        Column::new("y_solved_mm", "Solved y, mm.", numbers(|press| press.place_solved.y_mm)),
        Column::new(
            "location_error_mm",
            "Distance between true and solved place, mm.",
            numbers(|press| press.location_error_mm),
        ),
        Column::new("force_solved_n", "Solved force, N.", numbers(|press| press.force_solved_n)),
        Column::new(
            "force_error_n",
            "Absolute difference from the true force, N.",
            numbers(|press| press.force_error_n.unwrap_or(f64::NAN)),
        ),
    ];
    Frame { name: "errors", rows: presses.len(), columns }
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Accepted => "accepted",
        Verdict::NotAccepted => "not-accepted",
        Verdict::NotDecided => "not-decided",
    }
}

/// Returns a time with its zone as UTC in microseconds, which other programs read; an unknown form stays as it is.
fn utc(time: &str) -> String {
    time.parse::<jiff::ZonedDateTime>().map_or_else(|_| time.to_owned(), |time| format!("{:.6}", time.timestamp()))
}
