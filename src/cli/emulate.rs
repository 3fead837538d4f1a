//! `palpate emulate`.

use super::output::json_line;
use super::signals::{First, heed};
use super::summary::print;
use crate::api::Failure;
use crate::api::sources::read_rig;
use miette::IntoDiagnostic;
use palpate_core::parallel::lock;
use palpate_link::time::Instant;
use palpate_run::rig::{EmulatedDevice, FarEnd, RigSpec};
use palpate_sim::emulator::Shared;
use palpate_sim::emulator::listen::{self, ListenError, Listening};
use palpate_sim::scene::Scene;
use serde::Serialize;
use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;
use std::process::ExitCode;
use tokio::runtime::Builder;

const EXAMPLES: &str = "\
Examples:
  palpate emulate rigs/sim.toml
  palpate emulate rigs/esp301.toml --json
  palpate emulate rigs/xps.toml --port stage=5001 --port array=1502

Serial devices are pseudo-terminals, network devices are ports of this machine (127.0.0.1); --port puts any device on a port.
All devices of the rig act on one scene. Ctrl-C ends the program.";

/// Serve a rig's emulators in real time, for use by any program
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct EmulateArgs {
    /// The rig
    rig: PathBuf,
    /// Print one JSON object per device: device, protocol, listen
    #[arg(long)]
    json: bool,
    /// Put a device (stage, load_cell, array) on this port, TCP or UDP as it uses; 0 selects a free port
    #[arg(long = "port", value_name = "NAME=PORT", value_parser = port)]
    ports: Vec<(String, u16)>,
    /// Listen at this address, also for other machines: anyone who can reach it can use the emulators
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    listen: IpAddr,
    /// Random seed for the specimen and all noise
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = crate::api::sources::seed, allow_negative_numbers = true)]
    seed: u64,
}

/// One line of `--json`.
#[derive(Serialize)]
struct Offer<'a> {
    device: &'a str,
    protocol: &'a str,
    /// None where there is no socket.
    listen: Option<&'a str>,
}

/// Serves until it is stopped.
pub(super) fn emulate(args: &EmulateArgs) -> Result<ExitCode, Failure> {
    let (_, spec) = read_rig(&args.rig)?;
    let runtime = Builder::new_current_thread().enable_all().build().into_diagnostic().map_err(Failure::usage)?;
    runtime.block_on(serve(args, &spec))
}

async fn serve(args: &EmulateArgs, spec: &RigSpec) -> Result<ExitCode, Failure> {
    let cancel = heed(First::Stop, None)?;
    let origin = Instant::now();
    let simulated = spec.emulators(args.seed).map_err(Failure::usage)?;
    let devices = simulated.devices();
    for (name, _) in &args.ports {
        let Some((device, _)) = devices.iter().find(|(_, role)| role == name) else {
            return Err(Failure::usage(miette::miette!(
                help = "stage, load_cell and array are the devices of a rig",
                "--port {name}=...: there is no device with this name"
            )));
        };
        if device.instrument().is_none() {
            let help = "programs load it as a library; it has no port";
            return Err(Failure::usage(miette::miette!(
                help = help,
                "--port {name}=...: {} has no socket",
                device.protocol
            )));
        }
    }
    let mut listening: Vec<(&EmulatedDevice, Listening)> = Vec::new();
    let mut others = Vec::new();
    for (device, role) in devices {
        let port = args.ports.iter().find(|(name, _)| name == role).map(|(_, port)| *port);
        // two roles of one controller are at one place
        let there = listening.iter().position(|(other, _)| port.is_none() && other.is_same(device));
        let offered = match there {
            Some(_) => None,
            None => offer(device, port, args.listen, &simulated.scene, origin).await,
        };
        if let Some(offered) = offered {
            listening.push((device, offered.into_diagnostic().map_err(Failure::usage)?));
        }
        let at = there.or_else(|| listening.iter().rposition(|(other, _)| std::ptr::eq(*other, device)));
        show(args, role, device.protocol, at.map(|at| listening[at].1.address()))?;
        if there.is_none() {
            for (usual, protocol) in device.ports {
                let Some(instrument) = device.instrument().and_then(|device| lock(device).at_port(*usual)) else {
                    continue;
                };
                // a program that expects the usual first port expects the others, too
                let other = if port.is_some_and(|port| port != 0) { *usual } else { 0 };
                let offered =
                    listen::tcp((args.listen, other).into(), instrument, simulated.scene.clone(), origin, None).await;
                let offered = offered.into_diagnostic().map_err(Failure::usage)?;
                show(args, role, protocol, Some(offered.address()))?;
                others.push(offered);
            }
        }
    }
    cancel.wait().await;
    drop((listening, others));
    Ok(ExitCode::SUCCESS)
}

fn show(args: &EmulateArgs, device: &str, protocol: &str, listen: Option<&str>) -> Result<(), Failure> {
    if args.json {
        return print(&json_line(&Offer { device, protocol, listen })?);
    }
    let listen = listen.unwrap_or("no socket: available only within a simulated run");
    print(&format!("{device:<12}{protocol:<14}{listen}\n"))
}

/// Offers a device at its wired link, or on a port; `None` if there is nothing to offer.
async fn offer(
    device: &EmulatedDevice,
    port: Option<u16>,
    at: IpAddr,
    scene: &Shared<Scene>,
    origin: Instant,
) -> Option<Result<Listening, ListenError>> {
    let (instrument, port) = match (&device.far_end, port) {
        (FarEnd::Library, _) | (FarEnd::Pipe(_), None) => return None,
        (FarEnd::Serial(instrument), None) => {
            return Some(listen::pseudo_terminal(instrument.clone(), scene.clone(), origin, device.line));
        }
        (FarEnd::Serial(instrument) | FarEnd::Pipe(instrument), Some(port)) => (instrument, port),
        (FarEnd::Network(instrument), port) => (instrument, port.unwrap_or(0)),
        (FarEnd::Datagrams(instrument), port) => {
            let at = (at, port.unwrap_or(0)).into();
            return Some(listen::udp(at, instrument.clone(), scene.clone(), origin).await);
        }
    };
    Some(listen::tcp((at, port).into(), instrument.clone(), scene.clone(), origin, device.line).await)
}

fn port(text: &str) -> Result<(String, u16), String> {
    let parts = text.split_once('=').and_then(|(name, port)| Some((name.to_owned(), port.parse().ok()?)));
    parts.ok_or_else(|| "expected NAME=PORT, such as stage=5001".to_owned())
}
