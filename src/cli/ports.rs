//! `palpate ports`.

use super::exit::Failure;
use super::summary::{self, print};
use palpate_link::device::shown;
use serialport::{SerialPortInfo, SerialPortType};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Example:
  palpate ports

In a rig file, write link = \"serial://PORT?baud=RATE\".";

/// List the serial ports of this machine
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct PortsArgs {}

/// Lists the ports, one line each.
pub(super) fn ports(_: &PortsArgs) -> Result<ExitCode, Failure> {
    let mut ports = serialport::available_ports()
        .map_err(|error| Failure::usage(miette::miette!("can't list the serial ports of this system: {error}")))?;
    ports.sort_by(|a, b| a.port_name.cmp(&b.port_name));
    if ports.is_empty() {
        summary::tell("no serial ports found\n")?;
    }
    print(&ports.iter().map(line).collect::<String>())?;
    Ok(ExitCode::SUCCESS)
}

fn line(port: &SerialPortInfo) -> String {
    let what = match &port.port_type {
        SerialPortType::UsbPort(usb) => {
            let name = usb.product.as_deref().unwrap_or("USB");
            let serial = usb.serial_number.as_deref().map(|serial| format!(", {serial}")).unwrap_or_default();
            format!("{name} ({:04x}:{:04x}{serial})", usb.vid, usb.pid)
        }
        SerialPortType::PciPort => "PCI".to_owned(),
        SerialPortType::BluetoothPort => "Bluetooth".to_owned(),
        SerialPortType::Unknown => String::new(),
    };
    format!("{:<24}{}\n", port.port_name, shown(&what)).trim_end().to_owned() + "\n"
}
