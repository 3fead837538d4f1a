use super::exit::{CANCELLED, Failure, accepted};
use super::progress::Progress;
use super::summary;
use crate::dataset::RunFolder;
use crate::recipe::Plan;
use crate::rig::RigSpec;
use crate::run::{Cancel, Errand, Halt, keep_pace, walk};
use jiff::Zoned;
use miette::IntoDiagnostic;
use std::io::Write;
use std::process::ExitCode;
use std::time::Instant;
use tokio::runtime::Builder;

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
    let runtime = Builder::new_current_thread().enable_all().start_paused(virtual_time).build();
    let runtime = runtime.into_diagnostic().map_err(Failure::usage)?;
    let mut progress = Progress::new(plan, folder.contacts().len(), args.json);
    let ending = runtime.block_on(async {
        let cancel = Cancel::default();
        let asked = cancel.clone();
        tokio::spawn(async move {
            told_to_stop().await;
            let _ = writeln!(std::io::stderr(), "\nstopping: the stage is brought to rest and parked");
            asked.ask();
        });
        if let Some(pace) = args.pace {
            tokio::spawn(keep_pace(pace));
        }
        let shown = progress.gauge();
        walk(Errand { plan, spec, folder, cancel: &cancel, shown: &*shown }, &mut progress).await
    });
    progress.end();
    let status = ending.status();
    folder.manifest.wall_s = wall_before_s + began.elapsed().as_secs_f64();
    folder.manifest.ended = Some(Zoned::now().to_string());
    folder.manifest.failure = ending.told();
    let finished = folder.finish(status);
    let show = |text: &str| if args.json { summary::tell(text) } else { summary::print(text) };
    let shown = show(&summary::ended(folder, virtual_time));
    if let Some(unparked) = ending.unparked {
        eprintln!("the stage could not be parked: move it clear of the specimen by hand");
        // said even if it is not what the exit code is about
        if ending.halt.is_some() {
            _ = Failure::halted(unparked).report();
        } else {
            return Err(Failure::halted(unparked));
        }
    }
    match ending.halt {
        Some(Halt::Cancelled) => {
            finished.map_err(Failure::dataset)?;
            return Ok(ExitCode::from(CANCELLED));
        }
        Some(halt) => return Err(Failure::halted(halt)),
        None => finished.map_err(Failure::dataset)?,
    }
    shown?; // whatever went wrong with the rig is said first
    let evaluations = summary::evaluations(folder, spec, solvers)?;
    show(&summary::results(folder, spec, &evaluations)?)?;
    Ok(accepted(&evaluations))
}

/// Waits for Ctrl-C, or on Unix for a polite end or a closed terminal.
pub async fn told_to_stop() {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let (Ok(mut interrupt), Ok(mut terminate), Ok(mut hang_up)) =
            (signal(SignalKind::interrupt()), signal(SignalKind::terminate()), signal(SignalKind::hangup()))
        else {
            return std::future::pending().await;
        };
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
            _ = hang_up.recv() => {}
        }
    }
    #[cfg(not(unix))]
    if tokio::signal::ctrl_c().await.is_err() {
        std::future::pending::<()>().await;
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(pace) if pace.is_finite() && pace > 0.0 => Ok(pace),
        _ => Err("expected a number over 0: 1 is real time, 60 a minute a second".to_owned()),
    }
}
