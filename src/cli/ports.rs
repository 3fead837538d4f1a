//! `palpate ports`.

use super::output::OutputArgs;
use super::summary;
use crate::api::Failure;
use palpate_link::device::shown;
use serde_json::{Value, json};
use serialport::{SerialPortInfo, SerialPortType};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Example:
  palpate ports

In a rig file, write link = \"serial://PORT?baud=RATE\".";

/// List the serial ports of this machine
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct PortsArgs {
    #[command(flatten)]
    output: OutputArgs,
}

/// Lists the ports, one line each.
pub(super) fn ports(args: &PortsArgs) -> Result<ExitCode, Failure> {
    let mut ports = serialport::available_ports()
        .map_err(|error| Failure::usage(miette::miette!("can't list the serial ports of this system: {error}")))?;
    ports.sort_by(|a, b| a.port_name.cmp(&b.port_name));
    if ports.is_empty() {
        summary::tell("no serial ports found\n")?;
    }
    let objects: Vec<Value> =
        ports.iter().map(|port| json!({ "port": port.port_name, "device": device(port) })).collect();
    args.output.print(&ports.iter().map(line).collect::<String>(), &json!({ "ports": objects }))?;
    Ok(ExitCode::SUCCESS)
}

fn line(port: &SerialPortInfo) -> String {
    format!("{:<24}{}\n", port.port_name, device(port)).trim_end().to_owned() + "\n"
}

/// Returns the name of the device at a port.
fn device(port: &SerialPortInfo) -> String {
    let name = match &port.port_type {
        SerialPortType::UsbPort(usb) => {
            let product = usb.product.as_deref().unwrap_or("USB");
            let serial = usb.serial_number.as_deref().map(|serial| format!(", {serial}")).unwrap_or_default();
            format!("{product} ({:04x}:{:04x}{serial})", usb.vid, usb.pid)
        }
        SerialPortType::PciPort => "PCI".to_owned(),
        SerialPortType::BluetoothPort => "Bluetooth".to_owned(),
        SerialPortType::Unknown => String::new(),
    };
    shown(&name)
}
