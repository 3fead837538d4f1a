//! `palpate batch status`.

use super::super::output::OutputArgs;
use super::super::text_table::{TextTable, cells};
use crate::api::{Failure, batch_status};
use palpate_run::batch::{BatchSensor, BatchState, SensorState};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate batch status runs/first-batch
  palpate batch status runs/first-batch --json

A batch can be looked at while it is in use.";

/// Show what became of each sensor of a batch
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct StatusArgs {
    /// The batch folder
    batch: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
}

/// Prints the state that follows from the batch's journal.
pub(super) fn status(args: &StatusArgs) -> Result<ExitCode, Failure> {
    let state = batch_status(&args.batch)?;
    let counts =
        SensorState::ALL.map(|sensor_state| (sensor_state.name().replace(' ', "-"), state.count(sensor_state)));
    let text = StatusJson {
        name: &state.facts.name,
        design: &state.facts.design,
        counts: counts.into_iter().collect(),
        reference: state.reference.as_ref(),
        reference_due: state.is_reference_due(),
        next: state.next().map(|item| item.serial.as_str()),
        refused: state.refused,
        alarms: state.alarms,
        sensors: &state.items,
    };
    args.output.print(&described(&state), &text)?;
    Ok(ExitCode::SUCCESS)
}

/// The state of a batch as JSON.
#[derive(Serialize)]
struct StatusJson<'a> {
    name: &'a str,
    design: &'a str,
    counts: BTreeMap<String, usize>,
    reference: Option<&'a BatchSensor>,
    reference_due: bool,
    next: Option<&'a str>,
    refused: u64,
    alarms: u64,
    sensors: &'a [BatchSensor],
}

/// Returns the state for a person: the numbers, then each sensor that has begun or was skipped.
pub(super) fn described(state: &BatchState) -> String {
    let mut text = format!("batch {}, design {}: {}\n", state.facts.name, state.facts.design, counted(state));
    // writing to a string can't fail
    if let Some(reference) = &state.reference {
        let due = if state.is_reference_due() { ", due now" } else { "" };
        let _ = writeln!(text, "reference sensor {}: begun {} times{due}", reference.serial, reference.times);
    }
    if state.refused + state.alarms > 0 {
        let _ = writeln!(text, "{} refused serial numbers, {} alarms", state.refused, state.alarms);
    }
    let mut table = TextTable::new(3, ["serial", "state", "run", "minutes"]);
    for item in state.items.iter().filter(|item| item.sensor_state != SensorState::Waiting || item.times > 0) {
        let minutes = item.minutes.map(|minutes| format!("{minutes:.1}")).unwrap_or_default();
        table.row(cells![item.serial, item.sensor_state.name(), item.run.as_deref().unwrap_or_default(), minutes]);
        for remark in item.reason.iter().chain(&item.before()).chain(&item.note) {
            table.line(format!("  {remark}"));
        }
    }
    if !table.is_empty() {
        text += &table.to_string();
    }
    if let Some(next) = state.next() {
        let _ = writeln!(text, "next: {}", next.serial);
    }
    text
}

/// Returns the number of sensors of each standing that occurs.
pub(super) fn counted(state: &BatchState) -> String {
    let counts = SensorState::ALL.map(|sensor_state| (state.count(sensor_state), sensor_state.name()));
    let counts: Vec<String> =
        counts.into_iter().filter(|(count, _)| *count > 0).map(|(count, name)| format!("{count} {name}")).collect();
    format!("{} sensors, {}", state.items.len(), counts.join(", "))
}
