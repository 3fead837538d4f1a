use super::exit::Failure;
use super::session::stop_on_signal;
use super::sources::read_rig;
use super::summary::print;
use crate::emulator::listen::{self, ListenError, Listening};
use crate::rig::{FarEnd, RigSpec};
use miette::IntoDiagnostic;
use serde::Serialize;
use std::path::PathBuf;
use std::process::ExitCode;
use tokio::runtime::Builder;
use tokio::time::Instant;

const EXAMPLES: &str = "\
Examples:
  palpate emulate rigs/sim.toml
  palpate emulate rigs/esp301.toml --json

Serial devices are pseudo-terminals, network devices loopback ports. Ends when it is told to stop (Ctrl-C).";

/// Serve a rig's emulators in real time, for any program to talk to
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// The rig
    rig: PathBuf,
    /// Print one JSON object a device: device, protocol, listen
    #[arg(long)]
    json: bool,
    /// What the specimen and all noise are drawn from
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// One line of `--json`.
#[derive(Serialize)]
struct Offer<'a> {
    device: &'a str,
    protocol: &'a str,
    listen: &'a str,
}

/// Serves until it is told to stop.
pub fn emulate(args: &Args) -> Result<ExitCode, Failure> {
    let (_, spec) = read_rig(&args.rig)?;
    let runtime = Builder::new_current_thread().enable_all().build().into_diagnostic().map_err(Failure::usage)?;
    runtime.block_on(serve(args, &spec))
}

async fn serve(args: &Args, spec: &RigSpec) -> Result<ExitCode, Failure> {
    let cancel = stop_on_signal(None)?;
    let origin = Instant::now();
    let simulated = spec.emulators(args.seed).map_err(Failure::usage)?;
    let mut listening = Vec::new();
    for (device, role) in simulated.devices() {
        let EmulatedDevice { instrument, protocol, wiring } = device;
        let offered: Result<Listening, ListenError> = match wiring {
            Wiring::Serial => listen::pseudo_terminal(instrument.clone(), simulated.scene.clone(), origin),
            Wiring::Network => listen::tcp(0, instrument.clone(), simulated.scene.clone(), origin).await,
        };
        let offered = offered.into_diagnostic().map_err(Failure::usage)?;
        let listen = offered.address();
        if args.json {
            let offer = Offer { device: role, protocol, listen };
            let line = serde_json::to_string(&offer).into_diagnostic().map_err(Failure::usage)?;
            print(&format!("{line}\n"))?;
        } else {
            print(&format!("{role:<12}{protocol:<14}{listen}\n"))?;
        }
        listening.push(offered);
    }
    cancel.wait().await;
    drop(listening);
    Ok(ExitCode::SUCCESS)
}
