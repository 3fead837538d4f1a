use super::exit::{CANCELLED, Failure, accepted};
use super::progress::Progress;
use super::summary;
use crate::dataset::RunFolder;
use crate::recipe::Plan;
use crate::rig::RigSpec;
use crate::run::{Cancel, Ending, Errand, Halt, keep_pace, walk};
use jiff::Zoned;
use miette::{IntoDiagnostic, WrapErr};
use std::io::Write;
use std::process::ExitCode;
use std::time::Instant;
use tokio::runtime::{Builder, Runtime};

/// How a run is shown and paced.
#[derive(Debug, clap::Args)]
pub struct SessionArgs {
    /// Print one JSON line for each row that is on disk
    #[arg(long)]
    pub json: bool,
    /// Run a simulation at X times real time, not as fast as it goes
    #[arg(long, value_name = "X", value_parser = positive)]
    pub pace: Option<f64>,
}

impl SessionArgs {
    /// Whether they fit a rig; asked before anything is made.
    pub fn check(&self, spec: &RigSpec) -> Result<(), Failure> {
        if self.pace.is_some() && !spec.is_simulated() {
            return Err(Failure::usage(miette::miette!("--pace is for simulated rigs: a real one has its own pace")));
        }
        Ok(())
    }
}

/// Walks a plan from where its folder is to its end, and tells the person how it went.
pub fn carry_out(
    plan: &Plan,
    spec: &RigSpec,
    folder: &mut RunFolder,
    solvers: &[String],
    args: &SessionArgs,
) -> Result<ExitCode, Failure> {
    let virtual_time = spec.is_simulated();
    let began = Instant::now();
    let wall_before_s = folder.manifest.wall_s;
    let runtime = runtime(virtual_time)?;
    let cancel = stop_on_signal(Some("stopping: the stage is brought to rest and parked"))?;
    let mut progress = Progress::new(plan, folder.manifest.presses_done as usize, args.json);
    let ending = runtime.block_on(async {
        if let Some(pace) = args.pace {
            tokio::spawn(keep_pace(pace));
        }
        let shown = progress.gauge();
        walk(Errand { plan, spec, ledger: folder, cancel: &cancel, shown: &*shown }, &mut progress).await
    });
    progress.end();
    let status = ending.status();
    folder.manifest.wall_s = wall_before_s + began.elapsed().as_secs_f64();
    folder.manifest.ended = Some(Zoned::now().to_string());
    folder.manifest.failure = ending.told();
    let finished = folder.finish(status);
    let show = |text: &str| if args.json { summary::tell(text) } else { summary::print(text) };
    let shown = show(&summary::ended(folder, virtual_time));
    match ending {
        Ending { halt: Some(Halt::Cancelled), unparked: None } => {
            finished.map_err(Failure::dataset)?;
            return Ok(ExitCode::from(CANCELLED));
        }
        Ending { halt: None, unparked: None } => finished.map_err(Failure::dataset)?,
        ending => return Err(Failure::ended(ending)),
    }
    shown?; // whatever went wrong with the rig is said first
    let evaluations = summary::evaluations(folder, spec, solvers)?;
    show(&summary::results(folder, &evaluations)?)?;
    Ok(accepted(&evaluations))
}

/// What a rig's drivers run on: virtual time needs no events of the system.
pub fn runtime(virtual_time: bool) -> Result<Runtime, Failure> {
    let mut builder = Builder::new_current_thread();
    builder.enable_time().start_paused(virtual_time);
    if !virtual_time {
        builder.enable_io();
    }
    builder.build().into_diagnostic().map_err(Failure::usage)
}

/// A stop that Ctrl-C asks for, and on Unix a polite end or a closed terminal. The signal is caught on a thread of its own, so
/// that a simulated run needs no I/O driver: asking the system for events between any two instants would be its largest cost.
pub fn stop_on_signal(told: Option<&'static str>) -> Result<Cancel, Failure> {
    let cancel = Cancel::default();
    let asked = cancel.clone();
    let heard = move || {
        if let Some(told) = told {
            let _ = writeln!(std::io::stderr(), "\n{told}");
        }
        asked.ask();
    };
    ctrlc::set_handler(heard).into_diagnostic().wrap_err("can't listen for Ctrl-C").map_err(Failure::usage)?;
    Ok(cancel)
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(pace) if pace.is_finite() && pace > 0.0 => Ok(pace),
        _ => Err("expected a number over 0: 1 is real time, 60 a minute a second".to_owned()),
    }
}
