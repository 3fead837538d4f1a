//! Frames that only a lake has: a row about a run, its verdict, and the errors of its test.

use super::frame::{self, ExportTable, TableColumn, Values};
use palpate_data::acceptance::{Judgement, SensorVerdict};
use palpate_data::dataset::Recorded;
use palpate_run::rig::Bench;
use palpate_solver::Evaluation;
use std::borrow::Cow;

/// Returns a frame with the run's name in the lake as its first column.
pub fn of_run(mut frame: ExportTable, id: &str) -> ExportTable {
    let ids = vec![Some(Cow::Owned(id.to_owned())); frame.rows];
    frame.columns.insert(0, TableColumn::new("run", "Name of the run in the lake.", Values::Text(ids)));
    frame
}

/// Returns a row about a run with this number of rows in the table of presses.
pub(crate) fn run(run: &Recorded, bench: &Bench, id: &str, rows: u64) -> ExportTable {
    let manifest = &run.manifest;
    let (facts, labels) = (&manifest.facts, &manifest.facts.labels);
    let (first, last) = (manifest.sessions.first(), manifest.sessions.last());
    let text = |text: Option<&str>| Values::Text(vec![text.map(|text| Cow::Owned(text.to_owned()))]);
    let count = |count: u64| Values::I64(vec![count as i64]);
    let began = first.map(|first| utc(&first.started));
    let columns = vec![
        TableColumn::new("name", "Name of the run's folder.", text(Some(&run.name()))),
        TableColumn::new("recipe", "Name of the recipe.", text(Some(&facts.recipe))),
        TableColumn::new("mounting", "Mounting of the sensor on the bench.", text(labels.mounting.as_deref())),
        TableColumn::new("operator", "Person who made the run.", text(labels.operator.as_deref())),
        TableColumn::new("note", "Any other note.", text(labels.note.as_deref())),
        TableColumn::new(
            "status",
            "Ending of the run: complete, stopped, tripped or failed.",
            text(Some(manifest.status.name())),
        ),
        TableColumn::new("started", "Start of the run, in UTC.", text(began.as_deref())),
        TableColumn::new(
            "ended",
            "End of the last session, in UTC.",
            text(manifest.ended.as_deref().map(utc).as_deref()),
        ),
        TableColumn::new("bench", "Name of the machine that measured last.", text(last.map(|last| last.host.as_str()))),
        TableColumn::new(
            "palpate",
            "Version of the program that began the run.",
            text(first.map(|first| first.palpate.as_str())),
        ),
        TableColumn::new(
            "simulated",
            "Whether emulators were at the other ends of the links.",
            Values::Bool(vec![facts.simulated]),
        ),
        TableColumn::new("seed", "Random seed for places, forces and simulated noise.", count(facts.seed)),
        TableColumn::new("presses_planned", "Number of entries of the plan.", count(facts.presses_planned)),
        TableColumn::new("presses_done", "Number of entries on disk.", count(manifest.presses_done)),
        TableColumn::new("rows", "Number of rows in the table of presses.", count(rows)),
        TableColumn::new("rows_flagged", "Number of flagged rows.", count(manifest.rows_flagged)),
        TableColumn::new("outputs", "Number of outputs of the array.", count(bench.layout.len() as u64)),
        TableColumn::new("output_unit", "Unit of the outputs.", text(Some(&bench.unit))),
        TableColumn::new("manifest", "The manifest of the run, as JSON.", text(Some(&frame::manifest(run)))),
    ];
    of_run(ExportTable { name: "runs", rows: 1, columns }, id)
}

/// Returns a row for each limit of a rule.
pub(crate) fn verdict(judgement: &Judgement) -> ExportTable {
    let checks = &judgement.checks;
    let all = |text: &str| Values::Text(vec![Some(Cow::Owned(text.to_owned())); checks.len()]);
    let numbers = |of: &dyn Fn(usize) -> Option<f64>| {
        Values::F64((0..checks.len()).map(|index| of(index).unwrap_or(f64::NAN)).collect())
    };
    let texts = |of: &dyn Fn(usize) -> Option<Cow<'static, str>>| Values::Text((0..checks.len()).map(of).collect());
    let columns = vec![
        TableColumn::new(
            "verdict",
            "SensorVerdict on the sensor: accepted, not-accepted or not-decided.",
            all(word(judgement.verdict)),
        ),
        TableColumn::new("rule", "Kind of the rule: simple or guarded.", all(judgement.rule)),
        TableColumn::new("method", "Method that finds places and forces.", all(&judgement.method)),
        TableColumn::new(
            "figure",
            "Key that sets the limit.",
            texts(&|index| Some(Cow::Borrowed(checks[index].figure))),
        ),
        TableColumn::new("value", "Measured value, in the figure's unit.", numbers(&|index| checks[index].value)),
        TableColumn::new(
            "bound",
            "One-sided 95 % bound of the value, with a guarded rule.",
            numbers(&|index| checks[index].bound),
        ),
        TableColumn::new("limit", "The limit, in the figure's unit.", numbers(&|index| Some(checks[index].limit))),
        TableColumn::new(
            "figure_unit",
            "Unit of value, bound and limit.",
            texts(&|index| Some(Cow::Borrowed(checks[index].kind.unit()))),
        ),
        TableColumn::new(
            "n",
            "Number of presses or readings.",
            Values::I64(checks.iter().map(|check| check.n as i64).collect()),
        ),
        TableColumn::new(
            "figure_verdict",
            "SensorVerdict by this limit alone.",
            texts(&|index| Some(Cow::Borrowed(word(checks[index].verdict)))),
        ),
        TableColumn::new(
            "reason",
            "Reason why the value isn't accepted.",
            texts(&|index| checks[index].reason.clone().map(Cow::Owned)),
        ),
    ];
    ExportTable { name: "verdicts", rows: checks.len(), columns }
}

/// Returns the errors of a method, a row for each test press that it solved.
pub(crate) fn errors(evaluation: &Evaluation) -> ExportTable {
    let presses = &evaluation.presses;
    let numbers = |of: fn(&palpate_solver::PressError) -> f64| Values::F64(presses.iter().map(of).collect());
    let method = Values::Text(vec![Some(Cow::Owned(evaluation.solver.clone())); presses.len()]);
    let mut columns = vec![
        TableColumn::new("method", "Method that found place and force.", method),
        TableColumn::new("x_mm", "True x, specimen frame, mm.", numbers(|press| press.place_true.x_mm)),
        TableColumn::new("y_mm", "True y, specimen frame, mm.", numbers(|press| press.place_true.y_mm)),
        TableColumn::new("x_solved_mm", "Solved x, mm.", numbers(|press| press.place_solved.x_mm)),
        TableColumn::new("y_solved_mm", "Solved y, mm.", numbers(|press| press.place_solved.y_mm)),
        TableColumn::new(
            "location_error_mm",
            "Distance between true and solved place, mm.",
            numbers(|press| press.location_error_mm),
        ),
        TableColumn::new(
            "force_solved_n",
            "Solved force, N.",
            numbers(|press| if press.depth_solved_mm.is_some() { f64::NAN } else { press.force_solved_n }),
        ),
        TableColumn::new(
            "force_error_n",
            "Absolute difference from the true force, N.",
            numbers(|press| press.force_error_n.unwrap_or(f64::NAN)),
        ),
    ];
    let depths = [
        TableColumn::new(
            "depth_solved_mm",
            "Solved depth, mm.",
            numbers(|press| press.depth_solved_mm.unwrap_or(f64::NAN)),
        ),
        TableColumn::new(
            "depth_error_mm",
            "Absolute difference from the true depth, mm.",
            numbers(|press| press.depth_error_mm.unwrap_or(f64::NAN)),
        ),
    ];
    if presses.iter().any(|press| press.depth_solved_mm.is_some()) {
        columns.extend(depths);
    }
    ExportTable { name: "errors", rows: presses.len(), columns }
}

fn word(verdict: SensorVerdict) -> &'static str {
    match verdict {
        SensorVerdict::Accepted => "accepted",
        SensorVerdict::NotAccepted => "not-accepted",
        SensorVerdict::NotDecided => "not-decided",
    }
}

/// Returns a time with its zone as UTC in microseconds, which other programs read; an unknown form stays as it is.
fn utc(time: &str) -> String {
    time.parse::<jiff::ZonedDateTime>().map_or_else(|_| time.to_owned(), |time| format!("{:.6}", time.timestamp()))
}
