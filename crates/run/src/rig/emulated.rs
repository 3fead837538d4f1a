//! One emulated device, and its type of connection.

use palpate_link::wire::{Link, SerialLine};
use palpate_sim::emulator::{Instrument, Shared};
use std::sync::{Arc, Mutex};

/// One emulated device.
#[derive(Clone)]
pub struct EmulatedDevice {
    /// Device at the far end of its link.
    pub far_end: FarEnd,
    /// Protocol of the device, such as `esp301`, `modbus-rtu` or `daqmx`.
    pub protocol: &'static str,
    /// Its other TCP ports, and the protocol of each.
    pub ports: &'static [(u16, &'static str)],
    /// Serial line on which it is, if the rig names its rate.
    pub line: Option<SerialLine>,
}

/// Device at the far end of a link, and its type of connection.
#[derive(Clone)]
pub enum FarEnd {
    /// An instrument on a serial line.
    Serial(Shared<dyn Instrument>),
    /// An instrument on a network.
    Network(Shared<dyn Instrument>),
    /// An instrument that sends datagrams.
    Datagrams(Shared<dyn Instrument>),
    /// A program, on its standard input and output.
    Pipe(Shared<dyn Instrument>),
    /// NI's library: a table of functions, not a stream of bytes.
    Library,
}

impl EmulatedDevice {
    /// Returns the emulator of an instrument on a serial line.
    pub(super) fn serial<I: Instrument + 'static>(instrument: I, protocol: &'static str) -> Self {
        EmulatedDevice { far_end: FarEnd::Serial(Arc::new(Mutex::new(instrument))), protocol, ports: &[], line: None }
    }

    /// Returns the emulator of an instrument on a network.
    pub(super) fn network<I: Instrument + 'static>(instrument: I, protocol: &'static str) -> Self {
        EmulatedDevice { far_end: FarEnd::Network(Arc::new(Mutex::new(instrument))), protocol, ports: &[], line: None }
    }

    /// Puts the device on the serial line of a link.
    pub(super) fn on(self, link: &Link) -> Self {
        EmulatedDevice { line: link.serial_line(), ..self }
    }

    /// Adds TCP ports, and the protocol of each.
    pub(super) fn at_ports(self, ports: &'static [(u16, &'static str)]) -> Self {
        EmulatedDevice { ports, ..self }
    }

    /// Returns the emulator of an instrument that sends datagrams.
    pub(super) fn datagrams<I: Instrument + 'static>(instrument: I, protocol: &'static str) -> Self {
        EmulatedDevice {
            far_end: FarEnd::Datagrams(Arc::new(Mutex::new(instrument))),
            protocol,
            ports: &[],
            line: None,
        }
    }

    /// Returns the emulator of a program.
    pub(super) fn pipe<I: Instrument + 'static>(instrument: I, protocol: &'static str) -> Self {
        EmulatedDevice { far_end: FarEnd::Pipe(Arc::new(Mutex::new(instrument))), protocol, ports: &[], line: None }
    }

    /// Returns the instrument at the far end; `None` for a library.
    pub fn instrument(&self) -> Option<&Shared<dyn Instrument>> {
        match &self.far_end {
            FarEnd::Serial(instrument)
            | FarEnd::Network(instrument)
            | FarEnd::Datagrams(instrument)
            | FarEnd::Pipe(instrument) => Some(instrument),
            FarEnd::Library => None,
        }
    }

    /// Whether two devices are the same instrument in different roles.
    pub fn is_same(&self, other: &EmulatedDevice) -> bool {
        self.instrument().zip(other.instrument()).is_some_and(|(own, others)| Arc::ptr_eq(own, others))
    }

    /// Replaces the instrument by another.
    pub fn replace(&mut self, other: Shared<dyn Instrument>) {
        match &mut self.far_end {
            FarEnd::Serial(instrument)
            | FarEnd::Network(instrument)
            | FarEnd::Datagrams(instrument)
            | FarEnd::Pipe(instrument) => *instrument = other,
            FarEnd::Library => {}
        }
    }
}
