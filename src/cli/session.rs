//! Executes a run: shows its progress, sets its pace and stops it.

use super::brief::LINES_MOST;
use super::choices::{DurabilityChoice, EvaluateChoice};
use super::exit::{CANCELLED, Failure, NOT_ACCEPTED};
use super::notify::Notifier;
use super::progress::Progress;
use super::provenance::now;
use super::signals::{First, heed};
use super::summary;
use super::verdict::verdict_code;
use super::which_way::ConfirmArgs;
use miette::IntoDiagnostic;
use palpate_data::dataset::{DatasetError, End, RunFolder, Status};
use palpate_data::recipe::{Plan, Recipe};
use palpate_run::batch::{Ended, Event};
use palpate_run::rig::RigSpec;
use palpate_run::run::{Cancel, Ending, Halt, Listener, Walk, keep_pace, walk};
use std::io;
use std::process::ExitCode;
use std::time::Instant;
use tokio::runtime::{Builder, Runtime};

/// Narrowest and widest text at the end of a run, columns.
const WIDTHS: (usize, usize) = (40, 100);

/// How a run is shown and paced.
#[derive(Debug, clap::Args)]
pub(super) struct SessionArgs {
    /// Print one JSON line for each row when it is stored on disk
    #[arg(long)]
    pub json: bool,
    /// Print every figure at the end, not only those that fit on a screen
    #[arg(long)]
    pub full: bool,
    /// Methods that solve the test presses: those of the recipe and the best one, or only those of the recipe
    #[arg(long, value_name = "METHODS", value_enum, default_value_t)]
    pub evaluate: EvaluateChoice,
    #[command(flatten)]
    pub manner: MannerArgs,
    /// Whether the report follows without a command.
    #[arg(skip)]
    pub is_reported: bool,
}

/// How a rig is driven and its data are kept.
#[derive(Debug, clap::Args)]
pub(super) struct MannerArgs {
    /// Run a simulation at X times real time instead of as fast as possible
    #[arg(long, value_name = "X", value_parser = positive)]
    pub pace: Option<f64>,
    /// Acknowledged presses survive a power failure (full), or only the end of the program (fast)
    #[arg(long, value_name = "NAME", value_enum, default_value_t)]
    pub durability: DurabilityChoice,
    #[command(flatten)]
    pub confirm: ConfirmArgs,
}

impl MannerArgs {
    /// Whether they fit a rig; asked before anything is made.
    pub(super) fn check(&self, spec: &RigSpec) -> Result<(), Failure> {
        if self.pace.is_some() && !spec.is_simulated() {
            return Err(Failure::usage(miette::miette!("--pace is only for simulated rigs")));
        }
        MannerArgs::check_gain(spec)
    }

    /// Whether a rig's load cell is to be trusted.
    pub(super) fn check_gain(spec: &RigSpec) -> Result<(), Failure> {
        spec.load_cell.check_gain().map_err(|trip| Failure::halted(trip.into()))
    }
}

/// Executes the rest of a plan, and prints the result.
pub(super) fn carry_out(
    plan: &Plan,
    spec: &RigSpec,
    folder: &mut RunFolder,
    recipe: &Recipe,
    args: &SessionArgs,
) -> Result<ExitCode, Failure> {
    let virtual_time = spec.is_simulated();
    let spec = &args.manner.confirm.of(spec.clone());
    let cancel = heed(First::Pause, Some("stopping: the stage is stopped and parked"))?;
    let notifier = Notifier::start(&spec.notify);
    let notify = |event: Event| notifier.iter().for_each(|notifier| notifier.pass(&event));
    let serial = folder.manifest().facts.labels.sensor.clone().unwrap_or_default();
    let paused = || notify(Event::Paused { at: now(), serial: serial.clone() });
    let done = folder.manifest().presses_done as usize;
    let mut progress = Progress::new(plan, done, args.json, cancel.clone()).pausing(paused).weighing(spec);
    let shown = progress.gauge();
    let (ending, finished) = walked(plan, spec, folder, args.manner.pace, &cancel, (&*shown, &mut progress))?;
    progress.end();
    summary::warn(folder)?;
    let show = |text: &str| if args.json { summary::tell(text) } else { summary::print(text) };
    let text = match &finished {
        Ok(()) => summary::ended(folder, virtual_time, args.full),
        Err(error) => summary::unfinished(folder, error),
    };
    let room = LINES_MOST.saturating_sub(text.lines().count() + 1);
    let shown = show(&text);
    let mut ended = Ended {
        at: now(),
        serial: serial.clone(),
        runs: vec![folder.path().display().to_string()],
        status: ending.status(),
        reasons: ending.told().into_iter().collect(),
        minutes: ending.t_s / 60.0,
        ..Ended::default()
    };
    if ending.halt.is_some() || ending.unparked.is_some() {
        notify(Event::Ended(ended.clone()));
    }
    match ending {
        Ending { halt: Some(Halt::Cancelled), unparked: None, .. } => {
            finished.map_err(Failure::unfinished)?;
            return Ok(ExitCode::from(CANCELLED));
        }
        Ending { halt: None, unparked: None, .. } => finished.map_err(Failure::unfinished)?,
        ending => return Err(Failure::ended(ending)),
    }
    progress.heard()?;
    shown?; // an error of the rig is reported first
    let results = summary::results(folder, spec, recipe, args.evaluate == EvaluateChoice::Best)?;
    if let Some(judgement) = &results.judgement {
        ended = ended.judged(judgement);
    }
    notify(Event::Ended(ended));
    let width = summary::width(io::stdout()).clamp(WIDTHS.0, WIDTHS.1);
    let text = if args.full { results.text() } else { results.brief(room, width) };
    let next =
        if args.is_reported { String::new() } else { format!("next: palpate report {}\n", folder.path().display()) };
    show(&(text + &next))?;
    let is_doubtful = folder.manifest().check_failed.is_some();
    Ok(if is_doubtful { ExitCode::from(NOT_ACCEPTED) } else { verdict_code(results.judgement.as_ref()) })
}

/// Walks a plan from where its folder is, and ends the folder's session. Returns how the walk ended, and whether that was recorded.
/// `heard` is called for every force, N, and for every event.
pub(super) fn walked(
    plan: &Plan,
    spec: &RigSpec,
    folder: &mut RunFolder,
    pace: Option<f64>,
    cancel: &Cancel,
    heard: (&dyn Fn(f64), &mut dyn Listener),
) -> Result<(Ending, Result<(), DatasetError>), Failure> {
    let began = Instant::now();
    let ending = runtime(spec.is_simulated())?.block_on(async {
        if let Some(pace) = pace {
            tokio::spawn(keep_pace(pace));
        }
        let (shown, listener) = heard;
        walk(Walk { plan, spec, ledger: folder, cancel, shown }, listener).await
    });
    let cell_unchecked = spec.load_cell.check.is_some() && ending.cell.is_none() && ending.status() == Status::Complete;
    let finished = folder.finish(End { cell_unchecked, ..ending.end(now(), began.elapsed().as_secs_f64()) });
    Ok((ending, finished))
}

/// Number of task polls between two checks of the timers while other tasks are ready. On a paused clock no timer becomes due
/// during this time.
const EVENT_INTERVAL: u32 = 1024;

/// Returns the runtime of a rig's drivers. Virtual time needs no events of the system.
pub(super) fn runtime(virtual_time: bool) -> Result<Runtime, Failure> {
    let mut builder = Builder::new_current_thread();
    builder.enable_time().start_paused(virtual_time).event_interval(EVENT_INTERVAL);
    if !virtual_time {
        builder.enable_io();
    }
    builder.build().into_diagnostic().map_err(Failure::usage)
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(pace) if pace.is_finite() && pace > 0.0 => Ok(pace),
        _ => Err("expected a number above 0: 1 is real time, 60 is one minute per second".to_owned()),
    }
}
