//! The verdict for a person, and its exit code.

use super::exit::exit_code;
use super::tables::filled;
use super::text_table::{TextTable, cells};
use crate::api::FailureKind;
use palpate_data::acceptance::{Decision, Judgement, LimitCheck, SensorVerdict};
use std::process::ExitCode;

/// Message if there is no rule.
pub(super) const NO_RULE: &str = "no verdict: no acceptance rule ([accept] of the recipe, or --accept FILE)\n";

/// The exit code of a verdict: 0 accepted, or none asked for; 1 not accepted or not decided.
pub(super) fn verdict_code(judgement: Option<&Judgement>) -> ExitCode {
    match judgement.map(|judgement| judgement.verdict) {
        None | Some(SensorVerdict::Accepted) => ExitCode::SUCCESS,
        Some(SensorVerdict::NotAccepted | SensorVerdict::NotDecided) => exit_code(FailureKind::NotAccepted),
    }
}

/// The verdict, and what it depends on.
pub(super) fn head(judgement: &Judgement) -> String {
    let afterwards = judgement.judged_afterwards_by.as_ref().map(|file| format!(", judged afterwards by {file}"));
    format!(
        "{}: {} rule, method {}, {} calibration and {} test presses{}",
        judgement.verdict.text().to_uppercase(),
        judgement.rule,
        judgement.method,
        judgement.calibration_presses,
        judgement.test_presses,
        afterwards.unwrap_or_default()
    )
}

/// The verdict with each limit, in at most 80 columns.
pub(super) fn verdict_table(judgement: &Judgement) -> String {
    let is_guarded = judgement.rule == Decision::Guarded.word();
    let mut text = filled(&head(judgement), "  ");
    let row = |name: String, [found, bound, limit]: [String; 3], n: String| {
        let bound = is_guarded.then_some(bound);
        [name, found].into_iter().chain(bound).chain([limit, n])
    };
    let mut table = TextTable::new(1, row(String::new(), cells!["found", "95 % bound", "limit"], "n".to_owned()));
    for check in &judgement.checks {
        let values = [check.value, check.bound, Some(check.limit)].map(|value| check.shown(value));
        table.row(row(named(check), values, check.n.to_string()));
    }
    text += &table.to_string();
    for note in &judgement.notes {
        text += &filled(&format!("  {note}"), "    ");
    }
    for reason in judgement.all_reasons() {
        text += &filled(&format!("  {reason}"), "    ");
    }
    text
}

/// Returns a figure's name with its unit.
fn named(check: &LimitCheck) -> String {
    let name = check.kind.full_name(check.reach);
    match check.kind.unit() {
        "" => name,
        unit => format!("{name}, {unit}"),
    }
}
