//! `palpate batch add`, `retry`, `skip` and `note`: what a person decides about sensors, recorded in the batch's journal.

use super::super::summary::print;
use crate::api::Failure;
use crate::api::labels::label;
use crate::api::provenance::now;
use palpate_run::batch::{BatchEvent, BatchFolder, check_serial};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const ADD_EXAMPLE: &str = "\
Example:
  palpate batch add runs/first-batch A-06 A-07";

/// Add sensors to a batch
#[derive(Debug, clap::Args)]
#[command(after_help = ADD_EXAMPLE)]
pub(super) struct AddArgs {
    /// The batch folder
    batch: PathBuf,
    /// Serial numbers
    #[arg(required = true)]
    serials: Vec<String>,
}

const RETRY_EXAMPLE: &str = "\
Example:
  palpate batch retry runs/first-batch A-02

The sensor waits again. Its next run gets a folder of its own, A-02-2; the
previous run stays as it is.";

/// Allow a sensor to be calibrated again: interrupted, failed, judged or skipped
#[derive(Debug, clap::Args)]
#[command(after_help = RETRY_EXAMPLE)]
pub(super) struct RetryArgs {
    /// The batch folder
    batch: PathBuf,
    /// Serial number
    serial: String,
}

const SKIP_EXAMPLE: &str = "\
Example:
  palpate batch skip runs/first-batch A-04";

/// Skip a sensor
#[derive(Debug, clap::Args)]
#[command(after_help = SKIP_EXAMPLE)]
pub(super) struct SkipArgs {
    /// The batch folder
    batch: PathBuf,
    /// Serial number
    serial: String,
}

const NOTE_EXAMPLE: &str = "\
Example:
  palpate batch note runs/first-batch A-04 'scratch on the cover'";

/// Add a note about a sensor
#[derive(Debug, clap::Args)]
#[command(after_help = NOTE_EXAMPLE)]
pub(super) struct NoteArgs {
    /// The batch folder
    batch: PathBuf,
    /// Serial number
    serial: String,
    /// The note
    #[arg(value_parser = label)]
    note: String,
}

/// Adds sensors, all or none.
pub(super) fn add(args: &AddArgs) -> Result<ExitCode, Failure> {
    let mut folder = BatchFolder::open(&args.batch).map_err(Failure::batch)?;
    for (index, serial) in args.serials.iter().enumerate() {
        let same = |other: &str| other.eq_ignore_ascii_case(serial);
        let is_there = folder.state().items.iter().any(|item| same(&item.serial));
        let is_reference = folder.state().reference.as_ref().is_some_and(|item| same(&item.serial));
        let problem = match check_serial(serial) {
            Err(problem) => Some(problem),
            Ok(()) if is_there || is_reference => Some("is in the batch already".to_owned()),
            Ok(()) if args.serials[..index].iter().any(|other| same(other)) => Some("is here twice".to_owned()),
            Ok(()) => None,
        };
        if let Some(problem) = problem {
            let help = "no sensor was added";
            return Err(Failure::usage(miette::miette!(help = help, "{serial:?}: {problem}")));
        }
    }
    folder.record(&BatchEvent::Added { at: now(), serials: args.serials.clone() }).map_err(Failure::batch)?;
    print(&format!("{} sensors added\n", args.serials.len()))?;
    Ok(ExitCode::SUCCESS)
}

/// Allows a sensor again.
pub(super) fn retry(args: &RetryArgs) -> Result<ExitCode, Failure> {
    let event = BatchEvent::Retry { at: now(), serial: args.serial.clone() };
    mark(&args.batch, &args.serial, &event, "may be calibrated again")
}

/// Skips a sensor.
pub(super) fn skip(args: &SkipArgs) -> Result<ExitCode, Failure> {
    mark(&args.batch, &args.serial, &BatchEvent::Skipped { at: now(), serial: args.serial.clone() }, "is skipped")
}

/// Adds a note.
pub(super) fn note(args: &NoteArgs) -> Result<ExitCode, Failure> {
    let event = BatchEvent::Noted { at: now(), serial: args.serial.clone(), note: args.note.clone() };
    mark(&args.batch, &args.serial, &event, "has this note")
}

fn mark(batch: &Path, serial: &str, event: &BatchEvent, done: &str) -> Result<ExitCode, Failure> {
    let mut folder = BatchFolder::open(batch).map_err(Failure::batch)?;
    if folder.state().item(serial).is_none() {
        let help = "`palpate batch status` shows the sensors; `palpate batch add` adds one";
        return Err(Failure::usage(miette::miette!(help = help, "{} has no sensor {serial:?}", batch.display())));
    }
    folder.record(event).map_err(Failure::batch)?;
    print(&format!("{serial} {done}\n"))?;
    Ok(ExitCode::SUCCESS)
}
