//! Executes a run: shows its progress, sets its pace and stops it.

use super::brief::{Brief, LINES_MOST};
use super::exit::exit_code;
use super::notify::Notifier;
use super::progress::Progress;
use super::signals::{First, heed};
use super::summary::{self, full};
use super::verdict::verdict_code;
use crate::api::provenance::now;
use crate::api::run::executed;
use crate::api::{EvaluateChoice, Failure, FailureKind, OpenedRun};
use palpate_run::batch::{BatchEvent, Ended};
use palpate_run::run::{Ending, Halt, Remaining};
use std::io;
use std::process::ExitCode;

/// Narrowest and widest text at the end of a run, columns.
const WIDTHS: (usize, usize) = (40, 100);

/// How a run is shown and paced.
#[derive(Debug, Default, clap::Args)]
pub(super) struct SessionArgs {
    /// Print one JSON line for each row when it is stored on disk
    #[arg(long)]
    pub json: bool,
    /// Print every figure at the end, also those beyond a screen
    #[arg(long)]
    pub full: bool,
    /// Methods that solve the test presses: the recipe's and the best, or the recipe's alone
    #[arg(long, value_name = "METHODS", value_enum, default_value_t)]
    pub evaluate: EvaluateChoice,
    /// Whether the report follows without a command.
    #[arg(skip)]
    pub is_reported: bool,
}

/// Executes the rest of a plan, and prints the result.
pub(super) fn carry_out(begun: &mut OpenedRun, args: &SessionArgs) -> Result<ExitCode, Failure> {
    let OpenedRun { plan, rig, folder, pace, .. } = begun;
    let cancel = heed(First::Pause, Some("stopping: the stage is stopped and parked"))?;
    let notifier = Notifier::start(&rig.notify);
    let notify = |event: BatchEvent| notifier.iter().for_each(|notifier| notifier.pass(&event));
    let serial = folder.manifest().facts.labels.sensor.clone().unwrap_or_default();
    let paused = || notify(BatchEvent::Paused { at: now(), serial: serial.clone() });
    let done = folder.manifest().presses_done as usize;
    let mut progress = Progress::new(plan, done, args.json, cancel.clone()).pausing(paused).weighing(rig);
    let shown = progress.watched_cell();
    let (ending, finished) = executed(plan, rig, folder, *pace, &cancel, (&*shown, &mut progress))?;
    progress.end();
    summary::warn(folder)?;
    let show = |text: &str| if args.json { summary::tell(text) } else { summary::print(text) };
    let text = match &finished {
        Ok(()) => summary::ended(folder, rig.is_simulated(), args.full),
        Err(error) => summary::unfinished(folder, error),
    };
    let room = LINES_MOST.saturating_sub(text.lines().count() + 1);
    let shown = show(&text);
    let mut ended = Ended {
        at: now(),
        serial: serial.clone(),
        runs: vec![folder.path().display().to_string()],
        status: ending.status(),
        reasons: ending.text().into_iter().collect(),
        minutes: ending.t_s / 60.0,
        ..Ended::default()
    };
    if ending.halt.is_some() || ending.unparked.is_some() {
        notify(BatchEvent::Ended(ended.clone()));
    }
    match ending {
        Ending { halt: Some(Halt::Cancelled), unparked: None, ref remaining, .. }
            if !matches!(remaining, Remaining::Force(_)) =>
        {
            finished.map_err(Failure::unfinished)?;
            return Ok(exit_code(FailureKind::Cancelled));
        }
        Ending { halt: None, unparked: None, .. } => finished.map_err(Failure::unfinished)?,
        ending => return Err(Failure::ended(ending)),
    }
    progress.heard()?;
    shown?; // an error of the rig is reported first
    let results = begun.results(args.evaluate)?;
    if let Some(judgement) = &results.judgement {
        ended = ended.judged(judgement);
    }
    notify(BatchEvent::Ended(ended));
    let width = summary::width(io::stdout()).clamp(WIDTHS.0, WIDTHS.1);
    let text = if args.full { full(&results) } else { Brief::of(&results, width).text(room) };
    let next =
        if args.is_reported { String::new() } else { format!("next: palpate report {}\n", begun.path().display()) };
    show(&(text + &next))?;
    let is_doubtful = begun.folder.manifest().check_failed.is_some();
    Ok(if is_doubtful { exit_code(FailureKind::NotAccepted) } else { verdict_code(results.judgement.as_ref()) })
}
